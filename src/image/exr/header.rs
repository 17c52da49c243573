//! What a file holds, without decoding a pixel.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use exr::meta::attribute::{AttributeValue, IntegerBounds, SampleType, Text};
use exr::meta::header::{ImageAttributes, LayerAttributes};

use crate::image::error::listing;
use crate::image::files::Format;

/// A file's parts and channels.
#[derive(Clone, Debug)]
pub struct Header {
    path: PathBuf,
    format: Format,
    is_encoded: bool,
    display: Window,
    parts: Vec<Part>,
    views: Vec<String>,
    samples_per_pixel: Option<u32>,
}

/// One part ("layer" in the `exr` crate's words): channels that share a size.
#[derive(Clone, Debug)]
pub struct Part {
    /// The part's name, if it has one.
    pub name: Option<String>,
    /// The part's view, if it says so.
    pub view: Option<String>,
    /// The data window: where its pixels are.
    pub window: Window,
    /// Compression, for people.
    pub compression: String,
    /// Whether the pixels stand in tiles.
    pub tiled: bool,
    /// Whether a pixel may have several samples at several depths: such parts are not read.
    pub deep: bool,
    /// The channels, in the file's order.
    pub channels: Vec<Channel>,
}

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Its top left corner.
    pub origin: (i32, i32),
    /// Width and height.
    pub size: (usize, usize),
}

impl Window {
    /// A window of this size that begins at (0, 0).
    pub fn of_size(size: (usize, usize)) -> Self {
        Self { origin: (0, 0), size }
    }

    /// How many pixels it has.
    pub fn pixels(&self) -> usize {
        self.size.0 * self.size.1
    }

    /// The pixels that both have, if there are any.
    pub fn overlap(&self, other: &Self) -> Option<Self> {
        let along = |pick: fn(&Self) -> (i32, usize)| {
            let ((a, n), (b, m)) = (pick(self), pick(other));
            let begin = i64::from(a.max(b));
            let end = (i64::from(a) + n as i64).min(i64::from(b) + m as i64);
            (end > begin).then(|| (a.max(b), (end - begin) as usize))
        };
        let (x, width) = along(|window| (window.origin.0, window.size.0))?;
        let (y, height) = along(|window| (window.origin.1, window.size.1))?;
        Some(Self { origin: (x, y), size: (width, height) })
    }
}

impl fmt::Display for Window {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ((w, h), (x, y)) = (self.size, self.origin);
        match (x, y) {
            (0, 0) => write!(f, "{w}x{h}"),
            _ => write!(f, "{w}x{h} at ({x}, {y})"),
        }
    }
}

/// How the bytes of a row of a chunk are shared out.
pub(super) struct Row {
    /// All of them.
    pub(super) bytes: usize,
    /// Those of each channel of the part, in its order; none of what has no sample in this row.
    pub(super) channels: Vec<Range<usize>>,
}

impl Part {
    /// Whether a channel has fewer samples than pixels.
    pub fn is_subsampled(&self) -> bool {
        self.channels.iter().any(|channel| channel.sampling != (1, 1))
    }

    /// The layout of a row, which counts from the window's first; so many pixels of it. Where
    /// there are tiles, each channel has every sample.
    pub(super) fn row(&self, y: usize, width: usize) -> Row {
        let mut begin = 0;
        let channels = self.channels.iter().map(|channel| {
            let (every, line) = (channel.sampling.0 as i64, channel.sampling.1 as i64);
            let (left, top) = (i64::from(self.window.origin.0), i64::from(self.window.origin.1));
            let samples = match (every, line) {
                (1, 1) => width,
                _ if (top + y as i64).rem_euclid(line) != 0 => 0,
                _ => {
                    let upto = |x: i64| x.div_euclid(every);
                    (upto(left + width as i64 - 1) - upto(left - 1)) as usize
                }
            };
            let range = begin..begin + samples * channel.kind.bytes();
            begin = range.end;
            range
        });
        let channels = channels.collect();
        Row { bytes: begin, channels }
    }
}

/// One channel.
#[derive(Clone, Debug)]
pub struct Channel {
    /// The full name: see the [module's documentation](super).
    pub name: String,
    /// How its samples are stored.
    pub kind: SampleKind,
    /// Every how many pixels of a row, and rows, there is a sample.
    pub sampling: (usize, usize),
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
        let channel = |name: &&str| Channel {
            name: (*name).to_owned(),
            kind: SampleKind::Half,
            sampling: (1, 1),
        };
        let display = Window::of_size((1, 1));
        let part = Part {
            name: None,
            view: None,
            window: display,
            compression: "none".to_owned(),
            tiled: false,
            deep: false,
            channels: names.iter().map(channel).collect(),
        };
        let path = PathBuf::from("made.exr");
        let format = Format::Exr;
        let (views, is_encoded) = (Vec::new(), false);
        let parts = vec![part];
        Self { path, format, is_encoded, display, parts, views, samples_per_pixel }
    }

    /// The listing of a file of another format: a single part.
    pub(in crate::image) fn of_picture(
        path: &Path,
        format: Format,
        is_encoded: bool,
        size: (usize, usize),
        channels: &[&str],
    ) -> Self {
        let channel = |name: &&str| Channel {
            name: (*name).to_owned(),
            kind: SampleKind::Float,
            sampling: (1, 1),
        };
        let display = Window::of_size(size);
        let part = Part {
            name: None,
            view: None,
            window: display,
            compression: format.name().to_owned(),
            tiled: false,
            deep: false,
            channels: channels.iter().map(channel).collect(),
        };
        Self {
            path: path.to_owned(),
            format,
            is_encoded,
            display,
            parts: vec![part],
            views: Vec::new(),
            samples_per_pixel: None,
        }
    }

    /// What the headers of the file at `path` say.
    pub(super) fn of_headers(path: &Path, headers: &[exr::meta::header::Header]) -> Self {
        let parts = headers.iter().map(|header| part(header, headers.len() > 1)).collect();
        let samples_per_pixel = headers.iter().find_map(samples_per_pixel);
        let views = views(headers);
        let (path, format) = (path.to_owned(), Format::Exr);
        let shown = headers.first().map(|header| header.shared_attributes.display_window);
        let display = shown.map_or(Window::of_size((0, 0)), |shown| Window {
            origin: (shown.position.0, shown.position.1),
            size: (shown.size.0, shown.size.1),
        });
        Self { path, format, is_encoded: false, display, parts, views, samples_per_pixel }
    }

    /// Whose listing this is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the file is.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Whether samples are those of a display: sRGB, from 0 to 1.
    pub fn is_encoded(&self) -> bool {
        self.is_encoded
    }

    /// The display window: the picture's frame, which data windows may fill in part or exceed.
    /// Pictures of formats without one fill theirs.
    pub fn display(&self) -> Window {
        self.display
    }

    /// The parts, in the file's order.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// The views, the main one first; none if the file does not speak of views.
    pub fn views(&self) -> &[String] {
        &self.views
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

fn part(header: &exr::meta::header::Header, several: bool) -> Part {
    let name = header.own_attributes.layer_name.as_ref().map(text);
    let prefix = name.as_deref().filter(|name| several && !name.is_empty());
    let view = header.own_attributes.view_name.as_ref().map(text);
    let channels = header.channels.list.iter().map(|channel| Channel {
        name: full_name(prefix, view.as_deref(), &text(&channel.name)),
        kind: match channel.sample_type {
            SampleType::F16 => SampleKind::Half,
            SampleType::F32 => SampleKind::Float,
            SampleType::U32 => SampleKind::Uint,
        },
        sampling: (channel.sampling.0, channel.sampling.1),
    });
    let (size, origin) = (header.layer_size, header.own_attributes.layer_position);
    Part {
        window: Window { origin: (origin.0, origin.1), size: (size.0, size.1) },
        deep: header.deep,
        compression: header.compression.to_string(),
        tiled: header.blocks.has_tiles(),
        channels: channels.collect(),
        name,
        view,
    }
}

/// A text of the file, which says in no encoding what it is; in most it is UTF-8.
fn text(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

fn full_name(part: Option<&str>, view: Option<&str>, channel: &str) -> String {
    // Blender's part `ViewLayer.Combined-left` has the channel `ViewLayer.Combined.R`.
    let viewless = part.zip(view).and_then(|(part, view)| {
        let layer = part.strip_suffix(view)?.strip_suffix(['-', '_', '.'])?;
        Some((part, channel.strip_prefix(layer).filter(|rest| rest.starts_with('.'))?))
    });
    if let Some((part, rest)) = viewless {
        return format!("{part}{rest}");
    }
    match part {
        None => channel.to_owned(),
        // Upper and lower case tell no layers apart: see `scene::naming`.
        Some(part) => match channel.get(..part.len()) {
            Some(begin)
                if begin.eq_ignore_ascii_case(part) && channel[part.len()..].starts_with('.') =>
            {
                channel.to_owned()
            }
            Some(_) | None => format!("{part}.{channel}"),
        },
    }
}

/// The views of a file: what a single part lists, or each part's own.
fn views(headers: &[exr::meta::header::Header]) -> Vec<String> {
    let mut views: Vec<String> = Vec::new();
    for header in headers {
        let own = header.own_attributes.view_name.iter();
        let listed = header.own_attributes.multi_view_names.iter().flatten();
        for view in own.chain(listed).map(text) {
            if !views.contains(&view) {
                views.push(view);
            }
        }
    }
    views
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
