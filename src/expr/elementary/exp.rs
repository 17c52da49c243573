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
    meaning: |x| x.min(f64::from(ARGUMENT_MAX)).exp(),
    build: exp,
    range: |x| {
        if x.hi <= ARGUMENT_MIN {
            return Interval::point(0.0);
        }
        enclosure(EXP.budget, (EXP.meaning)(x.lo.into()), (EXP.meaning)(x.hi.into()))
            .clamped(0.0, LIMIT)
    },
    budget: Budget { ulp: 1.0, absolute: f32::MIN_POSITIVE as f64 },
    fast: Fast { within: 88.0, budget: Budget { ulp: 300.0, absolute: f32::MIN_POSITIVE as f64 } },
};

/// The greatest `f32` whose exponential is at most [`LIMIT`].
const ARGUMENT_MAX: f32 = 41.446_53;

/// Below this the result is 0: the scale 2^-127 is flushed.
const ARGUMENT_MIN: f32 = -88.0;

/// ln 2 in two parts.
const LN_2: [f32; 2] = [std::f32::consts::LN_2, -1.904_654_2e-9];

/// (e^r - 1 - r) / r^2.
const TAIL: [f32; 5] = [0.499_999_94, 0.166_665_15, 0.041_668_08, 0.008_369_369, 0.001_384_181_2];

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
