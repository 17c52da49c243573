//! Pixels that are wrong, or look it: what is found on load, counted and told.
//!
//! | defect | what it is | what becomes of it |
//! |---|---|---|
//! | far | a depth that says "nothing was hit": [`drop_far`] | set to 0 |
//! | NaN, infinite, huge | no number, or beyond ±1e18 | [repaired](super::repair) |
//! | negative | below zero where that means nothing: [`negative`] | kept; a variance counts as 0 |
//! | outside | beyond the bounds of what the feature is: [`bound`] | brought into them |
//! | firefly | far brighter than all around: [`fireflies`] | kept |
//!
//! What is no number must go, as no sum survives it. Negative samples stay: a
//! reconstruction filter with negative lobes makes them rightly. Fireflies stay, too: they
//! are the noise that filters are for, and in one image nobody can tell a firefly from a
//! small lamp or the corner of a large one.

use std::ops::Range;

use rayon::prelude::*;

use crate::expr::feature::{Feature, Quantity};
use crate::image::is_good;

/// Depths from here on may stand for "nothing hit" (Blender writes 1e10, which
/// antialiasing can mix down; others 1e30 or infinity) …
const FAR: f32 = 1e8;
/// … if they are this many times the nearest one. So a large unit alone does
/// not make the geometry vanish.
const FAR_RATIO: f32 = 1e4;

/// A firefly is brighter than this many times the median of the 24 pixels around it, and
/// of the image. Four stops: in the colours of the test scenes, at four samples per pixel,
/// that is about one pixel in a hundred, and in their albedos, depths, positions and
/// normals, which are full of edges, it is none.
const FIREFLY: f32 = 16.0;
/// How far around a pixel is looked, and up to how many pixels of the image.
const AROUND: usize = 2;
const SAMPLED: usize = 1 << 14;

/// What may be wrong with a pixel; the table above says what becomes of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defect {
    /// Nothing was hit there, a depth says.
    Far,
    /// No number.
    Nan,
    /// Infinite, with either sign.
    Infinite,
    /// Finite, but beyond ±1e18.
    Huge,
    /// Below zero where that means nothing.
    Negative,
    /// Outside of the feature's bounds.
    Outside,
    /// Far brighter than all around.
    Firefly,
}

/// Samples that are looked at together.
const BLOCK: usize = 1024;

/// How many samples have a defect, and where.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// How many there are.
    pub count: usize,
    /// The first of them: positions in the channel's samples.
    pub first: Vec<usize>,
}

impl Tally {
    /// How many places are told.
    pub const TOLD: usize = 4;

    /// The samples for which something holds; `None` if there are none.
    pub fn of(samples: &[f32], holds: impl Fn(f32) -> bool) -> Option<Self> {
        let mut found = Self::default();
        for (block, samples) in samples.chunks(BLOCK).enumerate() {
            // Counting takes no branch, so that it is vector code; mostly there is nothing.
            let count = samples.iter().map(|&x| usize::from(holds(x))).sum::<usize>();
            if count > 0 && found.first.len() < Self::TOLD {
                let places = samples.iter().enumerate().filter(|&(_, &x)| holds(x));
                let places = places.map(|(k, _)| block * BLOCK + k);
                found.first.extend(places.take(Self::TOLD - found.first.len()));
            }
            found.count += count;
        }
        (found.count > 0).then_some(found)
    }

    fn of_positions(mut positions: impl Iterator<Item = usize>) -> Option<Self> {
        let first: Vec<usize> = positions.by_ref().take(Self::TOLD).collect();
        let count = first.len() + positions.count();
        (count > 0).then_some(Self { count, first })
    }
}

/// What one look at a plane tells: mostly, that nothing can be wrong with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Extremes {
    /// The least sample, and the greatest.
    pub(super) bounds: [f32; 2],
}

impl Extremes {
    /// Those of a plane; `None` if a sample is no number or beyond ±1e18.
    pub(super) fn of(samples: &[f32]) -> Option<Self> {
        // Eight running bounds: a single one would wait for itself at every sample.
        let (mut lo, mut hi) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
        let (groups, rest) = samples.as_chunks::<8>();
        let mut bad = [0_u32; 8];
        let mut look = |k: usize, x: f32| {
            lo[k] = if x < lo[k] { x } else { lo[k] };
            hi[k] = if x > hi[k] { x } else { hi[k] };
            bad[k] |= u32::from(!is_good(x));
        };
        for group in groups {
            group.iter().enumerate().for_each(|(k, &x)| look(k, x));
        }
        rest.iter().enumerate().for_each(|(k, &x)| look(k, x));
        let least = lo.into_iter().fold(f32::INFINITY, f32::min);
        let greatest = hi.into_iter().fold(f32::NEG_INFINITY, f32::max);
        (bad == [0; 8]).then_some(Self { bounds: [least, greatest] })
    }

    /// Whether all samples lie in bounds.
    pub(super) fn lie_in(self, [lo, hi]: [f32; 2]) -> bool {
        self.bounds[0] >= lo && self.bounds[1] <= hi
    }
}

/// Sets depths that say "nothing hit" to 0, which says so here; before the repair, which
/// would take an infinite one for a bad pixel.
pub fn drop_far(depth: &mut [f32]) -> Option<Tally> {
    let nearest = depth.iter().copied().filter(|&d| d > 0.0).fold(f32::INFINITY, f32::min);
    let is_far = |d: f32| d == f32::INFINITY || (d >= FAR && d / FAR_RATIO >= nearest);
    let found = Tally::of(depth, is_far);
    if found.is_some() {
        depth.iter_mut().filter(|d| is_far(**d)).for_each(|d| *d = 0.0);
    }
    found
}

/// The samples below zero of a channel in which that means nothing. Positions and normals
/// have two signs; what has bounds is [brought into them](bound); and where no depth is
/// positive, the axis points backwards.
pub fn negative(samples: &[f32], feature: Feature, quantity: Quantity) -> Option<Tally> {
    let signed = match quantity {
        Quantity::Value if feature == Feature::Depth => !samples.iter().any(|&d| d > 0.0),
        Quantity::Value => feature.row().signed || feature.row().bounds.is_some(),
        Quantity::Gradient | Quantity::Variance => false,
    };
    // Negative infinity is told as infinite.
    if signed { None } else { Tally::of(samples, |x| x < 0.0 && is_good(x)) }
}

/// A normal longer than this is longer than rounding to half floats makes it.
pub(super) const LONG_NORMAL: f32 = 1.01;

/// Whether normals were stored as colours, (n + 1) / 2: none has a negative component, and
/// most have length 1 only when they are taken for such.
pub(super) fn are_encoded(x: &[f32], y: &[f32], z: &[f32]) -> bool {
    let near = |a: f32, b: f32, c: f32| ((a * a + b * b + c * c).sqrt() - 1.0).abs() < 0.05;
    let (mut some, mut plain, mut encoded) = (0_usize, 0_usize, 0_usize);
    for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
        if x < 0.0 || y < 0.0 || z < 0.0 {
            return false;
        }
        let hit = x + y + z > 0.0;
        some += usize::from(hit);
        plain += usize::from(hit && near(x, y, z));
        let [a, b, c] = [x, y, z].map(|v| 2.0 * v - 1.0);
        encoded += usize::from(hit && near(a, b, c));
    }
    some > 0 && encoded * 10 >= some * 8 && plain * 2 < some
}

/// Beyond its bounds by no more than this, a sample is there by rounding: half floats have
/// 11 bits.
const ROUNDED: f32 = 1.0 / 1024.0;

/// Brings samples into bounds, and marks the pixels in which one was further out than
/// rounding explains.
///
/// Cycles writes the radiance of a lamp that is in view as its albedo, and motion blur
/// over few samples gives albedos above 1 too. Weights do not expect them. Most are made
/// of functions that fall with a distance, and to those a guide that is far off does no
/// harm: the pixel is alone. But bred weights may rise again, as d^(-d²) does from a
/// distance of 0.6 on: at 2.5 it is what it never is below 1, and a bred filter filled a
/// lamp of albedo 3 with the wall around it, and the wall with the lamp.
///
/// What has no bounds by its nature can still be far from everything else: the colour and
/// the direct light of a lamp, in units of the exposure; positions and depths of a far
/// mountain, in units of the extent, which leaves the farthest 5% out. They stay as they
/// are, as a light is bright and a mountain is far; weights are bred on scenes with both.
/// The variance of such a feature goes up with its square.
pub fn bound(samples: &mut [f32], bounds: [f32; 2], marked: &mut [bool]) {
    let [lo, hi] = bounds;
    for (samples, marked) in samples.chunks_mut(BLOCK).zip(marked.chunks_mut(BLOCK)) {
        if all_within(samples, bounds) {
            continue;
        }
        for (x, marked) in samples.iter_mut().zip(marked) {
            *marked |= is_out(*x, bounds);
            // What is bad is the repair's business, and was left in on purpose.
            if is_good(*x) {
                *x = x.clamp(lo, hi);
            }
        }
    }
}

/// Whether no sample is beyond bounds, as it mostly is.
fn all_within(samples: &[f32], [lo, hi]: [f32; 2]) -> bool {
    samples.iter().map(|&x| usize::from(x < lo || x > hi)).sum::<usize>() == 0
}

/// Whether a sample is further out of its bounds than rounding explains.
fn is_out(x: f32, [lo, hi]: [f32; 2]) -> bool {
    is_good(x) && (x < lo - ROUNDED || x > hi + ROUNDED)
}

/// The samples of a channel that are brought into bounds when it is loaded.
pub fn outside(samples: &[f32], feature: Feature, quantity: Quantity) -> Option<Tally> {
    let bounds = feature.row().bounds.filter(|_| quantity == Quantity::Value)?;
    Tally::of(samples, |x| is_out(x, bounds))
}

/// The pixels whose greatest component is more than sixteen times the median of those of
/// the 24 pixels around it, and of the image (of its positive ones, of large images some
/// ten thousand). Components of positions and normals, which have two signs, are counted
/// from their median in the image. Pixels that are no numbers take no part.
pub fn fireflies(components: &[Vec<f32>], width: usize, feature: Feature) -> Option<Tally> {
    fireflies_among(components, width, feature, &vec![None; components.len()])
}

/// The same where one look has told the extremes of components already.
pub(super) fn fireflies_among(
    components: &[Vec<f32>],
    width: usize,
    feature: Feature,
    extremes: &[Option<Extremes>],
) -> Option<Tally> {
    let magnitude = Magnitude::of(components, feature);
    let pixels = components.first().map_or(0, Vec::len);
    let sampled = (0..pixels).step_by(spacing(pixels)).map(|k| magnitude.at(k));
    let mut positive: Vec<f32> = sampled.filter(|&m| is_good(m) && m > 0.0).collect();
    let bright = FIREFLY * median(&mut positive)?;
    if magnitude.greatest(extremes).is_some_and(|greatest| greatest <= bright) {
        return None;
    }
    // Rows at a time, so that the positions come in order.
    let rows: Vec<Vec<usize>> = (0..pixels / width)
        .into_par_iter()
        .map_init(Vec::new, |row, y| {
            magnitude.row(y * width..(y + 1) * width, row);
            if row.iter().map(|&m| usize::from(m > bright)).sum::<usize>() == 0 {
                return Vec::new();
            }
            let bright = row.iter().enumerate().filter(|&(_, &m)| m > bright);
            let bright = bright.map(|(x, &m)| (y * width + x, m));
            let found = bright.filter(|&(k, m)| magnitude.is_lonely(width, k, m));
            found.map(|(k, _)| k).collect()
        })
        .collect();
    Tally::of_positions(rows.into_iter().flatten())
}

/// Per pixel, how far its components are from nothing; NaN where one is no number.
struct Magnitude<'a> {
    components: &'a [Vec<f32>],
    /// What is nothing, by component.
    centers: Vec<f32>,
}

impl<'a> Magnitude<'a> {
    fn of(components: &'a [Vec<f32>], feature: Feature) -> Self {
        let center = |samples: &Vec<f32>| match feature.row().signed {
            true => median(&mut sampled(samples).collect::<Vec<_>>()).unwrap_or(0.0),
            false => 0.0,
        };
        Self { components, centers: components.iter().map(center).collect() }
    }

    fn at(&self, pixel: usize) -> f32 {
        let components = self.components.iter().zip(&self.centers);
        components
            .fold(0.0, |greatest, (samples, &center)| greater(greatest, samples[pixel], center))
    }

    /// That of no pixel is greater, where the extremes of all components are known.
    fn greatest(&self, extremes: &[Option<Extremes>]) -> Option<f32> {
        let mut greatest = 0.0;
        for (extremes, &center) in extremes.iter().zip(&self.centers) {
            let [least, most] = (*extremes)?.bounds;
            greatest = greater(greater(greatest, least, center), most, center);
        }
        Some(greatest)
    }

    /// Those of some pixels side by side.
    fn row(&self, pixels: Range<usize>, row: &mut Vec<f32>) {
        row.clear();
        row.resize(pixels.len(), 0.0);
        for (samples, &center) in self.components.iter().zip(&self.centers) {
            for (greatest, &x) in row.iter_mut().zip(&samples[pixels.clone()]) {
                *greatest = greater(*greatest, x, center);
            }
        }
    }

    /// Whether a pixel of this magnitude is sixteen times as far from nothing as the lower median
    /// of those around it: as half of them, and one more if they are even.
    fn is_lonely(&self, width: usize, pixel: usize, magnitude: f32) -> bool {
        let height = self.components[0].len() / width;
        let (x, y) = (pixel % width, pixel / width);
        let columns = x.saturating_sub(AROUND)..(x + AROUND + 1).min(width);
        let rows = y.saturating_sub(AROUND)..(y + AROUND + 1).min(height);
        let (mut good, mut darker) = (0_usize, 0_usize);
        for k in rows.flat_map(|y| columns.clone().map(move |x| y * width + x)) {
            let around = self.at(k);
            if k != pixel && is_good(around) {
                good += 1;
                darker += usize::from(magnitude > FIREFLY * around);
            }
        }
        good > 0 && darker > (good - 1) / 2
    }
}

/// The greater of a magnitude and the distance of a sample from what is nothing. A NaN stays:
/// neither it nor what is compared with it is greater.
#[inline(always)]
fn greater(greatest: f32, x: f32, center: f32) -> f32 {
    let distance = (x - center).abs();
    if !is_good(x) {
        f32::NAN
    } else if distance > greatest {
        distance
    } else {
        greatest
    }
}

/// The good ones of so many samples, evenly spread, that their median is near that of all.
fn sampled(samples: &[f32]) -> impl Iterator<Item = f32> {
    samples.iter().copied().step_by(spacing(samples.len())).filter(|&x| is_good(x))
}

/// How far apart samples are taken. Odd, so as not to fall on the same few columns in every row.
fn spacing(count: usize) -> usize {
    (count / SAMPLED) | 1
}

/// The lower median. Reorders the samples.
fn median(samples: &mut [f32]) -> Option<f32> {
    let middle = samples.len().checked_sub(1)? / 2;
    Some(*samples.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 20;

    /// Shading from 1 to 2, of three components.
    fn wall() -> Vec<Vec<f32>> {
        let image = (0..WIDTH * 16).map(|k| 1.0 + (k % WIDTH) as f32 / WIDTH as f32).collect();
        vec![image; 3]
    }

    #[test]
    fn a_firefly_outshines_its_neighbours_and_the_image_sixteenfold() {
        let color = |image: &[Vec<f32>]| fireflies(image, WIDTH, Feature::Color);
        assert_eq!(color(&wall()), None);
        for (component, place) in [(0, 0), (2, 150), (1, WIDTH * 16 - 1)] {
            let mut image = wall();
            image[component][place] = 15.0;
            assert_eq!(color(&image), None, "a bright pixel is no firefly");
            image[component][place] = 40.0;
            assert_eq!(color(&image), Some(Tally { count: 1, first: vec![place] }));
        }
        // A tube of light, four pixels high, shines like that on purpose.
        let mut lamp = wall();
        lamp[0][100..180].fill(40.0);
        assert_eq!(color(&lamp), None);
        // In the dark, what is as bright as the rest of the image is no firefly.
        let mut dark = wall();
        dark.iter_mut().for_each(|component| component[200..].fill(1e-3));
        dark[0][260] = 1.0;
        assert_eq!(color(&dark), None);
    }

    #[test]
    fn fireflies_do_not_hide_behind_what_is_no_number_nor_become_some() {
        let mut image = wall();
        image[0][150] = 40.0;
        image[1][151] = f32::NAN;
        image[2][152] = f32::INFINITY;
        image[0][152] = f32::NAN;
        let found = Some(Tally { count: 1, first: vec![150] });
        assert_eq!(fireflies(&image, WIDTH, Feature::Color), found);
        let hopeless = vec![vec![f32::NAN; WIDTH]; 3];
        assert_eq!(fireflies(&hopeless, WIDTH, Feature::Color), None);
        assert_eq!(fireflies(&[vec![0.0; WIDTH]], WIDTH, Feature::Depth), None);
    }

    #[test]
    fn places_are_far_from_the_others_wherever_the_world_is() {
        for origin in [0.0, 5000.0] {
            let mut position: Vec<Vec<f32>> =
                wall().iter().map(|axis| axis.iter().map(|x| x + origin).collect()).collect();
            assert_eq!(fireflies(&position, WIDTH, Feature::WorldPosition), None);
            position[1][99] = origin - 70.0;
            let found = fireflies(&position, WIDTH, Feature::WorldPosition);
            assert_eq!(found, Some(Tally { count: 1, first: vec![99] }), "{origin}");
        }
    }

    #[test]
    fn what_is_out_of_bounds_by_more_than_rounding_is_told_and_all_of_it_brought_in() {
        let samples = [0.5, -0.1, 1.0001, 3.0, -0.0001, f32::NAN, f32::INFINITY];
        let mut bounded = samples;
        let mut marked = [false; 7];
        bound(&mut bounded, [0.0, 1.0], &mut marked);
        assert_eq!(bounded[..5], [0.5, 0.0, 1.0, 1.0, 0.0]);
        assert!(bounded[5].is_nan() && bounded[6] == f32::INFINITY);
        assert_eq!(marked, [false, true, false, true, false, false, false]);
        let found = Some(Tally { count: 2, first: vec![1, 3] });
        assert_eq!(outside(&samples, Feature::Texture, Quantity::Value), found);
        assert_eq!(outside(&samples, Feature::Texture, Quantity::Variance), None);
        assert_eq!(outside(&samples, Feature::Color, Quantity::Value), None);
        let normal = outside(&[-1.5, -1.0, 1.0005, 2.0], Feature::Normal, Quantity::Value);
        assert_eq!(normal, Some(Tally { count: 2, first: vec![0, 3] }));
    }

    #[test]
    fn negative_samples_are_told_where_they_mean_nothing() {
        let samples = [1.0, -2.0, -0.0, f32::NEG_INFINITY, -3.0];
        let found = Some(Tally { count: 2, first: vec![1, 4] });
        for feature in Feature::ALL {
            let row = feature.row();
            let expected = found.clone().filter(|_| !row.signed && row.bounds.is_none());
            assert_eq!(negative(&samples, feature, Quantity::Value), expected, "{feature:?}");
            assert_eq!(negative(&samples, feature, Quantity::Variance), found, "{feature:?}");
        }
        assert_eq!(negative(&[-1.0, 0.0, -3.0], Feature::Depth, Quantity::Value), None);
        let many = Tally::of(&[-1.0; 9], |x| x < 0.0);
        assert_eq!(many, Some(Tally { count: 9, first: (0..Tally::TOLD).collect() }));
    }

    #[test]
    fn one_look_tells_extremes_unless_something_is_no_number() {
        let mut samples: Vec<f32> = (0..37).map(|k| (k * 7 % 37) as f32 - 5.0).collect();
        let extremes = Extremes::of(&samples).expect("all are good");
        assert_eq!(extremes.bounds, [-5.0, 31.0]);
        assert!(extremes.lie_in([-5.0, 31.0]) && !extremes.lie_in([-4.0, 40.0]));
        for bad in [f32::NAN, f32::INFINITY, -2e18] {
            for place in [0, 8, 36] {
                samples[place] = bad;
                assert_eq!(Extremes::of(&samples), None);
                samples[place] = 0.0;
            }
        }
    }

    #[test]
    fn what_one_look_tells_changes_no_finding() {
        let mut image = wall();
        image[0][150] = 40.0;
        for feature in [Feature::Color, Feature::WorldPosition, Feature::Normal] {
            let extremes: Vec<_> = image.iter().map(|samples| Extremes::of(samples)).collect();
            let found = fireflies(&image, WIDTH, feature);
            assert_eq!(fireflies_among(&image, WIDTH, feature, &extremes), found, "{feature:?}");
        }
    }
}
