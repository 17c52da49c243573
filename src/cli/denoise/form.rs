//! What a result is written as.

use std::path::Path;

use clap::ValueEnum;

use crate::image::{Image, ImageError};
use crate::report::Picture;

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Form {
    /// OpenEXR: linear R, G, B
    Exr,
    /// PNG: tone-mapped, 8 bits per channel
    Png,
}

impl Form {
    /// What its files' names end in.
    pub(super) fn ending(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Png => "png",
        }
    }

    /// The form that a file's name asks for.
    pub(super) fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?;
        let all = Self::value_variants().iter().copied();
        all.into_iter().find(|form| ending.eq_ignore_ascii_case(form.ending()))
    }

    /// Writes an image: the whole of it or nothing.
    pub(super) fn save(self, image: &Image, path: &Path) -> Result<(), ImageError> {
        match self {
            Self::Exr => image.save(path),
            Self::Png => Picture::of(image, 0.0).save(path),
        }
    }
}
