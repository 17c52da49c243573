//! The scenes of a run, laid down beside its checkpoint: whoever resumes it need not name
//! them again.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::scenes;
use crate::image::{ImageError, write_atomically};

/// Arguments as the command line has them, but for folders that they do not depend on.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Recall {
    scenes: Vec<String>,
    #[serde(default)]
    validate: Vec<String>,
}

impl Recall {
    /// What a run was started with.
    pub(super) fn of(scenes: &[PathBuf], validate: &[PathBuf]) -> Self {
        // Of a name that is no text, a resumed run says that it is not there.
        let text = |path: &PathBuf| scenes::absolute(path).to_string_lossy().into_owned();
        let texts = |paths: &[PathBuf]| paths.iter().map(text).collect();
        Self { scenes: texts(scenes), validate: texts(validate) }
    }

    pub(super) fn scenes(&self) -> Vec<PathBuf> {
        self.scenes.iter().map(PathBuf::from).collect()
    }

    pub(super) fn validate(&self) -> Vec<PathBuf> {
        self.validate.iter().map(PathBuf::from).collect()
    }

    /// Reads it; of a run that left none, nothing is known.
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        match fs::read(path) {
            Ok(bytes) => serde_json::from_slice(&bytes)
                .map_err(|source| Error::Recall { path: path.display().to_string(), source }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Self::default()),
            Err(source) => {
                Err(ImageError::Io { path: path.to_owned(), action: "read", source }.into())
            }
        }
    }

    pub(super) fn write(&self, path: &Path) -> Result<(), Error> {
        let mut json = serde_json::to_vec_pretty(self).expect("lists of text are JSON");
        json.push(b'\n');
        Ok(write_atomically(path, &json)?)
    }
}
