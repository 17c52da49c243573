//! What is computed from the features: gradients, variances, coordinates.
//!
//! All of it from *normalised* features, so that it inherits their independence
//! of units and exposure. Images are rows of `width` samples without padding.

use rayon::prelude::*;

/// What [`gradient`] computes, for those who must compute it themselves.
pub const GRADIENT: &str = "per component, the root of the squared differences in x and y, per \
     pixel: central ones, one-sided at the borders";

/// What [`estimate_variance`] computes, likewise.
pub const ESTIMATE: &str = "A renderer that has no variances can estimate them from the values: \
     what the least-squares plane through a pixel's 3 x 3 neighbourhood (edges repeated) leaves, \
     squared, summed, divided by 6, and averaged over the components.";

/// The magnitude of the gradient: central differences in x and y, one-sided at
/// the borders, zero along an axis of one pixel. In units per pixel.
pub fn gradient(samples: &[f32], width: usize) -> Vec<f32> {
    let height = samples.len() / width;
    let at = |x: usize, y: usize| f64::from(samples[y * width + x]);
    let mut out = Vec::with_capacity(samples.len());
    for y in 0..height {
        let (up, down) = neighbours(y, height);
        for x in 0..width {
            let (left, right) = neighbours(x, width);
            let dx = slope(at(right, y) - at(left, y), right - left);
            let dy = slope(at(x, down) - at(x, up), down - up);
            // f64: squares of what f32 holds neither overflow nor vanish.
            out.push((dx * dx + dy * dy).sqrt() as f32);
        }
    }
    out
}

/// The positions before and after `i` that exist, or `i` itself.
fn neighbours(i: usize, len: usize) -> (usize, usize) {
    (i.saturating_sub(1), (i + 1).min(len - 1))
}

fn slope(difference: f64, distance: usize) -> f64 {
    if distance == 0 { 0.0 } else { difference / distance as f64 }
}

/// Estimates the variance of the pixels' means from the image alone, for files
/// that do not hold it: what is left of the 3x3 neighbourhood after the best
/// plane through it, as a mean square over the six remaining degrees of
/// freedom; averaged over the components. Edges repeat.
///
/// **Honestly:** this measures how rough the image is around a pixel. Smooth
/// shading does not count as noise; but texture and outlines do, and noise
/// that neighbouring pixels share (a wide reconstruction filter, an upscaled
/// image) is missed. With six degrees of freedom an estimate is off by 58%
/// typically even where the noise is plain; a renderer's own sample variance
/// over four samples, with three, by 82%.
pub fn estimate_variance(components: &[Vec<f32>], width: usize) -> Vec<f32> {
    let mut out = vec![0.0; components.first().map_or(0, Vec::len)];
    out.par_chunks_mut(width).enumerate().for_each_init(Vec::new, |sums, (y, out)| {
        pulp::Arch::new().dispatch(Estimate { components, width, y, sums, out });
    });
    out
}

/// A row of estimates.
struct Estimate<'a> {
    components: &'a [Vec<f32>],
    width: usize,
    y: usize,
    /// Memory for the sums over the components.
    sums: &'a mut Vec<f64>,
    out: &'a mut [f32],
}

impl pulp::WithSimd for Estimate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { components, width, y, sums, out } = self;
        let (up, down) = neighbours(y, components[0].len() / width);
        let share = 1.0 / components.len() as f64;
        sums.clear();
        sums.resize(width, 0.0);
        for samples in components {
            let [above, here, below] = [up, y, down].map(|y| &samples[y * width..][..width]);
            let residual = |left: usize, x: usize, right: usize| {
                let center = f64::from(here[x]);
                let row = |row: &[f32]| [left, x, right].map(|x| f64::from(row[x]) - center);
                plane_residual([row(above), row(here), row(below)])
            };
            // The first and the last column have no neighbours on one side; between them the
            // loop asks for none that may not be there.
            for x in [0, width - 1] {
                let (left, right) = neighbours(x, width);
                if x == 0 || width > 1 {
                    sums[x] += share * residual(left, x, right);
                }
            }
            for (x, sum) in sums.iter_mut().enumerate().take(width - 1).skip(1) {
                *sum += share * residual(x - 1, x, x + 1);
            }
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = *sum as f32;
        }
    }
}

/// Columns and rows of a square whose noise is told apart from that of others.
const SQUARE: usize = 16;

/// What is added to a square's mean colour, in units of the exposure, so that the noise of
/// what is black is not infinitely large.
const BLACK: f64 = 0.02;

/// What [`grain`] computes, for those who must compute it themselves.
pub const GRAIN: &str = "Grain, where variances are estimated: for every square of 16 x 16 pixels, \
     the mean of the colour's variance over the square of (the mean colour, at least 0, + 0.02), \
     both in units of the exposure; of those that are not 0, the lower quartile and the median.";

/// How noisy an image is as a whole, from its colour (in units of the exposure) alone: the
/// mean of [`estimate_variance`] over a square of 16x16 pixels, relative to the square of its
/// mean colour; the lower quartile and the median over all squares that vary at all. Texture
/// and outlines count as noise in some squares, noise in all of them.
pub fn grain(color: &[Vec<f32>], width: usize) -> [f32; 2] {
    let variance = estimate_variance(color, width);
    let height = variance.len() / width;
    let mut squares = Vec::new();
    for top in (0..height).step_by(SQUARE) {
        for left in (0..width).step_by(SQUARE) {
            let rows = top..(top + SQUARE).min(height);
            let columns = left..(left + SQUARE).min(width);
            let count = (rows.len() * columns.len()) as f64;
            let mean = |samples: &[f32]| {
                let row = |y: usize| &samples[y * width..][columns.clone()];
                rows.clone().flat_map(row).map(|&x| f64::from(x)).sum::<f64>() / count
            };
            let level = color.iter().map(|channel| mean(channel)).sum::<f64>() / color.len() as f64;
            let noise = mean(&variance) / (level.max(0.0) + BLACK).powi(2);
            if noise > 0.0 {
                squares.push(noise.min(1e6) as f32);
            }
        }
    }
    squares.sort_unstable_by(f32::total_cmp);
    [1, 2].map(|quarters| squares.get(squares.len() * quarters / 4).copied().unwrap_or(0.0))
}

/// Mean square of nine samples about their least-squares plane.
#[inline(always)]
fn plane_residual(v: [[f64; 3]; 3]) -> f64 {
    let add = |[a, b, c]: [f64; 3], sum: f64| sum + a + b + c;
    let [above, here, below] = v;
    let sum = |f: fn([f64; 3]) -> [f64; 3]| add(f(below), add(f(here), add(f(above), 0.0)));
    let mean = sum(|row| row) / 9.0;
    let column = |k: usize| v[0][k] + v[1][k] + v[2][k];
    let line = |k: usize| v[k][0] + v[k][1] + v[k][2];
    let (dx, dy) = (column(2) - column(0), line(2) - line(0));
    let residual = sum(|row| row.map(|x| x * x)) - 9.0 * mean * mean - (dx * dx + dy * dy) / 6.0;
    // Rounding can leave a trace below zero where the plane fits exactly.
    residual.max(0.0) / 6.0
}

/// The mean of several components, sample by sample.
pub fn average(components: &[Vec<f32>]) -> Vec<f32> {
    match components {
        [] => Vec::new(),
        [single] => single.clone(),
        [first, rest @ ..] => {
            let count = components.len() as f32;
            let total = |i: usize| rest.iter().fold(first[i], |sum, component| sum + component[i]);
            (0..first.len()).map(|i| total(i) / count).collect()
        }
    }
}

/// The pixels' x or y coordinates (axis 0 or 1).
pub fn coordinates(width: usize, height: usize, axis: usize) -> Vec<f32> {
    let rows = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    rows.map(|position| position[axis] as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_has_its_slope_everywhere_borders_included() {
        let ramp: Vec<f32> = (0..12).map(|i| (i % 4) as f32 * 3.0 + (i / 4) as f32 * 4.0).collect();
        assert_eq!(gradient(&ramp, 4), vec![5.0; 12]);
        assert_eq!(gradient(&[7.0], 1), [0.0]);
        assert_eq!(gradient(&[1.0, 2.0, 4.0], 3), [1.0, 1.5, 2.0]);
        assert_eq!(gradient(&[1.0, 2.0, 4.0], 1), [1.0, 1.5, 2.0]);
        assert_eq!(gradient(&[1e18, -1e18], 2), [2e18, 2e18]);
    }

    #[test]
    fn grain_is_noise_that_is_everywhere() {
        let (width, height) = (64, 48);
        let image = |f: &dyn Fn(usize, usize) -> f32| -> Vec<f32> {
            (0..width * height).map(|k| f(k % width, k / width)).collect()
        };
        // Uniform noise of a tenth of the colour has a relative variance of 1/300.
        let noise = |x: usize, y: usize| {
            let h = (x * 7919 + y * 104_729 + 13).wrapping_mul(0x9e37_79b9_7f4a_7c15u64 as usize);
            (h >> 40) as f32 / (1u64 << 24) as f32 - 0.5
        };
        let noisy = image(&|x, y| 2.0 * (1.0 + 0.2 * noise(x, y)));
        let [quartile, median] = grain(&[noisy], width);
        assert!(
            quartile <= median && (0.5..1.5).contains(&(median * 300.0)),
            "{quartile} {median}"
        );
        // A part of the image is textured, and smooth otherwise.
        let textured =
            image(&|x, y| if x < 40 { 1.0 + 0.01 * y as f32 } else { 1.0 + noise(x / 2, y / 2) });
        let [quartile, median] = grain(&[textured], width);
        assert!(quartile < 1e-6 && median > 1e-3, "{quartile} {median}");
        assert_eq!(grain(&[vec![0.5; 64]], 8), [0.0; 2]);
        assert_eq!(grain(&[], 8), [0.0; 2]);
    }

    #[test]
    fn shading_is_no_noise_and_noise_is_estimated_without_bias() {
        let ramp: Vec<f32> = (0..64).map(|i| (i % 8) as f32 * 0.5 + (i / 8) as f32).collect();
        let inner = estimate_variance(&[ramp], 8)[9];
        assert!(inner < 1e-12, "{inner}");

        // Uniform noise of width 1 has variance 1/12.
        let mut state = 1u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        let noise: Vec<f32> = (0..256 * 256).map(|_| next()).collect();
        let estimate = estimate_variance(&[noise], 256);
        let mean = estimate.iter().map(|&v| f64::from(v)).sum::<f64>() / estimate.len() as f64;
        assert!((mean * 12.0 - 1.0).abs() < 0.02, "{mean}");
    }

    #[test]
    fn means_and_coordinates() {
        assert_eq!(average(&[vec![1.0, 2.0], vec![3.0, 6.0]]), [2.0, 4.0]);
        assert_eq!(coordinates(2, 2, 0), [0.0, 1.0, 0.0, 1.0]);
        assert_eq!(coordinates(2, 2, 1), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(estimate_variance(&[vec![3.0]], 1), [0.0]);
    }
}
