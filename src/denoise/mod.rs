//! Floor 6: filters applied to images, as `tamis denoise` does.
//!
//! A [`Denoiser`] reads a file, filters it with what was asked for or with the best shipped
//! filter that the file can feed, and gives an image back. [`Code`] is a filter that is
//! ready to run on scenes that are in memory already.
//!
//! ```no_run
//! use tamis::backend::Interpreter;
//! use tamis::denoise::{Denoiser, Options};
//!
//! let denoised = Denoiser::new(&Interpreter, Options::default()).denoise("noisy.exr".as_ref())?;
//! denoised.save("clean.exr".as_ref())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Images that do not fit in memory are [spilled](crate::scene::SpilledScene) and filtered
//! part by part, to the same bits.

mod code;
mod error;
mod feeds;
mod parts;
mod whole;

use std::path::Path;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

use glob::Pattern;

use crate::backend::{Backend, Watch};
use crate::expr::Feature;
use crate::filter::{Carrying, Filter, shipped};
use crate::image::Image;
use crate::plan::{Passes, Precision};
use crate::scene::listing::Aux;
use crate::scene::mapping::Selection;
use crate::scene::{LayerChannels, LoadOptions, Note, Scene, SpilledScene, Target, Weight};

pub use code::{Applied, Code, How, apply};
pub use error::DenoiseError;
pub use feeds::Feeds;
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

/// Denoises images.
pub struct Denoiser<'a> {
    backend: &'a dyn Backend,
    filter: Filter,
    options: Options,
}

/// A frame that was read.
pub struct Frame {
    pictures: Vec<Loaded>,
}

/// A picture that was read.
struct Loaded {
    target: Target,
    pixels: Pixels,
}

enum Pixels {
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

impl<'a> Denoiser<'a> {
    /// One that filters on this back end.
    pub fn new(backend: &'a dyn Backend, options: Options) -> Self {
        let filter = options.filter.clone().unwrap_or_else(shipped::best);
        Self { backend, filter, options }
    }

    /// What runs the filters.
    pub fn backend(&self) -> &'a dyn Backend {
        self.backend
    }

    /// Reads a file, and denoises it.
    ///
    /// # Errors
    /// If the file cannot be read or lacks what the filter needs, or the back end fails.
    pub fn denoise(&self, path: &Path) -> Result<Denoised, DenoiseError> {
        self.filter(self.load(path, &[])?)
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
        let pixels = match spilled {
            false => Pixels::InMemory(Box::new(Scene::of(&target, &layers, &needs, reach, load)?)),
            true => Pixels::Spilled(Box::new(SpilledScene::load(&target, &needs, reach, load)?)),
        };
        Ok(Loaded { target, pixels })
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
        self.filter_watched(frame, &|_, _| {})
    }

    /// The same, and tells how far it is: how many rows are filtered, of how many, those of
    /// every picture and of every layer that is filtered by its weights. It is told from any thread.
    ///
    /// # Errors
    /// Those of [`filter`](Self::filter).
    pub fn filter_watched(
        &self,
        frame: Frame,
        watch: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Denoised, DenoiseError> {
        let all: usize = frame.pictures.iter().map(|loaded| self.rows(loaded)).sum();
        let done = AtomicUsize::new(0);
        // A back end that takes over begins anew.
        let watch = |rows: usize| watch(all.min(done.fetch_add(rows, Relaxed) + rows), all);
        let pictures = frame.pictures.into_iter();
        let pictures = pictures.map(|loaded| self.filter_picture(loaded, &watch));
        let pictures = pictures.collect::<Result<_, _>>()?;
        let (backend, precision) = (self.backend.name(), self.options.passes.precision);
        Ok(Denoised { pictures, filter: self.filter.clone(), backend, precision })
    }

    /// Rows that are filtered of a picture, each as often as there is something to filter.
    fn rows(&self, loaded: &Loaded) -> usize {
        match &loaded.pixels {
            Pixels::Spilled(scene) => scene.layout().height(),
            Pixels::InMemory(scene) => {
                let pictures = self.pictures(&loaded.target, scene);
                // The colour of a single weight is filtered on its own.
                let alone = usize::from(pictures == 0 || self.filter.paper().is_some());
                scene.layout().height() * (alone + pictures.div_ceil(Feature::PICTURES))
            }
        }
    }

    fn filter_picture(&self, loaded: Loaded, watch: &Watch<'_>) -> Result<Picture, DenoiseError> {
        let Loaded { target, pixels } = loaded;
        let filter = &self.filter;
        let (passes, strength) = (self.options.passes, self.options.strength.unwrap_or(1.0));
        let how = How { passes, strength, watch };
        let mut layers = Vec::new();
        let (image, applied, notes) = match pixels {
            Pixels::InMemory(scene) => {
                let missing = scene.missing().to_vec();
                let scene = if self.options.filters_alpha { scene.without_alpha() } else { *scene };
                let notes = scene.notes().to_vec();
                let has_layers = scene.layers().next().is_some();
                let (image, applied) = match has_layers {
                    false => apply(filter, &scene, self.backend, how)?,
                    true => {
                        let (image, others, applied) = self.filter_layers(&target, scene, how)?;
                        layers = others;
                        (image, applied)
                    }
                };
                (image.blackened(&missing), applied, notes)
            }
            Pixels::Spilled(scene) => {
                let max_memory = self.options.max_memory.unwrap_or(u64::MAX);
                let (image, applied) = parts::apply(filter, &scene, self.backend, how, max_memory)?;
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

impl Denoiser<'_> {
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
        how: How<'_>,
    ) -> Result<(Image, Vec<Image>, Applied), DenoiseError> {
        let layers: Vec<LayerChannels> = scene.layers().cloned().collect();
        let mut pictures: Vec<[Vec<f32>; 3]> =
            (0..layers.len()).map(|k| scene.layer(k).clone()).collect();
        if self.filters_alpha_of(target) {
            let white = vec![1.0; scene.layout().pixels()];
            pictures.push([white.clone(), white.clone(), white]);
        }
        // The colour of a single weight has code of its own, which gives other bits.
        let mut color = match self.filter.paper() {
            Some(_) => Some(apply(&self.filter, &scene, self.backend, how)?),
            None => None,
        };
        let mut filtered: Vec<Image> = Vec::with_capacity(pictures.len());
        for together in pictures.chunks(Feature::PICTURES) {
            let carrying = self.carrying(target, together.len())?;
            scene = scene.with_pictures(together);
            let (images, took) =
                code::apply_pictures(&carrying, &scene, together, self.backend, how)?;
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
