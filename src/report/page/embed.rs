//! What pages hold beside text: pictures, numbers, pixels.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use half::f16;
use serde::Serialize;

use crate::image::{Image, Map};

/// JSON that may stand within a `script` element.
pub(super) fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("pages have text for keys").replace('<', "\\u003c")
}

/// The side of the squares of pixels that a page shows as one, so that it shows no more pixels
/// than `most`.
pub(super) fn step((width, height): (usize, usize), most: usize) -> usize {
    let shown = |step: &usize| width.div_ceil(*step) * height.div_ceil(*step);
    (1..).find(|step| shown(step) <= most.max(1)).expect("a step of the image's size shows one")
}

/// The mean of every square of `step` by `step` pixels; those at the edge may be smaller. What is
/// no number makes its square none.
pub(super) fn shrunk(plane: &[f32], (width, height): (usize, usize), step: usize) -> Vec<f32> {
    let corners =
        (0..height).step_by(step).flat_map(|y| (0..width).step_by(step).map(move |x| (x, y)));
    let square = |(x, y): (usize, usize)| {
        let rows = plane.chunks_exact(width).skip(y).take(step);
        let pixels = rows.flat_map(|row| &row[x..width.min(x + step)]);
        let (sum, count) = pixels.fold((0.0, 0u32), |(sum, n), &p| (sum + f64::from(p), n + 1));
        (sum / f64::from(count)) as f32
    };
    corners.map(square).collect()
}

/// An image's pixels as half floats, packed: channel by channel the high bytes of the differences
/// from one pixel's bits to the next, then the low ones; deflated, in base64. What is beyond the
/// range of half floats stands at its end.
pub(super) fn halves(image: &Image, step: usize) -> String {
    let mut bytes = Vec::new();
    for channel in image.rgb() {
        let mut before = 0u16;
        let half = |x: f32| f16::from_f32(if x.is_nan() { x } else { x.clamp(-65504.0, 65504.0) });
        let differences = shrunk(channel, image.size(), step).into_iter().map(|x| {
            let bits = half(x).to_bits();
            bits.wrapping_sub(std::mem::replace(&mut before, bits)).to_be_bytes()
        });
        let differences: Vec<[u8; 2]> = differences.collect();
        bytes.extend(differences.iter().map(|[high, _]| high));
        bytes.extend(differences.iter().map(|[_, low]| low));
    }
    packed(&bytes)
}

/// A map's values as bytes by `level`, which takes no number for what is not known; packed.
pub(super) fn levels(map: &Map, step: usize, level: impl Fn(f64) -> u8) -> String {
    let values: Vec<f32> = map.values().iter().map(|&x| x as f32).collect();
    let shown = shrunk(&values, map.size(), step);
    packed(&shown.into_iter().map(|x| level(x.into())).collect::<Vec<u8>>())
}

fn packed(bytes: &[u8]) -> String {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).expect("memory takes what is written to it");
    STANDARD.encode(encoder.finish().expect("memory takes what is written to it"))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::ZlibDecoder;

    use super::*;

    fn unpacked(text: &str) -> Vec<u8> {
        let bytes = STANDARD.decode(text).expect("base64");
        let mut inflated = Vec::new();
        ZlibDecoder::new(&bytes[..]).read_to_end(&mut inflated).expect("deflated");
        inflated
    }

    #[test]
    fn large_images_are_shown_by_squares() {
        assert_eq!([step((10, 10), 100), step((10, 10), 99), step((9, 1), 2)], [1, 2, 5]);
        let plane = [1.0, 3.0, 5.0, 1.0, 3.0, 7.0];
        assert_eq!(shrunk(&plane, (3, 2), 2), [2.0, 6.0]);
        assert_eq!(shrunk(&plane, (3, 2), 1), plane);
    }

    #[test]
    fn pixels_come_back_as_half_floats() {
        let channel = vec![0.0, 0.5, -2.0, 1e9, f32::NAN, 1.0 / 3.0];
        let image = Image::new("test", 3, 2, [channel.clone(), channel.clone(), channel.clone()]);
        let bytes = unpacked(&halves(&image.expect("a sample per pixel"), 1));
        assert_eq!(bytes.len(), 3 * 2 * 6);
        let mut before = 0u16;
        for (k, x) in channel.iter().enumerate() {
            before = before.wrapping_add(u16::from_be_bytes([bytes[k], bytes[6 + k]]));
            let found = f16::from_bits(before).to_f32();
            let near = (found - x.min(65504.0)).abs() < 1e-3 * found.abs().max(1e-3);
            assert!(near || (found.is_nan() && x.is_nan()), "{found} is not {x}");
        }
    }

    #[test]
    fn maps_come_back_as_levels() {
        let map = Map::new((3, 1), vec![0.0, f64::NAN, 1.0]);
        let level = |x: f64| if x.is_nan() { 0 } else { 1 + (x * 254.0) as u8 };
        assert_eq!(unpacked(&levels(&map, 1, level)), [1, 0, 255]);
    }

    #[test]
    fn no_text_ends_a_script() {
        assert_eq!(json(&"</script>"), "\"\\u003c/script>\"");
    }
}
