//! Floor 6: filters applied to images, as `tamis denoise` does.
//!
//! A [`Denoiser`] filters files, and frames in memory, with what was asked for or with `tamis`:
//!
//! ```
//! use tamis::denoise::Denoiser;
//!
//! let (width, height) = (64, 48);
//! let noise = |k: usize| if (k + k / width) % 2 == 0 { 0.6 } else { 0.4 };
//! let color: Vec<f32> = (0..3 * width * height).map(|k| noise(k / 3)).collect();
//! let mut clean = vec![0.0f32; color.len()];
//!
//! let denoiser = Denoiser::builder().build()?;
//! let report = denoiser.frame(width, height).color(&color).run(&mut clean)?;
//! assert!(clean.iter().all(|x| (x - 0.5).abs() < 0.05));
//! println!("{} took {:?}", report.backend, report.applied.filtering);
//! # Ok::<(), tamis::denoise::DenoiseError>(())
//! ```
//!
//! Renderers have more than a colour, in buffers of many shapes ([`View`]), and want to be told
//! how far it is:
//!
//! ```
//! use std::ops::ControlFlow;
//!
//! use half::f16;
//! use tamis::backend::Choice;
//! use tamis::denoise::{Denoiser, View, ViewMut};
//! use tamis::expr::{Feature, Quantity};
//! use tamis::filter::Filter;
//!
//! let (width, height) = (64, 48);
//! let pixels = width * height;
//! let mut rgba = vec![0.5f32; 4 * pixels];        // filtered in place; the alpha stays
//! let albedo = vec![f16::from_f32(0.8); 3 * pixels]; // all of R, then of G, then of B
//! let normal = [0.0f32, 0.0, 1.0].repeat(pixels);
//! let variance = vec![0.01f32; 3 * pixels];
//!
//! let fast = Filter::named("tamis-fast").expect("it ships");
//! let denoiser = Denoiser::builder().filter(fast).backend(Choice::Auto).build()?;
//! let filtered = denoiser
//!     .frame(width, height)
//!     .color(View::interleaved(&rgba, 4))
//!     .albedo(View::planar(&albedo))
//!     .normal(&normal)
//!     .feature(Feature::Color, Quantity::Variance, &variance)
//!     .samples(16)
//!     .progress(&|done, of| if done < of { ControlFlow::Continue(()) } else { ControlFlow::Break(()) })
//!     .filter();
//! assert!(filtered.is_err_and(|error| error.is_stop()), "the last row was not wanted");
//!
//! let filtered = denoiser.frame(width, height).color(View::interleaved(&rgba, 4)).filter()?;
//! filtered.write(&mut ViewMut::interleaved(&mut rgba, 4))?;
//! # Ok::<(), tamis::denoise::DenoiseError>(())
//! ```
//!
//! Files keep whatever is in them beside the colour:
//!
//! ```no_run
//! use tamis::denoise::Denoiser;
//!
//! let denoised = Denoiser::builder().build()?.denoise("noisy.exr".as_ref())?;
//! denoised.save("clean.exr".as_ref())?;
//! # Ok::<(), tamis::denoise::DenoiseError>(())
//! ```
//!
//! Files that do not fit in memory are [spilled](crate::scene::SpilledScene) and filtered
//! part by part, to the same bits. [`Code`] is a filter that is ready to run on scenes that were
//! prepared already.

mod buffers;
mod builder;
mod code;
mod error;
mod feeds;
mod parts;
mod view;
mod whole;

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use glob::Pattern;
use rayon::ThreadPool;

use crate::backend::{Backend, Filtered, Rect, Watch};
use crate::expr::Feature;
use crate::filter::{Carrying, Filter, shipped};
use crate::image::Image;
use crate::plan::{Passes, Precision};
use crate::scene::listing::Aux;
use crate::scene::mapping::Selection;
use crate::scene::{Facts, LayerChannels, LoadOptions, Note, Scene, SpilledScene, Target, Weight};

pub use buffers::{Buffers, Pixels, Report};
pub use builder::Builder;
pub use code::{Applied, Code, Run, apply};
pub use error::DenoiseError;
pub use feeds::Feeds;
pub use view::{Sample, SampleType, Strides, View, ViewError, ViewMut};
pub use whole::ATTRIBUTE;

/// How images are denoised.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// With what; with the best shipped filter if nothing is said.
    pub filter: Option<Filter>,
    /// How plans are made.
    pub passes: Passes,
    /// How scenes are loaded.
    pub load: LoadOptions,
    /// Which pictures of a frame, and what channels are.
    pub selection: Selection,
    /// Layers beside the colour, by their names, that are filtered by the same weights.
    pub layers: Vec<Pattern>,
    /// Whether the alpha is filtered by the same weights, rather than kept.
    pub filters_alpha: bool,
    /// How much of the result is taken, between 0 and 1, and how little of the noisy colour;
    /// if nothing is said, all.
    pub strength: Option<f32>,
    /// Memory for a frame, in bytes; if nothing is said, as much as it takes.
    pub max_memory: Option<u64>,
}

/// Who is told how many rows are done, and of how many, and says whether to go on.
pub type Progress<'p> = dyn Fn(usize, usize) -> ControlFlow<()> + Sync + 'p;

/// Denoises images: files, and frames in memory. Several threads may use one at a time.
pub struct Denoiser {
    backend: Arc<dyn Backend>,
    filter: Filter,
    options: Options,
    /// Threads of its own.
    threads: Option<ThreadPool>,
    /// The filter as code for the latest image, and for others of which the same is known.
    ready: Mutex<Option<(Facts, Arc<Code>)>>,
}

/// A frame that was read.
pub struct Frame {
    pictures: Vec<Loaded>,
}

/// A picture that was read.
struct Loaded {
    target: Target,
    scene: Prepared,
}

enum Prepared {
    InMemory(Box<Scene>),
    Spilled(Box<SpilledScene>),
}

/// A frame that was filtered.
#[derive(Debug)]
pub struct Denoised {
    /// Its pictures, the best one first: mostly one, but as many as it has views and layers
    /// that are pictures of their own. There is at least one.
    pub pictures: Vec<Picture>,
    /// What it was filtered with.
    pub filter: Filter,
    /// What ran that, and how accurately.
    backend: &'static str,
    precision: Precision,
}

/// A picture that was filtered.
#[derive(Debug)]
pub struct Picture {
    /// Which picture of the frame it is, and what fed its features.
    pub target: Target,
    /// The result.
    pub image: Image,
    /// Layers that were filtered by the same weights.
    pub layers: Vec<Image>,
    /// What was done to the scene on the way in.
    pub notes: Vec<Note>,
    /// What else there is to say.
    pub applied: Applied,
}

impl Denoiser {
    /// What it is to be is said step by step.
    pub fn builder() -> Builder {
        Builder::default()
    }

    /// One that filters on this back end, on the threads of whoever calls it.
    pub fn new(backend: Arc<dyn Backend>, options: Options) -> Self {
        let filter = options.filter.clone().unwrap_or_else(shipped::best);
        Self { backend, filter, options, threads: None, ready: Mutex::default() }
    }

    /// What runs the filters.
    pub fn backend(&self) -> &dyn Backend {
        &*self.backend
    }

    /// What it filters with.
    pub fn filter_used(&self) -> &Filter {
        &self.filter
    }

    /// A frame in memory, to be filtered: of so many columns and rows, whose buffers are then
    /// named.
    pub fn frame<'v>(&self, width: usize, height: usize) -> Buffers<'_, 'v> {
        Buffers::new(self, width, height)
    }

    /// Does something on the threads that are for it.
    fn within<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.threads {
            Some(threads) => threads.install(work),
            None => work(),
        }
    }

    fn strength(&self) -> f32 {
        self.options.strength.unwrap_or(1.0)
    }

    /// Filters the colour of a scene.
    fn filtered(&self, scene: &Scene, run: Run<'_>) -> Result<(Filtered, Applied), DenoiseError> {
        let checked = self.filter.check().expect("only filters that make sense get here");
        scene.require(&checked.required())?;
        let (code, planning, compilation) = self.code(scene.name(), Facts::of(scene))?;
        let start = Instant::now();
        let filtered = code.run(scene, Rect::whole(scene), run)?;
        let (kept, filtering) = (filtered.kept.clone(), start.elapsed());
        Ok((filtered, Applied { kept, planning, compilation, filtering }))
    }

    /// The filter as code for images of which this is known, and how long it took to plan and to
    /// compile it.
    fn code(
        &self,
        scene: &str,
        facts: Facts,
    ) -> Result<(Arc<Code>, Duration, Duration), DenoiseError> {
        let ready = || self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, code)) = &*ready()
            && *known == facts
        {
            return Ok((code.clone(), Duration::ZERO, Duration::ZERO));
        }
        let code = Code::new(&self.filter, (scene, &facts), &*self.backend, self.options.passes)?;
        let (planning, compilation) = (code.planning, code.compilation);
        let code = Arc::new(code);
        *ready() = Some((facts, code.clone()));
        Ok((code, planning, compilation))
    }

    /// Reads a file, and denoises it.
    ///
    /// # Errors
    /// If the file cannot be read or lacks what the filter needs, or the back end fails.
    pub fn denoise(&self, path: &Path) -> Result<Denoised, DenoiseError> {
        self.within(|| self.filter(self.load(path, &[])?))
    }

    /// Reads a file, and others beside it with features of their own, with what its filter
    /// needs.
    ///
    /// # Errors
    /// If one cannot be read, or not within the memory that there is.
    pub fn load(&self, path: &Path, aux: &[Aux]) -> Result<Frame, DenoiseError> {
        let mut selection = self.options.selection.clone();
        selection.samples = selection.samples.or(self.options.load.samples);
        let targets = Target::all(path, aux, &selection)?;
        let share = self.options.max_memory.map(|memory| memory / targets.len() as u64);
        let pictures = targets.into_iter().map(|target| self.load_picture(target, share));
        Ok(Frame { pictures: pictures.collect::<Result<_, _>>()? })
    }

    fn load_picture(
        &self,
        target: Target,
        max_memory: Option<u64>,
    ) -> Result<Loaded, DenoiseError> {
        let checked = self.filter.check().expect("only filters that make sense get here");
        let (mut needs, mut reach) = (checked.needs(), checked.reach());
        let mut layers = target.layers(&self.options.layers)?;
        if let Some(alpha) = target.alpha().filter(|_| self.options.filters_alpha) {
            let channels = [(); 3].map(|()| alpha.clone());
            layers.push(LayerChannels { name: alpha, channels });
        }
        if !layers.is_empty() {
            let carrying = self.carrying(&target, 1)?;
            let checked = carrying.filter.check().expect("it was checked when it was made");
            needs = needs.union(checked.needs());
            reach = reach.max(checked.reach());
        }
        let load = &self.options.load;
        let spilled = match max_memory {
            None => false,
            Some(max_memory) => {
                let Weight { mut in_memory, mut least } = Weight::of(&target, &needs, load)?;
                if !layers.is_empty() {
                    // Layers are filtered in memory alone, beside a copy of the scene.
                    in_memory *= 2;
                    least = in_memory;
                }
                if least > max_memory {
                    let path = target.path().to_owned();
                    let layers = !layers.is_empty();
                    return Err(DenoiseError::TooLittleMemory { path, max_memory, least, layers });
                }
                in_memory > max_memory
            }
        };
        let scene = match spilled {
            false => {
                Prepared::InMemory(Box::new(Scene::of(&target, &layers, &needs, reach, load)?))
            }
            true => Prepared::Spilled(Box::new(SpilledScene::load(&target, &needs, reach, load)?)),
        };
        Ok(Loaded { target, scene })
    }

    /// The filter of so many layers.
    fn carrying(&self, target: &Target, layers: usize) -> Result<Carrying, DenoiseError> {
        self.filter.carrying(layers).ok_or_else(|| DenoiseError::Carries {
            path: target.path().to_owned(),
            filter: self.filter.name.clone(),
        })
    }

    /// Filters a frame.
    ///
    /// # Errors
    /// If it lacks what its filter needs, or the back end fails.
    pub fn filter(&self, frame: Frame) -> Result<Denoised, DenoiseError> {
        self.filter_watched(frame, &|_, _| ControlFlow::Continue(()))
    }

    /// The same, and tells how far it is: how many rows are filtered, of how many, those of
    /// every picture and of every layer that is filtered by its weights. It is told from any thread.
    ///
    /// # Errors
    /// Those of [`filter`](Self::filter), and one that [is a stop](DenoiseError::is_stop) if
    /// `progress` breaks off.
    pub fn filter_watched(
        &self,
        frame: Frame,
        progress: &Progress<'_>,
    ) -> Result<Denoised, DenoiseError> {
        let all: usize = frame.pictures.iter().map(|loaded| self.rows(loaded)).sum();
        let done = AtomicUsize::new(0);
        // A back end that takes over begins anew.
        let watch = |rows: usize| progress(all.min(done.fetch_add(rows, Relaxed) + rows), all);
        let pictures = self.within(|| {
            let pictures = frame.pictures.into_iter();
            pictures.map(|loaded| self.filter_picture(loaded, &watch)).collect::<Result<_, _>>()
        })?;
        let (backend, precision) = (self.backend.name(), self.options.passes.precision);
        Ok(Denoised { pictures, filter: self.filter.clone(), backend, precision })
    }

    /// Rows that are filtered of a picture, each as often as there is something to filter.
    fn rows(&self, loaded: &Loaded) -> usize {
        match &loaded.scene {
            Prepared::Spilled(scene) => scene.layout().height(),
            Prepared::InMemory(scene) => {
                let pictures = self.pictures(&loaded.target, scene);
                // The colour of a single weight is filtered on its own.
                let alone = usize::from(pictures == 0 || self.filter.paper().is_some());
                scene.layout().height() * (alone + pictures.div_ceil(Feature::PICTURES))
            }
        }
    }

    fn filter_picture(&self, loaded: Loaded, watch: &Watch<'_>) -> Result<Picture, DenoiseError> {
        let Loaded { target, scene } = loaded;
        let (filter, passes) = (&self.filter, self.options.passes);
        let run = Run { strength: self.strength(), watch };
        let mut layers = Vec::new();
        let (image, applied, notes) = match scene {
            Prepared::InMemory(scene) => {
                let missing = scene.missing().to_vec();
                let scene = if self.options.filters_alpha { scene.without_alpha() } else { *scene };
                let notes = scene.notes().to_vec();
                let has_layers = scene.layers().next().is_some();
                let (image, applied) = match has_layers {
                    false => {
                        let (filtered, applied) = self.filtered(&scene, run)?;
                        (code::image(&scene, filtered), applied)
                    }
                    true => {
                        let (image, others, applied) = self.filter_layers(&target, scene, run)?;
                        layers = others;
                        (image, applied)
                    }
                };
                (image.blackened(&missing), applied, notes)
            }
            Prepared::Spilled(scene) => {
                let max_memory = self.options.max_memory.unwrap_or(u64::MAX);
                let backend = &*self.backend;
                let (image, applied) =
                    parts::apply(filter, &scene, backend, passes, run, max_memory)?;
                (image.blackened(scene.missing()), applied, scene.notes().to_vec())
            }
        };
        let origin = target.window()?.origin;
        let layers: Vec<Image> =
            layers.into_iter().map(|layer: Image| layer.with_origin(origin)).collect();
        let mut image = image.with_channels(target.color_channels()?).with_origin(origin);
        if let Some(alpha) = layers.last().filter(|_| self.filters_alpha_of(&target)) {
            image = image.with_alpha(Some(alpha.rgb()[0].to_vec()));
        }
        Ok(Picture { target, image, layers, notes, applied })
    }
}

impl Denoiser {
    fn filters_alpha_of(&self, target: &Target) -> bool {
        self.options.filters_alpha && target.alpha().is_some()
    }

    /// How many pictures are filtered beside the colour: an alpha with what it covers, and with
    /// white.
    fn pictures(&self, target: &Target, scene: &Scene) -> usize {
        scene.layers().count() + usize::from(self.filters_alpha_of(target))
    }

    /// Filters a scene and its layers; the alpha is the last of them, if it is one.
    fn filter_layers(
        &self,
        target: &Target,
        mut scene: Scene,
        run: Run<'_>,
    ) -> Result<(Image, Vec<Image>, Applied), DenoiseError> {
        let layers: Vec<LayerChannels> = scene.layers().cloned().collect();
        let mut pictures: Vec<[Vec<f32>; 3]> =
            (0..layers.len()).map(|k| scene.layer(k).clone()).collect();
        if self.filters_alpha_of(target) {
            let white = vec![1.0; scene.layout().pixels()];
            pictures.push([white.clone(), white.clone(), white]);
        }
        let (backend, passes) = (&*self.backend, self.options.passes);
        // The colour of a single weight has code of its own, which gives other bits.
        let mut color = match self.filter.paper() {
            Some(_) => {
                let (filtered, applied) = self.filtered(&scene, run)?;
                Some((code::image(&scene, filtered), applied))
            }
            None => None,
        };
        let mut filtered: Vec<Image> = Vec::with_capacity(pictures.len());
        for together in pictures.chunks(Feature::PICTURES) {
            let carrying = self.carrying(target, together.len())?;
            scene = scene.with_pictures(together);
            let (images, took) =
                code::apply_pictures(&carrying, &scene, together, backend, passes, run)?;
            let mut images = images.into_iter();
            let first = images.next().expect("the colour comes first");
            filtered.extend(images);
            let (_, applied) = color.get_or_insert((first, Applied::nothing(&took)));
            applied.planning += took.planning;
            applied.compilation += took.compilation;
            applied.filtering += took.filtering;
        }
        if self.filters_alpha_of(target) {
            // Light is divided by the albedo and multiplied by it again, which keeps what
            // is lit evenly. What covers a pixel is not lit: it is kept where it is even.
            let white = filtered.pop().expect("white is the last");
            let alpha = filtered.last_mut().expect("the alpha is the last layer");
            let shares = alpha.rgb()[0].iter().zip(white.rgb()[0]);
            let share = |(&a, &one): (&f32, &f32)| if one > 0.0 { a / one } else { a };
            let covered: Vec<f32> = shares.map(share).collect();
            let (width, height) = alpha.size();
            let rgb = [covered.clone(), covered.clone(), covered];
            *alpha = Image::new(alpha.name(), width, height, rgb).expect("the same size");
        }
        let finished = filtered.into_iter().zip(&layers).enumerate().map(|(k, (layer, named))| {
            layer.with_channels(named.channels.clone()).blackened(scene.missing_of_layer(k))
        });
        let finished = finished.collect();
        let (image, applied) = color.expect("there is a layer");
        Ok((image, finished, applied))
    }
}

impl Denoised {
    /// The best picture, or the only one.
    pub fn image(&self) -> &Image {
        &self.pictures[0].image
    }
}

#[cfg(test)]
mod tests;
