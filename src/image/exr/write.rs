//! RGB images out.

use std::path::Path;

use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer};
use exr::math::Vec2;
use exr::meta::attribute::{IntegerBounds, LineOrder};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{Compression, SmallVec, WritableImage};

use super::guard::guarded;
use super::header::Attributes;
use crate::image::ImageError;
use crate::image::output::write_through;

/// Writes an RGB image (float, ZIP, scan lines), taking along what `attributes`
/// of the source image still says truly of it. The file appears complete or not
/// at all.
///
/// # Errors
/// If the file cannot be written.
///
/// # Panics
/// If a channel does not hold `width * height` samples.
pub fn write_rgb(
    path: &Path,
    (width, height): (usize, usize),
    rgb: [&[f32]; 3],
    attributes: Option<&Attributes>,
) -> Result<(), ImageError> {
    for channel in rgb {
        assert_eq!(channel.len(), width * height, "one sample per pixel and channel");
    }
    let (shared, own) = match attributes {
        Some(source) => (source.shared.clone(), source.own.clone()),
        None => {
            let window = IntegerBounds::from_dimensions((width, height));
            (ImageAttributes::new(window), LayerAttributes::default())
        }
    };
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = ["R", "G", "B"]
        .into_iter()
        .zip(rgb)
        .map(|(name, samples)| AnyChannel::new(name, FlatSamples::F32(samples.to_vec())))
        .collect();
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: exr::image::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new(Vec2(width, height), own, encoding, AnyChannels::sort(channels));
    let mut image = Image::from_layer(layer);
    image.attributes = shared;

    write_through(path, |file| {
        guarded(path, || image.write().to_buffered(file)).map_err(|error| match error {
            ImageError::Io { path, source, .. } => ImageError::Io { path, action: "write", source },
            other => other,
        })
    })
}
