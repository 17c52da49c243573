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

mod choice;
mod code;
mod error;
mod feeds;
mod parts;
mod whole;

use std::path::Path;

use crate::backend::Backend;
use crate::filter::Filter;
use crate::image::Image;
use crate::plan::{Passes, Precision};
use crate::scene::listing::Aux;
use crate::scene::mapping::Selection;
use crate::scene::{LoadOptions, Note, Scene, SpilledScene, Target, Weight};

pub use choice::{Chosen, Why};
pub use code::{Applied, Code, apply};
pub use error::DenoiseError;
pub use feeds::Feeds;
pub use whole::ATTRIBUTE;

/// How images are denoised.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// With what. If nothing is said, with the best shipped filter that each file can feed.
    pub filter: Option<Filter>,
    /// With which radius, if a filter is chosen, in pixels.
    pub radius: Option<u32>,
    /// How plans are made.
    pub passes: Passes,
    /// How scenes are loaded.
    pub load: LoadOptions,
    /// Which pictures of a frame, and what channels are.
    pub selection: Selection,
    /// How much of the result is taken, between 0 and 1, and how little of the noisy colour;
    /// if nothing is said, all.
    pub strength: Option<f32>,
    /// Memory for a frame, in bytes; if nothing is said, as much as it takes.
    pub max_memory: Option<u64>,
}

/// Denoises images.
pub struct Denoiser<'a> {
    backend: &'a dyn Backend,
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
    chosen: Chosen,
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
    /// What filtered it, and how accurately.
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
    /// What it was filtered with.
    pub chosen: Chosen,
    /// What was done to the scene on the way in.
    pub notes: Vec<Note>,
    /// What else there is to say.
    pub applied: Applied,
}

impl<'a> Denoiser<'a> {
    /// One that filters on this back end.
    pub fn new(backend: &'a dyn Backend, options: Options) -> Self {
        Self { backend, options }
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
        let chosen = self.choose(&target)?;
        let checked = chosen.filter.check().expect("only filters that make sense are chosen");
        let (needs, reach) = (checked.needs(), checked.reach());
        let load = &self.options.load;
        let spilled = match max_memory {
            None => false,
            Some(max_memory) => {
                let Weight { in_memory, least } = Weight::of(&target, &needs, load)?;
                if least > max_memory {
                    let path = target.path().to_owned();
                    return Err(DenoiseError::TooLittleMemory { path, max_memory, least });
                }
                in_memory > max_memory
            }
        };
        let pixels = match spilled {
            false => Pixels::InMemory(Box::new(Scene::of(&target, &needs, reach, load)?)),
            true => Pixels::Spilled(Box::new(SpilledScene::load(&target, &needs, reach, load)?)),
        };
        Ok(Loaded { target, pixels, chosen })
    }

    /// Filters a frame.
    ///
    /// # Errors
    /// If it lacks what its filter needs, or the back end fails.
    pub fn filter(&self, frame: Frame) -> Result<Denoised, DenoiseError> {
        let pictures = frame.pictures.into_iter().map(|loaded| self.filter_picture(loaded));
        let pictures = pictures.collect::<Result<_, _>>()?;
        let (backend, precision) = (self.backend.name(), self.options.passes.precision);
        Ok(Denoised { pictures, backend, precision })
    }

    fn filter_picture(&self, loaded: Loaded) -> Result<Picture, DenoiseError> {
        let Loaded { target, pixels, chosen } = loaded;
        let filter = &chosen.filter;
        let (passes, strength) = (self.options.passes, self.options.strength.unwrap_or(1.0));
        let (image, applied, notes) = match pixels {
            Pixels::InMemory(scene) => {
                let (image, applied) = apply(filter, &scene, self.backend, passes, strength)?;
                (image, applied, scene.notes().to_vec())
            }
            Pixels::Spilled(scene) => {
                let max_memory = self.options.max_memory.unwrap_or(u64::MAX);
                let how = (passes, strength);
                let (image, applied) = parts::apply(filter, &scene, self.backend, how, max_memory)?;
                (image, applied, scene.notes().to_vec())
            }
        };
        let window = target.window()?;
        let image = image.with_channels(target.color_channels()?).with_origin(window.origin);
        Ok(Picture { target, image, chosen, notes, applied })
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
