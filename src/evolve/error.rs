//! Why a search cannot go on.

use std::io;
use std::path::PathBuf;

use crate::expr::text::TextError;
use crate::scene::SceneError;

/// Everything that this floor's functions can fail with.
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
    /// The initial expression is none.
    #[error("setting `initial` is neither a filter's name nor an expression")]
    Initial(#[source] TextError),
    /// The fitness failed.
    #[error("the expressions could not be evaluated")]
    Fitness(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// A file cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] SceneError),
    /// A file is no checkpoint.
    #[error("{} is not a checkpoint that this version can resume", path.display())]
    Checkpoint {
        /// Which.
        path: PathBuf,
        /// Where it stops making sense.
        source: serde_json::Error,
    },
    /// A checkpoint is laid out as another version does.
    #[error(
        "{} is a checkpoint of another version ({found}; this one reads {read}): resume it with \
         the version that wrote it, or start anew", path.display()
    )]
    Format {
        /// Which.
        path: PathBuf,
        /// The layout's name.
        found: String,
        /// The one that this version reads.
        read: &'static str,
    },
    /// A checkpoint belongs to another fitness.
    #[error(
        "the checkpoint was bred against {bred}, which is not {given}: resume it with what it was \
         bred against, or start anew"
    )]
    Identity {
        /// What the checkpoint was bred against.
        bred: String,
        /// What it is to be resumed with.
        given: String,
    },
}
