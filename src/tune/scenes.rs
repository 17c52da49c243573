//! What constants are tuned on: scenes at several sample counts, with their references.

use std::path::{Path, PathBuf};

use super::error::Error;
use super::loss::Reference;
use crate::image::{Image, ImageError};
use crate::scene::{LoadOptions, NOISY, Needs, Scene, SceneFiles, load_reference};

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
    /// Loads a scene with what `needs` names, for windows of radius `pad`. Beside `4spp.exr`
    /// stand further noisy images, if there are any, as `1spp.exr`, `16spp.exr` and so on.
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
                let noisy = scene.noisy();
                crate::image::Metrics::of(&noisy, &image)?;
            }
            levels.push(Level { samples, scene });
        }
        let reference = Reference::new(image.rgb());
        Ok(Self { name: files.name.clone(), levels, image, reference })
    }
}

/// The noisy images of a scene, by sample count.
fn levels_of(noisy: &Path) -> Result<Vec<(Option<u32>, PathBuf)>, Error> {
    let usual = noisy.file_name().is_some_and(|name| name == NOISY);
    let folder = match noisy.parent() {
        Some(folder) if usual => folder,
        Some(_) | None => return Ok(vec![(None, noisy.to_owned())]),
    };
    let io = |source| ImageError::Io { path: folder.to_owned(), action: "list", source };
    let mut levels = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let samples = name.strip_suffix("spp.exr").and_then(|count| count.parse().ok());
        if let Some(samples) = samples {
            levels.push((Some(samples), path));
        }
    }
    levels.sort();
    Ok(levels)
}
