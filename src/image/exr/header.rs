//! What a file holds, without decoding a pixel.

use std::fmt;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use exr::block::reader::Reader;
use exr::meta::attribute::{AttributeValue, IntegerBounds, SampleType, Text};
use exr::meta::header::{ImageAttributes, LayerAttributes};

use super::guard::guarded;
use crate::image::ImageError;
use crate::image::error::listing;

/// More pixels than this are refused before anything is allocated (16384²).
const MAX_PIXELS: usize = 1 << 28;

/// A file's parts and channels.
#[derive(Clone, Debug)]
pub struct Header {
    path: PathBuf,
    parts: Vec<Part>,
    samples_per_pixel: Option<u32>,
}

/// One part ("layer" in the `exr` crate's words): channels that share a size.
#[derive(Clone, Debug)]
pub struct Part {
    /// The part's name, if it has one.
    pub name: Option<String>,
    /// Width and height of the data window.
    pub size: (usize, usize),
    /// Top left corner of the data window.
    pub origin: (i32, i32),
    /// Compression, for people.
    pub compression: String,
    /// Whether the pixels stand in tiles.
    pub tiled: bool,
    /// The channels, in the file's order.
    pub channels: Vec<Channel>,
}

impl Part {
    /// Size and place of the data window, for people.
    pub fn window(&self) -> String {
        let ((w, h), (x, y)) = (self.size, self.origin);
        if (x, y) == (0, 0) { format!("{w}x{h}") } else { format!("{w}x{h} at ({x}, {y})") }
    }
}

/// One channel.
#[derive(Clone, Debug)]
pub struct Channel {
    /// The full name: see the [module's documentation](super).
    pub name: String,
    /// How its samples are stored.
    pub kind: SampleKind,
}

/// How samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleKind {
    /// 16-bit floating point.
    Half,
    /// 32-bit floating point.
    Float,
    /// 32-bit unsigned integer.
    Uint,
}

impl fmt::Display for SampleKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Half => "half",
            Self::Float => "float",
            Self::Uint => "uint",
        })
    }
}

/// What an image says about itself beside its pixels: windows, pixel aspect,
/// chromaticities, camera. Taken along from the noisy file to the filtered one.
#[derive(Clone, Debug)]
pub struct Attributes {
    pub(super) shared: ImageAttributes,
    pub(super) own: LayerAttributes,
}

impl Attributes {
    /// Keeps what stays true of a filtered RGB image. Names of parts and views,
    /// previews and unknown attributes (cryptomatte manifests, …) describe the
    /// source file, not the result.
    pub(super) fn of(header: &exr::meta::header::Header) -> Self {
        let own = LayerAttributes {
            layer_name: None,
            view_name: None,
            multi_view_names: None,
            preview: None,
            deep_image_state: None,
            other: Default::default(),
            ..header.own_attributes.clone()
        };
        let mut kept = Self { shared: header.shared_attributes.clone(), own };
        kept.mend(header.data_window());
        kept
    }
}

impl Attributes {
    /// Replaces what readers accept but no writer may write.
    fn mend(&mut self, data_window: IntegerBounds) {
        let Self { shared, own } = self;
        if !(1e-6..=1e6).contains(&shared.pixel_aspect) {
            shared.pixel_aspect = 1.0;
        }
        if shared.display_window.size.0 == 0 || shared.display_window.size.1 == 0 {
            shared.display_window = data_window;
        }
        if own.screen_window_width.is_nan() || own.screen_window_width < 0.0 {
            own.screen_window_width = 1.0;
        }
    }
}

impl Header {
    /// A listing made up for a test: a single part with these channels.
    #[cfg(test)]
    pub(crate) fn made(names: &[&str], samples_per_pixel: Option<u32>) -> Self {
        let channel = |name: &&str| Channel { name: (*name).to_owned(), kind: SampleKind::Half };
        let part = Part {
            name: None,
            size: (1, 1),
            origin: (0, 0),
            compression: "none".to_owned(),
            tiled: false,
            channels: names.iter().map(channel).collect(),
        };
        Self { path: PathBuf::from("made.exr"), parts: vec![part], samples_per_pixel }
    }

    /// Reads the listing of the file at `path`.
    ///
    /// # Errors
    /// If the file cannot be opened or is no OpenEXR file.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        Ok(Self::of(path, open(path)?.headers()))
    }

    pub(super) fn of(path: &Path, headers: &[exr::meta::header::Header]) -> Self {
        let parts = headers.iter().map(|header| part(header, headers.len() > 1)).collect();
        let samples_per_pixel = headers.iter().find_map(samples_per_pixel);
        Self { path: path.to_owned(), parts, samples_per_pixel }
    }

    /// Whose listing this is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The parts, in the file's order.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// The file's own statement of its samples per pixel (pbrt-v4 and Blender write one).
    pub fn samples_per_pixel(&self) -> Option<u32> {
        self.samples_per_pixel
    }

    /// The full names of all channels, in the file's order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.parts.iter().flat_map(|part| &part.channels).map(|channel| channel.name.as_str())
    }

    /// All channel names as one text, for error messages.
    pub fn listing(&self) -> String {
        listing(self.names())
    }

    /// Part and position in that part of the channel with this full name; of
    /// several, the first.
    pub fn find(&self, name: &str) -> Option<(usize, usize)> {
        self.parts.iter().enumerate().find_map(|(p, part)| {
            part.channels.iter().position(|channel| channel.name == name).map(|c| (p, c))
        })
    }
}

/// Opens a file and reads its headers, which are then known to be plausible:
/// no size in them is out of proportion to the file's length.
pub(super) fn open(path: &Path) -> Result<Reader<BufReader<File>>, ImageError> {
    let io = |action| move |source| ImageError::Io { path: path.to_owned(), action, source };
    let file = File::open(path).map_err(io("open"))?;
    let metadata = file.metadata().map_err(io("inspect"))?;
    if metadata.is_dir() {
        return Err(ImageError::Unsupported {
            path: path.to_owned(),
            what: "is a folder where an OpenEXR file is expected".to_owned(),
            advice: "name the file inside it",
        });
    }
    let reader =
        guarded(path, || exr::block::read(BufReader::new(file), false)).map_err(|error| {
            match error {
                // The crate's wording for a wrong magic number, or none at all.
                ImageError::Corrupt { detail, .. } if detail.contains("file identifier") => {
                    ImageError::NotExr { path: path.to_owned() }
                }
                other => other,
            }
        })?;
    for header in reader.headers() {
        plausible(path, header, metadata.len())?;
    }
    Ok(reader)
}

/// Refuses sizes that the file cannot hold, before they are allocated.
fn plausible(
    path: &Path,
    header: &exr::meta::header::Header,
    file_bytes: u64,
) -> Result<(), ImageError> {
    let (width, height) = (header.layer_size.0, header.layer_size.1);
    let corrupt = |detail: String| ImageError::Corrupt { path: path.to_owned(), detail };
    if width == 0 || height == 0 {
        return Err(corrupt(format!("the data window is {width}x{height}")));
    }
    if width.checked_mul(height).is_none_or(|pixels| pixels > MAX_PIXELS) {
        return Err(ImageError::Unsupported {
            path: path.to_owned(),
            what: format!("the image is {width}x{height} pixels, more than 2^28"),
            advice: "cut it into smaller images",
        });
    }
    // Every chunk has an eight-byte entry in the offset table.
    if (header.chunk_count as u64).saturating_mul(8) > file_bytes {
        return Err(corrupt(format!(
            "{} chunks are declared in {file_bytes} bytes",
            header.chunk_count
        )));
    }
    Ok(())
}

fn part(header: &exr::meta::header::Header, several: bool) -> Part {
    let name = header.own_attributes.layer_name.as_ref().map(Text::to_string);
    let prefix = name.as_deref().filter(|name| several && !name.is_empty());
    let channels = header.channels.list.iter().map(|channel| Channel {
        name: full_name(prefix, &channel.name.to_string()),
        kind: match channel.sample_type {
            SampleType::F16 => SampleKind::Half,
            SampleType::F32 => SampleKind::Float,
            SampleType::U32 => SampleKind::Uint,
        },
    });
    Part {
        size: (header.layer_size.0, header.layer_size.1),
        origin: (header.own_attributes.layer_position.0, header.own_attributes.layer_position.1),
        compression: header.compression.to_string(),
        tiled: header.blocks.has_tiles(),
        channels: channels.collect(),
        name,
    }
}

fn full_name(part: Option<&str>, channel: &str) -> String {
    match part {
        None => channel.to_owned(),
        Some(part) => match channel.strip_prefix(part) {
            Some(rest) if rest.starts_with('.') => channel.to_owned(),
            Some(_) | None => format!("{part}.{channel}"),
        },
    }
}

fn samples_per_pixel(header: &exr::meta::header::Header) -> Option<u32> {
    let mut attributes =
        header.own_attributes.other.iter().chain(header.shared_attributes.other.iter());
    attributes.find_map(|(name, value)| {
        let samples = match value {
            AttributeValue::I32(samples) if name.eq("samplesPerPixel") => {
                u32::try_from(*samples).ok()
            }
            // Blender's `cycles.VIEW_LAYER.samples`.
            AttributeValue::Text(samples) => {
                let name = name.to_string();
                let layer =
                    name.strip_prefix("cycles.").and_then(|rest| rest.strip_suffix(".samples"));
                layer.and_then(|_| samples.to_string().trim().parse().ok())
            }
            _ => None,
        };
        samples.filter(|&samples| samples > 0)
    })
}

#[cfg(test)]
mod tests {
    use exr::meta::header::Header;
    use exr::prelude::{ChannelDescription, SmallVec};

    use super::*;

    #[test]
    fn files_say_how_many_samples_they_have_in_two_ways() {
        let said = |name: &str, value: AttributeValue| {
            let channel = ChannelDescription::named("R", SampleType::F32);
            let mut header =
                Header::new(Text::from("made"), (2, 2), SmallVec::from_iter([channel]));
            header.own_attributes.other.insert(Text::from(name), value);
            samples_per_pixel(&header)
        };
        let text = |text: &str| AttributeValue::Text(Text::from(text));
        assert_eq!(said("samplesPerPixel", AttributeValue::I32(16)), Some(16));
        assert_eq!(said("samplesPerPixel", AttributeValue::I32(-1)), None);
        assert_eq!(said("cycles.ViewLayer.samples", text("128")), Some(128));
        assert_eq!(said("cycles.ViewLayer.samples", text("many")), None);
        assert_eq!(said("cycles.ViewLayer.synchronization_time", text("128")), None);
        assert_eq!(said("samples", text("128")), None);
    }
}
