//! What a result is written as.

use std::path::Path;

use clap::ValueEnum;

use crate::denoise::{DenoiseError, Denoised};
use crate::image::exr::Lost;
use crate::image::{pfm, write_atomically};
use crate::report::Picture;
use crate::scene::SceneError;

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Form {
    /// OpenEXR: the whole input with its colour replaced
    Exr,
    /// PNG: tone-mapped, 8 bits per channel, with alpha where the input has one
    Png,
    /// Portable float map: linear R, G, B alone
    Pfm,
}

impl Form {
    /// What its files' names end in.
    pub(super) fn ending(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Png => "png",
            Self::Pfm => "pfm",
        }
    }

    /// Its name, for people.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Exr => "OpenEXR",
            Self::Png => "PNG",
            Self::Pfm => "PFM",
        }
    }

    /// The form that a file's name asks for.
    pub(super) fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?;
        let all = Self::value_variants().iter().copied();
        all.into_iter().find(|form| ending.eq_ignore_ascii_case(form.ending()))
    }

    /// Writes a result: the whole of it or nothing. Formats of one picture get the best one.
    pub(super) fn save(
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
