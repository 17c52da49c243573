//! Portable float maps: what Open Image Denoise and its tools read and write.
//!
//! A header of three lines (`PF`, or `Pf` for grey; the size; the byte order with -1 for
//! little endian), then the rows from the bottom, the channels of a pixel together.

/// One or three channels, each row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Pfm {
    /// Width and height.
    pub size: (usize, usize),
    /// R, G and B, or one that is grey.
    pub channels: Vec<Vec<f32>>,
}

/// Writes an image of three channels.
///
/// # Panics
/// If a channel does not hold `width * height` samples.
pub fn write((width, height): (usize, usize), channels: [&[f32]; 3]) -> Vec<u8> {
    for channel in channels {
        assert_eq!(channel.len(), width * height, "one sample per pixel and channel");
    }
    let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    for y in (0..height).rev() {
        for k in y * width..(y + 1) * width {
            bytes.extend(channels.iter().flat_map(|channel| channel[k].to_le_bytes()));
        }
    }
    bytes
}

/// The header of a file: its size, how many channels it has, whether its numbers are little
/// endian, and where they begin.
pub(super) struct Head {
    pub(super) size: (usize, usize),
    pub(super) channels: usize,
    is_little: bool,
    begin: usize,
}

impl Head {
    /// Reads a header; else says what it is not.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut rest = bytes;
        let mut word = || -> Result<&str, String> {
            let start = rest.iter().position(|byte| !byte.is_ascii_whitespace());
            let start = start.unwrap_or(rest.len());
            let end = rest[start..].iter().position(u8::is_ascii_whitespace);
            let end = start + end.ok_or("its header ends too early")?;
            let word =
                std::str::from_utf8(&rest[start..end]).map_err(|_| "its header is no text")?;
            // One white space ends the header; the next byte may be a sample's.
            rest = &rest[end + 1..];
            Ok(word)
        };
        let (magic, columns, rows, order) = (word()?, word()?, word()?, word()?);
        let channels = match magic {
            "PF" => 3,
            "Pf" => 1,
            _ => return Err("it is no portable float map".to_owned()),
        };
        let (Ok(width), Ok(height)) = (columns.parse(), rows.parse()) else {
            return Err(format!("its size is `{columns} {rows}`"));
        };
        let order: f32 = order.parse().map_err(|_| format!("its byte order is `{order}`"))?;
        let begin = bytes.len() - rest.len();
        Ok(Self { size: (width, height), channels, is_little: order < 0.0, begin })
    }
}

/// Reads an image; else says what it is not.
///
/// # Errors
/// If the bytes are no such file, or too few.
pub fn read(bytes: &[u8]) -> Result<Pfm, String> {
    let Head { size: (width, height), channels, is_little, begin } = Head::read(bytes)?;
    let (samples, _) = bytes[begin..].as_chunks::<4>();
    let needed = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(channels));
    if needed.is_none_or(|needed| samples.len() < needed) {
        return Err("it ends too early".to_owned());
    }
    let number = if is_little { f32::from_le_bytes } else { f32::from_be_bytes };
    let channel = |channel| {
        let rows = (0..height).rev();
        let places =
            rows.flat_map(|y| (0..width).map(move |x| channels * (y * width + x) + channel));
        places.map(|place| number(samples[place])).collect()
    };
    Ok(Pfm { size: (width, height), channels: (0..channels).map(channel).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_read_as_it_was_written() {
        let image = [0.0, 10.0, 20.0].map(|base| (0..6).map(|k| base + k as f32).collect());
        let bytes = write((3, 2), image.each_ref().map(|channel: &Vec<f32>| channel.as_slice()));
        assert_eq!(read(&bytes), Ok(Pfm { size: (3, 2), channels: image.to_vec() }));
        // The bottom row comes first: pixel 3 is red 3, green 13, blue 23.
        assert_eq!(bytes[12..16], 3.0f32.to_le_bytes());
        assert!(read(&bytes[..bytes.len() - 1]).unwrap_err().contains("too early"));
    }

    #[test]
    fn what_is_no_image_is_refused() {
        for bytes in ["", "PF", "P6\n1 1\n-1\n", "PF\n1 1\nx\n", "PF\n1 1\n-1.0\nabc"] {
            assert!(read(bytes.as_bytes()).is_err(), "{bytes:?}");
        }
        let big_endian = [b"PF 1 1 1.0\n".as_slice(), &1.5f32.to_be_bytes().repeat(3)].concat();
        assert_eq!(read(&big_endian).expect("one pixel").channels, vec![vec![1.5]; 3]);
        let grey = [b"Pf 1 1 -1.0\n".as_slice(), &1.5f32.to_le_bytes()].concat();
        assert_eq!(read(&grey).expect("one pixel").channels, [[1.5]]);
    }
}
