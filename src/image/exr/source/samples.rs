//! The samples of chunks: decompressed, and compressed again.

use std::io::Write;

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock};
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::error::Error;
use exr::math::Vec2;
use exr::meta::BlockDescription;
use exr::meta::attribute::{IntegerBounds, SampleType, Text};
use exr::meta::header::Header;
use exr::prelude::{ChannelDescription, SmallVec};
use flate2::write::ZlibEncoder;

use super::super::dwa;
use super::super::guard::guarded;
use super::super::header::Part;
use super::{Block, Coordinates, RawChunk, Source};
use crate::image::ImageError;

impl Source {
    /// Decompresses a chunk of this file.
    pub(in crate::image::exr) fn unpack(
        &self,
        chunk: &RawChunk,
        part: &Part,
    ) -> Result<Block, ImageError> {
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
    pub(in crate::image::exr) fn pack(
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
    pub(in crate::image::exr) fn blank(
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
