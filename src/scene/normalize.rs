//! Scales that free filters from a scene's units and exposure.
//!
//! A weight such as `exp(-distanceMax(worldPosition, worldPosition) / 0.05)`
//! means nothing before one knows in what unit. So what weights look at is
//! measured in units of the picture itself:
//!
//! - **Positions** are taken relative to the visible geometry: per axis, the
//!   median of the pixels that hit something is subtracted; then all axes are
//!   divided by the *extent*, the greatest of the three distances between the
//!   axis' 5th and 95th percentile. A floor that runs to the horizon, or one far
//!   mountain, hardly moves either.
//!   Positions that are one point up to rounding have no extent: what stands in is
//!   their distance from the world's origin, beside which rounding errors stay small.
//! - **Depth** is divided by the same extent, or where the file has no positions
//!   by the 95th percentile of its own non-zero values.
//! - **Pixels that hit nothing** have 0 in depth and in all components of the
//!   position, wherever the world's origin is. (Pixels that hit something with
//!   some of their samples are a mixture the renderer made, in which the origin
//!   counts: moving the world changes them by more than rounding.)
//! - **Colour and direct light** are divided by the *exposure*, the median of the
//!   noisy colour's positive luminances. Only what weights look at: the colours
//!   that a filter averages stay as they are.
//! - **Variances** are divided by the square of what their feature is divided by.
//!
//! Every scale is an element of the data or the difference of two (never a sum
//! over pixels), so that scaling the input by a power of two scales it exactly,
//! and what is divided by it does not change in a single bit; unless values
//! leave the range of normal `f32` numbers.

use std::fmt;

use rayon::prelude::*;

/// The quantiles that bound the visible geometry along an axis. On the training
/// scenes the whole bounding box does as well (sums of RelMSE: cross-bilateral
/// 0.482 with these and 0.485 with the box, kan2017 1.02 with either); these
/// also hold where one far object would stretch the box.
const NEAR: f64 = 0.05;
const FAR: f64 = 0.95;

/// Extents up to this share of the coordinates' magnitude are rounding errors: some sixteen
/// units in the last place. A renderer gets a position by a multiplication and an
/// addition or two, some more through instances, each half a unit off.
const ROUNDING: f32 = 16.0 * f32::EPSILON;

/// How colours are laid out for weights, after division by the exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorScale {
    /// As they are.
    #[default]
    Linear,
    /// c / (1 + |c|): equal steps mean less in bright regions, as they do to the
    /// eye, and fireflies come to at most 1. Variances follow to first order.
    Compressed,
}

impl ColorScale {
    /// Lays one component out.
    pub fn apply(self, c: f32) -> f32 {
        match self {
            Self::Linear => c,
            Self::Compressed => c / (1.0 + c.abs()),
        }
    }

    /// The square of the layout's slope at `c`: how it scales variances.
    pub fn slope_squared(self, c: f32) -> f32 {
        match self {
            Self::Linear => 1.0,
            Self::Compressed => (1.0 + c.abs()).powi(-4),
        }
    }
}

/// The scales that a scene was normalised by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normalization {
    /// What colour and direct light were divided by.
    pub exposure: f32,
    /// How they were laid out afterwards.
    pub color_scale: ColorScale,
    /// What was subtracted from positions; `None` if none were read.
    pub center: Option<[f32; 3]>,
    /// What positions and depths were divided by; `None` if none were read.
    pub extent: Option<f32>,
}

impl fmt::Display for Normalization {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "exposure {:.4}", self.exposure)?;
        match self.color_scale {
            ColorScale::Linear => {}
            ColorScale::Compressed => f.write_str(" (compressed)")?,
        }
        if let Some(extent) = self.extent {
            write!(f, ", extent {extent:.4}")?;
        }
        if let Some([x, y, z]) = self.center {
            write!(f, ", centre ({x:.4}, {y:.4}, {z:.4})")?;
        }
        Ok(())
    }
}

/// What [`exposure`] finds, for those who must find it themselves.
pub const EXPOSURE: &str = "Exposure: the median of the noisy image's positive luminances, \
     0.2126 R + 0.7152 G + 0.0722 B.";

/// What [`geometry`] subtracts, likewise.
pub const CENTER: &str =
    "Centre: per axis, the median of the positions of the pixels that hit something.";

/// What [`geometry`] and [`depth_extent`] divide by, likewise.
pub const EXTENT: &str = "Extent: per axis, the distance between the 5th and the 95th percentile \
     of the positions of the pixels that hit something; of the three, the greatest. Without \
     positions: the 95th percentile of the depths' magnitudes, those of 0 left out.";

/// The exposure of an image: the (lower) median of its positive luminances, by
/// the primaries of Rec. 709; 1 for an image without any.
pub fn exposure(rgb: [&[f32]; 3]) -> f32 {
    let [r, g, b] = rgb;
    let luminance = |i: usize| 0.2126 * r[i] + 0.7152 * g[i] + 0.0722 * b[i];
    let positive: Vec<f32> =
        (0..r.len()).map(luminance).filter(|&y| y > 0.0 && y.is_finite()).collect();
    Ranks::of(&positive).quantile(0.5).unwrap_or(1.0)
}

/// Which pixels show something: those where `evidence` (a feature that is zero
/// where nothing is hit) is not zero in all components.
pub fn hits(evidence: &[Vec<f32>]) -> Vec<bool> {
    let pixels = evidence.first().map_or(0, Vec::len);
    (0..pixels).map(|i| evidence.iter().any(|component| component[i] != 0.0)).collect()
}

/// Centre and extent of the positions of the pixels that hit something.
pub fn geometry(position: &[Vec<f32>], hits: &[bool]) -> ([f32; 3], f32) {
    // A median of a million numbers takes as long as filtering some rows.
    let axes: Vec<(f32, [Span; 2])> = position
        .par_iter()
        .take(3)
        .map(|samples| {
            let seen: Vec<f32> = samples
                .iter()
                .zip(hits)
                .filter(|&(x, &hit)| hit && x.is_finite())
                .map(|(&x, _)| x)
                .collect();
            let ranks = Ranks::of(&seen);
            let spans = [Span::of(&ranks, NEAR, FAR), Span::of(&ranks, 0.0, 1.0)];
            (ranks.quantile(0.5).unwrap_or(0.0), spans)
        })
        .collect();
    let mut center = [0.0; 3];
    let [mut near, mut full] = [Span::default(); 2];
    for (center, (middle, [axis_near, axis_full])) in center.iter_mut().zip(axes) {
        *center = middle;
        near = near.join(axis_near);
        full = full.join(axis_full);
    }
    // Almost everything in one point: what is not, tells the size.
    let extent = near.length().or(full.length()).or(usable(near.magnitude));
    (center, extent.unwrap_or(1.0))
}

/// How far coordinates reach.
#[derive(Clone, Copy, Debug, Default)]
struct Span {
    /// From the least to the greatest.
    extent: f32,
    /// The greater magnitude of the two.
    magnitude: f32,
}

impl Span {
    /// Of coordinates between two quantiles.
    fn of(coordinates: &Ranks<'_>, low: f64, high: f64) -> Self {
        let [low, high] = [low, high].map(|q| coordinates.quantile(q).unwrap_or(0.0));
        Self { extent: high - low, magnitude: low.abs().max(high.abs()) }
    }

    /// Of several axes: an error in one coordinate comes from all, wherever the
    /// world was turned.
    fn join(self, other: Self) -> Self {
        Self {
            extent: self.extent.max(other.extent),
            magnitude: self.magnitude.max(other.magnitude),
        }
    }

    /// The extent, if it is more than rounding errors and can be divided by.
    fn length(self) -> Option<f32> {
        usable(self.extent).filter(|&extent| extent > ROUNDING * self.magnitude)
    }
}

/// The extent of a scene that is known by its depths alone.
pub fn depth_extent(depth: &[f32]) -> f32 {
    // Some renderers count depth along a camera axis that points backwards.
    let seen: Vec<f32> =
        depth.iter().map(|d| d.abs()).filter(|&d| d != 0.0 && d.is_finite()).collect();
    Ranks::of(&seen).quantile(FAR).and_then(usable).unwrap_or(1.0)
}

/// A scale that can be divided by.
fn usable(scale: f32) -> Option<f32> {
    (scale.is_normal() && scale > 0.0).then_some(scale)
}

/// Samples, sorted by their first bits alone: so most of them are known to be on one side of a
/// quantile.
struct Ranks<'a> {
    samples: &'a [f32],
    /// By the first bits: how many there are.
    counts: Vec<usize>,
}

impl<'a> Ranks<'a> {
    fn of(samples: &'a [f32]) -> Self {
        let mut counts = vec![0; 1 << BITS];
        samples.iter().for_each(|&x| counts[bucket(x)] += 1);
        Self { samples, counts }
    }

    /// The element at a quantile, counted from below.
    fn quantile(&self, q: f64) -> Option<f32> {
        let last = self.samples.len().checked_sub(1)?;
        let rank = (last as f64 * q).floor() as usize;
        let mut below = 0;
        let holds_it = |&count: &usize| {
            let ends_below = below + count <= rank;
            below += if ends_below { count } else { 0 };
            !ends_below
        };
        let wanted = self.counts.iter().position(holds_it).expect("the counts add up to all");
        let near = self.samples.iter().copied().filter(|&x| bucket(x) == wanted);
        let mut near: Vec<f32> = near.collect();
        Some(*near.select_nth_unstable_by(rank - below, f32::total_cmp).1)
    }
}

/// Bits by which samples are sorted roughly: sign, exponent, and three of the fraction.
const BITS: u32 = 12;

/// The first bits of a number that is ordered as [`f32::total_cmp`] orders samples.
fn bucket(x: f32) -> usize {
    let bits = x.to_bits();
    let ordered = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
    (ordered >> (u32::BITS - BITS)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exposure_is_a_luminance_of_the_image_and_ignores_black_and_negative_pixels() {
        let grey = [0.0, -4.0, 2.0, 1.0, 3.0, f32::NAN];
        let e = exposure([&grey, &grey, &grey]);
        assert!((e - 2.0).abs() < 1e-6, "{e}");
        assert_eq!(exposure([&[0.0], &[0.0], &[0.0]]), 1.0);
        assert_eq!(exposure([&[], &[], &[]]), 1.0);
    }

    #[test]
    fn outliers_hardly_move_the_geometry() {
        let mut x: Vec<f32> = (0..1000).map(|i| i as f32 / 1000.0).collect();
        let zeros = vec![0.0; 1000];
        let hit = vec![true; 1000];
        let (_, before) = geometry(&[x.clone(), zeros.clone(), zeros.clone()], &hit);
        for far in &mut x[990..] {
            *far = 1e6;
        }
        let (center, after) = geometry(&[x, zeros.clone(), zeros], &hit);
        assert!((before - after).abs() < 0.02 && (after - 0.9).abs() < 0.01, "{before} {after}");
        assert!((center[0] - 0.5).abs() < 0.01);
    }

    #[test]
    fn a_single_point_and_no_point_have_a_usable_extent() {
        let point = [vec![5.0], vec![5.0], vec![5.0]];
        assert_eq!(geometry(&point, &[true]), ([5.0; 3], 5.0));
        assert_eq!(geometry(&point, &[false]), ([0.0; 3], 1.0));
        assert_eq!(geometry(&[vec![0.0; 2], vec![0.0; 2], vec![0.0; 2]], &[true; 2]).1, 1.0);
        assert_eq!(depth_extent(&[0.0, 0.0]), 1.0);
    }
    #[test]
    fn rounding_errors_are_no_extent() {
        let hit = [true; 100];
        // A point, computed with errors of up to `ulps` units in the last place.
        let point = |at: f32, ulps: u32| -> Vec<f32> {
            (0..100).map(|i| f32::from_bits(at.to_bits() + i % (ulps + 1))).collect()
        };
        for scale in [1.0, 1e-20, 1e6] {
            let positions = [point(3.0 * scale, 7), point(0.25 * scale, 3), vec![0.0; 100]];
            let (center, extent) = geometry(&positions, &hit);
            assert!((extent / scale - 3.0).abs() < 1e-5, "{extent} for {scale}");
            // What the extent is for: errors stay errors.
            for (axis, center) in positions.iter().zip(center) {
                assert!(axis.iter().all(|x| ((x - center) / extent).abs() < 1e-5), "{scale}");
            }
            // What is as small beside another axis is an error too, and what is not, is none.
            let beside = [point(3.0 * scale, 0), point(1e-3 * scale, 99), vec![0.0; 100]];
            assert_eq!(geometry(&beside, &hit).1, 3.0 * scale);
            let wall = [point(3.0 * scale, 99), point(3.0 * scale, 0), vec![0.0; 100]];
            assert!(geometry(&wall, &hit).1 < 1e-4 * scale, "{scale}");
        }
    }

    #[test]
    fn one_pixel_that_is_elsewhere_tells_the_size_unless_by_rounding() {
        let hit = [true; 100];
        let mut x = vec![7.0; 100];
        x[50] = 9.0;
        let zeros = vec![0.0; 100];
        assert_eq!(geometry(&[x.clone(), zeros.clone(), zeros.clone()], &hit).1, 2.0);
        x[50] = 7.0f32.next_up();
        assert_eq!(geometry(&[x, zeros.clone(), zeros], &hit).1, 7.0);
    }

    #[test]
    fn quantiles_are_elements_of_the_sorted_samples() {
        let mut state = 7_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f32::from_bits(state)
        };
        for count in [1, 2, 3, 100, 5000] {
            // Any bits: both signs, both zeros, NaNs and infinities among them.
            let mut samples: Vec<f32> = (0..count).map(|_| next()).collect();
            samples[count / 2] = -0.0;
            let mut sorted = samples.clone();
            sorted.sort_by(f32::total_cmp);
            let ranks = Ranks::of(&samples);
            for q in [0.0, 0.05, 0.5, 0.95, 1.0] {
                let expected = sorted[((count - 1) as f64 * q).floor() as usize];
                let found = ranks.quantile(q).expect("there are some");
                assert_eq!(found.to_bits(), expected.to_bits(), "{q} of {count}");
            }
        }
        assert_eq!(Ranks::of(&[]).quantile(0.5), None);
    }
}
