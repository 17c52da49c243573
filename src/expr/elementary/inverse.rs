//! Arc sine, arc cosine and arc tangent.

use std::f32::consts::{FRAC_PI_2, PI};

use super::{enclosure, horner};
use crate::expr::builder::{Builder, LIMIT};
use crate::expr::derivative::inside;
use crate::expr::function::{Budget, Fast, Unary};
use crate::expr::tape::Value;

/// `asin`, of the argument clamped into [-1, 1]. 18 primitives.
///
/// Up to 1/2 an odd polynomial of degree 11 (relative error 6.8e-9); beyond,
/// asin a = pi/2 - 2 asin sqrt((1 - a) / 2), whose argument is at most 1/2 again.
pub const ASIN: Unary = Unary {
    meaning: |x| x.clamp(-1.0, 1.0).asin(),
    build: asin,
    range: |x| {
        enclosure(ASIN.budget, (ASIN.meaning)(x.lo.into()), (ASIN.meaning)(x.hi.into()))
            .clamped(-FRAC_PI_2, FRAC_PI_2)
    },
    derivative: |b, x, _| arc_slope(b, x),
    budget: Budget { ulp: 2.5, absolute: 0.0 },
    fast: Fast { within: 1.0, budget: Budget { ulp: 8.0, absolute: 1e-6 } },
    short: None,
};

/// `acos`, of the argument clamped into [-1, 1]. 19 primitives: the two halves
/// of [`ASIN`], without its loss of digits near 1.
pub const ACOS: Unary = Unary {
    meaning: |x| x.clamp(-1.0, 1.0).acos(),
    build: acos,
    range: |x| {
        enclosure(ACOS.budget, (ACOS.meaning)(x.hi.into()), (ACOS.meaning)(x.lo.into()))
            .clamped(0.0, PI)
    },
    derivative: |b, x, _| {
        let slope = arc_slope(b, x);
        b.neg(slope)
    },
    budget: Budget { ulp: 1.5, absolute: 0.0 },
    fast: Fast { within: 1.0, budget: Budget { ulp: 8.0, absolute: 1e-6 } },
    short: None,
};

/// `atan`. 18 primitives: an odd polynomial of degree 17 on [0, 1] (relative
/// error 2.5e-8), and atan a = pi/2 - atan(1 / a) beyond.
pub const ATAN: Unary = Unary {
    meaning: f64::atan,
    build: atan,
    range: |x| {
        enclosure(ATAN.budget, f64::from(x.lo).atan(), f64::from(x.hi).atan())
            .clamped(-FRAC_PI_2, FRAC_PI_2)
    },
    derivative: |b, x, _| {
        let one = b.constant(1.0);
        let divisor = b.fma(x, x, one);
        b.div(one, divisor)
    },
    budget: Budget { ulp: 2.0, absolute: 0.0 },
    fast: Fast { within: LIMIT, budget: Budget { ulp: 8.0, absolute: 1e-6 } },
    short: None,
};

/// (asin s / s - 1) / s^2, in powers of s^2.
const ARC_SINE: [f32; 5] = [0.166_667_31, 0.074_964_2, 0.045_324_784, 0.024_882_814, 0.041_017_253];

/// (atan t / t - 1) / t^2, in powers of t^2.
const ARC_TANGENT: [f32; 8] = [
    -0.333_332_15,
    0.199_950_04,
    -0.142_200_1,
    0.106_984_06,
    -0.076_168_04,
    0.043_933_623,
    -0.016_791_806,
    0.003_022_557,
];

/// The polynomial argument of arc sine and arc cosine: s with asin s wanted, and
/// z = s^2. `small` is s where |x| < 1/2; elsewhere s = sqrt((1 - |x|) / 2).
fn arc_sine(b: &mut Builder, magnitude: Value, small: Value) -> Value {
    let (half, minus_half) = (b.constant(0.5), b.constant(-0.5));
    let square = b.mul(magnitude, magnitude);
    let rest = b.fma(magnitude, minus_half, half);
    let z = b.select_lt(magnitude, half, square, rest);
    let root = b.sqrt(z);
    let s = b.select_lt(magnitude, half, small, root);
    let tail = horner(b, z, &ARC_SINE);
    let cube = b.mul(s, z);
    b.fma(cube, tail, s)
}

/// 1 / sqrt(1 - x^2), and 0 where x is clamped.
fn arc_slope(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, -1.0, 1.0);
    let (one, minus_x) = (b.constant(1.0), b.neg(x));
    // Rounded once. It is 2^-23 at least, but for the ends.
    let rest = b.fma(minus_x, x, one);
    b.pin(rest);
    let least = b.constant(f32::EPSILON / 2.0);
    let rest = b.max(rest, least);
    let root = b.sqrt(rest);
    let slope = b.div(one, root);
    inside(b, x, 1.0, slope)
}

fn asin(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, -1.0, 1.0);
    let magnitude = b.abs(x);
    let near = arc_sine(b, magnitude, magnitude);
    let (minus_two, quarter_turn) = (b.constant(-2.0), b.constant(FRAC_PI_2));
    let far = b.fma(near, minus_two, quarter_turn);
    let angle = b.select_below(magnitude, 0.5, near, far);
    with_sign_of(b, x, angle)
}

fn acos(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, -1.0, 1.0);
    let magnitude = b.abs(x);
    let arc = arc_sine(b, magnitude, x);
    let (minus_two, quarter_turn, half_turn) =
        (b.constant(-2.0), b.constant(FRAC_PI_2), b.constant(PI));
    let middle = b.sub(quarter_turn, arc);
    let left = b.fma(arc, minus_two, half_turn);
    let right = b.add(arc, arc);
    let outer = b.select_below(x, 0.0, left, right);
    b.select_below(magnitude, 0.5, middle, outer)
}

fn atan(b: &mut Builder, x: Value) -> Value {
    let magnitude = b.abs(x);
    let one = b.constant(1.0);
    let (least, greatest) = (b.min(magnitude, one), b.max(magnitude, one));
    let t = b.div(least, greatest);
    let z = b.mul(t, t);
    let tail = horner(b, z, &ARC_TANGENT);
    let cube = b.mul(t, z);
    let near = b.fma(cube, tail, t);
    let quarter_turn = b.constant(FRAC_PI_2);
    let far = b.sub(quarter_turn, near);
    let angle = b.select_lt(one, magnitude, far, near);
    with_sign_of(b, x, angle)
}

fn with_sign_of(b: &mut Builder, x: Value, magnitude: Value) -> Value {
    let minus = b.neg(magnitude);
    b.select_below(x, 0.0, minus, magnitude)
}
