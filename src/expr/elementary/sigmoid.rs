//! Hyperbolic tangent and logistic function: steps.

use super::exp::EXP;
use super::{enclosure, horner};
use crate::expr::builder::{Builder, LIMIT};
use crate::expr::function::{Budget, Fast, Unary};
use crate::expr::tape::Value;

/// `tanh`. 15 primitives: one quotient x P(x^2) / Q(x^2) of degree 4 over 4 on
/// |x| <= 8.7 (relative error 2.0e-8), where the result is 1 but for half a unit in
/// the last place. Both polynomials have positive coefficients, so that nothing
/// cancels, and begin with 1, so that small arguments keep their digits.
pub const TANH: Unary = Unary {
    meaning: f64::tanh,
    build: tanh,
    range: |x| {
        enclosure(TANH.budget, f64::from(x.lo).tanh(), f64::from(x.hi).tanh()).clamped(-1.0, 1.0)
    },
    derivative: |b, _, y| {
        let (one, minus_y) = (b.constant(1.0), b.neg(y));
        b.fma(minus_y, y, one)
    },
    budget: Budget { ulp: 6.0, absolute: 0.0 },
    fast: Fast { within: LIMIT, budget: Budget { ulp: 8.0, absolute: 1e-6 } },
    short: None,
};

/// `logistic`: 1 / (1 + e^-x). 17 primitives: the exponential's, a sum and a
/// quotient. As the exponential is at most [`LIMIT`], no result is below 1e-18.
pub const LOGISTIC: Unary = Unary {
    meaning: |x| 1.0 / (1.0 + (EXP.meaning)(-x)),
    build: logistic,
    range: |x| {
        let at = |x: f32| (LOGISTIC.meaning)(x.into());
        enclosure(LOGISTIC.budget, at(x.lo), at(x.hi)).clamped(0.0, 1.0)
    },
    derivative: |b, _, y| {
        let one = b.constant(1.0);
        let rest = b.sub(one, y);
        b.mul(y, rest)
    },
    budget: Budget { ulp: 2.5, absolute: 0.0 },
    fast: Fast { within: 88.0, budget: Budget { ulp: 300.0, absolute: 1e-6 } },
    short: None,
};

/// From here on tanh is 1 but for half a unit in the last place.
const TANH_MAX: f32 = 8.7;

/// tanh x = x P(x^2) / Q(x^2).
const TANH_P: [f32; 5] = [1.0, 0.134_032_15, 0.003_521_939, 2.104_376_8e-5, 1.396_203_15e-8];
const TANH_Q: [f32; 5] = [1.0, 0.467_365_38, 0.025_977_226, 3.328_757_3e-4, 8.023_897e-7];

fn tanh(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, -TANH_MAX, TANH_MAX);
    let z = b.mul(x, x);
    let [p, q] = [&TANH_P, &TANH_Q].map(|coefficients| horner(b, z, coefficients));
    let numerator = b.mul(x, p);
    let quotient = b.div(numerator, q);
    b.clamp(quotient, -1.0, 1.0)
}

fn logistic(b: &mut Builder, x: Value) -> Value {
    let minus_x = b.neg(x);
    let power = (EXP.build)(b, minus_x);
    let one = b.constant(1.0);
    let sum = b.add(power, one);
    b.div(one, sum)
}
