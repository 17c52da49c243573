//! The natural logarithm.

use super::{at_least_normal, enclosure, horner, split};
use crate::expr::builder::{Builder, DIVISOR_MIN, LIMIT};
use crate::expr::function::{Budget, Fast, Unary};
use crate::expr::tape::Value;

/// `log`: the natural logarithm of what is no normal number, 0 and negative numbers
/// among it, is that of the smallest one, about -87.3. 15 primitives.
///
/// x = 2^e (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)), and log(1 + f) = f + f^2 q(f)
/// with q of degree 7 (relative error 3.0e-8). Where e is 0 the result is that sum,
/// so that it keeps its digits near 1; elsewhere e ln 2 is added, with ln 2 in one
/// part, whose error is less than a tenth of a unit in the last place.
pub const LOG: Unary = Unary {
    meaning: |x| x.max(f64::from(f32::MIN_POSITIVE)).ln(),
    build: log,
    range: |x| {
        // Operands are never beyond the limit, even if no more is known of them.
        let at = |x: f32| (LOG.meaning)(x.min(LIMIT).into());
        enclosure(LOG.budget, at(x.lo), at(x.hi))
    },
    derivative: |b, x, _| {
        let (zero, one, least) = (b.constant(0.0), b.constant(1.0), b.constant(DIVISOR_MIN));
        let divisor = b.max(x, least);
        let slope = b.div(one, divisor);
        let slope = b.limited(slope);
        b.select_below(x, f32::MIN_POSITIVE, zero, slope)
    },
    budget: Budget { ulp: 1.5, absolute: 0.0 },
    fast: Fast { within: LIMIT, budget: Budget { ulp: 8.0, absolute: 1e-6 } },
    short: None,
};

/// (log(1 + f) - f) / f^2.
const TAIL: [f32; 8] = [
    -0.499_999_9,
    0.333_339_45,
    -0.250_017_76,
    0.199_622_41,
    -0.165_703_18,
    0.149_163_41,
    -0.143_076_66,
    0.087_387_525,
];

fn log(b: &mut Builder, x: Value) -> Value {
    let normal = at_least_normal(b, x);
    let [e, _, f] = split(b, normal);
    let square = b.mul(f, f);
    let tail = horner(b, f, &TAIL);
    let log_m = b.fma(square, tail, f);
    let ln_2 = b.constant(std::f32::consts::LN_2);
    b.fma(e, ln_2, log_m)
}
