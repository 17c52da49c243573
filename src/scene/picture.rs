//! The colour of a file as an image: results and references.

use std::path::Path;

use super::SceneError;
use super::mapping::Mapping;
use crate::image::Image;
use crate::image::exr::{Header, read_channels};

/// Reads the colour of a file (bare `R G B` or what its renderer calls the image), and no
/// other channel. Samples are taken as they are.
///
/// # Errors
/// If the file cannot be read or has no colour.
pub fn load_image(path: &Path) -> Result<Image, SceneError> {
    let header = Header::read(path)?;
    let mapping = Mapping::of(&header);
    let names = &mapping.color(&header)?.channels;
    let mut pixels = read_channels(path, names)?;
    let mut next = names
        .iter()
        .map(|name| pixels.channels.remove(name).expect("read_channels returns what was wanted"));
    let rgb = std::array::from_fn(|_| next.next().expect("a colour has three channels"));
    drop(next);
    let image = Image::new(&path.display().to_string(), pixels.width, pixels.height, rgb)
        .expect("a file has one sample per pixel and channel");
    let channels = std::array::from_fn(|k| names[k].clone());
    Ok(image.with_channels(channels).with_attributes(Some(&pixels.attributes)))
}

/// Reads an image that others are to be measured against, as [`load_image`] does.
///
/// # Errors
/// Those of [`load_image`], and of [`Image::check_reference`].
pub fn load_reference(path: &Path) -> Result<Image, SceneError> {
    let image = load_image(path)?;
    image.check_reference()?;
    Ok(image)
}
