//! Chosen channels as `f32`.
//!
//! Liveness reaches down to here: parts that hold no wanted channel are skipped
//! in the file without being read, and of the chunks that are decompressed only
//! the wanted channels' samples are converted and stored. (OpenEXR compresses
//! the channels of a part together, so within a part there is no smaller unit.)
//!
//! Chunks are decompressed and converted on all threads of the global pool, a
//! batch at a time, so that what is in flight stays small beside the result.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use exr::block::UncompressedBlock;
use exr::block::chunk::Chunk;
use exr::meta::MetaData;
use half::f16;
use rayon::prelude::*;

use super::dwa;
use super::guard::guarded;
use super::header::{Attributes, Header, SampleKind, open};
use crate::image::ImageError;

/// Chunks in flight at a time, at most, and what they may take when they are decompressed:
/// as much as keeps all threads busy, and little beside an image that is large.
const BATCH: usize = 256;
const BATCH_BYTES: usize = 64 << 20;
/// No compression of OpenEXR shrinks pixels by more than this factor; a file
/// that claims more lies about its size. (Deflate reaches 1030:1; DWA applies
/// it to one coefficient of 64.)
const MAX_RATIO: u64 = 1 << 17;

/// Decoded channels of one size.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// By full name, row by row without padding.
    pub channels: BTreeMap<String, Vec<f32>>,
    /// What the first wanted channel's part says beside its pixels.
    pub attributes: Attributes,
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
    /// What the first wanted channel's part says beside its pixels.
    pub attributes: Attributes,
}

/// Decodes the channels with the given full names, and no others.
///
/// # Errors
/// If the file cannot be read, lacks one of them, or holds them in a form that
/// is not read (different data windows).
///
/// # Panics
/// If `wanted` is empty.
pub fn read_channels<S: AsRef<str>>(path: &Path, wanted: &[S]) -> Result<Pixels, ImageError> {
    let mut memory = Memory { path, planes: Vec::new() };
    let Decoded { width, height, names, attributes } = decode_channels(path, wanted, &mut memory)?;
    let channels = names.into_iter().zip(memory.planes).collect();
    Ok(Pixels { width, height, channels, attributes })
}

/// The same, given away line by line as it is decoded.
///
/// # Errors
/// Those of [`read_channels`], and the sink's.
///
/// # Panics
/// If `wanted` is empty.
pub fn decode_channels<S: AsRef<str>>(
    path: &Path,
    wanted: &[S],
    sink: &mut dyn Sink,
) -> Result<Decoded, ImageError> {
    let reader = open(path)?;
    let header = Header::of(path, reader.headers());
    let places = locate(&header, wanted)?;
    let first = places.first().expect("callers want at least the colour").part;
    let attributes = Attributes::of(&reader.headers()[first]);
    let (width, height) = header.parts()[first].size;
    check_size(path, places.len(), width * height)?;
    sink.begin(places.len(), (width, height))?;

    let live: HashSet<usize> = places.iter().map(|place| place.part).collect();
    let mut chunks = guarded(path, || {
        reader.filter_chunks(false, |_, _, block| {
            live.contains(&block.layer) && (block.level.0, block.level.1) == (0, 0)
        })
    })?;
    let meta = exr::block::reader::ChunksReader::meta_data(&chunks).clone();
    let largest = live.iter().map(|&part| meta.headers[part].max_block_byte_size()).max();
    let most = (BATCH_BYTES / largest.unwrap_or(1).max(1)).min(BATCH);
    let most = most.max(rayon::current_num_threads());
    let mut seen = HashSet::new();
    loop {
        let batch = guarded(path, || chunks.by_ref().take(most).collect::<Result<Vec<_>, _>>())?;
        if batch.is_empty() {
            break;
        }
        let bands: Vec<Band> = batch
            .into_par_iter()
            .map(|chunk| convert(path, chunk, &meta, &header, &places))
            .collect::<Result<_, _>>()?;
        for band in bands {
            seen.insert((band.part, band.x, band.y));
            band.scatter(width, sink)?;
        }
    }
    // The offset table names each block once; a chunk that says it is another
    // block leaves a hole where it should have been.
    let expected = chunks_of(&meta, &live);
    if seen.len() != expected {
        return Err(ImageError::Corrupt {
            path: path.to_owned(),
            detail: format!("{} of {expected} chunks are present", seen.len()),
        });
    }
    let names = places.into_iter().map(|place| place.name).collect();
    Ok(Decoded { width, height, names, attributes })
}

/// Samples kept in memory.
struct Memory<'a> {
    path: &'a Path,
    planes: Vec<Vec<f32>>,
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
        if let Some(first) = places.first() {
            let (a, b) = (&header.parts()[first.part], &header.parts()[part]);
            if (a.size, a.origin) != (b.size, b.origin) {
                return Err(ImageError::WindowsDiffer {
                    path: path.to_owned(),
                    first: first.name.clone(),
                    first_window: a.window(),
                    second: name.to_owned(),
                    second_window: b.window(),
                });
            }
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

/// Full-resolution blocks of the parts that are read.
fn chunks_of(meta: &MetaData, live: &HashSet<usize>) -> usize {
    live.iter()
        .flat_map(|&part| meta.headers[part].blocks_increasing_y_order())
        .filter(|tile| (tile.location.level_index.0, tile.location.level_index.1) == (0, 0))
        .count()
}

/// The wanted samples of one chunk.
struct Band {
    part: usize,
    x: usize,
    y: usize,
    width: usize,
    /// The result plane that each converted channel belongs to.
    planes: Vec<(usize, Vec<f32>)>,
}

impl Band {
    fn scatter(self, stride: usize, sink: &mut dyn Sink) -> Result<(), ImageError> {
        for (slot, samples) in &self.planes {
            for (row, line) in samples.chunks_exact(self.width).enumerate() {
                sink.line(*slot, (self.y + row) * stride + self.x, line)?;
            }
        }
        Ok(())
    }
}

fn convert(
    path: &Path,
    chunk: Chunk,
    meta: &MetaData,
    header: &Header,
    places: &[Place],
) -> Result<Band, ImageError> {
    let block = guarded(path, || {
        dwa::check(&chunk, &meta.headers)?;
        UncompressedBlock::decompress_chunk(chunk, meta, false)
    })?;
    let corrupt =
        |detail: &str| ImageError::Corrupt { path: path.to_owned(), detail: detail.to_owned() };
    let index = block.index;
    let part = header.parts().get(index.layer).ok_or_else(|| corrupt("a chunk of no part"))?;
    let (x, y) = (index.pixel_position.0, index.pixel_position.1);
    let (width, height) = (index.pixel_size.0, index.pixel_size.1);
    let inside = x + width <= part.size.0 && y + height <= part.size.1;
    if !inside || (index.level.0, index.level.1) != (0, 0) || width == 0 {
        return Err(corrupt("a chunk lies outside the image"));
    }

    // Each line holds the samples of all channels, one channel after another.
    let bytes: Vec<usize> = part.channels.iter().map(|c| width * c.kind.bytes()).collect();
    let line: usize = bytes.iter().sum();
    if block.data.len() != line * height {
        return Err(corrupt("a chunk has the wrong size"));
    }
    let wanted = places.iter().enumerate().filter(|(_, place)| place.part == index.layer);
    let planes: Vec<(usize, Vec<f32>)> = wanted
        .map(|(slot, place)| {
            let start: usize = bytes[..place.channel].iter().sum();
            let kind = part.channels[place.channel].kind;
            let mut samples = Vec::with_capacity(width * height);
            for row in block.data.chunks_exact(line) {
                kind.decode(&row[start..start + bytes[place.channel]], &mut samples);
            }
            (slot, samples)
        })
        .collect();
    if planes.is_empty() {
        return Err(corrupt("a chunk belongs to another part than the offset table says"));
    }
    Ok(Band { part: index.layer, x, y, width, planes })
}

impl SampleKind {
    fn bytes(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Float | Self::Uint => 4,
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
