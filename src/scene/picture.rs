//! The colour of a file as an image: results and references.

use std::path::Path;

use super::SceneError;
use super::raw::RawScene;
use super::target::Target;
use super::{LoadOptions, Needs};
use crate::expr::feature::{Feature, Quantity};
use crate::image::Image;
use crate::image::files::Format;

/// Reads the colour of a file (bare `R G B` or what its renderer calls the image), and no
/// other channel. Samples are taken as they are.
///
/// # Errors
/// If the file cannot be read or has no colour.
pub fn load_image(path: &Path) -> Result<Image, SceneError> {
    let target = Target::of(path)?;
    let raw = RawScene::of(&target, &[], &Needs::nothing(), &LoadOptions::default())?;
    let window = target.window()?;
    let has_place = target.listing().header().format() == Format::Exr;
    let channels = target.color_channels()?;
    let attributes = raw.origin.attributes;
    let mut features = raw.features;
    let color = features.remove(&(Feature::Color, Quantity::Value));
    let rgb = color.and_then(|color| color.try_into().ok()).expect("a colour has three channels");
    let image = Image::new(&path.display().to_string(), raw.width, raw.height, rgb)
        .expect("a file has one sample per pixel and channel");
    let image = image.with_channels(channels).with_attributes(attributes.as_ref());
    Ok(if has_place { image.with_origin(window.origin) } else { image })
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
