//! Square root and power.
//!
//! x^y = 2^(y log2 x). The exponent of 2 reaches 127 and an error in it is as
//! large a *relative* error in the result, so an `f32` logarithm would lose
//! seven bits. There are two ways round that. The logarithm and the product can be
//! carried in two parts. Or, for exponents that magnify little, the whole part of the logarithm
//! and its fraction are kept apart, and each is multiplied on its own: the whole part's
//! product needs no rounding once the whole part of the result is taken off.
//!
//! Measured for a base that is not negative and a constant exponent, over results of all
//! magnitudes:
//!
//! | logarithm and product | primitives | worst | mean |
//! |---|---|---|---|
//! | in `f32` | 25 | 225 ulp | 17 ulp |
//! | whole part and fraction, exponents to 2.5 | 29-34 | 2.3 ulp | 0.24 ulp |
//! | in two parts | 43 | 2.2 ulp | 0.20 ulp |
//!
//! [`POW`] is made in the second way or the third, [`SHORT_POW`] in the first. The third
//! has a further use: with a constant base the builder folds the whole logarithm into
//! two constants, so that 2^y or 0.3^y cost what an exponential costs, and are as
//! accurate.

use std::f32::consts::{LN_2, LOG2_E};

use super::exp::short_exp2;
use super::log::LOG;
use super::{at_least_normal, enclosure, horner, split};
use crate::expr::builder::{Builder, DIVISOR_MIN, LIMIT};
use crate::expr::derivative::{of_even, unless_limited};
use crate::expr::function::{Binary, Budget, Fast, Unary};
use crate::expr::interval::Interval;
use crate::expr::tape::{Native, Value};

/// `sqrt`; 0 for negative operands. 2 primitives.
pub const SQRT: Unary = Unary {
    meaning: |x| x.max(0.0).sqrt(),
    build: sqrt,
    range: |x| x.clamped(0.0, f32::INFINITY).increasing(f32::sqrt),
    derivative: |b, x, root| {
        // The least root whose derivative is within the limit.
        let (half, least, zero) = (b.constant(0.5), b.constant(0.5 / LIMIT), b.constant(0.0));
        let divisor = b.max(root, least);
        let slope = b.div(half, divisor);
        let slope = b.limited(slope);
        b.select_lt(zero, x, slope, zero)
    },
    budget: Budget { ulp: 0.5, absolute: 0.0 },
    fast: Fast { within: LIMIT, budget: Budget { ulp: 5.0, absolute: 1.1e-19 } },
    short: None,
};

/// `pow`: |x|^y, with a minus sign where x is negative and y an odd integer, so
/// that it is defined everywhere and agrees with mathematics for all integers y.
/// Clamped at ±[`LIMIT`]; results below the normal numbers may be flushed to 0.
///
/// x^0 is 1 for all x, 0 included. A base of 0, for which any subnormal counts,
/// has the logarithm -2^66: 0^y is 0 for y > 2e-18, [`LIMIT`] for y < -1e-18, and
/// joins these two without a jump at y = 0.
///
/// 54 primitives; 46 for a base that is not negative, 42 if it is also not 0 and
/// |y| <= 1024; 20 for a constant base, 13 for base 2; 43 to 47 for a constant
/// exponent, 27 to 34 for one within ±2.5, and 1 to 4 for the
/// exponents -2, -1, -1/2, 0, 1/2, 1, 2, 3 and 4. Of a square root, as distances
/// are, it takes no root but half the exponent, where the exponent is 1 at least. The absolute
/// part of the budget is what x^(1/2) makes of subnormals.
pub const POW: Binary = Binary {
    meaning,
    build: pow,
    range: |x, y| range(x, y, BUDGET),
    derivatives,
    budget: BUDGET,
    fast: FAST,
    short: Some(&SHORT_POW),
};

/// The same with the logarithm and the product in one part each: 34 primitives. The budget
/// is what is left of results below 1e-19, where the absolute part allows as much; elsewhere
/// 225 ulp.
pub const SHORT_POW: Binary = Binary {
    meaning,
    build: short_pow,
    range: |x, y| range(x, y, SHORT_BUDGET),
    derivatives,
    budget: SHORT_BUDGET,
    fast: FAST,
    short: None,
};

const BUDGET: Budget = Budget { ulp: 3.5, absolute: 1.1e-19 };
const SHORT_BUDGET: Budget = Budget { ulp: 600.0, ..BUDGET };
const FAST: Fast = Fast { within: 16.0, budget: Budget { ulp: 500.0, ..BUDGET } };

/// The logarithm of 0: far enough to decide any exponent that means something,
/// near enough that its product with any other stays finite, and a power of two,
/// so that the product is exact.
const LOG2_ZERO: f32 = -73_786_976_294_838_206_464.0;

/// Exponents from here on make 0 of 0, as [`LOG2_ZERO`] times this is less than -127.5.
const VANISHING: f32 = 2e-18;

/// The least normal number has the logarithm -126. Exponents from here on, 127/126 and a
/// little more, flush powers of it to 0, so that 0 needs no logarithm of its own.
const FLUSHING: f32 = 1.008;

/// log2 of [`LIMIT`], below which no power is clamped.
const LOG2_LIMIT: f32 = 59.794_705;

/// log2 m = s (LOG2_E + series(s^2)) with s = 2 (m - 1) / (m + 1), |s| <= 0.3432;
/// the constant term is what `f32` leaves of 1 / ln 2. Relative error 1.8e-11.
const SERIES: [f32; 5] =
    [1.925_963e-8, 0.120_224_59, 0.018_033_681, 0.003_218_870_1, 0.000_653_595_55];

/// What the rest of s weighs in log2 m: the derivative LOG2_E / (1 + s/2), to 1.5%.
const REST: [f32; 2] = [-0.7434, 1.4646];

/// (2^g - 1) / g, to 5.2e-9 of 2^g on |g| <= 1/2.
const EXP2: [f32; 6] =
    [LN_2, 0.240_226_5, 0.055_503_607, 0.009_618_248, 0.001_339_152_5, 0.000_154_315_89];

/// Below this, 2^-128, the result is 0: the scale 2^-127 is flushed.
const POWER_MIN: f64 = f32::MIN_POSITIVE as f64 / 4.0;

/// The scale 2^-127 is 0, and 2^60 is above the limit.
const EXPONENT_MIN: f32 = -127.0;
const EXPONENT_MAX: f32 = 60.0;

/// log2 (1 + f) / f, to 1.8e-7 of itself where 1 + f is in [sqrt(1/2), sqrt(2)).
const SHORT_LOG2: [f32; 8] = [
    1.442_694_9,
    -0.721_352,
    0.480_925_74,
    -0.360_270_68,
    0.287_077_96,
    -0.248_556_67,
    0.234_010_79,
    -0.146_597_97,
];

/// log2 (1 + f) / f where 1 + f is in [sqrt(1/2), sqrt(2)); the logarithm to 7.2e-9, absolute.
const LOG2: [f32; 9] = [
    1.442_694_9,
    -0.721_347_15,
    0.480_920_43,
    -0.360_719_05,
    0.287_694_78,
    -0.238_570_53,
    0.217_158_48,
    -0.209_954_22,
    0.125_494_51,
];

/// Exponents up to here, in magnitude, magnify the error of a logarithm in `f32` so little that
/// the budget holds.
const SMALL_EXPONENT: f32 = 2.5;

/// Bound of the low part of y log2 x. Where the result is neither 0 nor clamped
/// that part is a thousand times smaller; elsewhere it could be anything.
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

fn range(x: Interval, y: Interval, budget: Budget) -> Interval {
    // Operands are never beyond the limit, even if no more is known of them.
    let [x, y] = [x, y].map(|operand| operand.clamped(-LIMIT, LIMIT));
    let positive = (x.hi >= 0.0).then(|| range_of_magnitude(x.clamped(0.0, LIMIT), y, budget));
    let negative = (x.lo < 0.0).then(|| {
        let magnitude = range_of_magnitude((-x).clamped(0.0, LIMIT), y, budget);
        match y.single() {
            Some(y) if is_odd(y.into()) => -magnitude,
            Some(_) => magnitude,
            None => magnitude.hull(-magnitude),
        }
    });
    let parts = positive.into_iter().chain(negative);
    parts.reduce(Interval::hull).expect("a number is negative or it is not")
}

/// The range for a base that is not negative. The power is then monotone in
/// either operand, so that its extremes are at the corners.
fn range_of_magnitude(x: Interval, y: Interval, budget: Budget) -> Interval {
    let corners = [(x.lo, y.lo), (x.lo, y.hi), (x.hi, y.lo), (x.hi, y.hi)]
        .map(|(x, y)| meaning(x.into(), y.into()));
    let lo = corners.into_iter().fold(f64::INFINITY, f64::min);
    let hi = corners.into_iter().fold(0.0, f64::max);
    // These are made without a logarithm, and are not flushed.
    let products = [1.0, 2.0, 3.0, 4.0].iter().any(|&exponent| y.contains(exponent));
    if hi < POWER_MIN && !products {
        return Interval::point(0.0);
    }
    enclosure(budget, lo, hi).clamped(0.0, LIMIT)
}

fn sqrt(b: &mut Builder, x: Value) -> Value {
    let zero = b.constant(0.0);
    let x = b.max(x, zero);
    b.sqrt(x)
}

/// y x^y / x and x^y log |x|.
fn derivatives(b: &mut Builder, x: Value, y: Value, power: Value) -> [Value; 2] {
    let (zero, one) = (b.constant(0.0), b.constant(1.0));
    let magnitude = b.abs(x);
    let normal = at_least_normal(b, magnitude);
    let product = b.mul(y, power);
    // A divisor by which no quotient is beyond the limit, nor anything on the way.
    let size = b.abs(product);
    let least = b.constant(DIVISOR_MIN);
    let least = b.mul(size, least);
    let divisor = b.max(normal, least);
    let quotient = b.div(product, divisor);
    let quotient = b.limited(quotient);
    let by_x = of_even(b, x, quotient);
    // What is no normal number counts as 0, whose powers are 0, or x itself.
    let is_one = b.select_lt(one, y, zero, one);
    let of_zero = b.select_lt(y, one, zero, is_one);
    let smallest = b.constant(f32::MIN_POSITIVE);
    let by_x = b.select_lt(magnitude, smallest, of_zero, by_x);

    let log = (LOG.build)(b, magnitude);
    let by_y = b.mul(power, log);
    let by_y = b.limited(by_y);
    let by_y = b.select_lt(magnitude, smallest, zero, by_y);
    [by_x, by_y].map(|derivative| unless_limited(b, power, derivative))
}

fn pow(b: &mut Builder, x: Value, y: Value) -> Value {
    if let Some(power) = b.constant_of(y).and_then(|y| constant_power(b, x, y)) {
        return power;
    }
    // The guards and signs vanish where x is known to be positive.
    let power = match b.exponent_of(x) {
        Some(exponent) => {
            let log = logarithm_of_power(b, exponent);
            exp2_of_product(b, y, log)
        }
        None => {
            let (base, exponent) = without_root(b, x, y);
            if is_small(b, exponent) {
                small_power(b, base, exponent)
            } else {
                let log = logarithm(b, base, log2_of_zero(b, exponent));
                exp2_of_product(b, exponent, log)
            }
        }
    };
    signed(b, x, y, power)
}

fn short_pow(b: &mut Builder, x: Value, y: Value) -> Value {
    if let Some(power) = b.constant_of(y).and_then(|y| constant_power(b, x, y)) {
        return power;
    }
    let (factor, log) = match b.exponent_of(x) {
        Some([exponent, _]) => (y, short_logarithm_of_power(b, exponent)),
        None => {
            let (base, exponent) = without_root(b, x, y);
            (exponent, short_logarithm(b, base, log2_of_zero(b, exponent)))
        }
    };
    let exponent = b.mul(factor, log);
    let clamped = exponent_of_scale(b, exponent);
    let power = short_exp2(b, clamped);
    let limit = b.constant(LIMIT);
    let power = b.min(power, limit);
    let zero = b.constant(0.0);
    b.set_exponent(power, clamped, zero);
    signed(b, x, y, power)
}

/// A base and an exponent that give x^y: where x is a square root and y 1 at least, what x is
/// the root of, and half of y. Distances are roots, and a root takes as long as five products.
/// Squares below the normal numbers count as 0, which x^y is then too as far as the budget
/// goes, but for smaller y.
fn without_root(b: &mut Builder, x: Value, y: Value) -> (Value, Value) {
    let square = if b.rules().contract && b.range(y).lo >= 1.0 { b.square_of(x) } else { None };
    let Some(square) = square else { return (x, y) };
    let half = b.constant(0.5);
    (square, b.mul(y, half))
}

/// Whether an exponent is known to be within ±[`SMALL_EXPONENT`]. What ranges show counts as
/// contraction, as the two ways to compute a power round differently.
fn is_small(b: &Builder, y: Value) -> bool {
    let known = b.constant_of(y).is_some() || b.rules().contract;
    known && b.range(y).magnitude() <= SMALL_EXPONENT
}

/// The logarithm that 0 counts as having where the exponent is y. It is [`LOG2_ZERO`]; but a
/// constant that makes 0 of 0 gets no lower one than it flushes, so that what follows is never
/// out of bounds. There is none where the power of the least normal number is flushed too.
fn log2_of_zero(b: &Builder, y: Value) -> Option<f32> {
    if b.rules().ranges && b.range(y).lo >= FLUSHING {
        return None;
    }
    match b.constant_of(y) {
        Some(y @ VANISHING..FLUSHING) if b.rules().ranges => Some(EXPONENT_MIN / y),
        _ => Some(LOG2_ZERO),
    }
}

/// Bounds an exponent of 2, where the integer nearest to it may be out of bounds.
fn exponent_of_scale(b: &mut Builder, exponent: Value) -> Value {
    let range = b.range(exponent);
    let [low, high] = [range.lo, range.hi].map(|bound| b.rules().ranges && is_scale(bound));
    let (least, greatest) = (b.constant(EXPONENT_MIN), b.constant(EXPONENT_MAX));
    let raised = if low { exponent } else { b.max(exponent, least) };
    if high { raised } else { b.min(raised, greatest) }
}

/// Whether the integer nearest to an exponent of 2 is the exponent of a scale. The margin is
/// less than half, as the ends of ranges are rounded.
fn is_scale(exponent: f32) -> bool {
    (EXPONENT_MIN - 0.4..=EXPONENT_MAX + 0.4).contains(&exponent)
}

/// The power of |x| with the sign of that of x.
fn signed(b: &mut Builder, x: Value, y: Value, power: Value) -> Value {
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
            let square = b.product(x, x);
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
    let square = b.product(x, x);
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
    /// Bounds `low`, unless `high` says that the number is 0.
    low_max: f32,
}

/// log2 |x|, or what 0 counts as having.
fn logarithm(b: &mut Builder, x: Value, of_zero: Option<f32>) -> Parts {
    let magnitude = b.abs(x);
    let normal = at_least_normal(b, magnitude);
    let log = log2(b, normal);
    let high = unless_zero(b, magnitude, of_zero, log.high);
    Parts { high, ..log }
}

/// The logarithm, or that of 0, if it has one, where |x| is no normal number.
fn unless_zero(b: &mut Builder, magnitude: Value, of_zero: Option<f32>, log: Value) -> Value {
    let Some(of_zero) = of_zero else { return log };
    let smallest = b.constant(f32::MIN_POSITIVE);
    let of_zero = b.constant(of_zero);
    b.select_lt(magnitude, smallest, of_zero, log)
}

/// The same of a value that is itself a power, from the exponent it was made with:
/// a power of a power takes one logarithm. What the first power flushed to 0 or
/// clamped is 0 or clamped here too.
fn logarithm_of_power(b: &mut Builder, [high, low]: [Value; 2]) -> Parts {
    let (least, greatest) = (b.constant(-126.0), b.constant(LOG2_LIMIT));
    let zero = b.constant(0.0);
    let low = b.select_lt(greatest, high, zero, low);
    let clamped = b.min(high, greatest);
    let log2_zero = b.constant(LOG2_ZERO);
    let high = b.select_lt(high, least, log2_zero, clamped);
    Parts { high, low, low_max: RESIDUE_MAX }
}

/// The logarithm in one part.
fn short_logarithm(b: &mut Builder, x: Value, of_zero: Option<f32>) -> Value {
    let magnitude = b.abs(x);
    let normal = at_least_normal(b, magnitude);
    let [e, _, f] = split(b, normal);
    let series = horner(b, f, &SHORT_LOG2);
    let log = b.fma(f, series, e);
    b.stands_for(log, Native::Log2, normal);
    unless_zero(b, magnitude, of_zero, log)
}

/// The same of a value that is itself a power, from the exponent it was made with.
fn short_logarithm_of_power(b: &mut Builder, exponent: Value) -> Value {
    let (least, greatest) = (b.constant(-126.0), b.constant(LOG2_LIMIT));
    let clamped = b.min(exponent, greatest);
    let log2_zero = b.constant(LOG2_ZERO);
    b.select_lt(exponent, least, log2_zero, clamped)
}

/// log2 of a positive normal number, to 2^-28 of itself.
fn log2(b: &mut Builder, x: Value) -> Parts {
    let one = b.constant(1.0);
    let [e, h, f] = split(b, x);

    // s = f / (1 + f/2) rounded. The subtraction f - s is exact, so
    // rest = f - s (1 + f/2) is what s leaves over, however the divisor was rounded.
    let divisor = b.add(one, h);
    let s = b.div(f, divisor);
    b.pin(s);
    let difference = b.sub(f, s);
    let minus_h = b.neg(h);
    let rest = b.fma(s, minus_h, difference);
    b.pin(rest);

    // log2 m = -minus_main + tail, where minus_main is -LOG2_E s rounded.
    let (log2_e, minus_log2_e) = (b.constant(LOG2_E), b.constant(-LOG2_E));
    let minus_main = b.mul(s, minus_log2_e);
    b.pin(minus_main);
    let tail = b.fma(s, log2_e, minus_main);
    b.pin(tail);
    let [slope, weight] = REST.map(|c| b.constant(c));
    let weight = b.fma(s, slope, weight);
    let tail = b.fma(rest, weight, tail);
    let z = b.mul(s, s);
    let series = horner(b, z, &SERIES);
    let tail = b.fma(s, series, tail);

    // The differences are exact; what high rounds away reaches low.
    let log_m = b.sub(tail, minus_main);
    let high = b.add(e, log_m);
    b.pin(high);
    b.stands_for(high, Native::Log2, x);
    let low = b.sub(e, high);
    b.pin(low);
    let low = b.sub(low, minus_main);
    b.pin(low);
    let low = b.add(low, tail);
    Parts { high, low, low_max: 1.0 / 131_072.0 }
}

/// |x|^y for y within ±[`SMALL_EXPONENT`].
///
/// With x = 2^e m, p = y log2 m and n the integer nearest to y e + p, x^y is 2^n times 2 to the
/// power of (y e - n) + p. The difference is small and has next to no error, so nothing large
/// is ever rounded, and the logarithm of m alone has to be known, to an absolute error.
fn small_power(b: &mut Builder, x: Value, y: Value) -> Value {
    let magnitude = b.abs(x);
    let normal = at_least_normal(b, magnitude);
    let [e, _, f] = split(b, normal);
    let series = horner(b, f, &LOG2);
    let log_m = b.mul(f, series);
    b.assume(log_m, Interval::new(-0.500_001, 0.500_001));
    let of_zero = log2_of_zero(b, y);
    let e = unless_zero(b, magnitude, of_zero, e);

    let product = b.mul(y, log_m);
    let sum = b.fma(y, e, product);
    if of_zero.is_some_and(|log| log > LOG2_ZERO) {
        // It is lowest for 0, -127 with two roundings, and for the least normal number, -127.01.
        b.assume(sum, Interval::new(EXPONENT_MIN - 0.1, f32::INFINITY));
    }
    let high = exponent_of_scale(b, sum);
    let n = b.round(high);
    let minus_n = b.neg(n);
    let g = b.fma(y, e, minus_n);
    b.pin(g);
    let g = b.add(g, product);
    // A half, and what rounding the sum left; but all of the excess of a sum that was clamped.
    let range = b.range(sum);
    let least = if is_scale(range.lo) { -1.0 } else { f32::NEG_INFINITY };
    let greatest = if is_scale(range.hi) { 1.0 } else { f32::INFINITY };
    b.assume(g, Interval::new(least, greatest));
    let g = b.clamp(g, -1.0, 1.0);
    let power = scaled_exp2(b, g, n);
    b.stands_for(power, Native::Exp2, high);
    let limit = b.constant(LIMIT);
    let power = b.min(power, limit);

    // For a power of this power; without one nothing of it is left.
    let minus_sum = b.neg(sum);
    let low = b.fma(y, e, minus_sum);
    b.pin(low);
    let low = b.add(low, product);
    let low = b.clamp(low, -RESIDUE_MAX, RESIDUE_MAX);
    b.set_exponent(power, high, low);
    power
}

/// 2^(n + g) for an integer n in [-127, 60] and |g| up to 1/2 and a little; up to 1 something
/// between 2^(n - 2) and 2^(n + 2).
fn scaled_exp2(b: &mut Builder, g: Value, n: Value) -> Value {
    let one = b.constant(1.0);
    let slope = horner(b, g, &EXP2);
    let power = b.fma(slope, g, one);
    let scale = b.exp2i(n);
    b.mul(power, scale)
}

/// 2^(y * log), at most [`LIMIT`].
fn exp2_of_product(b: &mut Builder, y: Value, log: Parts) -> Value {
    let high = b.mul(y, log.high);
    b.pin(high);
    let minus_high = b.neg(high);
    let low = b.fma(y, log.high, minus_high);
    b.pin(low);
    let low = b.fma(y, log.low, low);
    // |log| < 128, so that its product with y leaves less than 2^-17 of y.
    // Moderate exponents need no clamp.
    let bound = b.range(y).magnitude() * (1.0 / 131_072.0 + log.low_max);
    b.assume(low, Interval::new(-bound, bound));
    let low = b.clamp(low, -RESIDUE_MAX, RESIDUE_MAX);

    let high = exponent_of_scale(b, high);
    let n = b.round(high);
    let g = b.sub(high, n);
    b.assume(g, Interval::new(-0.5, 0.5));
    let g = b.add(g, low);
    let power = scaled_exp2(b, g, n);
    b.stands_for(power, Native::Exp2, high);
    let limit = b.constant(LIMIT);
    let power = b.min(power, limit);
    b.set_exponent(power, high, low);
    power
}
