//! An OpenEXR file as it stands on disk: its headers to the byte, and its chunks by number.
//!
//! The `exr` crate understands headers and compresses; where things stand in the file is
//! found here. So a file is not refused for a part or a channel that nobody reads (deep,
//! subsampled, of a newer compression), what is not understood can be copied, and a render
//! that was not finished can be read as far as it goes.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use exr::block::chunk::{
    Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock, TileCoordinates,
};
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::error::Error;
use exr::math::Vec2;
use exr::meta::attribute::{IntegerBounds, SampleType, Text};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{ChannelDescription, SmallVec};
use flate2::write::ZlibEncoder;

use super::dwa;
use super::guard::guarded;
use super::header::{Header as Listing, Part};
use crate::image::ImageError;

/// More pixels than this are refused before anything is allocated (16384²).
const MAX_PIXELS: usize = 1 << 28;
/// The bytes of a file before its first header: a magic number and flags.
const PREAMBLE: usize = 8;
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

    /// Decompresses a chunk of this file.
    pub(super) fn unpack(&self, chunk: &RawChunk, part: &Part) -> Result<Block, ImageError> {
        guarded(&self.path, || {
            let compressed = chunk.bytes[chunk.data..].to_vec();
            let header = &self.meta.headers[chunk.part];
            if let (true, Coordinates::Lines(y)) = (part.is_subsampled(), chunk.coordinates) {
                return unpack_subsampled(header, part, y, compressed);
            }
            let block = match chunk.coordinates {
                Coordinates::Lines(y_coordinate) => {
                    CompressedBlock::ScanLine(CompressedScanLineBlock {
                        y_coordinate,
                        compressed_pixels_le: compressed,
                    })
                }
                Coordinates::Tile(coordinates) => CompressedBlock::Tile(CompressedTileBlock {
                    coordinates,
                    compressed_pixels_le: compressed,
                }),
                Coordinates::Deep => return Err(Error::NotSupported("deep data".into())),
            };
            let chunk = Chunk { layer_index: chunk.part, compressed_block: block };
            dwa::check(&chunk, &self.meta.headers)?;
            let block = UncompressedBlock::decompress_chunk(chunk, &self.meta, false)?;
            Ok(Block { index: block.index, data: block.data })
        })
    }

    /// The chunk with other samples.
    pub(super) fn pack(
        &self,
        chunk: &RawChunk,
        part: &Part,
        block: Block,
    ) -> Result<RawChunk, ImageError> {
        let compressed = guarded(&self.path, || {
            let header = &self.meta.headers[chunk.part];
            if part.is_subsampled() {
                let (header, bounds) = surrogate(header.compression, block.data.len())?;
                return header
                    .compression
                    .compress_image_section_to_le(&header, block.data, bounds);
            }
            if matches!(header.compression, Compression::ZIP1 | Compression::ZIP16)
                && cfg!(target_endian = "little")
            {
                return Ok(zipped(block.data));
            }
            let (position, size) = (block.index.pixel_position, block.index.pixel_size);
            let bounds = IntegerBounds::new(position.to_i32(), size);
            header.compression.compress_image_section_to_le(header, block.data, bounds)
        })?;
        let mut bytes = chunk.bytes[..chunk.data - 4].to_vec();
        bytes.extend((compressed.len() as i32).to_le_bytes());
        bytes.extend(compressed);
        Ok(RawChunk { bytes, ..*chunk })
    }

    /// A chunk that the file lacks, of samples that are zero.
    pub(super) fn blank(
        &self,
        part: usize,
        number: usize,
        described: &Part,
    ) -> Result<RawChunk, ImageError> {
        let header = &self.meta.headers[part];
        let (location, bounds) = guarded(&self.path, || {
            let tile = header.blocks_increasing_y_order().nth(number).expect("a chunk of the part");
            Ok((tile.location, header.get_absolute_block_pixel_coordinates(tile.location)?))
        })?;
        let mut bytes = Vec::new();
        if self.names_parts() {
            bytes.extend((part as i32).to_le_bytes());
        }
        let coordinates = if header.blocks.has_tiles() {
            let (tile, level) = (location.tile_index, location.level_index);
            for number in [tile.0, tile.1, level.0, level.1] {
                bytes.extend((number as i32).to_le_bytes());
            }
            Coordinates::Tile(location)
        } else {
            let y = bounds.position.1 + header.own_attributes.layer_position.1;
            bytes.extend(y.to_le_bytes());
            Coordinates::Lines(y)
        };
        bytes.extend([0; 4]);
        let data = bytes.len();
        let chunk = RawChunk { part, bytes, coordinates, data };
        let (top, size) = (bounds.position.1 as usize, bounds.size);
        let index = BlockIndex {
            layer: part,
            pixel_position: Vec2(bounds.position.0 as usize, top),
            pixel_size: size,
            level: location.level_index,
        };
        let samples = (top..top + size.1).map(|y| described.row(y, size.0).bytes);
        let block = Block { index, data: vec![0; samples.sum()] };
        self.pack(&chunk, described, block)
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

/// Compresses as ZIP does. The crate's deflate takes four times as long, and a file is mostly
/// channels that are compressed as they were.
fn zipped(samples: Vec<u8>) -> Vec<u8> {
    // The lower and the upper bytes of halves apart, and each as its difference from the one
    // before.
    let even = samples.iter().step_by(2);
    let odd = samples.iter().skip(1).step_by(2);
    let mut before = 128_u8;
    let differences = even.chain(odd).enumerate().map(|(k, &byte)| {
        let difference = byte.wrapping_sub(before).wrapping_add(128);
        before = byte;
        if k == 0 { byte } else { difference }
    });
    let differences: Vec<u8> = differences.collect();
    let mut encoder = ZlibEncoder::new(Vec::new(), flate2::Compression::new(4));
    encoder.write_all(&differences).expect("memory takes what is written to it");
    let compressed = encoder.finish().expect("memory takes what is written to it");
    // What does not become smaller stands as it is.
    if compressed.len() < samples.len() { compressed } else { samples }
}

/// Decompresses lines of which not every channel has every sample. The crate expects that
/// each has: it is told of one channel of as many bytes, which is the same to compressions
/// that know nothing of channels.
fn unpack_subsampled(
    header: &Header,
    part: &Part,
    y: i32,
    compressed: Vec<u8>,
) -> exr::error::Result<Block> {
    let tile = header.get_scan_line_block_tile_coordinates(y)?;
    let bounds = header.get_absolute_block_pixel_coordinates(tile)?;
    let (top, width, height) = (bounds.position.1 as usize, bounds.size.0, bounds.size.1);
    let bytes = (top..top + height).map(|y| part.row(y, width).bytes).sum();
    let (surrogate, whole) = surrogate(header.compression, bytes)?;
    let compression = surrogate.compression;
    let data =
        compression.decompress_image_section_from_le(&surrogate, compressed, whole, false)?;
    let index = BlockIndex {
        layer: 0,
        pixel_position: Vec2(0, top),
        pixel_size: bounds.size,
        level: Vec2(0, 0),
    };
    Ok(Block { index, data })
}

/// A header of one line of so many bytes, and the bounds of that line.
fn surrogate(
    compression: Compression,
    bytes: usize,
) -> exr::error::Result<(Header, IntegerBounds)> {
    use Compression::{RLE, Uncompressed, ZIP1, ZIP16};
    let knows_no_channels = matches!(compression, Uncompressed | RLE | ZIP1 | ZIP16);
    if !knows_no_channels || cfg!(target_endian = "big") {
        let what = format!("subsampling of channels in a part with {compression}");
        return Err(Error::NotSupported(what.into()));
    }
    let channel = ChannelDescription::named("bytes", SampleType::F16);
    let size = Vec2(bytes / 2, 1);
    let mut header = Header::new(Text::from("bytes"), size, SmallVec::from_iter([channel]));
    // New headers have tiles of 64 x 64.
    header.blocks = BlockDescription::ScanLines;
    header.compression = compression;
    Ok((header, IntegerBounds::from_dimensions(size)))
}

/// What a tile is looked up by.
fn key(tile: TileCoordinates) -> Key {
    (tile.level_index.0, tile.level_index.1, tile.tile_index.0, tile.tile_index.1)
}

/// The bytes of all headers.
struct Head {
    head: Vec<u8>,
    ends: Vec<usize>,
}

impl Head {
    fn read(path: &Path, file: &mut impl Read, length: u64) -> Result<Self, ImageError> {
        let mut bytes = Bytes { path, file, length, read: Vec::new() };
        if length < PREAMBLE as u64 {
            return Err(ImageError::NotExr { path: path.to_owned() });
        }
        bytes.take(PREAMBLE)?;
        if bytes.read[..4] != exr::meta::magic_number::BYTES {
            return Err(ImageError::NotExr { path: path.to_owned() });
        }
        // The twelfth flag of the second number.
        let is_multipart = bytes.read[5] & 0x10 != 0;
        let mut ends = Vec::new();
        loop {
            while bytes.text()? > 0 {
                bytes.text()?;
                bytes.take(4)?;
                let size = bytes.read.last_chunk().copied().map_or(0, i32::from_le_bytes);
                let size = usize::try_from(size)
                    .map_err(|_| corrupt(path, "an attribute has a negative size".to_owned()))?;
                bytes.take(size)?;
            }
            ends.push(bytes.read.len() - 1);
            if !is_multipart {
                break;
            }
            bytes.take(1)?;
            if bytes.read.last() == Some(&0) {
                break;
            }
        }
        Ok(Self { head: bytes.read, ends })
    }
}

/// The beginning of a file, as far as it was read.
struct Bytes<'a, R> {
    path: &'a Path,
    file: &'a mut R,
    length: u64,
    read: Vec<u8>,
}

impl<R: Read> Bytes<'_, R> {
    fn take(&mut self, count: usize) -> Result<(), ImageError> {
        let old = self.read.len();
        if (old as u64).saturating_add(count as u64) > self.length {
            return Err(cut(self.path, io::ErrorKind::UnexpectedEof.into()));
        }
        self.read.resize(old + count, 0);
        self.file.read_exact(&mut self.read[old..]).map_err(|error| cut(self.path, error))
    }

    /// A text and the zero behind it; gives its length.
    fn text(&mut self) -> Result<usize, ImageError> {
        let mut length = 0;
        loop {
            self.take(1)?;
            if self.read.last() == Some(&0) {
                return Ok(length);
            }
            length += 1;
        }
    }
}

/// Refuses sizes that the file cannot hold, before they are allocated.
fn plausible(path: &Path, header: &Header, file_bytes: u64) -> Result<(), ImageError> {
    let (width, height) = (header.layer_size.0, header.layer_size.1);
    if width == 0 || height == 0 {
        return Err(corrupt(path, format!("the data window is {width}x{height}")));
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
        let detail = format!("{} chunks are declared in {file_bytes} bytes", header.chunk_count);
        return Err(corrupt(path, detail));
    }
    Ok(())
}

/// Checks what the crate asks of headers, but for what it cannot read and nobody may want:
/// deep parts and subsampled channels.
fn sound(header: &Header) -> exr::error::Result<()> {
    if header.deep {
        return Ok(());
    }
    let mut full = header.clone();
    for channel in &mut full.channels.list {
        if channel.sampling.0 == 0 || channel.sampling.1 == 0 {
            return Err(Error::Invalid("a channel without samples".into()));
        }
        let subsampled = channel.sampling != Vec2(1, 1);
        if subsampled && header.blocks.has_tiles() {
            return Err(Error::Invalid("a subsampled channel in tiles".into()));
        }
        channel.sampling = Vec2(1, 1);
    }
    full.validate(false, &mut false, false)
}

fn corrupt(path: &Path, detail: String) -> ImageError {
    ImageError::Corrupt { path: path.to_owned(), detail }
}

fn cut(path: &Path, source: io::Error) -> ImageError {
    match source.kind() {
        io::ErrorKind::UnexpectedEof => corrupt(path, "it ends too early".to_owned()),
        _ => ImageError::Io { path: path.to_owned(), action: "read", source },
    }
}
