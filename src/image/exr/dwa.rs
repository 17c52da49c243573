//! A check that DWA chunks need before they are decompressed.
//!
//! A DWA chunk begins with eleven counters that say how large its sections become,
//! and the `exr` crate (1.74) allocates what they say. A damaged counter of
//! 2^48 does not give an error there, nor a panic that could be caught: the
//! failed allocation ends the process. So the counters are held against the
//! size of the block that the chunk is to fill.

use exr::block::chunk::{Chunk, CompressedBlock};
use exr::compression::Compression;
use exr::error::{Error, Result};
use exr::meta::header::Header;

/// The counters that sizes are allocated by, with the bytes of one unit:
/// sections of raw, RLE and DCT data after decompression.
const COUNTERS: [(usize, u64); 5] = [(1, 1), (6, 1), (7, 1), (8, 2), (9, 2)];
/// Room for what entropy coding adds where it fails to compress, as a factor.
const SLACK: u64 = 4;

/// Refuses a DWA chunk whose declared sizes its block cannot have.
pub(super) fn check(chunk: &Chunk, headers: &[Header]) -> Result<()> {
    let Some(header) = headers.get(chunk.layer_index) else { return Ok(()) };
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Ok(());
    }
    let bytes = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => return Ok(()),
    };
    let tile = header.get_block_data_indices(&chunk.compressed_block)?;
    let size = header.get_absolute_block_pixel_coordinates(tile)?.size;
    let pixel = header.channels.bytes_per_pixel;
    if bytes.len() == size.0 * size.1 * pixel {
        return Ok(()); // stored as it is, without counters
    }
    // DCT blocks are whole at the image's edge, too.
    let padded = size.0.next_multiple_of(8) * size.1.next_multiple_of(8);
    let most = (padded * pixel) as u64 * SLACK;
    let (counters, _) = bytes.as_chunks::<8>();
    for (position, unit) in COUNTERS {
        let declared = counters.get(position).map_or(0, |&counter| u64::from_le_bytes(counter));
        if declared.saturating_mul(unit) > most {
            return Err(Error::Invalid("a DWA chunk declares more data than its block has".into()));
        }
    }
    Ok(())
}
