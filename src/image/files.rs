//! Files of every format that is read, by what they begin with: OpenEXR, PFM, TIFF, PNG.
//!
//! All but OpenEXR hold one picture, whose channels are called `R`, `G`, `B` and `A`, or `Y`.
//! Samples are numbers of the file; those of integer formats are divided by the greatest.

use std::fs::{self, File};
use std::io::{self, BufReader, Cursor, Read, Seek};
use std::path::Path;

use super::exr::{self, Decoded, Header, Pixels, Sink, Unfinished, Window};
use super::{ImageError, pfm};

/// A format of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// OpenEXR.
    Exr,
    /// Portable float map.
    Pfm,
    /// Tagged image file format.
    Tiff,
    /// Portable network graphics.
    Png,
}

/// What pixels are allowed at most: 16384².
const MAX_PIXELS: usize = 1 << 28;

impl Format {
    /// The format that a file's first bytes are of; what is none of them is taken for OpenEXR,
    /// whose reader says what it is not.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn of(path: &Path) -> Result<Self, ImageError> {
        let io = |action| move |source| ImageError::Io { path: path.to_owned(), action, source };
        let mut begin = [0; 8];
        let mut file = File::open(path).map_err(io("open"))?;
        let mut length = 0;
        while length < begin.len() {
            match file.read(&mut begin[length..]) {
                Ok(0) => break,
                Ok(count) => length += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                // A folder: the reader says so.
                Err(error) if error.kind() == io::ErrorKind::IsADirectory => break,
                Err(error) => return Err(io("read")(error)),
            }
        }
        Ok(match begin {
            [b'P', b'F' | b'f', space, ..] if space.is_ascii_whitespace() => Self::Pfm,
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Self::Tiff,
            [0x89, b'P', b'N', b'G', ..] => Self::Png,
            _ => Self::Exr,
        })
    }

    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exr => "OpenEXR",
            Self::Pfm => "PFM",
            Self::Tiff => "TIFF",
            Self::Png => "PNG",
        }
    }
}

/// A picture of a format other than OpenEXR.
struct Flat {
    size: (usize, usize),
    names: &'static [&'static str],
    planes: Vec<Vec<f32>>,
    /// Whether samples were integers, and so are those of a display.
    is_encoded: bool,
}

/// Lists a file.
///
/// # Errors
/// If it cannot be read.
pub fn read_header(path: &Path) -> Result<Header, ImageError> {
    let format = Format::of(path)?;
    if format == Format::Exr {
        return Header::read(path);
    }
    let Flat { size, names, is_encoded, .. } = flat(path, format)?;
    Ok(Header::of_picture(path, format, is_encoded, size, names))
}

/// Decodes channels, as [`exr::decode_channels`] does. A picture of another format, which has
/// no place, lies where the window begins.
///
/// # Errors
/// Those of [`exr::decode_channels`], and if the file is no whole picture of its format.
pub fn decode_channels<S: AsRef<str>>(
    path: &Path,
    wanted: &[S],
    window: Option<Window>,
    unfinished: Unfinished,
    sink: &mut dyn Sink,
) -> Result<Decoded, ImageError> {
    let format = Format::of(path)?;
    if format == Format::Exr {
        return exr::decode_channels(path, wanted, window, unfinished, sink);
    }
    let Flat { size, names, planes, .. } = flat(path, format)?;
    let window = window.unwrap_or(Window::of_size(size));
    sink.begin(wanted.len(), window.size)?;
    let mut decoded = Vec::with_capacity(wanted.len());
    for (slot, name) in wanted.iter().enumerate() {
        let name = name.as_ref();
        let Some(k) = names.iter().position(|known| *known == name) else {
            return Err(ImageError::MissingChannel {
                path: path.to_owned(),
                channel: name.to_owned(),
                present: names.join(", "),
            });
        };
        let (width, height) = (size.0.min(window.size.0), size.1.min(window.size.1));
        for y in 0..height {
            sink.line(slot, y * window.size.0, &planes[k][y * size.0..][..width])?;
        }
        decoded.push(name.to_owned());
    }
    let (width, height) = window.size;
    let missing = vec![Vec::new(); decoded.len()];
    Ok(Decoded { width, height, names: decoded, attributes: None, missing, missing_rows: 0 })
}

/// Decodes channels into memory.
///
/// # Errors
/// Those of [`decode_channels`].
pub fn read_channels<S: AsRef<str>>(
    path: &Path,
    wanted: &[S],
    window: Option<Window>,
    unfinished: Unfinished,
) -> Result<Pixels, ImageError> {
    let mut memory = exr::Memory::of(path);
    let decoded = decode_channels(path, wanted, window, unfinished, &mut memory)?;
    Ok(memory.pixels(decoded))
}

fn flat(path: &Path, format: Format) -> Result<Flat, ImageError> {
    let corrupt = |detail: String| ImageError::NotRead {
        path: path.to_owned(),
        format: format.name(),
        detail,
    };
    let io = |source| ImageError::Io { path: path.to_owned(), action: "read", source };
    let flat = match format {
        Format::Pfm => pfm::read(&fs::read(path).map_err(io)?).map(|pfm| Flat {
            size: pfm.size,
            names: names(pfm.channels.len()),
            planes: pfm.channels,
            is_encoded: false,
        }),
        Format::Tiff => tiff(BufReader::new(File::open(path).map_err(io)?)),
        Format::Png | Format::Exr => png(&fs::read(path).map_err(io)?),
    };
    let flat = flat.map_err(corrupt)?;
    let pixels = flat.size.0.saturating_mul(flat.size.1);
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(corrupt(format!("it is {}x{} pixels", flat.size.0, flat.size.1)));
    }
    Ok(flat)
}

/// The channels of a picture of so many samples per pixel.
fn names(channels: usize) -> &'static [&'static str] {
    match channels {
        1 => &["Y"],
        2 => &["Y", "A"],
        3 => &["R", "G", "B"],
        _ => &["R", "G", "B", "A"],
    }
}

/// Parts what stands pixel by pixel; of more than four channels the first four.
fn parted(
    size: (usize, usize),
    channels: usize,
    samples: &[f32],
    is_encoded: bool,
) -> Result<Flat, String> {
    if channels == 0 || samples.len() < size.0 * size.1 * channels {
        return Err("it ends too early".to_owned());
    }
    let names = names(channels);
    let plane = |k: usize| {
        samples.iter().skip(k).step_by(channels).take(size.0 * size.1).copied().collect()
    };
    Ok(Flat { size, names, planes: (0..names.len()).map(plane).collect(), is_encoded })
}

fn png(bytes: &[u8]) -> Result<Flat, String> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let size = reader.output_buffer_size().ok_or("it is too large")?;
    let mut data = vec![0; size];
    let frame = reader.next_frame(&mut data).map_err(|error| error.to_string())?;
    let channels = frame.color_type.samples();
    let samples: Vec<f32> = match frame.bit_depth {
        png::BitDepth::Sixteen => {
            let (words, _) = data.as_chunks::<2>();
            words.iter().map(|&word| f32::from(u16::from_be_bytes(word)) / 65535.0).collect()
        }
        _ => data.iter().map(|&byte| f32::from(byte) / 255.0).collect(),
    };
    parted((frame.width as usize, frame.height as usize), channels, &samples, true)
}

fn tiff(file: impl Read + Seek) -> Result<Flat, String> {
    use tiff::ColorType::{CMYK, Gray, GrayA, Lab, Multiband, Palette, RGB, RGBA, YCbCr};
    use tiff::decoder::DecodingResult as Samples;
    let text = |error: tiff::TiffError| error.to_string();
    let mut decoder = tiff::decoder::Decoder::new(file).map_err(text)?;
    let (width, height) = decoder.dimensions().map_err(text)?;
    let channels = match decoder.colortype().map_err(text)? {
        Gray(_) => 1,
        GrayA(_) => 2,
        RGB(_) => 3,
        RGBA(_) => 4,
        Multiband { num_samples, .. } => usize::from(num_samples),
        other @ (Palette(_) | CMYK(_) | YCbCr(_) | Lab(_)) => {
            return Err(format!("its colours are {other:?}, and not RGB"));
        }
        other => return Err(format!("its colours are {other:?}, and not RGB")),
    };
    let image = decoder.read_image().map_err(text)?;
    let is_encoded = matches!(image, Samples::U8(_) | Samples::U16(_));
    let samples: Vec<f32> = match image {
        Samples::U8(data) => data.iter().map(|&x| f32::from(x) / 255.0).collect(),
        Samples::U16(data) => data.iter().map(|&x| f32::from(x) / 65535.0).collect(),
        Samples::F16(data) => data.iter().map(|x| x.to_f32()).collect(),
        Samples::F32(data) => data,
        Samples::F64(data) => data.iter().map(|&x| x as f32).collect(),
        _ => return Err("its samples are integers of a kind that is not read".to_owned()),
    };
    parted((width as usize, height as usize), channels, &samples, is_encoded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_read_by_what_they_begin_with() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("picture.bin");
        let read = |name: &str| {
            let pixels = read_channels(&path, &[name], None, Unfinished::Refused);
            pixels.map(|pixels| pixels.channels[name].clone())
        };

        let red = [0.25, 2.0];
        fs::write(&path, pfm::write((2, 1), [&red, &red, &red])).expect("writable");
        assert_eq!(Format::of(&path).expect("a file"), Format::Pfm);
        assert_eq!(read("R").expect("a picture"), red);
        let header = read_header(&path).expect("a picture");
        assert_eq!(header.names().collect::<Vec<_>>(), ["R", "G", "B"]);

        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).expect("memory");
        encoder.write_image::<tiff::encoder::colortype::Gray32Float>(2, 1, &red).expect("memory");
        fs::write(&path, bytes.into_inner()).expect("writable");
        assert_eq!(read("Y").expect("a picture"), red);

        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
        encoder.set_color(png::ColorType::GrayscaleAlpha);
        let mut writer = encoder.write_header().expect("memory");
        writer.write_image_data(&[255, 0, 51, 255]).expect("memory");
        writer.finish().expect("memory");
        fs::write(&path, &bytes).expect("writable");
        assert_eq!(read("Y").expect("a picture"), [1.0, 0.2]);
        assert_eq!(read("A").expect("a picture"), [0.0, 1.0]);

        fs::write(&path, &bytes[..40]).expect("writable");
        let error = read("Y").unwrap_err().to_string();
        assert!(error.contains("picture.bin") && error.contains("PNG"), "{error}");
    }
}
