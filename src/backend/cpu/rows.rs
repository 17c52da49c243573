//! Loops over the pixels of a row that all CPU back ends share, by whatever vectors the
//! processor has: types, not closures, for the reason given in `cpu`.

use std::borrow::Cow;

use crate::backend::{TRUSTED_SHARE, TRUSTED_SUM};
use crate::expr::interval::Interval;

/// Where the sums of weights can be relied on.
pub(super) struct Trust<'a> {
    pub(super) totals: &'a [f32],
    pub(super) magnitudes: &'a [f32],
    pub(super) trusted: &'a mut [bool],
}

impl pulp::WithSimd for Trust<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let sums = self.totals.iter().zip(self.magnitudes);
        for (trusted, (total, magnitude)) in self.trusted.iter_mut().zip(sums) {
            let sum = total.abs();
            *trusted = sum >= TRUSTED_SUM.max(TRUSTED_SHARE * magnitude) && sum.is_finite();
        }
    }
}

/// Sums by weights as means, or as variances of means; what was averaged stays where the
/// weights cannot be trusted.
pub(super) struct Mean<'a> {
    pub(super) sums: &'a [f32],
    pub(super) totals: &'a [f32],
    pub(super) squared: bool,
    pub(super) own: &'a [f32],
    pub(super) trusted: &'a [bool],
    pub(super) range: Interval,
    pub(super) means: &'a mut [f32],
}

impl pulp::WithSimd for Mean<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Interval { lo, hi } = self.range;
        let sums = self.sums.iter().zip(self.totals).zip(self.own).zip(self.trusted);
        for (mean, (((&sum, &total), &own), &trusted)) in self.means.iter_mut().zip(sums) {
            let once = sum / total;
            let value = if self.squared { once / total } else { once };
            let sound = trusted & value.is_finite();
            *mean = if sound { value.clamp(lo, hi) } else { own };
        }
    }
}

/// Adds numbers to others, by whatever vectors there are.
pub(super) struct Add<'a> {
    pub(super) to: &'a mut [f32],
    pub(super) from: &'a [f32],
}

impl pulp::WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.to.iter_mut().zip(self.from).for_each(|(to, from)| *to += from);
    }
}

/// The means of two by two pixels: within the range of the four.
pub(super) struct Halve<'a> {
    pub(super) upper: &'a [f32],
    pub(super) lower: &'a [f32],
    pub(super) pixels: &'a mut [f32],
}

impl pulp::WithSimd for Halve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let (upper, lower) = (self.upper.as_chunks::<2>().0, self.lower.as_chunks::<2>().0);
        for ((pixel, [a, b]), [c, d]) in self.pixels.iter_mut().zip(upper).zip(lower) {
            *pixel = 0.25 * ((a + b) + (c + d));
        }
    }
}

/// What lies between pixels, a quarter of the way: within the range of the four. Rows begin
/// one pixel before the first.
pub(super) struct Double<'a> {
    pub(super) nearest: &'a [f32],
    pub(super) other: &'a [f32],
    /// Memory for what lies between the rows.
    pub(super) between: &'a mut [f32],
    pub(super) pixels: &'a mut [f32],
}

impl pulp::WithSimd for Double<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { nearest, other, between, pixels } = self;
        let quarter = |near: f32, far: f32| near + 0.25 * (far - near);
        for ((between, near), far) in between.iter_mut().zip(nearest).zip(other) {
            *between = quarter(*near, *far);
        }
        let (pairs, last) = pixels.as_chunks_mut::<2>();
        for (pair, around) in pairs.iter_mut().zip(between.windows(3)) {
            *pair = [quarter(around[1], around[0]), quarter(around[1], around[2])];
        }
        if let ([pixel], Some([left, here, ..])) = (last, between.last_chunk::<3>()) {
            *pixel = quarter(*here, *left);
        }
    }
}

/// Adds to sums the products of rows of pixels, each of the first with each of the second.
/// Products that are no finite numbers count as 0.
pub(super) struct Products<'a> {
    pub(super) rows: &'a [Cow<'a, [f32]>],
    pub(super) columns: &'a [Cow<'a, [f32]>],
    /// Those of the first row come first.
    pub(super) sums: &'a mut [f64],
}

impl pulp::WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        const LANES: usize = 8;
        let sums = self.sums.chunks_exact_mut(self.columns.len());
        for (row, sums) in self.rows.iter().zip(sums) {
            for (column, total) in self.columns.iter().zip(sums) {
                let mut lanes = [0.0f32; LANES];
                let (whole, rest) = row.as_chunks::<LANES>();
                let (others, others_rest) = column.as_chunks::<LANES>();
                for (a, b) in whole.iter().zip(others) {
                    for lane in 0..LANES {
                        lanes[lane] = a[lane].mul_add(b[lane], lanes[lane]);
                    }
                }
                for ((a, b), lane) in rest.iter().zip(others_rest).zip(&mut lanes) {
                    *lane = a.mul_add(*b, *lane);
                }
                let sum: f64 = lanes.iter().map(|&lane| f64::from(lane)).sum();
                *total += if sum.is_finite() { sum } else { 0.0 };
            }
        }
    }
}
