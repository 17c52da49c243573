//! The bytes before the tables of offsets, and whether what they declare can be true.

use std::io::{self, Read};
use std::path::Path;

use exr::error::Error;
use exr::math::Vec2;
use exr::meta::header::Header;

use crate::image::ImageError;

/// More pixels than this are refused before anything is allocated (16384²).
const MAX_PIXELS: usize = 1 << 28;
/// The bytes of a file before its first header: a magic number and flags.
const PREAMBLE: usize = 8;

/// The bytes of all headers.
pub(super) struct Head {
    /// Everything before the tables of offsets.
    pub(super) head: Vec<u8>,
    /// Where in `head` the zero stands that closes each header.
    pub(super) ends: Vec<usize>,
}

impl Head {
    pub(super) fn read(path: &Path, file: &mut impl Read, length: u64) -> Result<Self, ImageError> {
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
pub(super) fn plausible(path: &Path, header: &Header, file_bytes: u64) -> Result<(), ImageError> {
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
pub(super) fn sound(header: &Header) -> exr::error::Result<()> {
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

pub(super) fn corrupt(path: &Path, detail: String) -> ImageError {
    ImageError::Corrupt { path: path.to_owned(), detail }
}

pub(super) fn cut(path: &Path, source: io::Error) -> ImageError {
    match source.kind() {
        io::ErrorKind::UnexpectedEof => corrupt(path, "it ends too early".to_owned()),
        _ => ImageError::Io { path: path.to_owned(), action: "read", source },
    }
}
