//! Why constants cannot be tuned.

use super::sealed::SealedError;
use crate::backend::BackendError;
use crate::image::ImageError;
use crate::plan::PlanError;
use crate::scene::SceneError;

/// Everything that this room's functions can fail with.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A setting makes no sense.
    #[error("setting `{name}` is {value}: {wanted}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// What it was set to.
        value: String,
        /// What it must be.
        wanted: &'static str,
    },
    /// There is nothing to tune.
    #[error(
        "filter `{0}` has no constant that may be tuned: give it [params] or [layers], and read \
         them in its formulas"
    )]
    NoConstants(String),
    /// No scene was given.
    #[error("no scene to tune on")]
    NoScenes,
    /// A scene cannot be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A reference and a noisy image are of different sizes.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The filter cannot run on a scene.
    #[error("scene `{scene}`: {source}")]
    Plan {
        /// Which scene.
        scene: String,
        /// Why.
        source: PlanError,
    },
    /// The back end failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// A checkpoint cannot be read or written.
    #[error(transparent)]
    Checkpoint(#[from] SealedError),
    /// A checkpoint is of another run.
    #[error(
        "the checkpoint was made with another {what}: resume it with what it was begun with, or \
         start anew"
    )]
    Other {
        /// What differs.
        what: &'static str,
    },
    /// A picture is not what it was.
    #[error(
        "{picture} is not the one that the checkpoint was made with (another picture, or loaded \
         by another version): resume with the old one, or start anew"
    )]
    Picture {
        /// Which.
        picture: String,
    },
}
