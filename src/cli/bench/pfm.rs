//! Portable float maps: what Open Image Denoise reads and writes.
//!
//! A header of three lines (`PF`, the size, the byte order with -1 for little
//! endian), then the rows from the bottom, R, G and B of a pixel together.

/// Three channels, each row by row from the top.
pub(super) type Channels = [Vec<f32>; 3];

/// Writes an image.
///
/// # Panics
/// If a channel does not hold `width * height` samples.
pub(super) fn write(width: usize, height: usize, channels: &Channels) -> Vec<u8> {
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

/// Reads an image of three channels and of this size; else says what it is not.
pub(super) fn read(bytes: &[u8], width: usize, height: usize) -> Result<Channels, String> {
    let mut rest = bytes;
    let mut word = || -> Result<&str, String> {
        let start = rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
        let end = rest[start..].iter().position(u8::is_ascii_whitespace);
        let end = start + end.ok_or("its header ends too early")?;
        let word = std::str::from_utf8(&rest[start..end]).map_err(|_| "its header is no text")?;
        // One white space ends the header; the next byte may be a sample's.
        rest = &rest[end + 1..];
        Ok(word)
    };
    let (magic, columns, rows, order) = (word()?, word()?, word()?, word()?);
    if magic != "PF" {
        return Err("it is no portable float map of three channels".to_owned());
    }
    if [columns, rows].map(str::parse) != [Ok(width), Ok(height)] {
        return Err(format!("it is {columns}x{rows} pixels instead of {width}x{height}"));
    }
    let order: f32 = order.parse().map_err(|_| format!("its byte order is `{order}`"))?;
    let (samples, _) = rest.as_chunks::<4>();
    if samples.len() < 3 * width * height {
        return Err("it ends too early".to_owned());
    }
    let number = if order < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
    Ok([0, 1, 2].map(|channel| {
        let rows = (0..height).rev();
        let places = rows.flat_map(|y| (0..width).map(move |x| 3 * (y * width + x) + channel));
        places.map(|place| number(samples[place])).collect()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_read_as_it_was_written() {
        let image = [0.0, 10.0, 20.0].map(|base| (0..6).map(|k| base + k as f32).collect());
        let bytes = write(3, 2, &image);
        assert_eq!(read(&bytes, 3, 2), Ok(image));
        // The bottom row comes first: pixel 3 is red 3, green 13, blue 23.
        assert_eq!(bytes[12..16], 3.0f32.to_le_bytes());
        assert!(read(&bytes, 2, 3).unwrap_err().contains("3x2"));
        assert!(read(&bytes[..bytes.len() - 1], 3, 2).unwrap_err().contains("too early"));
    }

    #[test]
    fn what_is_no_image_is_refused() {
        for bytes in ["", "PF", "P6\n1 1\n-1\n", "PF\n1 1\nx\n", "PF\n1 1\n-1.0\nabc"] {
            assert!(read(bytes.as_bytes(), 1, 1).is_err(), "{bytes:?}");
        }
        let big_endian = [b"PF 1 1 1.0\n".as_slice(), &1.5f32.to_be_bytes().repeat(3)].concat();
        assert_eq!(read(&big_endian, 1, 1), Ok([vec![1.5], vec![1.5], vec![1.5]]));
    }
}
