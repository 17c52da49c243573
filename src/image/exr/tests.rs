//! Reading and writing files, sound ones and others.

use std::path::Path;

use exr::image::FlatSamples;
use exr::prelude::Compression;
use half::f16;

use super::*;
use crate::image::ImageError;
use crate::image::files::read_channels;
use crate::image::sample::{File, PartOf, file, part, scan_lines, tiles};

const RGB: [&str; 3] = ["R", "G", "B"];

/// Values that half floats hold exactly.
fn value(channel: usize, pixel: usize) -> f32 {
    (pixel % 37) as f32 * 0.5 - channel as f32
}

fn read(file: &File, names: &[&str]) -> Result<Pixels, ImageError> {
    read_channels(&file.path, names, None, Unfinished::Refused)
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
    assert!(matches!(read(&sample, &["b.Z"]), Err(ImageError::Unfinished { .. })));
}

#[test]
fn parts_of_other_windows_are_placed_in_the_firsts() {
    let named = |name, size, origin| {
        PartOf { name: Some(name), origin, ..part(size) }.filled(&["Z"], |_, k| 1.0 + k as f32)
    };
    let sample = file(vec![
        named("a", (4, 3), (0, 0)),
        named("b", (2, 2), (1, 1)),
        named("c", (8, 2), (-3, -1)),
        named("d", (1, 1), (9, 9)),
    ]);
    assert_eq!(read(&sample, &["b.Z"]).expect("alone").width, 2);
    let pixels = read(&sample, &["a.Z", "b.Z", "c.Z", "d.Z"]).expect("they are placed");
    assert_eq!((pixels.width, pixels.height), (4, 3));
    let expected: [&[f32]; 3] = [
        &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 3.0, 4.0, 0.0],
        // Its second row, from the fourth pixel on, is the first's first.
        &[12.0, 13.0, 14.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        &[0.0; 12],
    ];
    for (name, expected) in ["b.Z", "c.Z", "d.Z"].into_iter().zip(expected) {
        assert_eq!(pixels.channels[name], expected, "{name}");
    }
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

/// Pixels per row of a subsampled file: more than a tile has.
const LONG: usize = 200;

/// A file of two rows with R at each pixel, and B at one of four.
fn subsampled(compression: Compression) -> File {
    let lines = scan_lines(compression);
    let sample = PartOf { encoding: lines, ..part((LONG, 2)) }.filled(&["B", "R"], value);
    let sample = file(vec![sample]);
    let source = source::Source::open(&sample.path).expect("a sound file");
    let (head, _) = source.head();
    let mut head = head.to_vec();
    // In the channel list: name, NUL, type, linearity and padding, sampling.
    let channel = b"B\0\x02\0\0\0";
    let at = head.windows(channel.len()).position(|w| w == channel).expect("the channel list");
    for sampling in [at + 10, at + 14] {
        head[sampling] = 2;
    }
    // One chunk per line, which is not compressed: B and R, then R alone.
    let b = 9.0f32.to_le_bytes().repeat(LONG / 2);
    let r = |row: usize| {
        (0..LONG).flat_map(move |x| value(1, row * LONG + x).to_le_bytes()).collect::<Vec<u8>>()
    };
    let lines: [Vec<u8>; 2] = [[b, r(0)].concat(), r(1)];
    let mut offset = head.len() as u64 + 16;
    let (mut table, mut chunks) = (Vec::new(), Vec::new());
    for (y, line) in lines.iter().enumerate() {
        table.extend(offset.to_le_bytes());
        chunks.extend((y as i32).to_le_bytes());
        chunks.extend((line.len() as i32).to_le_bytes());
        chunks.extend(line);
        offset += 8 + line.len() as u64;
    }
    sample.replace(&[head, table, chunks].concat());
    sample
}

#[test]
fn a_subsampled_channel_is_kept_and_no_other_suffers_from_it() {
    for compression in [Compression::Uncompressed, Compression::ZIP1, Compression::RLE] {
        let sample = subsampled(compression);
        let pixels = read(&sample, &["R"]).expect("nobody wants B");
        let expected: Vec<f32> = (0..2 * LONG).map(|k| value(1, k)).collect();
        assert_eq!(pixels.channels["R"], expected);
        let error = read(&sample, &["B"]).unwrap_err().to_string();
        assert!(error.contains("subsampled") && error.contains("\"B\""), "{error}");

        let copy = sample.folder.path().join("copy.exr");
        let samples: Vec<f32> = (0..2 * LONG).map(|k| 5.0 + (k % 7) as f32).collect();
        let window = Window::of_size((LONG, 2));
        let new = [Replacement { channel: "R", window, samples: &samples }];
        rewrite(&sample.path, &copy, &new, ("tamis", "test")).expect("writable");
        let pixels = read_channels(&copy, &["R"], None, Unfinished::Refused).expect("sound");
        assert_eq!(pixels.channels["R"], samples);
        // B stands before R in its line, as it was.
        let mut source = source::Source::open(&copy).expect("a sound file");
        let chunk = source.chunk(0, 0).expect("readable").expect("it is there");
        let block = source.unpack(&chunk, &source.listing().parts()[0]).expect("sound");
        let b = 9.0f32.to_ne_bytes().repeat(LONG / 2);
        assert_eq!(block.data[..b.len()], b, "{compression}: B is lost");
    }
}

#[test]
fn what_is_no_exr_file_says_so() {
    let sample = file(vec![part((2, 2)).filled(&RGB, value)]);
    for bytes in [&b""[..], b"\x76\x2f", b"\x89JPG\r\n\x1a\n and so on"] {
        sample.replace(bytes);
        let error = read(&sample, &RGB).unwrap_err().to_string();
        assert!(error.contains("sample.exr"), "{error}");
    }
    assert!(matches!(read(&sample, &RGB), Err(ImageError::NotExr { .. })));
    let folder = sample.folder.path();
    let read = |path| read_channels(path, &RGB, None, Unfinished::Refused);
    assert!(matches!(read(folder), Err(ImageError::Unsupported { .. })));
    assert!(matches!(read(Path::new("/no/such.exr")), Err(ImageError::Io { .. })));
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
fn a_render_that_was_not_finished_is_read_as_far_as_it_goes() {
    for encoding in [scan_lines(Compression::ZIP1), tiles(Compression::ZIP16, (8, 4))] {
        let sample = file(vec![PartOf { encoding, ..part((16, 12)) }.filled(&RGB, value)]);
        let bytes = sample.bytes();
        let source = source::Source::open(&sample.path).expect("a sound file");
        let head = source.head().0.len();
        let chunks = source.table(0).len();
        // As a renderer leaves it that was killed: no offsets, and the last chunks missing.
        let mut unfinished = bytes.clone();
        unfinished[head..head + 8 * chunks].fill(0);
        unfinished.truncate(source.table(0)[chunks - 2] as usize + 5);
        sample.replace(&unfinished);
        let error = read(&sample, &RGB).unwrap_err().to_string();
        assert!(error.contains("not finished") && error.contains("--repair"), "{error}");
        let read = |path: &Path| read_channels(path, &RGB, None, Unfinished::Zero);
        let pixels = read(&sample.path).expect("some of it is there");
        assert!((1..12).contains(&pixels.missing_rows), "{}", pixels.missing_rows);
        assert_eq!(pixels.channels["R"][..32], (0..32).map(|k| value(0, k)).collect::<Vec<_>>());
        assert_eq!(pixels.channels["R"].last(), Some(&0.0));

        // What is written of it is whole.
        let copy = sample.folder.path().join("copy.exr");
        rewrite(&sample.path, &copy, &[], ("tamis", "test")).expect("writable");
        let again = read_channels(&copy, &RGB, None, Unfinished::Refused).expect("whole");
        assert_eq!(again.channels, pixels.channels);
    }
}

#[test]
fn a_table_without_offsets_is_made_anew() {
    let sample = file(vec![part((16, 40)).filled(&RGB, value)]);
    let source = source::Source::open(&sample.path).expect("a sound file");
    let (head, chunks) = (source.head().0.len(), source.table(0).len());
    let mut bytes = sample.bytes();
    bytes[head..head + 8 * chunks].fill(0);
    sample.replace(&bytes);
    assert_rgb(&read(&sample, &RGB).expect("all of it is there"), (16, 40));
}

#[test]
fn a_rewritten_file_is_the_old_one_but_for_what_was_replaced() {
    let lossless = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
    ];
    for compression in lossless {
        for encoding in [scan_lines(compression), tiles(compression, (32, 16))] {
            let named = |name, channels: &[&str]| {
                let part = PartOf { name: Some(name), origin: (3, -5), encoding, ..part((70, 45)) };
                part.filled(channels, value)
            };
            let sample = file(vec![
                named("beauty", &["A", "B", "G", "R", "id"]),
                named("other", &["R", "Z"]),
            ]);
            let header = Header::read(&sample.path).expect("a sound file");
            let new: Vec<f32> = (0..70 * 45).map(|k| k as f32 * 0.25).collect();
            let window = header.parts()[0].window;
            let replaced = |channel| Replacement { channel, window, samples: &new };
            let copy = sample.folder.path().join("copy.exr");
            let both = [replaced("beauty.R"), replaced("beauty.B")];
            let lost = rewrite(&sample.path, &copy, &both, ("tamis", "once")).expect("writable");
            assert_eq!(lost, Lost::default());
            let all: Vec<&str> = header.names().collect();
            for name in all {
                let read = |path| {
                    let read = read_channels(path, &[name], None, Unfinished::Refused);
                    read.expect("a sound file").channels.remove(name)
                };
                let expected = match name {
                    "beauty.R" | "beauty.B" => Some(new.clone()),
                    _ => read(&sample.path),
                };
                assert_eq!(read(&copy), expected, "{name}");
            }
            // Once more: the attribute is one, with the newer text.
            let again = sample.folder.path().join("again.exr");
            rewrite(&copy, &again, &both[..1], ("tamis", "twice")).expect("writable");
            let bytes = std::fs::read(&again).expect("written");
            let count = |what: &[u8]| bytes.windows(what.len()).filter(|w| *w == what).count();
            assert_eq!((count(b"tamis\0string"), count(b"once"), count(b"twice")), (1, 0, 1));
        }
    }
}

#[test]
fn halves_stay_finite_and_halves() {
    let mut sample = part((2, 1));
    sample.channels.push(("R".to_owned(), FlatSamples::F16(vec![f16::ONE; 2])));
    let sample = file(vec![sample]);
    let copy = sample.folder.path().join("copy.exr");
    let window = Window::of_size((2, 1));
    let new = [Replacement { channel: "R", window, samples: &[1e9, 0.1] }];
    rewrite(&sample.path, &copy, &new, ("tamis", "test")).expect("writable");
    let header = Header::read(&copy).expect("a sound file");
    assert_eq!(header.parts()[0].channels[0].kind, SampleKind::Half);
    let pixels = read_channels(&copy, &["R"], None, Unfinished::Refused).expect("a sound file");
    assert_eq!(pixels.channels["R"], [65504.0, f16::from_f32(0.1).to_f32()]);
}

#[test]
fn what_is_written_reads_back_with_the_sources_windows() {
    let window = PartOf { origin: (5, -3), ..part((9, 4)) }.filled(&RGB, value);
    let source = file(vec![window]);
    let pixels = read(&source, &RGB).expect("a sound file");
    let copy = source.folder.path().join("copy.exr");
    let rgb = RGB.map(|name| pixels.channels[name].as_slice());
    write_rgb(&copy, (9, 4), rgb, pixels.attributes.as_ref()).expect("writable");
    let again = read_channels(&copy, &RGB, None, Unfinished::Refused);
    assert_rgb(&again.expect("a sound file"), (9, 4));
    assert_eq!(Header::read(&copy).expect("a sound file").parts()[0].window.origin, (5, -3));
    write_rgb(&copy, (9, 4), rgb, None).expect("writable");
    assert_eq!(Header::read(&copy).expect("a sound file").parts()[0].window.origin, (0, 0));

    let nowhere = Path::new("/no/such/folder/out.exr");
    let error = write_rgb(nowhere, (9, 4), rgb, None).unwrap_err().to_string();
    assert!(error.contains("/no/such/folder/out.exr"), "{error}");
}

/// The levels of a channel, the largest first.
fn levels(path: &Path) -> Vec<Vec<f32>> {
    use exr::prelude::{ReadChannels, ReadLayers, read};
    let image = read()
        .no_deep_data()
        .all_resolution_levels()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .expect("a sound file");
    let samples = image.layer_data.channel_data.list.into_iter().next().expect("R").sample_data;
    match samples {
        exr::image::Levels::Mip { level_data, .. } => {
            level_data.into_iter().map(|level| level.values_as_f32().collect()).collect()
        }
        _ => panic!("it has several levels"),
    }
}

#[test]
fn smaller_levels_are_made_anew() {
    use exr::image::{AnyChannel, AnyChannels, Encoding, Image, Layer, Levels};
    use exr::math::{RoundingMode, Vec2};
    use exr::meta::mip_map_levels;
    use exr::prelude::WritableImage;
    let size = (20, 12);
    let maps = mip_map_levels(RoundingMode::Down, Vec2(size.0, size.1))
        .map(|(_, level)| FlatSamples::F32(vec![7.0; level.0 * level.1]));
    let samples = Levels::Mip { rounding_mode: RoundingMode::Down, level_data: maps.collect() };
    let channels = AnyChannels::sort([AnyChannel::new("R", samples)].into_iter().collect());
    let encoding = Encoding { ..tiles(Compression::ZIP16, (8, 8)) };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("mip.exr");
    let layer = Layer::new(size, Default::default(), encoding, channels);
    Image::from_layer(layer).write().to_file(&path).expect("a writable folder");
    assert!(levels(&path).iter().flatten().all(|&x| x == 7.0));
    assert_eq!(
        read_channels(&path, &["R"], None, Unfinished::Refused).expect("sound").channels["R"].len(),
        240
    );

    let new: Vec<f32> = (0..240).map(|k| (k % 20) as f32).collect();
    let copy = folder.path().join("copy.exr");
    let replaced = Replacement { channel: "R", window: Window::of_size(size), samples: &new };
    rewrite(&path, &copy, &[replaced], ("tamis", "test")).expect("writable");
    let levels = levels(&copy);
    assert_eq!(levels[0], new);
    // Means of two by two, four by four, …
    assert_eq!(levels[1][..3], [0.5, 2.5, 4.5]);
    assert_eq!(levels[2][..2], [1.5, 5.5]);
    assert_eq!(levels.last().expect("several"), &[9.5]);
}

#[test]
fn a_chunk_that_says_it_is_another_leaves_a_hole_that_is_filled_on_the_way_out() {
    let encoding = scan_lines(Compression::ZIP1);
    let sample = file(vec![PartOf { encoding, ..part((6, 5)) }.filled(&RGB, value)]);
    let source = source::Source::open(&sample.path).expect("a sound file");
    let third = source.table(0)[2] as usize;
    let mut bytes = sample.bytes();
    bytes[third..third + 4].copy_from_slice(&1i32.to_le_bytes());
    sample.replace(&bytes);
    assert!(matches!(read(&sample, &RGB), Err(ImageError::Unfinished { missing: 1, .. })));
    let copy = sample.folder.path().join("copy.exr");
    rewrite(&sample.path, &copy, &[], ("tamis", "test")).expect("writable");
    let pixels = read_channels(&copy, &RGB, None, Unfinished::Refused).expect("whole");
    assert_eq!(pixels.channels["R"][12..18], [0.0; 6]);
    assert_eq!(pixels.channels["R"][6..12], (6..12).map(|k| value(0, k)).collect::<Vec<_>>());
}
