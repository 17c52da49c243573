//! Structural similarity (Wang, Bovik, Sheikh, Simoncelli: *Image quality assessment: from error
//! visibility to structural similarity*, 2004).
//!
//! It is what scikit-image calls `structural_similarity(…, gaussian_weights=True, sigma=1.5,
//! use_sample_covariance=False, data_range=1, channel_axis=2)`: statistics are weighted by a
//! Gaussian over 11 x 11 pixels, K1 is 0.01 and K2 is 0.03, the image is mirrored at its edges,
//! channels are judged apart and then averaged, and the mean leaves out the five outermost rows
//! and columns.

use super::convolve::{Edge, convolve, kernel};

/// The deviation of the weights, in pixels.
const SIGMA: f64 = 1.5;

/// How far they reach: scikit-image cuts them off at 3.5 deviations.
pub(super) const RADIUS: usize = 5;

/// Keep quotients of small numbers from meaning anything.
const MEANS: f64 = 0.01 * 0.01;
const VARIANCES: f64 = 0.03 * 0.03;

/// The similarity around every pixel, from -1 to 1; not a number in the five outermost rows and
/// columns. Channels are encoded as on a screen, from 0 to 1.
pub(super) fn similarity(
    size: (usize, usize),
    image: &[Vec<f64>; 3],
    reference: &[Vec<f64>; 3],
) -> Vec<f64> {
    let (width, height) = size;
    let weights = kernel(RADIUS, |x| (-x * x / (2.0 * SIGMA * SIGMA)).exp());
    let sum: f64 = weights.iter().sum();
    let weights: Vec<f64> = weights.iter().map(|w| w / sum).collect();
    let mean = |plane: &[f64]| convolve(plane, size, &weights, &weights, Edge::Mirrored);
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<f64>>();
    let mut similarity = vec![0.0; width * height];
    for (x, y) in image.iter().zip(reference) {
        let (mx, my) = (mean(x), mean(y));
        let (xx, yy) = (mean(&product(x, x)), mean(&product(y, y)));
        let xy = mean(&product(x, y));
        for (k, out) in similarity.iter_mut().enumerate() {
            let (mx, my) = (mx[k], my[k]);
            let (vx, vy, covariance) = (xx[k] - mx * mx, yy[k] - my * my, xy[k] - mx * my);
            let means = (2.0 * mx * my + MEANS) / (mx * mx + my * my + MEANS);
            *out += means * (2.0 * covariance + VARIANCES) / (vx + vy + VARIANCES) / 3.0;
        }
    }
    let is_inner = |at: usize, count: usize| (RADIUS..count.saturating_sub(RADIUS)).contains(&at);
    for (k, out) in similarity.iter_mut().enumerate() {
        if !is_inner(k % width, width) || !is_inner(k / width, height) {
            *out = f64::NAN;
        }
    }
    similarity
}
