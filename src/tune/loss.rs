//! What is made small, and how much each part of an image counts.
//!
//! With x a channel of the result, r of the reference, and e = (x - r)² / (r² + 0.01) as in
//! RelMSE, a loss is made of four means over pixels and channels:
//!
//! | part | mean of | it asks for |
//! |---|---|---|
//! | robust | e / (1 + e) | most pixels to be right; a firefly costs 1 at most |
//! | mean | e / (1 + e / 20) | no firefly left, and no light lost: up to 20 |
//! | tone-mapped | \|t(x) - t(r)\| | a picture that looks right, in dark places too |
//! | smooth | \|mean of t(x) - t(r) over 5 x 5 pixels\| | no blotches, which eyes see before noise |
//!
//! where t(x) is the root of y / (1 + y) + 0.01, and y is x, 0 if negative, at an exposure that
//! makes the reference's mean luminance 0.6.
//!
//! Each part is divided by what it is for images like this one by now: a running mean by
//! scene and sample count. So a scene counts the same whether it is nearly clean or all noise,
//! and each part of a loss what its share says.

use serde::{Deserialize, Serialize};

use crate::expr::symbol::Variadic;

/// How many parts there are.
pub const PARTS: usize = 4;

/// A choice of the parts' shares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// All four.
    Balanced,
    /// Robust and mean: small relative errors.
    Relative,
    /// The tone-mapped and the smooth one.
    ToneMapped,
}

impl Loss {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Balanced, Self::Relative, Self::ToneMapped];

    /// What `--loss` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Balanced => "balanced",
            Self::Relative => "relative",
            Self::ToneMapped => "tone-mapped",
        }
    }

    /// One line for people.
    pub fn doc(self) -> &'static str {
        match self {
            Self::Balanced => {
                "relative errors, fireflies and lost lights, and how the picture looks"
            }
            Self::Relative => "relative errors, fireflies and lost lights",
            Self::ToneMapped => "how the tone-mapped picture looks",
        }
    }

    /// What each part counts.
    pub fn shares(self) -> [f64; PARTS] {
        match self {
            Self::Balanced => [0.7, 0.2, 0.5, 0.4],
            Self::Relative => [1.0, 0.2, 0.0, 0.0],
            Self::ToneMapped => [0.0, 0.0, 0.5, 0.5],
        }
    }

    /// The mean of the parts' logarithms, by their shares: how images of any noise are
    /// compared.
    pub fn score(self, parts: [f64; PARTS]) -> f64 {
        let shares = self.shares();
        let logs = parts.iter().zip(shares).map(|(part, share)| share * part.max(1e-12).ln());
        logs.sum::<f64>() / shares.iter().sum::<f64>()
    }
}

/// Keeps the denominators of relative errors from vanishing, as in RelMSE.
const DARK: f64 = 0.01;

/// How far errors count in the mean.
const REACH: f64 = 0.05;

/// A reference to be compared with.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Linear R, G and B, pixel by pixel, as the renderer wrote them.
    pub pixels: Vec<[f32; 3]>,
    /// What makes the whole picture's mean luminance 0.6.
    pub exposure: f64,
}

impl Reference {
    /// A whole picture.
    pub fn new(rgb: [&[f32]; 3]) -> Self {
        let [r, g, b] = rgb;
        let channels = r.iter().zip(g).zip(b);
        let pixels: Vec<[f32; 3]> = channels.map(|((&r, &g), &b)| [r, g, b]).collect();
        let luminance = |pixel: &[f32; 3]| -> f64 {
            let parts = pixel.iter().zip(Variadic::LUMINANCE);
            parts.map(|(&x, share)| f64::from(x) * f64::from(share)).sum()
        };
        let mean = pixels.iter().map(luminance).sum::<f64>() / pixels.len().max(1) as f64;
        let exposure = 0.6 / mean.max(1e-6);
        Self { pixels, exposure }
    }
}

/// The tone-mapped value, and its derivative.
fn tone(x: f64, exposure: f64) -> [f64; 2] {
    let y = exposure * x.max(0.0);
    let value = (y / (1.0 + y) + DARK).sqrt();
    let derivative = if x > 0.0 { exposure / (1.0 + y).powi(2) / (2.0 * value) } else { 0.0 };
    [value, derivative]
}

/// Pixels to either side over which the smooth part takes its means.
const RADIUS: usize = 2;

/// Means over the pixels of a square that lie in the image, or their transpose: what every
/// pixel hands back to those that it is the mean of.
fn smoothed(values: &[f64], width: usize, transposed: bool) -> Vec<f64> {
    let height = values.len() / width;
    let around = |k: usize, end: usize| k.saturating_sub(RADIUS)..(k + RADIUS + 1).min(end);
    let share =
        |x: usize, y: usize| 1.0 / (around(x, width).len() * around(y, height).len()) as f64;
    let mut rows = vec![0.0; values.len()];
    for (k, sum) in rows.iter_mut().enumerate() {
        let (x, y) = (k % width, k / width);
        let given = |u: usize| values[y * width + u] * if transposed { share(u, y) } else { 1.0 };
        *sum = around(x, width).map(given).sum();
    }
    let pixel = |k: usize| {
        let (x, y) = (k % width, k / width);
        let sum: f64 = around(y, height).map(|v| rows[v * width + x]).sum();
        if transposed { sum } else { sum * share(x, y) }
    };
    (0..values.len()).map(pixel).collect()
}

/// The parts of a loss for colours in units of `unit`, in rows of `width`. Writes the
/// derivative of Σ part · weight by every colour.
pub fn parts(
    colors: &[[f32; 3]],
    width: usize,
    unit: f32,
    reference: &Reference,
    weights: [f64; PARTS],
    owed: &mut [[f32; 3]],
) -> [f64; PARTS] {
    let unit = f64::from(unit);
    let count = (3 * colors.len()).max(1) as f64;
    let mut sums = [0.0; PARTS];
    for k in 0..3 {
        let mut derivatives = Vec::with_capacity(colors.len());
        let (mut slopes, mut differences) = (Vec::new(), Vec::new());
        for (color, reference_pixel) in colors.iter().zip(&reference.pixels) {
            let (x, r) = (f64::from(color[k]) * unit, f64::from(reference_pixel[k]));
            let (difference, size) = (x - r, r * r + DARK);
            let e = difference * difference / size;
            let by_x = 2.0 * difference / size;
            let [[seen, slope], [wanted, _]] = [x, r].map(|x| tone(x, reference.exposure));
            sums[0] += e / (1.0 + e);
            sums[1] += e / (1.0 + REACH * e);
            sums[2] += (seen - wanted).abs();
            derivatives.push(
                weights[0] * by_x / (1.0 + e).powi(2)
                    + weights[1] * by_x / (1.0 + REACH * e).powi(2)
                    + weights[2] * slope * (seen - wanted).signum(),
            );
            slopes.push(slope);
            differences.push(seen - wanted);
        }
        let smooth = smoothed(&differences, width, false);
        sums[3] += smooth.iter().map(|x| x.abs()).sum::<f64>();
        let signs: Vec<f64> = smooth.iter().map(|x| x.signum()).collect();
        let by_tone = smoothed(&signs, width, true);
        for (n, owed) in owed.iter_mut().enumerate() {
            let derivative = derivatives[n] + weights[3] * slopes[n] * by_tone[n];
            owed[k] = (derivative * unit / count) as f32;
        }
    }
    sums.map(|sum| sum / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_difference_quotients() {
        let channel =
            |k: usize| -> Vec<f32> { (0..40).map(|n| ((n * 7 + k) % 11) as f32 * 0.2).collect() };
        let [r, g, b] = [0, 1, 2].map(channel);
        let reference = Reference::new([&r, &g, &b]);
        let colors: Vec<[f32; 3]> =
            (0..40).map(|n| [0, 3, 5].map(|k| ((n * 5 + k) % 13) as f32 * 0.3 - 0.2)).collect();
        let weights = [1.0, 0.1, 0.5, 0.7];
        let value = |colors: &[[f32; 3]]| -> f64 {
            let mut owed = vec![[0.0; 3]; colors.len()];
            let parts = parts(colors, 8, 1.5, &reference, weights, &mut owed);
            parts.iter().zip(weights).map(|(part, weight)| part * weight).sum()
        };
        let mut owed = vec![[0.0; 3]; colors.len()];
        parts(&colors, 8, 1.5, &reference, weights, &mut owed);
        for n in 0..40 {
            for k in 0..3 {
                let moved = |by: f32| {
                    let mut colors = colors.clone();
                    colors[n][k] += by;
                    value(&colors)
                };
                let step = 1.0 / 1024.0;
                let quotient = (moved(step) - moved(-step)) / f64::from(2.0 * step);
                let error = (f64::from(owed[n][k]) - quotient).abs();
                // Where signs change there is no derivative.
                let kink = colors[n][k].abs() < 0.01 || error > 0.1 * quotient.abs();
                assert!(kink || error < 1e-4 + 1e-3 * quotient.abs(), "{n} {k}: {quotient}");
            }
        }
    }

    #[test]
    fn a_perfect_picture_costs_nothing_and_a_lost_light_more_than_it_did() {
        let grey = vec![0.5f32; 9];
        let mut lit = grey.clone();
        lit[4] = 40.0;
        let reference = Reference::new([&lit, &lit, &lit]);
        let colors = |grey: &[f32]| -> Vec<[f32; 3]> { grey.iter().map(|&x| [x; 3]).collect() };
        let cost = |grey: &[f32]| {
            parts(&colors(grey), 3, 1.0, &reference, [1.0; PARTS], &mut [[0.0; 3]; 9])
        };
        assert_eq!(cost(&lit), [0.0; PARTS]);
        assert!(cost(&grey).iter().all(|&part| part > 0.0));
    }
}
