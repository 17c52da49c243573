//! Why a search cannot go on.

use std::path::{Path, PathBuf};

use crate::expr::text::TextError;
use crate::tune::SealedError;

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
    /// The fitness failed, for a reason that has nothing to do with the expressions.
    #[error("the search stopped, as expressions could not be judged: {source}")]
    Fitness {
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
        /// What the search can be resumed from; none if no checkpoint was asked for, or
        /// it could not be written.
        checkpoint: Option<PathBuf>,
    },
    /// The search was stopped before anything was judged.
    #[error(
        "the search was stopped before the first expressions were judged, so that there is no \
         best so far"
    )]
    Stopped,
    /// A checkpoint cannot be read or written.
    #[error(transparent)]
    Checkpoint(#[from] SealedError),
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
    /// A picture that expressions are judged by is not what it was.
    #[error(
        "{picture} is not the one that the checkpoint was bred against (another picture, or \
         loaded by another version): resume with the old one, or start anew"
    )]
    Picture {
        /// Which.
        picture: String,
    },
}

impl Error {
    /// What an error of the fitness stops a search with.
    pub(super) fn fitness(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::Fitness { source: Box::new(error), checkpoint: None }
    }

    /// The same error, saying which checkpoint the search can be resumed from.
    pub(super) fn resumable(self, path: Option<&Path>) -> Self {
        match self {
            Self::Fitness { source, .. } => {
                Self::Fitness { source, checkpoint: path.map(Path::to_owned) }
            }
            other => other,
        }
    }
}

/// What an error says with its causes, as far as it does not name them itself.
pub fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let detail = error.to_string();
        if !text.contains(&detail) {
            text = format!("{text}: {detail}");
        }
        cause = error.source();
    }
    text
}
