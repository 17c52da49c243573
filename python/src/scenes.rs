//! Scenes to tune and to breed on: folders, or pairs of files.

use std::path::PathBuf;

use pyo3::prelude::*;
use tamis::scene::{Needs, SceneFiles, discover};
use tamis::tune::{self, TuningScene};

/// One of the places that people name.
#[derive(FromPyObject)]
pub(crate) enum Place {
    /// A noisy image and its reference.
    #[pyo3(transparent)]
    Pair((PathBuf, PathBuf)),
    /// A folder with scenes in or below it.
    #[pyo3(transparent)]
    Folder(PathBuf),
}

/// Finds and loads scenes, each once, with what `needs` names, for windows of radius `pad`.
///
/// # Errors
/// If nothing is there, or it cannot be read.
pub(crate) fn load(
    places: &[Place],
    needs: &Needs,
    pad: usize,
) -> Result<Vec<TuningScene>, tune::Error> {
    let mut files: Vec<SceneFiles> = Vec::new();
    for place in places {
        let found = match place {
            Place::Pair((noisy, reference)) => vec![SceneFiles::of(noisy, reference)],
            Place::Folder(folder) => discover(&[folder])?,
        };
        for scene in found {
            if !files.contains(&scene) {
                files.push(scene);
            }
        }
    }
    files.iter().map(|files| TuningScene::load(files, needs, pad)).collect()
}
