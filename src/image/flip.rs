//! LDR-FLIP: what an eye notices that sees one picture after the other (Andersson, Nilsson,
//! Akenine-Möller, Oskarsson, Åström, Fairchild: *FLIP: A Difference Evaluator for Alternating
//! Images*, 2020).
//!
//! Two things are compared: colours, after blurring them as an eye does from that far away, and
//! features (edges and points) of the luminance, which make a difference of colours count more.
//! The constants are the paper's, and results agree with NVIDIA's `flip-evaluator`, which is also
//! where the colour spaces' numbers are from.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::convolve::{Edge, convolve, kernel};

/// Pixels per degree of the eye's field, of a screen of 0.7 m and 3840 pixels that is 0.7 m away:
/// 67.02, which everybody calls 67. With 67 itself, pixels are off by up to 3e-4.
const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// The sensitivity to contrast, as sums of Gaussians a √(π / b) exp(-π² x² / b), by channel:
/// pairs of a and b.
const SENSITIVITY: [&[[f64; 2]]; 3] =
    [&[[1.0, 0.0047]], &[[1.0, 0.0053]], &[[34.1, 0.04], [13.5, 0.025]]];

/// How a difference of colours counts: its power, and what share of the greatest is brought to
/// what share of the result.
const COLOR_POWER: f64 = 0.7;
const KNEE: [f64; 2] = [0.4, 0.95];

/// The width of features, in degrees, and how they count.
const FEATURE_WIDTH: f64 = 0.082;
const FEATURE_POWER: f64 = 0.5;

/// Linear RGB with the primaries of sRGB to XYZ, and back.
const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];
const FROM_XYZ: [[f64; 3]; 3] = [
    [3.241_003_275, -1.537_398_934, -0.498_615_861],
    [-0.969_224_334, 1.875_930_071, 0.041_554_224],
    [0.055_639_423, -0.204_011_202, 1.057_148_933],
];

/// White, D65.
const WHITE: [f64; 3] = [0.950_428_545, 1.0, 1.088_900_371];

/// The difference that is seen at every pixel, from 0 to 1, of linear channels from 0 to 1.
pub(super) fn difference(
    size: (usize, usize),
    image: &[Vec<f64>; 3],
    reference: &[Vec<f64>; 3],
) -> Vec<f64> {
    let (image, reference) = (Seen::new(size, image), Seen::new(size, reference));
    let greatest = hyab(hunt(lab([0.0, 1.0, 0.0])), hunt(lab([0.0, 0.0, 1.0]))).powf(COLOR_POWER);
    let knee = KNEE[0] * greatest;
    let at = |k: usize| {
        let color = hyab(image.color(k), reference.color(k)).powf(COLOR_POWER);
        let color = match color < knee {
            true => color * KNEE[1] / knee,
            false => KNEE[1] + (color - knee) / (greatest - knee) * (1.0 - KNEE[1]),
        };
        let feature = (image.edges[k] - reference.edges[k]).abs();
        let feature = feature.max((image.points[k] - reference.points[k]).abs());
        color.powf(1.0 - (feature / 2f64.sqrt()).powf(FEATURE_POWER))
    };
    (0..size.0 * size.1).into_par_iter().map(at).collect()
}

/// What is seen of a picture.
struct Seen {
    /// Blurred colours, in CIELAB, with saturation as dark or bright as it is seen.
    colors: [Vec<f64>; 3],
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl Seen {
    fn new(size: (usize, usize), rgb: &[Vec<f64>; 3]) -> Self {
        let mut planes = each(rgb, |rgb| opponent(xyz(rgb)));
        let luminance: Vec<f64> = planes[0].iter().map(|y| (y + 16.0) / 116.0).collect();
        for (plane, gaussians) in planes.iter_mut().zip(SENSITIVITY) {
            *plane = blurred(plane, size, gaussians);
        }
        let colors = each(&planes, |seen| {
            let rgb = times(&FROM_XYZ, from_opponent(seen)).map(|x| x.clamp(0.0, 1.0));
            hunt(lab(rgb))
        });
        let [edges, points] = features(&luminance, size);
        Self { colors, edges, points }
    }

    fn color(&self, k: usize) -> [f64; 3] {
        self.colors.each_ref().map(|plane| plane[k])
    }
}

/// Every pixel made another.
fn each(planes: &[Vec<f64>; 3], f: impl Fn([f64; 3]) -> [f64; 3] + Sync) -> [Vec<f64>; 3] {
    let [a, b, c] = planes;
    let pixels = a.par_iter().zip(b).zip(c).map(|((&a, &b), &c)| {
        let [a, b, c] = f([a, b, c]);
        (a, (b, c))
    });
    let (a, (b, c)) = pixels.unzip::<_, _, _, (Vec<f64>, Vec<f64>)>();
    [a, b, c]
}

/// A plane as an eye blurs it.
fn blurred(plane: &[f64], size: (usize, usize), gaussians: &[[f64; 2]]) -> Vec<f64> {
    let widest = SENSITIVITY.iter().copied().flatten().map(|[_, b]| *b).fold(0.0, f64::max);
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as usize;
    let parts = gaussians.iter().map(|[a, b]| {
        let row = kernel(radius, |x| {
            let degrees = x / PIXELS_PER_DEGREE;
            (-PI * PI * degrees * degrees / b).exp()
        });
        let sum: f64 = row.iter().sum();
        (a * (PI / b).sqrt(), sum * sum, row)
    });
    let parts: Vec<(f64, f64, Vec<f64>)> = parts.collect();
    let whole: f64 = parts.iter().map(|(share, sum, _)| share * sum).sum();
    let mut out = vec![0.0; plane.len()];
    for (share, _, row) in &parts {
        let part = convolve(plane, size, row, row, Edge::Nearest);
        out.iter_mut().zip(part).for_each(|(out, part)| *out += share / whole * part);
    }
    out
}

/// Edges and points: how steep the luminance is, and how bent.
fn features(luminance: &[f64], size: (usize, usize)) -> [Vec<f64>; 2] {
    let sigma = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * sigma).ceil() as usize;
    let gauss = |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
    let smooth = balanced(kernel(radius, gauss));
    let slope = balanced(kernel(radius, |x| -x * gauss(x)));
    let bend = balanced(kernel(radius, |x| (x * x / (sigma * sigma) - 1.0) * gauss(x)));
    [slope, bend].map(|across| {
        let x = convolve(luminance, size, &across, &smooth, Edge::Nearest);
        let y = convolve(luminance, size, &smooth, &across, Edge::Nearest);
        x.iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
    })
}

/// A kernel whose positive numbers sum to 1, and whose negative ones to -1.
fn balanced(kernel: Vec<f64>) -> Vec<f64> {
    let sum = |sign: f64| kernel.iter().map(|x| (x * sign).max(0.0)).sum::<f64>();
    let (above, below) = (sum(1.0), sum(-1.0));
    kernel
        .iter()
        .map(|x| if *x > 0.0 { x / above } else { x / below.max(f64::MIN_POSITIVE) })
        .collect()
}

fn times(matrix: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn xyz(rgb: [f64; 3]) -> [f64; 3] {
    times(&TO_XYZ, rgb)
}

/// XYZ to YCxCz: luminance, red against green, blue against yellow, all linear.
fn opponent([x, y, z]: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = [x / WHITE[0], y / WHITE[1], z / WHITE[2]];
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn from_opponent([luminance, red, blue]: [f64; 3]) -> [f64; 3] {
    let y = (luminance + 16.0) / 116.0;
    [(y + red / 500.0) * WHITE[0], y * WHITE[1], (y - blue / 200.0) * WHITE[2]]
}

/// Linear RGB to CIELAB.
fn lab(rgb: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let [x, y, z] = xyz(rgb);
    let [x, y, z] = [x / WHITE[0], y / WHITE[1], z / WHITE[2]].map(|t: f64| {
        if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// The Hunt effect: what is dark looks less saturated.
fn hunt([l, a, b]: [f64; 3]) -> [f64; 3] {
    [l, 0.01 * l * a, 0.01 * l * b]
}

/// A distance of colours that also holds for those far apart.
fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}
