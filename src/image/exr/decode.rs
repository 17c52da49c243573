//! Chosen channels as `f32`.
//!
//! Liveness reaches down to here: parts that hold no wanted channel are skipped
//! in the file without being read, and of the chunks that are decompressed only
//! the wanted channels' samples are converted and stored. (OpenEXR compresses
//! the channels of a part together, so within a part there is no smaller unit.)
//!
//! Chunks are decompressed and converted on all threads of the global pool, a
//! batch at a time, so that what is in flight stays small beside the result.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

use exr::meta::TileIndices;
use half::f16;
use rayon::prelude::*;

use super::header::{Attributes, Header, SampleKind, Window};
use super::source::{RawChunk, Source};
use crate::image::ImageError;

/// Chunks in flight at a time, at most, and what they may take when they are decompressed:
/// as much as keeps all threads busy, and little beside an image that is large.
const BATCH: usize = 256;
const BATCH_BYTES: usize = 64 << 20;
/// No compression of OpenEXR shrinks pixels by more than this factor; a file
/// that claims more lies about its size. (Deflate reaches 1030:1; DWA applies
/// it to one coefficient of 64.)
const MAX_RATIO: u64 = 1 << 17;

/// What becomes of renders that were not finished.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unfinished {
    /// They are refused.
    #[default]
    Refused,
    /// What is missing is zero, and [`Decoded::missing`] says where.
    Zero,
}

/// Decoded channels of one size.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// By full name, row by row without padding.
    pub channels: BTreeMap<String, Vec<f32>>,
    /// What the first wanted channel's part says beside its pixels; nothing in formats that
    /// have no such thing.
    pub attributes: Option<Attributes>,
    /// Rows of parts that are read, in which a pixel is missing.
    pub missing_rows: usize,
}

/// Where decoded samples go.
pub trait Sink {
    /// So many channels of this size are about to come.
    ///
    /// # Errors
    /// If there is no room for them.
    fn begin(&mut self, channels: usize, size: (usize, usize)) -> Result<(), ImageError>;

    /// A part of a row of a channel, which begins at this pixel of the image, counted row by
    /// row.
    ///
    /// # Errors
    /// If it cannot be kept.
    fn line(&mut self, channel: usize, start: usize, samples: &[f32]) -> Result<(), ImageError>;
}

/// What was decoded, beside the samples.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The full names of the channels, in the order in which the sink counts them.
    pub names: Vec<String>,
    /// What the first wanted channel's part says beside its pixels; nothing in formats that
    /// have no such thing.
    pub attributes: Option<Attributes>,
    /// Of each channel, in the order of `names`, the pixels of the window that its part should
    /// hold and the file lacks: rectangles that do not overlap, counted from the window's corner.
    pub missing: Vec<Vec<Window>>,
    /// Rows of parts that are read, in which a pixel is missing.
    pub missing_rows: usize,
}

/// Decodes the channels with the given full names, and no others, within a window; if none is
/// given, the data window of the first. They are given away line by line. What they have
/// outside of the window is left out; what they lack is not given, and so is zero.
///
/// # Errors
/// If the file cannot be read, lacks one of them, or holds them in a form that is not read; and
/// the sink's.
///
/// # Panics
/// If `wanted` is empty.
pub fn decode_channels<S: AsRef<str>>(
    path: &Path,
    wanted: &[S],
    window: Option<Window>,
    unfinished: Unfinished,
    sink: &mut dyn Sink,
) -> Result<Decoded, ImageError> {
    let mut source = Source::open(path)?;
    let header = source.listing();
    let places = locate(&header, wanted)?;
    let first = places.first().expect("callers want at least the colour").part;
    let attributes = Some(Attributes::of(&source.headers()[first]));
    let window = window.unwrap_or(header.parts()[first].window);
    check_size(path, places.len(), window.pixels())?;
    sink.begin(places.len(), window.size)?;

    let live: HashSet<usize> = places.iter().map(|place| place.part).collect();
    // In the order of the file, so that it is read from one end to the other.
    let mut chunks: Vec<(u64, usize, usize)> = Vec::new();
    for &part in &live {
        let table = source.table(part).iter().enumerate();
        chunks.extend(table.map(|(number, &at)| (at, part, number)));
    }
    chunks.sort_unstable();
    let largest = live.iter().map(|&part| source.headers()[part].max_block_byte_size()).max();
    let most = (BATCH_BYTES / largest.unwrap_or(1).max(1)).min(BATCH);
    let most = most.max(rayon::current_num_threads());
    let mut seen: HashSet<(usize, usize, usize)> = HashSet::new();
    let mut pixels = 0;
    for numbers in chunks.chunks(most) {
        let mut batch: Vec<RawChunk> = Vec::with_capacity(numbers.len());
        for &(_, part, number) in numbers {
            let chunk = source.chunk(part, number)?;
            batch.extend(chunk.filter(RawChunk::is_full_resolution));
        }
        let bands: Vec<Band> = batch
            .into_par_iter()
            .map(|chunk| convert(&source, &chunk, &header, &places))
            .collect::<Result<_, _>>()?;
        for band in bands {
            // The offset table names each block once; a chunk that says it is another
            // block leaves a hole where it should have been.
            if seen.insert((band.part, band.x, band.y)) {
                pixels += band.pixels;
                let home = header.parts()[band.part].window;
                band.scatter(&home, &window, sink)?;
            }
        }
    }
    let expected: usize = live.iter().map(|&part| header.parts()[part].window.pixels()).sum();
    let mut holes: HashMap<usize, Vec<Window>> = HashMap::new();
    if pixels != expected {
        holes.extend(live.iter().map(|&part| (part, unseen(&source, part, &seen))));
    }
    let rows = holes.iter().flat_map(|(&part, holes)| {
        let rows = |hole: &Window| hole.origin.1..hole.origin.1 + hole.size.1 as i32;
        holes.iter().flat_map(rows).map(move |y| (part, y))
    });
    let missing_rows = rows.collect::<HashSet<_>>().len();
    if missing_rows > 0 && unfinished == Unfinished::Refused {
        let rows = live.iter().map(|&part| header.parts()[part].window.size.1).sum();
        return Err(ImageError::Unfinished { path: path.to_owned(), missing: missing_rows, rows });
    }
    let missing = places.iter().map(|place| {
        let home = header.parts()[place.part].window;
        let holes = holes.get(&place.part).into_iter().flatten();
        holes.filter_map(|hole| in_window(hole, &home, &window)).collect()
    });
    Ok(Decoded {
        width: window.size.0,
        height: window.size.1,
        missing: missing.collect(),
        names: places.into_iter().map(|place| place.name).collect(),
        attributes,
        missing_rows,
    })
}

/// The blocks of full resolution of a part that were not seen, counted from its corner.
fn unseen(source: &Source, part: usize, seen: &HashSet<(usize, usize, usize)>) -> Vec<Window> {
    let header = &source.headers()[part];
    let block = |tile: TileIndices| {
        let level = tile.location.level_index;
        let bounds = header.get_absolute_block_pixel_coordinates(tile.location).ok()?;
        let (x, y) = (bounds.position.0, bounds.position.1);
        let is_missing =
            (level.0, level.1) == (0, 0) && !seen.contains(&(part, x as usize, y as usize));
        is_missing.then_some(Window { origin: (x, y), size: (bounds.size.0, bounds.size.1) })
    };
    header.blocks_increasing_y_order().filter_map(block).collect()
}

/// What of a rectangle of a part lies in a window, counted from the window's corner.
fn in_window(rect: &Window, home: &Window, window: &Window) -> Option<Window> {
    let add = |a: (i32, i32), b: (i32, i32)| (a.0.saturating_add(b.0), a.1.saturating_add(b.1));
    let placed = Window { origin: add(rect.origin, home.origin), size: rect.size };
    let both = placed.overlap(window)?;
    let from = |a: i32, b: i32| a.abs_diff(b) as i32;
    let origin = (from(both.origin.0, window.origin.0), from(both.origin.1, window.origin.1));
    Some(Window { origin, size: both.size })
}

/// Samples kept in memory.
pub(crate) struct Memory<'a> {
    path: &'a Path,
    planes: Vec<Vec<f32>>,
}

impl<'a> Memory<'a> {
    /// For samples of this file.
    pub(crate) fn of(path: &'a Path) -> Self {
        Self { path, planes: Vec::new() }
    }

    /// The samples of each channel.
    pub(crate) fn into_planes(self) -> Vec<Vec<f32>> {
        self.planes
    }

    /// What was decoded, with its samples.
    pub(in crate::image) fn pixels(self, decoded: Decoded) -> Pixels {
        let Decoded { width, height, names, attributes, missing_rows, .. } = decoded;
        let channels = names.into_iter().zip(self.planes).collect();
        Pixels { width, height, channels, attributes, missing_rows }
    }
}

impl Sink for Memory<'_> {
    fn begin(&mut self, channels: usize, size: (usize, usize)) -> Result<(), ImageError> {
        let pixels = size.0 * size.1;
        for _ in 0..channels {
            let mut plane = Vec::new();
            if plane.try_reserve_exact(pixels).is_err() {
                return Err(ImageError::Unsupported {
                    path: self.path.to_owned(),
                    what: format!("{channels} channels of {pixels} pixels do not fit in memory"),
                    advice: "cut it into smaller images",
                });
            }
            plane.resize(pixels, 0.0);
            self.planes.push(plane);
        }
        Ok(())
    }

    fn line(&mut self, channel: usize, start: usize, samples: &[f32]) -> Result<(), ImageError> {
        self.planes[channel][start..start + samples.len()].copy_from_slice(samples);
        Ok(())
    }
}

/// A wanted channel's place in the file.
struct Place {
    name: String,
    part: usize,
    channel: usize,
}

/// Finds the wanted channels and checks that they can be used together.
fn locate<S: AsRef<str>>(header: &Header, wanted: &[S]) -> Result<Vec<Place>, ImageError> {
    let path = header.path();
    let mut places: Vec<Place> = Vec::new();
    for name in wanted {
        let name = name.as_ref();
        let Some((part, channel)) = header.find(name) else {
            return Err(ImageError::MissingChannel {
                path: path.to_owned(),
                channel: name.to_owned(),
                present: header.listing(),
            });
        };
        let home = &header.parts()[part];
        if home.deep {
            return Err(ImageError::Unsupported {
                path: path.to_owned(),
                what: format!("channel \"{name}\" holds deep data (several samples per pixel)"),
                advice: "flatten it to one sample per pixel",
            });
        }
        if home.channels[channel].sampling != (1, 1) {
            return Err(ImageError::Unsupported {
                path: path.to_owned(),
                what: format!("channel \"{name}\" has fewer samples than pixels (subsampled)"),
                advice: "save the image as RGB, not as luminance and chroma",
            });
        }
        if places.iter().all(|place| place.name != name) {
            places.push(Place { name: name.to_owned(), part, channel });
        }
    }
    Ok(places)
}

/// Refuses a lying header that asks for more than the file can hold.
fn check_size(path: &Path, channels: usize, pixels: usize) -> Result<(), ImageError> {
    let bytes = (pixels as u64) * 2 * (channels as u64);
    let length = std::fs::metadata(path).map(|file| file.len()).unwrap_or(0);
    if bytes > length.saturating_mul(MAX_RATIO) {
        return Err(ImageError::Corrupt {
            path: path.to_owned(),
            detail: format!("{length} bytes cannot hold {channels} channels of {pixels} pixels"),
        });
    }
    Ok(())
}

/// The wanted samples of one chunk.
struct Band {
    part: usize,
    /// Its place in the part's window.
    x: usize,
    y: usize,
    width: usize,
    pixels: usize,
    /// The result plane that each converted channel belongs to.
    planes: Vec<(usize, Vec<f32>)>,
}

impl Band {
    /// Gives away what lies in a window, of a band of a part with a window of its own.
    fn scatter(
        self,
        home: &Window,
        window: &Window,
        sink: &mut dyn Sink,
    ) -> Result<(), ImageError> {
        let size = (self.width, self.pixels / self.width);
        // The sizes were found plausible: they are far from overflowing.
        let origin = (
            home.origin.0.saturating_add(self.x as i32),
            home.origin.1.saturating_add(self.y as i32),
        );
        let band = Window { origin, size };
        let Some(part) = band.overlap(window) else { return Ok(()) };
        let from =
            |a: (i32, i32), b: (i32, i32)| (a.0.abs_diff(b.0) as usize, a.1.abs_diff(b.1) as usize);
        let (inside, outside) = (from(part.origin, band.origin), from(part.origin, window.origin));
        for (slot, samples) in &self.planes {
            for row in 0..part.size.1 {
                let begin = (inside.1 + row) * self.width + inside.0;
                let start = (outside.1 + row) * window.size.0 + outside.0;
                sink.line(*slot, start, &samples[begin..begin + part.size.0])?;
            }
        }
        Ok(())
    }
}

fn convert(
    source: &Source,
    chunk: &RawChunk,
    header: &Header,
    places: &[Place],
) -> Result<Band, ImageError> {
    let part = &header.parts()[chunk.part];
    let block = source.unpack(chunk, part)?;
    let corrupt = |detail: &str| ImageError::Corrupt {
        path: source.path().to_owned(),
        detail: detail.to_owned(),
    };
    let index = block.index;
    let (x, y) = (index.pixel_position.0, index.pixel_position.1);
    let (width, height) = (index.pixel_size.0, index.pixel_size.1);
    let inside = x + width <= part.window.size.0 && y + height <= part.window.size.1;
    if !inside || width == 0 {
        return Err(corrupt("a chunk lies outside the image"));
    }
    let rows: Vec<_> = (y..y + height).map(|y| part.row(y, width)).collect();
    if block.data.len() != rows.iter().map(|row| row.bytes).sum::<usize>() {
        return Err(corrupt("a chunk has the wrong size"));
    }
    let wanted = places.iter().enumerate().filter(|(_, place)| place.part == chunk.part);
    let planes = wanted.map(|(slot, place)| {
        let kind = part.channels[place.channel].kind;
        let mut samples = Vec::with_capacity(width * height);
        let mut begin = 0;
        for row in &rows {
            let range = &row.channels[place.channel];
            kind.decode(&block.data[begin + range.start..begin + range.end], &mut samples);
            begin += row.bytes;
        }
        (slot, samples)
    });
    let planes = planes.collect();
    Ok(Band { part: chunk.part, x, y, width, pixels: width * height, planes })
}

impl SampleKind {
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Float | Self::Uint => 4,
        }
    }

    /// Writes samples over others, rounded to what can be stored: halves stay finite, and
    /// integers are not negative.
    pub(super) fn encode(self, samples: &[f32], bytes: &mut [u8]) {
        let largest = f16::MAX.to_f32();
        for (&sample, bytes) in samples.iter().zip(bytes.chunks_exact_mut(self.bytes())) {
            match self {
                Self::Half => {
                    let kept =
                        if sample.is_finite() { sample.clamp(-largest, largest) } else { sample };
                    bytes.copy_from_slice(&f16::from_f32(kept).to_ne_bytes());
                }
                Self::Float => bytes.copy_from_slice(&sample.to_ne_bytes()),
                Self::Uint => bytes.copy_from_slice(&(sample.round() as u32).to_ne_bytes()),
            }
        }
    }

    /// Appends native-endian samples as `f32` (unsigned ones above 2^24 are
    /// rounded).
    fn decode(self, bytes: &[u8], out: &mut Vec<f32>) {
        match self {
            Self::Half => {
                let (halves, _) = bytes.as_chunks::<2>();
                out.extend(halves.iter().map(|&b| f16::from_ne_bytes(b).to_f32()));
            }
            Self::Float => {
                let (floats, _) = bytes.as_chunks::<4>();
                out.extend(floats.iter().map(|&b| f32::from_ne_bytes(b)));
            }
            Self::Uint => {
                let (ints, _) = bytes.as_chunks::<4>();
                out.extend(ints.iter().map(|&b| u32::from_ne_bytes(b) as f32));
            }
        }
    }
}
