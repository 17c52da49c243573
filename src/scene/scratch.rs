//! A file of planes, for images that do not fit in memory.
//!
//! It stands in the folder for temporary files (`TMPDIR`), has no name there, and is gone
//! when it is closed, whatever ends the program.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::{Mutex, PoisonError};

use crate::image::ImageError;

/// Planes of one size.
pub(super) struct Scratch {
    file: Mutex<File>,
    pixels: usize,
}

impl Scratch {
    /// No plane yet.
    pub(super) fn new(pixels: usize) -> Result<Self, ImageError> {
        let file = tempfile::tempfile().map_err(failed)?;
        Ok(Self { file: Mutex::new(file), pixels })
    }

    /// So many planes, zero where nothing is written.
    pub(super) fn zeros(planes: usize, pixels: usize) -> Result<Self, ImageError> {
        let file = tempfile::tempfile().map_err(failed)?;
        file.set_len((planes * pixels * size_of::<f32>()) as u64).map_err(failed)?;
        Ok(Self { file: Mutex::new(file), pixels })
    }

    /// Writes samples of a plane, from this pixel on.
    pub(super) fn write(
        &self,
        plane: usize,
        start: usize,
        samples: &[f32],
    ) -> Result<(), ImageError> {
        self.at(plane, start, |file| file.write_all(bytemuck::cast_slice(samples)))
    }

    /// Reads samples of a plane, from this pixel on.
    pub(super) fn read(
        &self,
        plane: usize,
        start: usize,
        samples: &mut [f32],
    ) -> Result<(), ImageError> {
        self.at(plane, start, |file| file.read_exact(bytemuck::cast_slice_mut(samples)))
    }

    fn at(
        &self,
        plane: usize,
        start: usize,
        then: impl FnOnce(&mut File) -> io::Result<()>,
    ) -> Result<(), ImageError> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let place = (plane * self.pixels + start) * size_of::<f32>();
        file.seek(SeekFrom::Start(place as u64)).and_then(|_| then(&mut file)).map_err(failed)
    }
}

fn failed(source: io::Error) -> ImageError {
    ImageError::Io {
        path: std::env::temp_dir(),
        action: "keep what does not fit in memory in a scratch file there",
        source,
    }
}
