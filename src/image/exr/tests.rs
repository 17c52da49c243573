//! Reading and writing files, sound ones and others.

use std::path::Path;

use exr::image::FlatSamples;
use exr::prelude::Compression;
use half::f16;

use super::*;
use crate::image::ImageError;
use crate::image::sample::{File, PartOf, file, part, scan_lines, tiles};

const RGB: [&str; 3] = ["R", "G", "B"];

/// Values that half floats hold exactly.
fn value(channel: usize, pixel: usize) -> f32 {
    (pixel % 37) as f32 * 0.5 - channel as f32
}

fn read(file: &File, names: &[&str]) -> Result<Pixels, ImageError> {
    read_channels(&file.path, names)
}

fn assert_rgb(pixels: &Pixels, size: (usize, usize)) {
    assert_eq!((pixels.width, pixels.height), size);
    for (k, name) in RGB.iter().enumerate() {
        let expected: Vec<f32> = (0..size.0 * size.1).map(|i| value(k, i)).collect();
        assert_eq!(pixels.channels[*name], expected, "{name}");
    }
}

#[test]
fn every_lossless_compression_in_lines_and_tiles() {
    let sizes = [(1, 1), (70, 45), (300, 2), (2, 300)];
    let lossless = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
    ];
    for size in sizes {
        for compression in lossless {
            for encoding in [scan_lines(compression), tiles(compression, (32, 16))] {
                let sample = PartOf { encoding, ..part(size) }.filled(&RGB, value);
                assert_rgb(&read(&file(vec![sample]), &RGB).expect("a sound file"), size);
            }
        }
    }
}

#[test]
fn half_float_and_unsigned_samples_side_by_side() {
    let mut sample = part((5, 3)).filled(&["A"], value);
    let pixels = 0..15;
    let halves = pixels.clone().map(|i| f16::from_f32(value(1, i))).collect();
    sample.channels.push(("H".to_owned(), FlatSamples::F16(halves)));
    sample
        .channels
        .push(("U".to_owned(), FlatSamples::U32(pixels.map(|i| i as u32 * 3).collect())));
    let sample = file(vec![sample]);
    let pixels = read(&sample, &["U", "A", "H"]).expect("a sound file");
    assert_eq!(pixels.channels["A"][7], value(0, 7));
    assert_eq!(pixels.channels["H"][7], value(1, 7));
    assert_eq!(pixels.channels["U"][7], 21.0);
    let kinds: Vec<SampleKind> = Header::read(&sample.path).expect("a sound file").parts()[0]
        .channels
        .iter()
        .map(|c| c.kind)
        .collect();
    assert_eq!(kinds, [SampleKind::Float, SampleKind::Half, SampleKind::Uint]);
}

#[test]
fn parts_give_their_name_to_their_channels() {
    let named = |name, channels: &[&str]| {
        PartOf { name: Some(name), ..part((6, 4)) }.filled(channels, value)
    };
    let sample = file(vec![
        named("ViewLayer.Combined", &RGB),
        named("ViewLayer.Depth", &["Z"]),
        named("ViewLayer.Mist", &["ViewLayer.Mist.Z"]),
    ]);
    let header = Header::read(&sample.path).expect("a sound file");
    assert!(header.names().any(|name| name == "ViewLayer.Combined.R"));
    assert!(header.names().any(|name| name == "ViewLayer.Mist.Z"));
    let pixels =
        read(&sample, &["ViewLayer.Depth.Z", "ViewLayer.Combined.B"]).expect("both are there");
    assert_eq!(pixels.channels.len(), 2);
    assert_eq!(pixels.channels["ViewLayer.Combined.B"][5], value(2, 5));
    assert_eq!(pixels.channels["ViewLayer.Depth.Z"][5], value(0, 5));
}

#[test]
fn unwanted_parts_are_not_read() {
    let named = |name| PartOf { name: Some(name), ..part((64, 64)) }.filled(&["Z"], value);
    let sample = file(vec![named("a"), named("b")]);
    // Cut the file in the second part: the first does not notice.
    let bytes = sample.bytes();
    sample.replace(&bytes[..bytes.len() - 20]);
    assert!(read(&sample, &["a.Z"]).is_ok());
    assert!(matches!(read(&sample, &["b.Z"]), Err(ImageError::Corrupt { .. })));
}

#[test]
fn sizes_may_differ_between_parts_but_not_within_a_request() {
    let named = |name, size, origin| {
        PartOf { name: Some(name), origin, ..part(size) }.filled(&["Z"], value)
    };
    let sample = file(vec![
        named("a", (8, 4), (0, 0)),
        named("b", (4, 2), (0, 0)),
        named("c", (8, 4), (3, -2)),
    ]);
    assert_eq!(read(&sample, &["b.Z"]).expect("alone").width, 4);
    let error = read(&sample, &["a.Z", "b.Z"]).unwrap_err().to_string();
    assert!(error.contains("8x4") && error.contains("4x2") && error.contains("a.Z"), "{error}");
    let error = read(&sample, &["a.Z", "c.Z"]).unwrap_err().to_string();
    assert!(error.contains("8x4 at (3, -2)"), "{error}");
}

#[test]
fn data_windows_may_start_anywhere() {
    for encoding in [scan_lines(Compression::ZIP16), tiles(Compression::ZIP16, (16, 16))] {
        let sample = PartOf { origin: (-7, 13), encoding, ..part((40, 40)) }.filled(&RGB, value);
        assert_rgb(&read(&file(vec![sample]), &RGB).expect("a sound file"), (40, 40));
    }
}

#[test]
fn a_missing_channel_is_named_beside_those_that_are_there() {
    let error = read(&file(vec![part((2, 2)).filled(&RGB, value)]), &["R", "Albedo.R"]);
    let error = error.unwrap_err().to_string();
    assert!(error.contains("sample.exr") && error.contains("\"Albedo.R\""), "{error}");
    assert!(error.contains("B, G, R"), "{error}");
}

#[test]
fn subsampled_channels_are_refused() {
    let sample = file(vec![part((2, 2)).filled(&["R"], value)]);
    let mut bytes = sample.bytes();
    // In the channel list: name, NUL, type, linearity and padding, sampling.
    let channel = b"R\0\x02\0\0\0";
    let at = bytes.windows(channel.len()).position(|w| w == channel).expect("the channel list");
    for sampling in [at + 10, at + 14] {
        bytes[sampling] = 2;
    }
    sample.replace(&bytes);
    let error = read(&sample, &["R"]).unwrap_err().to_string();
    assert!(error.contains("subsampled") && error.contains("sample.exr"), "{error}");
}

#[test]
fn what_is_no_exr_file_says_so() {
    let sample = file(vec![part((2, 2)).filled(&RGB, value)]);
    for bytes in [&b""[..], b"\x76\x2f", b"\x89PNG\r\n\x1a\n and so on"] {
        sample.replace(bytes);
        let error = read(&sample, &RGB).unwrap_err().to_string();
        assert!(error.contains("sample.exr"), "{error}");
    }
    assert!(matches!(read(&sample, &RGB), Err(ImageError::NotExr { .. })));
    let folder = sample.folder.path();
    assert!(matches!(read_channels(folder, &RGB), Err(ImageError::Unsupported { .. })));
    assert!(matches!(read_channels(Path::new("/no/such.exr"), &RGB), Err(ImageError::Io { .. })));
}

#[test]
fn a_file_cut_anywhere_is_an_error() {
    for encoding in [scan_lines(Compression::ZIP16), tiles(Compression::PIZ, (16, 16))] {
        let sample = file(vec![PartOf { encoding, ..part((40, 40)) }.filled(&RGB, value)]);
        let bytes = sample.bytes();
        for length in (0..bytes.len()).step_by(23) {
            sample.replace(&bytes[..length]);
            assert!(read(&sample, &RGB).is_err(), "{length} of {} bytes", bytes.len());
        }
    }
}

#[test]
fn a_damaged_file_is_read_or_refused_but_never_panics() {
    let mut state = 7u64;
    let encodings = [
        scan_lines(Compression::Uncompressed),
        scan_lines(Compression::RLE),
        scan_lines(Compression::ZIP16),
        scan_lines(Compression::PXR24),
        scan_lines(Compression::B44),
        scan_lines(Compression::DWAA(None)),
        tiles(Compression::PIZ, (16, 16)),
    ];
    for encoding in encodings {
        let sample = file(vec![PartOf { encoding, ..part((33, 20)) }.filled(&RGB, value)]);
        let bytes = sample.bytes();
        for position in (0..bytes.len()).step_by(11) {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let mut damaged = bytes.clone();
            damaged[position] ^= (state >> 56) as u8 | 1;
            sample.replace(&damaged);
            if let Ok(pixels) = read(&sample, &RGB) {
                assert_eq!(pixels.channels["R"].len(), pixels.width * pixels.height);
            }
        }
    }
}

#[test]
fn a_header_that_lies_about_its_size_allocates_nothing() {
    let sample = file(vec![part((2, 2)).filled(&RGB, value)]);
    let mut bytes = sample.bytes();
    let name = b"dataWindow\0box2i\0";
    let at = bytes.windows(name.len()).position(|w| w == name).expect("the data window");
    let max = at + name.len() + 4 + 8;
    for (size, is_refused) in [(16_000i32, true), (i32::MAX - 1, true), (1, false)] {
        bytes[max..max + 4].copy_from_slice(&size.to_le_bytes());
        bytes[max + 4..max + 8].copy_from_slice(&size.to_le_bytes());
        sample.replace(&bytes);
        assert_eq!(read(&sample, &RGB).is_err(), is_refused, "{size}");
    }
}

#[test]
fn what_is_written_reads_back_with_the_sources_windows() {
    let window = PartOf { origin: (5, -3), ..part((9, 4)) }.filled(&RGB, value);
    let source = file(vec![window]);
    let pixels = read(&source, &RGB).expect("a sound file");
    let copy = source.folder.path().join("copy.exr");
    let rgb = RGB.map(|name| pixels.channels[name].as_slice());
    write_rgb(&copy, (9, 4), rgb, Some(&pixels.attributes)).expect("writable");
    assert_rgb(&read_channels(&copy, &RGB).expect("a sound file"), (9, 4));
    assert_eq!(Header::read(&copy).expect("a sound file").parts()[0].origin, (5, -3));
    write_rgb(&copy, (9, 4), rgb, None).expect("writable");
    assert_eq!(Header::read(&copy).expect("a sound file").parts()[0].origin, (0, 0));

    let nowhere = Path::new("/no/such/folder/out.exr");
    let error = write_rgb(nowhere, (9, 4), rgb, None).unwrap_err().to_string();
    assert!(error.contains("/no/such/folder/out.exr"), "{error}");
}
