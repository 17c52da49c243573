//! An OpenEXR file as it stands on disk: its headers to the byte, and its chunks by number.
//!
//! The `exr` crate understands headers and compresses; where things stand in the file is
//! found here. So a file is not refused for a part or a channel that nobody reads (deep,
//! subsampled, of a newer compression), what is not understood can be copied, and a render
//! that was not finished can be read as far as it goes.

mod head;
mod samples;

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use exr::block::BlockIndex;
use exr::block::chunk::TileCoordinates;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::header::Header;

use super::guard::guarded;
use super::header::Header as Listing;
use crate::image::ImageError;
use head::{Head, corrupt, cut, plausible, sound};

/// Entries in the tables of all parts together, at most.
const MAX_CHUNKS: u64 = 1 << 26;

/// An open file.
pub(super) struct Source {
    path: PathBuf,
    file: BufReader<File>,
    length: u64,
    meta: MetaData,
    /// Everything before the tables of offsets.
    head: Vec<u8>,
    /// Where in `head` the zero stands that closes each header.
    ends: Vec<usize>,
    /// Per part, where each of its chunks begins; 0 if it is not in the file.
    tables: Vec<Vec<u64>>,
    /// Per part, which piece each of its chunks is.
    pieces: Vec<Vec<Key>>,
}

/// What a piece of a part is told by: its level and its place in it, columns first.
type Key = (usize, usize, usize, usize);

/// A chunk as it stands in the file.
#[derive(Clone, Debug)]
pub(super) struct RawChunk {
    pub(super) part: usize,
    /// The chunk from its part's number to its last byte.
    pub(super) bytes: Vec<u8>,
    coordinates: Coordinates,
    /// Where in `bytes` the compressed samples begin.
    data: usize,
}

/// Which piece of its part a chunk is.
#[derive(Clone, Copy, Debug)]
enum Coordinates {
    /// Lines from this one on, which counts from the coordinates' origin.
    Lines(i32),
    /// A tile, and its level.
    Tile(TileCoordinates),
    /// Samples of a kind that is not read.
    Deep,
}

/// The samples of a chunk: row by row, and in each row channel by channel.
pub(super) struct Block {
    /// The level and the place in it.
    pub(super) index: BlockIndex,
    /// In the byte order of this computer.
    pub(super) data: Vec<u8>,
}

impl Source {
    /// Opens a file and reads its headers, which are then known to be plausible: no size in
    /// them is out of proportion to the file's length.
    pub(super) fn open(path: &Path) -> Result<Self, ImageError> {
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
        let length = metadata.len();
        let mut file = BufReader::new(file);
        let Head { head, ends } = Head::read(path, &mut file, length)?;
        let meta = guarded(path, || MetaData::read_from_buffered(head.as_slice(), false))?;
        if meta.headers.len() != ends.len() {
            return Err(corrupt(path, "the headers do not end where they should".to_owned()));
        }
        for header in &meta.headers {
            plausible(path, header, length)?;
            guarded(path, || sound(header))?;
        }
        let mut source = Self {
            path: path.to_owned(),
            file,
            length,
            meta,
            head,
            ends,
            tables: Vec::new(),
            pieces: Vec::new(),
        };
        source.read_tables()?;
        Ok(source)
    }

    pub(super) fn headers(&self) -> &[Header] {
        &self.meta.headers
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The parts and channels.
    pub(super) fn listing(&self) -> Listing {
        Listing::of_headers(&self.path, &self.meta.headers)
    }

    /// The bytes before the tables of offsets, and where in them each header ends.
    pub(super) fn head(&self) -> (&[u8], &[usize]) {
        (&self.head, &self.ends)
    }

    /// Whether chunks name their part: so they do in files of several, even if there is one.
    pub(super) fn names_parts(&self) -> bool {
        self.meta.requirements.is_multilayer()
    }

    /// Where the chunks of a part begin; 0 for those that are not in the file.
    pub(super) fn table(&self, part: usize) -> &[u64] {
        &self.tables[part]
    }

    /// Reads the tables of offsets. Writers fill them in at the end: where a table has holes,
    /// the chunks themselves tell what is there.
    fn read_tables(&mut self) -> Result<(), ImageError> {
        let chunks: u64 = self.meta.headers.iter().map(|header| header.chunk_count as u64).sum();
        let begin = self.head.len() as u64 + chunks.saturating_mul(8);
        if chunks > MAX_CHUNKS || begin > self.length {
            let detail = format!("{chunks} chunks are declared in {} bytes", self.length);
            return Err(corrupt(&self.path, detail));
        }
        let mut is_whole = true;
        for header in &self.meta.headers {
            let mut bytes = vec![0; header.chunk_count * 8];
            self.file.read_exact(&mut bytes).map_err(|error| cut(&self.path, error))?;
            let (entries, _) = bytes.as_chunks::<8>();
            let table: Vec<u64> = entries.iter().map(|&entry| u64::from_le_bytes(entry)).collect();
            is_whole &= table.iter().all(|offset| (begin..self.length).contains(offset));
            self.tables.push(table);
        }
        let pieces = |header: &Header| {
            header.blocks_increasing_y_order().map(|tile| key(tile.location)).collect()
        };
        self.pieces = guarded(&self.path, || Ok(self.meta.headers.iter().map(pieces).collect()))?;
        if !is_whole {
            self.rebuild_tables(begin)?;
        }
        Ok(())
    }

    /// Which piece of its part a chunk says it is; nothing if it is of a kind that is not read.
    fn piece(&self, chunk: &RawChunk) -> Option<Key> {
        match chunk.coordinates {
            Coordinates::Tile(tile) => Some(key(tile)),
            Coordinates::Lines(y) => {
                let header = &self.meta.headers[chunk.part];
                let tile = || header.get_scan_line_block_tile_coordinates(y);
                guarded(&self.path, tile).ok().map(key)
            }
            Coordinates::Deep => None,
        }
    }

    /// Walks from chunk to chunk as far as the file goes.
    fn rebuild_tables(&mut self, begin: u64) -> Result<(), ImageError> {
        let numbered =
            |pieces: &Vec<Key>| pieces.iter().enumerate().map(|(k, &piece)| (piece, k)).collect();
        let places: Vec<HashMap<Key, usize>> = self.pieces.iter().map(numbered).collect();
        for table in &mut self.tables {
            table.fill(0);
        }
        let mut at = begin;
        while let Ok(chunk) = self.read_chunk(at) {
            // Where a deep chunk belongs, nobody asks: its part is not read.
            let piece = self.piece(&chunk);
            if let Some(&k) = piece.and_then(|piece| places[chunk.part].get(&piece)) {
                self.tables[chunk.part][k] = at;
            }
            at += chunk.bytes.len() as u64;
        }
        Ok(())
    }

    /// A chunk of a part; nothing if it is not whole in the file.
    pub(super) fn chunk(
        &mut self,
        part: usize,
        number: usize,
    ) -> Result<Option<RawChunk>, ImageError> {
        let at = self.tables[part][number];
        if at == 0 {
            return Ok(None);
        }
        match self.read_chunk(at) {
            Ok(chunk) if chunk.part == part => {
                // One that says it is another piece leaves a hole where it should have been.
                let piece = self.piece(&chunk);
                let is_it = piece.is_none_or(|piece| self.pieces[part].get(number) == Some(&piece));
                Ok(is_it.then_some(chunk))
            }
            Ok(_) => {
                let detail = "a chunk belongs to another part than the offset table says";
                Err(corrupt(&self.path, detail.to_owned()))
            }
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                Err(corrupt(&self.path, error.to_string()))
            }
            Err(source) => Err(ImageError::Io { path: self.path.clone(), action: "read", source }),
        }
    }

    fn read_chunk(&mut self, at: u64) -> io::Result<RawChunk> {
        let here = self.file.stream_position()?;
        match i64::try_from(at).ok().zip(i64::try_from(here).ok()) {
            // What is buffered stays so.
            Some((at, here)) => self.file.seek_relative(at - here)?,
            None => _ = self.file.seek(SeekFrom::Start(at))?,
        }
        let invalid = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
        let mut bytes = Vec::new();
        let mut read = |count: usize, bytes: &mut Vec<u8>| {
            let old = bytes.len();
            bytes.resize(old + count, 0);
            self.file.read_exact(&mut bytes[old..])
        };
        let int = |bytes: &[u8], at: usize| {
            i32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
        };
        let mut part = 0;
        if self.meta.requirements.is_multilayer() {
            read(4, &mut bytes)?;
            part = usize::try_from(int(&bytes, 0)).unwrap_or(usize::MAX);
        }
        let header = self.meta.headers.get(part).ok_or_else(|| invalid("a chunk of no part"))?;
        let begin = bytes.len();
        let is_tile = header.blocks.has_tiles();
        read(if is_tile { 16 } else { 4 }, &mut bytes)?;
        let mut coordinates = if is_tile {
            let number = |k: usize| usize::try_from(int(&bytes, begin + 4 * k));
            let number = |k| number(k).map_err(|_| invalid("a tile has a negative number"));
            Coordinates::Tile(TileCoordinates {
                tile_index: Vec2(number(0)?, number(1)?),
                level_index: Vec2(number(2)?, number(3)?),
            })
        } else {
            Coordinates::Lines(int(&bytes, begin))
        };
        let size = if header.deep {
            coordinates = Coordinates::Deep;
            let begin = bytes.len();
            read(24, &mut bytes)?;
            let long = |k: usize| {
                u64::from_le_bytes(bytes[begin + k..begin + k + 8].try_into().expect("eight"))
            };
            long(0).saturating_add(long(8))
        } else {
            read(4, &mut bytes)?;
            let size = int(&bytes, bytes.len() - 4);
            u64::try_from(size).map_err(|_| invalid("a chunk has a negative size"))?
        };
        if at.saturating_add(bytes.len() as u64).saturating_add(size) > self.length {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let data = bytes.len();
        // The file holds that many, so that they fit into a usize.
        read(size as usize, &mut bytes)?;
        Ok(RawChunk { part, bytes, coordinates, data })
    }
}

impl Listing {
    /// Reads the listing of the file at `path`.
    ///
    /// # Errors
    /// If the file cannot be opened or is no OpenEXR file.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        Ok(Source::open(path)?.listing())
    }
}

impl RawChunk {
    /// Whether it is a piece of the image at its full resolution, and read at all.
    pub(super) fn is_full_resolution(&self) -> bool {
        match self.coordinates {
            Coordinates::Lines(_) => true,
            Coordinates::Tile(tile) => (tile.level_index.0, tile.level_index.1) == (0, 0),
            Coordinates::Deep => false,
        }
    }
}

/// What a tile is looked up by.
fn key(tile: TileCoordinates) -> Key {
    (tile.level_index.0, tile.level_index.1, tile.tile_index.0, tile.tile_index.1)
}
