//! Frames in memory: whoever renders has buffers, and no files.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::ControlFlow;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::code::Run;
use super::view::{View, ViewError, ViewMut};
use super::{Applied, DenoiseError, Denoiser, Progress};
use crate::expr::{Feature, Quantity};
use crate::image::listing;
use crate::scene::{LoadOptions, Needs, Note, RawScene};

/// The most pixels that a frame in memory may have: 65536 x 65536.
const MOST_PIXELS: usize = 1 << 32;

/// A frame in somebody's memory, picture by picture. Made by [`Denoiser::frame`].
#[must_use = "`run` filters it"]
pub struct Buffers<'d, 'v> {
    denoiser: &'d Denoiser,
    size: (usize, usize),
    planes: BTreeMap<(Feature, Quantity), View<'v>>,
    alpha: Option<View<'v>>,
    samples: Option<u32>,
    decode: Option<fn(f32) -> f32>,
    progress: Option<&'v Progress<'v>>,
}

/// What there is to say of a frame that was filtered in memory.
#[derive(Clone, Debug)]
pub struct Report {
    /// By stage of the filter how many pixels kept what was to be averaged, and how long
    /// planning, compilation and filtering took. Code that was there already took no time.
    pub applied: Applied,
    /// What was done to the frame before: pixels that were repaired, variances that were
    /// estimated.
    pub notes: Vec<Note>,
    /// How long it took to read the buffers and to prepare them.
    pub preparing: Duration,
    /// What ran the filter.
    pub backend: &'static str,
}

/// A frame that was filtered in memory.
pub struct Pixels {
    size: (usize, usize),
    pixels: Vec<[f32; 3]>,
    /// What there is to say of it.
    pub report: Report,
}

impl<'d, 'v> Buffers<'d, 'v> {
    pub(super) fn new(denoiser: &'d Denoiser, width: usize, height: usize) -> Self {
        let samples = denoiser.options.load.samples;
        let size = (width, height);
        let (planes, alpha, decode, progress) = (BTreeMap::new(), None, None, None);
        Self { denoiser, size, planes, alpha, samples, decode, progress }
    }

    /// The noisy colour, linear: three components.
    pub fn color(self, view: impl Into<View<'v>>) -> Self {
        self.feature(Feature::Color, Quantity::Value, view)
    }

    /// The albedo of what is seen, from 0 to 1: three components.
    pub fn albedo(self, view: impl Into<View<'v>>) -> Self {
        self.feature(Feature::Texture, Quantity::Value, view)
    }

    /// Shading normals of length 1, in the world or in the camera: three components.
    pub fn normal(self, view: impl Into<View<'v>>) -> Self {
        self.feature(Feature::Normal, Quantity::Value, view)
    }

    /// The distance from the camera, in any unit: one component.
    pub fn depth(self, view: impl Into<View<'v>>) -> Self {
        self.feature(Feature::Depth, Quantity::Value, view)
    }

    /// Any feature, in the renderer's units, with as many components as it has; or the variance
    /// of the pixel's mean: three components of the colour's, one of others'.
    pub fn feature(
        mut self,
        feature: Feature,
        quantity: Quantity,
        view: impl Into<View<'v>>,
    ) -> Self {
        self.planes.insert((feature, quantity), view.into());
        self
    }

    /// How much of each pixel is covered: one component. Where that and the colour are zero, the
    /// result is.
    pub fn alpha(mut self, view: impl Into<View<'v>>) -> Self {
        self.alpha = Some(view.into());
        self
    }

    /// How many samples each pixel is the mean of.
    pub fn samples(mut self, samples: u32) -> Self {
        self.samples = Some(samples);
        self
    }

    /// What makes the colour linear, sample by sample, where its buffer holds encoded samples
    /// (sRGB, for example). The result is linear; [`Pixels::map`] encodes it.
    pub fn decoded(mut self, decode: fn(f32) -> f32) -> Self {
        self.decode = Some(decode);
        self
    }

    /// Who is told, from any thread, how many rows are done and of how many, and says whether to
    /// go on. [`DenoiseError::is_stop`] tells errors that come of that.
    pub fn progress(mut self, progress: &'v Progress<'v>) -> Self {
        self.progress = Some(progress);
        self
    }

    /// Filters the frame into `out`: three components.
    ///
    /// # Errors
    /// If a buffer does not have the frame's size, the frame lacks what the filter needs, the
    /// back end fails, or somebody stopped it. `out` is then as it was.
    pub fn run<'o>(self, out: impl Into<ViewMut<'o>>) -> Result<Report, DenoiseError> {
        let mut out = out.into();
        self.sized()?;
        out.check(self.size).map_err(|source| named("the result", source))?;
        let pixels = self.filter()?;
        pixels.write(&mut out)?;
        Ok(pixels.report)
    }

    /// Filters the frame, and keeps the result: the buffers may be written to afterwards.
    ///
    /// # Errors
    /// Those of [`run`](Self::run).
    pub fn filter(self) -> Result<Pixels, DenoiseError> {
        self.sized()?;
        let denoiser = self.denoiser;
        denoiser.within(|| self.filter_here())
    }

    fn filter_here(self) -> Result<Pixels, DenoiseError> {
        let (denoiser, size, progress) = (self.denoiser, self.size, self.progress);
        let started = Instant::now();
        let checked = denoiser.filter.check().expect("it was checked when it was built");
        let (needs, load) = (checked.needs(), self.load());
        let scene = self.read(&needs)?.prepare(&needs, checked.reach(), &load)?;
        let preparing = started.elapsed();
        let (done, height) = (AtomicUsize::new(0), size.1);
        let watch = |rows: usize| match progress {
            None => ControlFlow::Continue(()),
            // A back end that takes over begins anew.
            Some(told) => told(height.min(done.fetch_add(rows, Relaxed) + rows), height),
        };
        let run = Run { strength: denoiser.strength(), watch: &watch };
        let (filtered, applied) = denoiser.filtered(&scene, run)?;
        let notes = scene.notes().to_vec();
        let backend = denoiser.backend.name();
        let report = Report { applied, notes, preparing, backend };
        Ok(Pixels { size, pixels: filtered.pixels, report })
    }

    fn load(&self) -> LoadOptions {
        LoadOptions { samples: self.samples, ..self.denoiser.options.load }
    }

    /// What is read of the buffers, and nothing else of them, as a scene.
    fn read(&self, needs: &Needs) -> Result<RawScene, DenoiseError> {
        let (width, height) = self.size;
        let has = |feature, quantity| self.planes.contains_key(&(feature, quantity));
        let wanted = needs.raw(&has, self.denoiser.options.load.color_scale);
        let read = self.planes.par_iter().map(|(&(feature, quantity), view)| {
            let components = feature.stored_width(quantity);
            if components == 0 {
                return Err(DenoiseError::NoBuffer { name: name(feature, quantity) });
            }
            let planes = match wanted.contains(&(feature, quantity)) {
                true => view.read(self.size, components).map(Some),
                // A wrong size is a mistake, even if nothing is read of it.
                false => view.check(self.size, components).map(|()| None),
            };
            let planes = planes.map_err(|source| named(&name(feature, quantity), source))?;
            Ok(planes.map(|planes| ((feature, quantity), planes)))
        });
        // The first error in the features' order, whichever was found first.
        let read: Vec<Result<_, DenoiseError>> = read.collect();
        let read: Vec<Option<_>> = read.into_iter().collect::<Result<_, _>>()?;
        let mut read: BTreeMap<(Feature, Quantity), Vec<Vec<f32>>> =
            read.into_iter().flatten().collect();
        let Some(color) = read.remove(&(Feature::Color, Quantity::Value)) else {
            return Err(DenoiseError::NoColor);
        };
        let mut color: [Vec<f32>; 3] = color.try_into().expect("colours have three components");
        if let Some(decode) = self.decode {
            color.iter_mut().flatten().for_each(|sample| *sample = decode(*sample));
        }
        let mut raw = RawScene::new("the frame", width, height, color);
        raw.features.extend(read);
        raw.samples = self.samples;
        if let Some(alpha) = &self.alpha {
            let alpha = alpha.read(self.size, 1).map_err(|source| named("alpha", source))?;
            raw.alpha = alpha.into_iter().next();
        }
        Ok(raw)
    }

    fn sized(&self) -> Result<(), DenoiseError> {
        let (width, height) = self.size;
        match width.checked_mul(height) {
            Some(1..=MOST_PIXELS) => Ok(()),
            Some(_) | None => Err(DenoiseError::Size { width, height }),
        }
    }
}

impl fmt::Debug for Buffers<'_, '_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Buffers").field("size", &self.size).field("planes", &self.planes).finish()
    }
}

impl Pixels {
    /// Linear R, G, B, row by row.
    pub fn colors(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// The same frame with each colour replaced by what this makes of it: encoded or bounded,
    /// for example.
    pub fn map(mut self, change: impl Fn([f32; 3]) -> [f32; 3]) -> Self {
        self.pixels.iter_mut().for_each(|pixel| *pixel = change(*pixel));
        self
    }

    /// Writes them into somebody's memory.
    ///
    /// # Errors
    /// If that is no image of the frame's size.
    pub fn write(&self, out: &mut ViewMut<'_>) -> Result<(), DenoiseError> {
        out.write(self.size, &self.pixels).map_err(|source| named("the result", source))
    }
}

impl fmt::Debug for Pixels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pixels").field("size", &self.size).field("report", &self.report).finish()
    }
}

/// What people call a buffer.
fn name(feature: Feature, quantity: Quantity) -> String {
    match quantity {
        Quantity::Value => feature.term().to_owned(),
        Quantity::Gradient => format!("the gradient of {}", feature.term()),
        Quantity::Variance => format!("the variance of {}", feature.term()),
    }
}

fn named(image: &str, source: ViewError) -> DenoiseError {
    DenoiseError::View { image: image.to_owned(), source: Box::new(source) }
}

/// What frames in memory can be fed, as people call it.
pub(super) fn buffers() -> String {
    let stored = Feature::ALL.into_iter().filter(|feature| feature.is_stored());
    let names: Vec<&str> = stored.map(Feature::term).collect();
    listing(names.into_iter())
}
