//! Floor 1: images, the files they are in, and how far one is from another.
//!
//! [`exr`] reads and writes OpenEXR files, [`metric`] compares images, and
//! [`write_atomically`] writes files whole or not at all. What the channels of a
//! renderer's file stand for is no matter of this room: see [`scene`](crate::scene).

mod error;
pub mod exr;
mod leftovers;
pub mod metric;
mod output;
#[cfg(test)]
pub(crate) mod sample;
mod temporary;

use std::path::Path;

pub use error::ImageError;
pub use exr::Attributes;
pub use metric::{Comparison, Metrics};
pub use output::write_atomically;
pub use temporary::{Temporary, remove_temporary_files};

use crate::expr::builder::LIMIT;
use exr::write_rgb;

/// Whether a sample can be computed with.
pub fn is_good(sample: f32) -> bool {
    // A NaN compares false.
    sample.abs() <= LIMIT
}

/// An RGB image, linear, row by row without padding.
#[derive(Clone, Debug)]
pub struct Image {
    name: String,
    size: (usize, usize),
    rgb: [Vec<f32>; 3],
    /// What the file calls the channels.
    channels: [String; 3],
    attributes: Option<Attributes>,
}

impl Image {
    /// An image of the given samples; `name` is what errors call it. `None`
    /// unless every channel has one sample per pixel.
    pub fn new(name: &str, width: usize, height: usize, rgb: [Vec<f32>; 3]) -> Option<Self> {
        let fits = rgb.iter().all(|channel| channel.len() == width * height);
        fits.then(|| Self {
            name: name.to_owned(),
            size: (width, height),
            rgb,
            channels: ["R", "G", "B"].map(str::to_owned),
            attributes: None,
        })
    }

    /// The same image whose channels errors call by other names than R, G and B.
    #[must_use]
    pub fn with_channels(mut self, channels: [String; 3]) -> Self {
        self.channels = channels;
        self
    }

    /// Checks that other images can be measured against this one: a single pixel that is
    /// no number would make the error of each of them infinite, so that none is better
    /// than another. Nothing is repaired, as a made-up value is no truth.
    ///
    /// # Errors
    /// If a sample is not finite or beyond ±1e18.
    pub fn check_reference(&self) -> Result<(), ImageError> {
        for (channel, samples) in self.channels.iter().zip(&self.rgb) {
            if let Some(first) = samples.iter().position(|&x| !is_good(x)) {
                return Err(ImageError::BadReference {
                    image: self.name.clone(),
                    channel: channel.clone(),
                    count: samples.iter().filter(|&&x| !is_good(x)).count(),
                    first: (first % self.size.0, first / self.size.0),
                });
            }
        }
        Ok(())
    }

    /// Writes the image as an OpenEXR file, with the attributes it was read with.
    ///
    /// # Errors
    /// If the file cannot be written; it then is as it was before.
    pub fn save(&self, path: &Path) -> Result<(), ImageError> {
        write_rgb(path, self.size, self.rgb(), self.attributes.as_ref())
    }

    /// What errors call it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The three channels.
    pub fn rgb(&self) -> [&[f32]; 3] {
        self.rgb.each_ref().map(Vec::as_slice)
    }

    /// What the file says beside the pixels.
    pub fn attributes(&self) -> Option<&Attributes> {
        self.attributes.as_ref()
    }

    /// The same image with what another file says beside its pixels.
    #[must_use]
    pub fn with_attributes(mut self, attributes: Option<&Attributes>) -> Self {
        self.attributes = attributes.cloned();
        self
    }
}
