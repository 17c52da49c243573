//! Closed `f32` intervals: what a value can be, given what its operands can be.
//!
//! An interval encloses every value that the *rounded* `f32` computation can
//! give, not only the real result. For the monotone primitives this costs
//! nothing: IEEE rounding is monotone, so rounding the exact bounds the way the
//! primitive itself rounds gives bounds that are attained.
//!
//! Intervals do not tell -0 from +0. No operator does either (each row of
//! [`crate::expr::Op`] treats both zeros alike), so nothing is lost.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A closed interval `[lo, hi]`; `lo <= hi`, neither is NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Least value, may be -inf.
    pub lo: f32,
    /// Greatest value, may be +inf.
    pub hi: f32,
}

impl Interval {
    /// Nothing is known, not even that the value is a number.
    pub const ENTIRE: Self = Self { lo: f32::NEG_INFINITY, hi: f32::INFINITY };

    /// The interval `[lo, hi]`; [`Interval::ENTIRE`] if the bounds are no bounds.
    pub fn new(lo: f32, hi: f32) -> Self {
        if lo <= hi { Self { lo, hi } } else { Self::ENTIRE }
    }

    /// The interval that holds `x` alone.
    pub fn point(x: f32) -> Self {
        Self::new(x, x)
    }

    /// The one value the interval holds, if it holds but one.
    pub fn single(self) -> Option<f32> {
        (self.lo == self.hi).then_some(self.lo)
    }

    /// Whether `x` lies inside.
    pub fn contains(self, x: f32) -> bool {
        self.lo <= x && x <= self.hi
    }

    /// Whether every value is at most `limit` in magnitude.
    pub fn within(self, limit: f32) -> bool {
        -limit <= self.lo && self.hi <= limit
    }

    /// The greatest magnitude inside.
    pub fn magnitude(self) -> f32 {
        self.lo.abs().max(self.hi.abs())
    }

    /// The smallest interval around both.
    pub fn hull(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    /// What both allow. Bounds that contradict each other say that one of them
    /// was no enclosure; the tighter claim is then dropped rather than trusted.
    pub fn intersect(self, other: Self) -> Self {
        let lo = self.lo.max(other.lo);
        let hi = self.hi.min(other.hi);
        if lo <= hi { Self { lo, hi } } else { self }
    }

    /// Widens both ends by a relative and an absolute margin: how an operator's
    /// exact range becomes an enclosure of its rounded implementation.
    pub fn widened(self, relative: f32, absolute: f32) -> Self {
        Self::new(
            self.lo - self.lo.abs() * relative - absolute,
            self.hi + self.hi.abs() * relative + absolute,
        )
    }

    /// Clamps both ends into `[lo, hi]`.
    pub fn clamped(self, lo: f32, hi: f32) -> Self {
        Self { lo: self.lo.clamp(lo, hi), hi: self.hi.clamp(lo, hi) }
    }

    /// The image under a function that never decreases.
    pub fn increasing(self, f: impl Fn(f32) -> f32) -> Self {
        Self::new(f(self.lo), f(self.hi))
    }

    /// The image under the absolute value.
    pub fn abs(self) -> Self {
        if self.lo >= 0.0 {
            self
        } else if self.hi <= 0.0 {
            -self
        } else {
            Self { lo: 0.0, hi: self.magnitude() }
        }
    }

    /// Squares: both factors are the same value.
    pub fn square(self) -> Self {
        let magnitude = self.abs();
        Self::new(magnitude.lo * magnitude.lo, magnitude.hi * magnitude.hi)
    }

    /// `a * b + c` rounded once.
    pub fn fma(self, b: Self, c: Self) -> Self {
        let low = self.corners(b, |x, y| x.mul_add(y, c.lo));
        let high = self.corners(b, |x, y| x.mul_add(y, c.hi));
        Self::new(low.lo, high.hi)
    }

    /// A function monotone in each argument takes its extremes at the corners.
    fn corners(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let images = [
            f(self.lo, other.lo),
            f(self.lo, other.hi),
            f(self.hi, other.lo),
            f(self.hi, other.hi),
        ];
        if images.iter().any(|x| x.is_nan()) {
            return Self::ENTIRE;
        }
        Self {
            lo: images.iter().copied().fold(f32::INFINITY, f32::min),
            hi: images.iter().copied().fold(f32::NEG_INFINITY, f32::max),
        }
    }
}

impl Neg for Interval {
    type Output = Self;

    fn neg(self) -> Self {
        Self { lo: -self.hi, hi: -self.lo }
    }
}

impl Add for Interval {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.lo + other.lo, self.hi + other.hi)
    }
}

/// Differences of unrelated values.
impl Sub for Interval {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

/// Products of unrelated values; see [`Interval::square`] for related ones.
impl Mul for Interval {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        self.corners(other, |a, b| a * b)
    }
}

/// Quotients; everything if the divisor may be zero.
impl Div for Interval {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        if other.contains(0.0) { Self::ENTIRE } else { self.corners(other, |a, b| a / b) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indeterminate_bounds_become_everything() {
        assert_eq!(Interval::ENTIRE * Interval::point(0.0), Interval::ENTIRE);
        assert_eq!(Interval::ENTIRE - Interval::ENTIRE, Interval::ENTIRE);
        assert_eq!(Interval::point(1.0) / Interval::new(-1.0, 1.0), Interval::ENTIRE);
    }

    #[test]
    fn a_square_is_never_negative_though_the_product_of_intervals_is() {
        let x = Interval::new(-2.0, 1.0);
        assert_eq!(x.square(), Interval::new(0.0, 4.0));
        assert_eq!(x * x, Interval::new(-2.0, 4.0));
    }
}
