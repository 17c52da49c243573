//! What a result is written as.

use std::path::{Path, PathBuf};

use super::Picture;
use crate::denoise::{DenoiseError, Denoised};
use crate::image::exr::Lost;
use crate::image::{pfm, write_atomically};
use crate::scene::SceneError;

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// OpenEXR: the whole input with its colour replaced.
    Exr,
    /// PNG: tone-mapped, 8 bits per channel, with alpha where the input has one.
    Png,
    /// Portable float map: linear R, G, B alone.
    Pfm,
}

/// The ending of a file's name says nothing of what to write.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{}: results are written as .exr, .pfm (linear) or .png (tone-mapped); give the output one of \
     these endings",
    path.display()
)]
pub struct UnknownForm {
    path: PathBuf,
}

impl Form {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Exr, Self::Png, Self::Pfm];

    /// What its files' names end in.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Png => "png",
            Self::Pfm => "pfm",
        }
    }

    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exr => "OpenEXR",
            Self::Png => "PNG",
            Self::Pfm => "PFM",
        }
    }

    /// One line for people.
    pub fn doc(self) -> &'static str {
        match self {
            Self::Exr => "OpenEXR: the whole input with its colour replaced",
            Self::Png => "PNG: tone-mapped, 8 bits per channel, with alpha where the input has one",
            Self::Pfm => "Portable float map: linear R, G, B alone",
        }
    }

    /// The form that a file's name asks for.
    ///
    /// # Errors
    /// If it has none of the endings.
    pub fn of(path: &Path) -> Result<Self, UnknownForm> {
        let ending = path.extension().unwrap_or_default();
        let named = Self::ALL.into_iter().find(|form| ending.eq_ignore_ascii_case(form.ending()));
        named.ok_or_else(|| UnknownForm { path: path.to_owned() })
    }

    /// Writes a result: the whole of it or nothing. Formats of one picture get the best one;
    /// PNG files are made brighter by `exposure` stops. Gives what was lost all the same.
    ///
    /// # Errors
    /// If the file cannot be written; what was there before then still is.
    pub fn save(
        self,
        denoised: &Denoised,
        path: &Path,
        exposure: f32,
    ) -> Result<Lost, DenoiseError> {
        let image = denoised.image();
        let written = match self {
            Self::Exr => return denoised.save(path),
            Self::Png => Picture::with_alpha(image, exposure).save(path),
            Self::Pfm => write_atomically(path, &pfm::write(image.size(), image.rgb())),
        };
        written.map_err(SceneError::from)?;
        Ok(Lost::default())
    }
}
