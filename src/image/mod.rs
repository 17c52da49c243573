//! Floor 1: images, the files they are in, and how far one is from another.
//!
//! [`exr`] reads and writes OpenEXR files, [`metric`] compares images, [`Differences`] says where
//! they differ, and
//! [`write_atomically`] writes files whole or not at all. What the channels of a
//! renderer's file stand for is no matter of this room: see [`scene`](crate::scene).

mod convolve;
mod difference;
mod error;
pub mod exr;
pub mod files;
mod flip;
mod leftovers;
mod lock;
mod map;
pub mod metric;
mod output;
pub mod pfm;
#[cfg(test)]
pub(crate) mod sample;
mod ssim;
mod temporary;

use std::path::Path;

pub use difference::Differences;
pub use error::ImageError;
pub(crate) use error::listing;
pub use exr::Attributes;
pub use lock::{Lock, LockError};
pub use map::Map;
pub use metric::{Comparison, Metrics};
pub use output::{check_folder, write_atomically};
pub use temporary::{Temporary, remove_temporary_files};

use crate::expr::builder::LIMIT;
use exr::{Window, write_rgb};

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
    /// How much of each pixel is covered, if anybody knows.
    alpha: Option<Vec<f32>>,
    /// Where its top left corner is, if anybody knows.
    origin: Option<(i32, i32)>,
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
            alpha: None,
            origin: None,
            attributes: None,
        })
    }

    /// The same image whose channels errors call by other names than R, G and B.
    #[must_use]
    pub fn with_channels(mut self, channels: [String; 3]) -> Self {
        self.channels = channels;
        self
    }

    /// The same image with its top left corner at a place.
    #[must_use]
    pub fn with_origin(mut self, origin: (i32, i32)) -> Self {
        self.origin = Some(origin);
        self
    }

    /// The same image of which so much of each pixel is covered: colours are premultiplied.
    ///
    /// # Panics
    /// If there is not one sample per pixel.
    #[must_use]
    pub fn with_alpha(mut self, alpha: Option<Vec<f32>>) -> Self {
        let fits = |alpha: &Vec<f32>| alpha.len() == self.size.0 * self.size.1;
        assert!(alpha.as_ref().is_none_or(fits), "one sample per pixel");
        self.alpha = alpha;
        self
    }

    /// The same image, black in some rectangles, which are counted from its corner.
    ///
    /// # Panics
    /// If one does not lie in the image.
    #[must_use]
    pub fn blackened(mut self, windows: &[Window]) -> Self {
        for window in windows {
            let (x, y) = (window.origin.0 as usize, window.origin.1 as usize);
            for channel in &mut self.rgb {
                let rows = channel.chunks_exact_mut(self.size.0).skip(y).take(window.size.1);
                rows.for_each(|row| row[x..x + window.size.0].fill(0.0));
            }
        }
        self
    }

    /// How much of each pixel is covered, if anybody knows.
    pub fn alpha(&self) -> Option<&[f32]> {
        self.alpha.as_deref()
    }

    /// What the file calls the channels.
    pub fn channels(&self) -> &[String; 3] {
        &self.channels
    }

    /// Where its pixels are, if anybody knows.
    pub fn window(&self) -> Option<Window> {
        Some(Window { origin: self.origin?, size: self.size })
    }

    /// The pixels of a window that lies in the image's own.
    ///
    /// # Panics
    /// If it does not, or nobody knows where the image is.
    #[must_use]
    pub fn within(&self, window: Window) -> Self {
        let own = self.window().expect("an image with a place");
        assert_eq!(own.overlap(&window), Some(window), "a window in the image");
        let x = window.origin.0.abs_diff(own.origin.0) as usize;
        let y = window.origin.1.abs_diff(own.origin.1) as usize;
        let rows = |samples: &Vec<f32>| {
            let rows = samples.chunks_exact(self.size.0).skip(y).take(window.size.1);
            rows.flat_map(|row| &row[x..x + window.size.0]).copied().collect()
        };
        let (rgb, alpha) = (self.rgb.each_ref().map(rows), self.alpha.as_ref().map(rows));
        Self { size: window.size, rgb, alpha, origin: Some(window.origin), ..self.clone() }
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
