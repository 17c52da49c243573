//! The exponential.

use super::{enclosure, horner};
use crate::expr::builder::{Builder, LIMIT};
use crate::expr::function::{Budget, Fast, Unary};
use crate::expr::interval::Interval;
use crate::expr::tape::{Native, Value};

/// `exp`: e^x, clamped at [`LIMIT`] above; below about -87.3, where e^x is no
/// normal number, the result may be flushed to 0. 14 primitives.
///
/// x = n ln 2 + r with |r| <= 0.347, ln 2 in two parts; e^r is a polynomial of
/// degree 6 (relative error 3.2e-9), and 2^n is built from its exponent field.
/// 12 primitives where the argument is known to be in [-88, 41]; 13 where it is
/// only known not to be positive, as in most filters.
pub const EXP: Unary = Unary {
    meaning,
    build: exp,
    range: |x| range(x, BUDGET),
    derivative,
    budget: BUDGET,
    fast: FAST,
    short: Some(&SHORT_EXP),
};

/// The same in 11 primitives: a polynomial of degree 4 (relative error 2.8e-6), and the
/// multiple of ln 2 is subtracted after the scaling, as in 2^x.
pub const SHORT_EXP: Unary = Unary {
    meaning,
    build: short_exp,
    range: |x| range(x, SHORT_BUDGET),
    derivative,
    budget: SHORT_BUDGET,
    fast: FAST,
    short: None,
};

const BUDGET: Budget = Budget { ulp: 1.0, absolute: f32::MIN_POSITIVE as f64 };
const SHORT_BUDGET: Budget = Budget { ulp: 100.0, ..BUDGET };
const FAST: Fast = Fast { within: 88.0, budget: Budget { ulp: 300.0, ..BUDGET } };

/// The greatest `f32` whose exponential is at most [`LIMIT`].
const ARGUMENT_MAX: f32 = 41.446_53;

/// Below this the result is 0: the scale 2^-127 is flushed.
const ARGUMENT_MIN: f32 = -88.0;

/// ln 2 in two parts.
const LN_2: [f32; 2] = [std::f32::consts::LN_2, -1.904_654_2e-9];

/// (e^r - 1 - r) / r^2.
const TAIL: [f32; 5] = [0.499_999_94, 0.166_665_15, 0.041_668_08, 0.008_369_369, 0.001_384_181_2];

/// (2^g - 1) / g, to 2.8e-6 of 2^g on |g| <= 1/2.
pub(super) const SHORT_EXP2: [f32; 4] = [0.693_124_2, 0.240_240_93, 0.055_906_504, 0.009_583_089];

fn meaning(x: f64) -> f64 {
    x.min(f64::from(ARGUMENT_MAX)).exp()
}

fn range(x: Interval, budget: Budget) -> Interval {
    if x.hi <= ARGUMENT_MIN {
        return Interval::point(0.0);
    }
    enclosure(budget, meaning(x.lo.into()), meaning(x.hi.into())).clamped(0.0, LIMIT)
}

/// The exponential itself, where it is not clamped.
fn derivative(b: &mut Builder, x: Value, y: Value) -> Value {
    let zero = b.constant(0.0);
    b.select_below(x, ARGUMENT_MAX, y, zero)
}

fn exp(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, ARGUMENT_MIN, ARGUMENT_MAX);
    let log2_e = b.constant(std::f32::consts::LOG2_E);
    let t = b.mul(x, log2_e);
    let n = b.round(t);
    let r = LN_2.iter().fold(x, |r, part| {
        let part = b.constant(-part);
        let r = b.fma(n, part, r);
        b.pin(r)
    });
    let one = b.constant(1.0);
    let tail = horner(b, r, &TAIL);
    let slope = b.fma(tail, r, one);
    let power = b.fma(slope, r, one);
    b.pin(power);
    let scale = b.exp2i(n);
    let power = b.mul(power, scale);
    b.stands_for(power, Native::Exp2, t);
    power
}

fn short_exp(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, ARGUMENT_MIN, ARGUMENT_MAX);
    let log2_e = b.constant(std::f32::consts::LOG2_E);
    let t = b.mul(x, log2_e);
    short_exp2(b, t)
}

/// 2^t for t in [-127, 127], below -126.5 flushed to 0.
pub(super) fn short_exp2(b: &mut Builder, t: Value) -> Value {
    let n = b.round(t);
    let g = b.sub(t, n);
    let one = b.constant(1.0);
    let slope = horner(b, g, &SHORT_EXP2);
    let power = b.fma(slope, g, one);
    let scale = b.exp2i(n);
    let power = b.mul(power, scale);
    b.stands_for(power, Native::Exp2, t);
    power
}
