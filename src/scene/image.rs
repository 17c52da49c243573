//! Plain RGB images: references, results.

use std::path::Path;

use super::SceneError;
use super::exr::{Attributes, Header, read_channels, write_rgb};
use super::mapping::Mapping;
use super::repair;

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

    /// Reads the colour of a file (bare `R G B` or what its renderer calls the
    /// image), and no other channel. Samples are taken as they are.
    ///
    /// # Errors
    /// If the file cannot be read or has no colour.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let header = Header::read(path)?;
        let mapping = Mapping::of(&header);
        let names = &mapping.color(&header)?.channels;
        let mut pixels = read_channels(path, names)?;
        let mut next = names.iter().map(|name| {
            pixels.channels.remove(name).expect("read_channels returns what was wanted")
        });
        let rgb = std::array::from_fn(|_| next.next().expect("a colour has three channels"));
        drop(next);
        Ok(Self {
            name: path.display().to_string(),
            size: (pixels.width, pixels.height),
            rgb,
            channels: std::array::from_fn(|k| names[k].clone()),
            attributes: Some(pixels.attributes),
        })
    }

    /// Reads an image that others are to be measured against, as [`load`](Self::load)
    /// does.
    ///
    /// # Errors
    /// Those of [`load`](Self::load), and of [`check_reference`](Self::check_reference).
    pub fn load_reference(path: &Path) -> Result<Self, SceneError> {
        let image = Self::load(path)?;
        image.check_reference()?;
        Ok(image)
    }

    /// Checks that other images can be measured against this one: a single pixel that is
    /// no number would make the error of each of them infinite, so that none is better
    /// than another. Nothing is repaired, as a made-up value is no truth.
    ///
    /// # Errors
    /// If a sample is not finite or beyond ±1e18.
    pub fn check_reference(&self) -> Result<(), SceneError> {
        for (channel, samples) in self.channels.iter().zip(&self.rgb) {
            if let Some(bad) = repair::find(samples) {
                return Err(SceneError::BadReference {
                    image: self.name.clone(),
                    channel: channel.clone(),
                    count: bad.count,
                    first: (bad.first[0] % self.size.0, bad.first[0] / self.size.0),
                });
            }
        }
        Ok(())
    }

    /// Writes the image as an OpenEXR file, with the attributes it was read with.
    ///
    /// # Errors
    /// If the file cannot be written; it then is as it was before.
    pub fn save(&self, path: &Path) -> Result<(), SceneError> {
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
