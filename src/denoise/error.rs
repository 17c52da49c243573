//! What can go wrong when an image is denoised.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use super::buffers::buffers;
use super::view::ViewError;
use crate::backend::BackendError;
use crate::filter::FilterError;
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
    /// The back end that was asked for cannot be opened.
    #[error("the back end cannot be opened: {0}")]
    Backend(#[source] BackendError),
    /// The filter makes no sense.
    #[error("filter `{filter}`: {source}")]
    Filter {
        /// The filter.
        filter: String,
        /// Why not.
        source: Box<FilterError>,
    },
    /// The threads could not be started.
    #[error("cannot start {threads} threads: {source}; ask for fewer")]
    Threads {
        /// How many were asked for.
        threads: NonZeroUsize,
        /// Why not.
        source: rayon::ThreadPoolBuildError,
    },
    /// The strength is no share.
    #[error("a strength of {0} was asked for; it must be a number from 0 to 1")]
    Strength(f32),
    /// A frame in memory has no pixels, or too many.
    #[error(
        "a frame of {width} x {height} pixels cannot be filtered; it must have some, and at most 2^32"
    )]
    Size {
        /// Pixels per row.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// A frame in memory has no colour.
    #[error("the frame has no colour; give it the noisy image")]
    NoColor,
    /// Nothing can be fed so.
    #[error("{name} is no buffer of a frame; there are {}, and variances of these", buffers())]
    NoBuffer {
        /// What it was called.
        name: String,
    },
    /// A buffer does not have the frame's size.
    #[error("{image}: {source}")]
    View {
        /// Which one.
        image: String,
        /// Why not.
        source: Box<ViewError>,
    },
}

impl DenoiseError {
    /// Whether it says no more than that somebody asked to stop.
    pub fn is_stop(&self) -> bool {
        BackendError::is_stop(self)
    }
}
