//! What can go wrong when an image is denoised.

use std::path::PathBuf;

use crate::backend::BackendError;
use crate::plan::PlanError;
use crate::scene::SceneError;

/// Why an image could not be denoised.
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// The file cannot be read, or lacks what the filter needs.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Layers cannot be filtered by a filter's weights.
    #[error(
        "{path}: filter `{filter}` gives no weighted mean of the colour, so that no other layer \
         can be filtered by its weights; leave out --layers and --alpha filter, or take another",
        path = path.display()
    )]
    Carries {
        /// The file.
        path: PathBuf,
        /// The filter.
        filter: String,
    },
    /// The filter cannot be planned.
    #[error("{scene}: filter `{filter}` cannot be applied: {source}")]
    Plan {
        /// The scene.
        scene: String,
        /// The filter.
        filter: String,
        /// Why.
        source: PlanError,
    },
    /// The back end failed.
    #[error("{scene}: filter `{filter}` could not run: {source}")]
    Run {
        /// The scene.
        scene: String,
        /// The filter.
        filter: String,
        /// Why.
        source: BackendError,
    },
    /// The image needs more memory than there may be used.
    #[error(
        "{path}: filtering it takes {} MiB of memory at least, and {} MiB may be used; allow \
         more, or {}",
        least.div_ceil(1 << 20), max_memory >> 20,
        match layers {
            true => "leave out --layers and --alpha filter, which need the whole image in memory",
            false => "cut the image into smaller ones",
        },
        path = path.display()
    )]
    TooLittleMemory {
        /// The file.
        path: PathBuf,
        /// What may be used, in bytes.
        max_memory: u64,
        /// What is needed, in bytes.
        least: u64,
        /// Whether layers, or the alpha, are filtered with it.
        layers: bool,
    },
}
