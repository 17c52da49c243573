//! A file like another, but for some channels.
//!
//! Whatever is not replaced is taken along as it is: other channels, parts, views and
//! levels, the types of samples, compression, tiles, windows and every attribute, known or
//! not. Chunks without a replaced channel are copied byte for byte; of the others the rest is
//! decompressed and compressed again, which changes no bit unless the compression loses some
//! (B44, DWA).

use std::collections::HashMap;
use std::io::{self, SeekFrom};
use std::path::Path;

use exr::math::RoundingMode;
use exr::meta::BlockDescription;
use exr::meta::compute_level_size;
use rayon::prelude::*;

use super::header::{Header, Part, Window};
use super::source::{RawChunk, Source};
use crate::image::ImageError;
use crate::image::output::{Target, write_through};

/// Chunks in flight at a time.
const BATCH: usize = 128;

/// New samples of a channel.
#[derive(Clone, Copy, Debug)]
pub struct Replacement<'a> {
    /// Its full name.
    pub channel: &'a str,
    /// Where the samples are; elsewhere the channel stays as it is.
    pub window: Window,
    /// The samples, row by row.
    pub samples: &'a [f32],
}

/// What a rewritten file lost.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lost {
    /// Compressions by which channels that were not replaced lost precision once more.
    pub recompressed: Vec<String>,
}

/// Writes the file at `path` like the one at `source`, with some channels replaced, and a
/// text attribute in every part that has one of them. The file appears complete or not at
/// all.
///
/// # Errors
/// If the source cannot be read or the file not written.
///
/// # Panics
/// If a channel is not in the source, or its window has another number of samples.
pub fn rewrite(
    source: &Path,
    path: &Path,
    replacements: &[Replacement<'_>],
    attribute: (&str, &str),
) -> Result<Lost, ImageError> {
    let mut source = Source::open(source)?;
    let header = source.listing();
    let mut places: Vec<Vec<Place>> = header.parts().iter().map(|_| Vec::new()).collect();
    for replacement in replacements {
        assert_eq!(replacement.samples.len(), replacement.window.pixels(), "one per pixel");
        let (part, channel) = header.find(replacement.channel).expect("a channel of the source");
        places[part].push(Place { channel, new: *replacement, levels: HashMap::new() });
    }
    for (part, places) in places.iter_mut().enumerate() {
        prepare_levels(&source, &header, part, places);
    }
    let head = with_attribute(&source, &places, attribute);
    write_through(path, |file| write(&mut source, &header, &places, &head, path, file))?;
    Ok(Lost { recompressed: lost(&header, &places) })
}

/// A channel that is replaced.
struct Place<'a> {
    channel: usize,
    new: Replacement<'a>,
    /// The samples of smaller levels, and their width.
    levels: HashMap<(usize, usize), (usize, Vec<f32>)>,
}

/// Makes the smaller levels of a tiled part, where it has some: means of the pixels that
/// theirs cover.
fn prepare_levels(source: &Source, header: &Header, part: usize, places: &mut [Place<'_>]) {
    let BlockDescription::Tiles(tiles) = source.headers()[part].blocks else { return };
    let full = header.parts()[part].window.size;
    let levels: Vec<(usize, usize)> = {
        let blocks = source.headers()[part].blocks_increasing_y_order();
        let level = blocks.map(|tile| tile.location.level_index);
        level.map(|level| (level.0, level.1)).filter(|&level| level != (0, 0)).collect()
    };
    for place in places {
        for &level in &levels {
            place.levels.entry(level).or_insert_with(|| {
                let size = level_size(tiles.rounding_mode, full, level);
                (size.0, smaller(place.new.samples, full, size))
            });
        }
    }
}

fn level_size(round: RoundingMode, full: (usize, usize), level: (usize, usize)) -> (usize, usize) {
    (compute_level_size(round, full.0, level.0), compute_level_size(round, full.1, level.1))
}

/// Means over as many rectangles as the smaller image has pixels.
fn smaller(samples: &[f32], full: (usize, usize), size: (usize, usize)) -> Vec<f32> {
    let span = |k: usize, of: usize, into: usize| {
        let begin = k * of / into;
        begin..((k + 1) * of / into).max(begin + 1)
    };
    let mut result = Vec::with_capacity(size.0 * size.1);
    for y in 0..size.1 {
        for x in 0..size.0 {
            let (rows, columns) = (span(y, full.1, size.1), span(x, full.0, size.0));
            let count = rows.len() * columns.len();
            let pixels = rows.flat_map(|y| &samples[y * full.0..][columns.clone()]);
            result.push((pixels.map(|&x| f64::from(x)).sum::<f64>() / count as f64) as f32);
        }
    }
    result
}

/// The bytes before the tables, with an attribute in the headers of parts that change; one of
/// the same name gives way to it.
fn with_attribute(
    source: &Source,
    places: &[Vec<Place<'_>>],
    (name, value): (&str, &str),
) -> Vec<u8> {
    let mut attribute = Vec::new();
    for text in [name, "string"] {
        attribute.extend(text.as_bytes());
        attribute.push(0);
    }
    attribute.extend((value.len() as i32).to_le_bytes());
    attribute.extend(value.as_bytes());

    let (head, ends) = source.head();
    let mut result = head[..8].to_vec();
    let mut begin = 8;
    for (places, &end) in places.iter().zip(ends) {
        let attributes = &head[begin..end];
        if places.is_empty() {
            result.extend(attributes);
        } else {
            for each in Attributes(attributes) {
                if !each.starts_with(&attribute[..name.len() + 1]) {
                    result.extend(each);
                }
            }
            result.extend(&attribute);
        }
        result.push(0);
        begin = end + 1;
    }
    result.extend(&head[begin..]);
    result
}

/// The attributes of a header, each with name, type, size and value.
struct Attributes<'a>(&'a [u8]);

impl<'a> Iterator for Attributes<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let name = self.0.iter().position(|&byte| byte == 0)? + 1;
        let kind = self.0[name..].iter().position(|&byte| byte == 0)? + 1;
        let begin = name + kind + 4;
        let size = self.0[..begin].last_chunk().copied().map_or(0, i32::from_le_bytes);
        let (attribute, rest) = self.0.split_at(begin + size as usize);
        self.0 = rest;
        Some(attribute)
    }
}

fn write(
    source: &mut Source,
    header: &Header,
    places: &[Vec<Place<'_>>],
    head: &[u8],
    path: &Path,
    file: &mut dyn Target,
) -> Result<(), ImageError> {
    let io = |source| ImageError::Io { path: path.to_owned(), action: "write", source };
    let mut chunks: Vec<(u64, usize, usize)> = Vec::new();
    let mut tables: Vec<Vec<u64>> = Vec::new();
    for part in 0..header.parts().len() {
        let table = source.table(part);
        // What is missing comes last.
        let place = |&at: &u64| if at == 0 { u64::MAX } else { at };
        chunks.extend(table.iter().enumerate().map(|(number, at)| (place(at), part, number)));
        tables.push(vec![0; table.len()]);
    }
    chunks.sort_unstable();
    file.write_all(head).map_err(io)?;
    let mut at = head.len() as u64 + 8 * chunks.len() as u64;
    file.seek(SeekFrom::Start(at)).map_err(io)?;
    for numbers in chunks.chunks(BATCH) {
        let mut batch = Vec::with_capacity(numbers.len());
        for &(_, part, number) in numbers {
            let described = &header.parts()[part];
            batch.push(match source.chunk(part, number)? {
                Some(chunk) => chunk,
                None if described.deep => {
                    let detail = "a chunk of deep data is missing".to_owned();
                    return Err(ImageError::Corrupt { path: source.path().to_owned(), detail });
                }
                None => source.blank(part, number, described)?,
            });
        }
        let replaced: Vec<RawChunk> = batch
            .into_par_iter()
            .map(|chunk| match places[chunk.part].as_slice() {
                [] => Ok(chunk),
                places => replace(source, &header.parts()[chunk.part], places, &chunk),
            })
            .collect::<Result<_, _>>()?;
        for (chunk, &(_, part, number)) in replaced.iter().zip(numbers) {
            tables[part][number] = at;
            file.write_all(&chunk.bytes).map_err(io)?;
            at += chunk.bytes.len() as u64;
        }
    }
    file.seek(SeekFrom::Start(head.len() as u64)).map_err(io)?;
    let entries = tables.iter().flatten().flat_map(|at| at.to_le_bytes());
    let bytes: Vec<u8> = entries.collect();
    file.write_all(&bytes).and_then(|()| flush(file)).map_err(io)
}

fn flush(file: &mut dyn Target) -> io::Result<()> {
    file.flush()
}

/// The same chunk with the new samples.
fn replace(
    source: &Source,
    part: &Part,
    places: &[Place<'_>],
    chunk: &RawChunk,
) -> Result<RawChunk, ImageError> {
    let mut block = source.unpack(chunk, part)?;
    let index = block.index;
    let (left, top) = (index.pixel_position.0, index.pixel_position.1);
    let (width, height) = (index.pixel_size.0, index.pixel_size.1);
    let level = (index.level.0, index.level.1);
    let mut begin = 0;
    for y in top..top + height {
        let row = part.row(y, width);
        for place in places {
            let range = &row.channels[place.channel];
            let bytes = &mut block.data[begin + range.start..begin + range.end];
            let kind = part.channels[place.channel].kind;
            if let Some((stride, samples)) = place.levels.get(&level) {
                let line = samples.get(y * stride + left..y * stride + left + width);
                kind.encode(line.unwrap_or_default(), bytes);
                continue;
            }
            let line = Window {
                origin: (
                    part.window.origin.0.saturating_add(left as i32),
                    part.window.origin.1.saturating_add(y as i32),
                ),
                size: (width, 1),
            };
            let Some(both) = line.overlap(&place.new.window) else { continue };
            let skip = both.origin.0.abs_diff(line.origin.0) as usize * kind.bytes();
            let x = both.origin.0.abs_diff(place.new.window.origin.0) as usize;
            let y = both.origin.1.abs_diff(place.new.window.origin.1) as usize;
            let samples = &place.new.samples[y * place.new.window.size.0 + x..][..both.size.0];
            kind.encode(samples, &mut bytes[skip..skip + both.size.0 * kind.bytes()]);
        }
        begin += row.bytes;
    }
    source.pack(chunk, part, block)
}

/// The compressions that lose bits of channels that were not replaced.
fn lost(header: &Header, places: &[Vec<Place<'_>>]) -> Vec<String> {
    let lossy = header.parts().iter().zip(places).filter(|(part, places)| {
        let is_lossy = ["b44", "dwa"].iter().any(|name| part.compression.starts_with(name));
        is_lossy && !places.is_empty() && places.len() < part.channels.len()
    });
    let mut names: Vec<String> = lossy.map(|(part, _)| part.compression.clone()).collect();
    names.dedup();
    names
}
