//! What constants are tuned on: scenes at several sample counts, with their references.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::error::Error;
use super::loss::Reference;
use crate::image::{Image, Metrics};
use crate::scene::{
    Crop, Fingerprint, LoadOptions, Needs, Scene, SceneFiles, load_reference, sample_counts,
    samples_of,
};

/// A scene, rendered with more and with fewer samples.
#[derive(Debug)]
pub struct TuningScene {
    /// What reports call it.
    pub name: String,
    /// By sample count, the fewest first.
    pub levels: Vec<Level>,
    /// What all of them converge to.
    pub image: Image,
    /// The same, to be compared with.
    pub reference: Reference,
}

/// A scene at a sample count.
#[derive(Debug)]
pub struct Level {
    /// How many samples per pixel its file's name says; none for a file of any name.
    pub samples: Option<u32>,
    /// The scene.
    pub scene: Scene,
}

impl TuningScene {
    /// Loads a scene with what `needs` names, for windows of radius `pad`: all of its noisy
    /// images, `1spp.exr`, `4spp.exr`, `16spp.exr` and so on.
    ///
    /// # Errors
    /// If a file cannot be read, or the sizes differ.
    pub fn load(files: &SceneFiles, needs: &Needs, pad: usize) -> Result<Self, Error> {
        let image = load_reference(&files.reference)?;
        image.check_reference()?;
        let mut levels = Vec::new();
        for (samples, path) in levels_of(&files.noisy)? {
            let scene = Scene::load(&path, needs, pad, &LoadOptions::default())?;
            let size = (scene.layout().width(), scene.layout().height());
            if size != image.size() {
                // It says so.
                Metrics::of(&scene.noisy(), &image)?;
            }
            levels.push(Level { samples, scene });
        }
        let reference = Reference::new(image.rgb());
        Ok(Self { name: files.name.clone(), levels, image, reference })
    }
}

impl TuningScene {
    /// A part of the scene as a scene of its own; its reference keeps the exposure of the whole.
    ///
    /// # Panics
    /// If the part does not lie in the image.
    #[must_use]
    pub fn part(&self, crop: &Crop) -> Self {
        let level =
            |level: &Level| Level { samples: level.samples, scene: level.scene.crop(crop, 1.0) };
        let columns = self.image.size().0;
        let [width, height] = crop.turned();
        let channel = |from: &[f32]| crop.pixels(columns).map(|k| from[k]).collect();
        let rgb = self.image.rgb().map(channel);
        let image = Image::new(&self.name, width, height, rgb).expect("as many as the part has");
        let pixels = crop.pixels(columns).map(|k| self.reference.pixels[k]).collect();
        let reference = Reference { pixels, exposure: self.reference.exposure };
        let levels = self.levels.iter().map(level).collect();
        Self { name: self.name.clone(), levels, image, reference }
    }
}

/// The pictures of scenes, as errors call them.
pub fn pictures(training: &[TuningScene], validation: &[TuningScene]) -> Vec<Fingerprint> {
    let scenes: Vec<&TuningScene> = training.iter().chain(validation).collect();
    let of = |scene: &TuningScene| {
        let name = &scene.name;
        let noisy = scene.levels.iter().map(|level| {
            let samples = level.samples.map_or(String::new(), |n| format!(" at {n} samples"));
            Fingerprint::of_scene(format!("the noisy image of `{name}`{samples}"), &level.scene)
        });
        let clean = Fingerprint::of_image(format!("the reference of `{name}`"), &scene.image);
        noisy.chain([clean]).collect::<Vec<Fingerprint>>()
    };
    scenes.par_iter().flat_map_iter(|scene| of(scene)).collect()
}

/// The noisy images of a scene, by sample count.
fn levels_of(noisy: &Path) -> Result<Vec<(Option<u32>, PathBuf)>, Error> {
    match (samples_of(noisy), noisy.parent()) {
        (Some(_), Some(folder)) => {
            let images = sample_counts(folder)?.into_iter();
            Ok(images.map(|(samples, path)| (Some(samples), path)).collect())
        }
        _ => Ok(vec![(None, noisy.to_owned())]),
    }
}
