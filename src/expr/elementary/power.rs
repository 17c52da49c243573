//! Square root and power.
//!
//! x^y = 2^(y log2 x), where the logarithm and the product are carried in two
//! parts: an error in the exponent of 2 is an error in the result a hundred
//! times as large (the exponent reaches 127), so `f32` alone would lose seven
//! bits.

use super::{enclosure, horner};
use crate::expr::builder::{Builder, DIVISOR_MIN, LIMIT};
use crate::expr::function::{Binary, Budget, Unary};
use crate::expr::interval::Interval;
use crate::expr::tape::Value;

/// `sqrt`; 0 for negative operands. 2 primitives.
pub const SQRT: Unary = Unary {
    meaning: |x| x.max(0.0).sqrt(),
    build: sqrt,
    range: |x| x.clamped(0.0, f32::INFINITY).increasing(f32::sqrt),
    budget: Budget { ulp: 0.5, absolute: 0.0 },
};

/// `pow`: |x|^y, with a minus sign where x is negative and y an odd integer;
/// clamped at [`LIMIT`] above.
pub const POW: Binary =
    Binary { meaning, build: pow, range, budget: Budget { ulp: 5.0, absolute: 1.1e-19 } };

/// log2 of zero, for `pow`.
const LOG2_ZERO: f32 = -73_786_976_294_838_206_464.0;

/// 1 / ln 2: the leading part, and the rest as the constant term of the series.
const LOG2_E: f32 = std::f32::consts::LOG2_E;

/// log2 m = s (LOG2_E + series(s^2)) with s = 2 (m - 1) / (m + 1).
const SERIES: [f32; 5] =
    [1.925_963e-8, 0.120_224_59, 0.018_033_681, 0.003_218_870_1, 0.000_653_595_55];

/// (2^g - 1) / g.
const EXP2: [f32; 6] =
    [0.693_147_2, 0.240_226_5, 0.055_503_607, 0.009_618_248, 0.001_339_152_5, 0.000_154_315_89];

/// Residues of the exponent of 2 are kept within this; in the domain where the
/// result is neither 0 nor clamped they are far smaller.
const RESIDUE_MAX: f32 = 1.0 / 64.0;

fn meaning(x: f64, y: f64) -> f64 {
    let magnitude = x.abs();
    let log2 = if magnitude < f64::from(f32::MIN_POSITIVE) {
        f64::from(LOG2_ZERO)
    } else {
        magnitude.log2()
    };
    let power = (y * log2).exp2().min(f64::from(LIMIT));
    if x < 0.0 && is_odd(y) { -power } else { power }
}

fn is_odd(y: f64) -> bool {
    (y * 0.5).fract().abs() == 0.5
}

fn range(x: Interval, y: Interval) -> Interval {
    // For a base that is not negative, the power is monotone in either operand.
    let magnitude = |x: Interval| {
        let corner = |x: f32, y: f32| meaning(x.into(), y.into());
        let corners =
            [corner(x.lo, y.lo), corner(x.lo, y.hi), corner(x.hi, y.lo), corner(x.hi, y.hi)];
        let (lo, hi) =
            corners.iter().fold((f64::INFINITY, 0.0_f64), |(lo, hi), &c| (lo.min(c), hi.max(c)));
        enclosure(POW.budget, lo, hi).clamped(0.0, LIMIT)
    };
    let positive = (x.hi >= 0.0).then(|| magnitude(x.clamped(0.0, f32::INFINITY)));
    let negative = (x.lo < 0.0).then(|| {
        let mirrored = magnitude((-x).clamped(0.0, f32::INFINITY));
        match y.single() {
            Some(y) if is_odd(y.into()) => -mirrored,
            Some(_) => mirrored,
            None => mirrored.hull(-mirrored),
        }
    });
    match (positive, negative) {
        (Some(p), Some(n)) => p.hull(n),
        (Some(one), None) | (None, Some(one)) => one,
        (None, None) => Interval::new(-LIMIT, LIMIT),
    }
}

fn sqrt(b: &mut Builder, x: Value) -> Value {
    let zero = b.constant(0.0);
    let x = b.max(x, zero);
    b.sqrt(x)
}

fn pow(b: &mut Builder, x: Value, y: Value) -> Value {
    if let Some(power) = b.constant_of(y).and_then(|y| constant_power(b, x, y)) {
        return power;
    }
    let magnitude = b.abs(x);
    let smallest = b.constant(f32::MIN_POSITIVE);
    let normal = b.max(magnitude, smallest);
    let log = log2(b, normal);
    let log2_zero = b.constant(LOG2_ZERO);
    let high = b.select_lt(magnitude, smallest, log2_zero, log.high);
    let power = exp2_of_product(b, y, Parts { high, low: log.low });

    // y - 2 round(y / 2) is ±1 for odd integers, and less for all else.
    let (half, minus_two, one) = (b.constant(0.5), b.constant(-2.0), b.constant(1.0));
    let t = b.mul(y, half);
    let pairs = b.round(t);
    let rest = b.fma(pairs, minus_two, y);
    let rest = b.abs(rest);
    let minus = b.neg(power);
    let of_negative = b.select_lt(rest, one, power, minus);
    b.select_below(x, 0.0, of_negative, power)
}

/// Exponents that need no logarithm.
fn constant_power(b: &mut Builder, x: Value, y: f32) -> Option<Value> {
    let limit = b.constant(LIMIT);
    Some(match y {
        0.0 => b.constant(1.0),
        1.0 => x,
        2.0 => square(b, x),
        3.0 => {
            let square = square(b, x);
            let cube = b.mul(square, x);
            b.limited(cube)
        }
        4.0 => {
            let square = square(b, x);
            let fourth = b.mul(square, square);
            b.min(fourth, limit)
        }
        0.5 => {
            let magnitude = b.abs(x);
            b.sqrt(magnitude)
        }
        -0.5 => {
            let magnitude = b.abs(x);
            let least = b.constant(DIVISOR_MIN * DIVISOR_MIN);
            let magnitude = b.max(magnitude, least);
            let root = b.sqrt(magnitude);
            reciprocal(b, root)
        }
        -1.0 => {
            let (least, minus_least) = (b.constant(DIVISOR_MIN), b.constant(-DIVISOR_MIN));
            let right = b.max(x, least);
            let left = b.min(x, minus_least);
            let divisor = b.select_below(x, 0.0, left, right);
            reciprocal(b, divisor)
        }
        -2.0 => {
            let square = b.mul(x, x);
            let least = b.constant(DIVISOR_MIN);
            let square = b.max(square, least);
            reciprocal(b, square)
        }
        _ => return None,
    })
}

/// x^2, at most [`LIMIT`].
fn square(b: &mut Builder, x: Value) -> Value {
    let limit = b.constant(LIMIT);
    let square = b.mul(x, x);
    b.min(square, limit)
}

fn reciprocal(b: &mut Builder, x: Value) -> Value {
    let one = b.constant(1.0);
    b.div(one, x)
}

/// An unevaluated sum: `high` is the sum rounded, `low` what that leaves.
struct Parts {
    high: Value,
    low: Value,
}

/// log2 of a positive normal number, to about 2^-30 of itself.
fn log2(b: &mut Builder, x: Value) -> Parts {
    let one = b.constant(1.0);

    // x = 2^e m with m in [sqrt(1/2), sqrt(2)).
    let sqrt_2 = b.constant(std::f32::consts::SQRT_2);
    let shifted = b.mul(x, sqrt_2);
    let e = b.exponent(shifted);
    let minus_e = b.neg(e);
    let scale = b.exp2i(minus_e);
    let m = b.mul(x, scale);

    // s + s_low = f / (1 + f/2), f = m - 1. The subtraction f - s is exact.
    let f = b.sub(m, one);
    let minus_half = b.constant(-0.5);
    let h = b.mul(f, minus_half);
    let divisor = b.sub(one, h);
    let inverse = b.div(one, divisor);
    let s = b.mul(f, inverse);
    let t = b.sub(f, s);
    let rest = b.fma(s, h, t);
    let s_low = b.mul(rest, inverse);

    // log2 m = -minus_main + tail, where minus_main is s * -LOG2_E rounded.
    let (log2_e, minus_log2_e) = (b.constant(LOG2_E), b.constant(-LOG2_E));
    let minus_main = b.mul(s, minus_log2_e);
    let tail = b.fma(s, log2_e, minus_main);
    let tail = b.fma(s_low, log2_e, tail);
    let z = b.mul(s, s);
    let series = horner(b, z, &SERIES);
    let tail = b.fma(s, series, tail);

    let log_m = b.sub(tail, minus_main);
    let high = b.add(e, log_m);
    let low = b.sub(e, high);
    let low = b.sub(low, minus_main);
    let low = b.add(low, tail);
    Parts { high, low }
}

/// 2^(y * log), at most [`LIMIT`].
fn exp2_of_product(b: &mut Builder, y: Value, log: Parts) -> Value {
    let high = b.mul(y, log.high);
    let minus_high = b.neg(high);
    let low = b.fma(y, log.high, minus_high);
    let low = b.fma(y, log.low, low);
    let bound = b.range(y).magnitude() / 65536.0;
    b.assume(low, Interval::new(-bound, bound));
    let low = b.clamp(low, -RESIDUE_MAX, RESIDUE_MAX);

    let high = b.clamp(high, -127.0, 60.0);
    let n = b.round(high);
    let g = b.sub(high, n);
    let g = b.add(g, low);
    let one = b.constant(1.0);
    let slope = horner(b, g, &EXP2);
    let power = b.fma(slope, g, one);
    let scale = b.exp2i(n);
    let power = b.mul(power, scale);
    let limit = b.constant(LIMIT);
    b.min(power, limit)
}
