//! Small OpenEXR files for tests, made by the `exr` crate itself.

use std::path::PathBuf;

use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, Layer, Layers};
use exr::math::Vec2;
use exr::meta::attribute::{IntegerBounds, LineOrder, Text};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{Compression, WritableImage};

/// A part to be written.
pub(crate) struct PartOf {
    pub(crate) name: Option<&'static str>,
    pub(crate) size: (usize, usize),
    pub(crate) origin: (i32, i32),
    pub(crate) encoding: Encoding,
    pub(crate) channels: Vec<(String, FlatSamples)>,
}

pub(crate) fn part(size: (usize, usize)) -> PartOf {
    PartOf {
        name: None,
        size,
        origin: (0, 0),
        encoding: scan_lines(Compression::ZIP16),
        channels: Vec::new(),
    }
}

pub(crate) fn scan_lines(compression: Compression) -> Encoding {
    Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing }
}

pub(crate) fn tiles(compression: Compression, size: (usize, usize)) -> Encoding {
    let blocks = Blocks::Tiles(Vec2(size.0, size.1));
    Encoding { compression, blocks, line_order: LineOrder::Increasing }
}

impl PartOf {
    pub(crate) fn with(mut self, name: &str, samples: Vec<f32>) -> Self {
        self.channels.push((name.to_owned(), FlatSamples::F32(samples)));
        self
    }

    /// Every channel of this size, filled by a function of channel and pixel.
    pub(crate) fn filled(mut self, names: &[&str], f: impl Fn(usize, usize) -> f32) -> Self {
        let pixels = self.size.0 * self.size.1;
        for (k, name) in names.iter().enumerate() {
            self = self.with(name, (0..pixels).map(|i| f(k, i)).collect());
        }
        self
    }
}

/// A file that lives as long as its folder.
pub(crate) struct File {
    pub(crate) path: PathBuf,
    pub(crate) folder: tempfile::TempDir,
}

impl File {
    pub(crate) fn bytes(&self) -> Vec<u8> {
        std::fs::read(&self.path).expect("the file was written")
    }

    pub(crate) fn replace(&self, bytes: &[u8]) {
        std::fs::write(&self.path, bytes).expect("a temporary folder is writable");
    }
}

/// Writes parts to a file in a temporary folder.
pub(crate) fn file(parts: Vec<PartOf>) -> File {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("sample.exr");
    let window = IntegerBounds::from_dimensions(parts[0].size);
    let mut layers: Layers<AnyChannels<FlatSamples>> = Layers::new();
    for part in parts {
        let channels = part
            .channels
            .into_iter()
            .map(|(name, samples)| AnyChannel::new(Text::from(name.as_str()), samples));
        let own = LayerAttributes {
            layer_name: part.name.map(Text::from),
            layer_position: Vec2(part.origin.0, part.origin.1),
            ..LayerAttributes::default()
        };
        let channels = AnyChannels::sort(channels.collect());
        layers.push(Layer::new(part.size, own, part.encoding, channels));
    }
    let image = Image::from_layers(ImageAttributes::new(window), layers);
    image.write().to_file(&path).expect("a sound image");
    File { path, folder }
}
