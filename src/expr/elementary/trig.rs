//! Sine, cosine and tangent.
//!
//! The argument is reduced by a multiple of pi (of pi/2 for the tangent) that is
//! subtracted in three parts. The first subtraction is exact, because the
//! difference is a multiple of the first part's last bit and fits in 24 bits; so
//! the budgets hold up to |x| = 1e5. Beyond, the argument is clamped by intent,
//! in the meaning too: there the reduced argument would soon be noise, and no
//! filter wants the sine of numbers whose `f32` neighbours are far around the
//! circle.

use std::f32::consts::{FRAC_1_PI, FRAC_2_PI, FRAC_PI_2, PI};

use super::{enclosure, horner};
use crate::expr::builder::Builder;
use crate::expr::derivative::inside;
use crate::expr::function::{Budget, Fast, Unary};
use crate::expr::interval::Interval;
use crate::expr::tape::Value;

/// Arguments are clamped into ± this.
const ARGUMENT_MAX: f32 = 1e5;

/// `sin`, of the argument clamped into ±1e5. 18 primitives: a polynomial of degree
/// 9 on |r| <= 1.58 (relative error 1.2e-8), its sign flipped where the multiple of
/// pi is odd. No result exceeds 1: the last bits of the coefficients were chosen
/// to that end, over all arguments near pi/2.
pub const SIN: Unary = Unary {
    meaning: |x| clamped(x).sin(),
    build: sin,
    range: |x| {
        if x.within(QUARTER_TURN) {
            enclosure(SIN.budget, f64::from(x.lo).sin(), f64::from(x.hi).sin()).clamped(-1.0, 1.0)
        } else {
            Interval::new(-1.0, 1.0)
        }
    },
    derivative: |b, x, _| {
        let cosine = cos(b, x);
        inside(b, x, ARGUMENT_MAX, cosine)
    },
    budget: Budget { ulp: 2.0, absolute: 0.0 },
    fast: Fast { within: 8.0, budget: Budget { ulp: 2.0, absolute: 2e-6 } },
    short: None,
};

/// `cos`, of the argument clamped into ±1e5. 19 primitives: the same polynomial,
/// around the nearest odd multiple of pi/2, so that the zeros keep their digits.
pub const COS: Unary = Unary {
    meaning: |x| clamped(x).cos(),
    build: cos,
    range: |x| {
        let x = x.abs();
        if x.within(HALF_TURN) {
            enclosure(COS.budget, f64::from(x.hi).cos(), f64::from(x.lo).cos()).clamped(-1.0, 1.0)
        } else {
            Interval::new(-1.0, 1.0)
        }
    },
    derivative: |b, x, _| {
        let sine = sin(b, x);
        let minus_sine = b.neg(sine);
        inside(b, x, ARGUMENT_MAX, minus_sine)
    },
    budget: Budget { ulp: 2.1, absolute: 0.0 },
    fast: Fast { within: 8.0, budget: Budget { ulp: 2.1, absolute: 2e-6 } },
    short: None,
};

/// `tan`, of the argument clamped into ±1e5. 19 primitives: one quotient
/// r (1 + p r^2) / (1 + q r^2 + s r^4) on |r| <= 0.793 (relative error 2.4e-8),
/// turned over where the multiple of pi/2 is odd.
///
/// It is total because no `f32` is a pole: the nearest, 252.89821, has a tangent of
/// 2.389e8, so that there is nothing to clamp.
pub const TAN: Unary = Unary {
    meaning: |x| clamped(x).tan(),
    build: tan,
    range: |x| {
        if x.within(QUARTER_TURN) {
            enclosure(TAN.budget, f64::from(x.lo).tan(), f64::from(x.hi).tan())
        } else {
            Interval::new(-TANGENT_MAX, TANGENT_MAX)
        }
    },
    derivative: |b, x, y| {
        let one = b.constant(1.0);
        let slope = b.fma(y, y, one);
        inside(b, x, ARGUMENT_MAX, slope)
    },
    budget: Budget { ulp: 3.2, absolute: 0.0 },
    fast: Fast { within: 1.0, budget: Budget { ulp: 8.0, absolute: 2e-6 } },
    short: None,
};

/// No tangent of an `f32` within ±[`ARGUMENT_MAX`] is greater.
const TANGENT_MAX: f32 = 2.4e8;

/// Within these, a little below pi/2 and pi, sine and tangent grow, and the
/// cosine falls with the magnitude.
const QUARTER_TURN: f32 = 1.5;
const HALF_TURN: f32 = 3.0;

/// Minus pi and minus pi/2, in three parts.
const MINUS_PI: [f32; 3] = [-PI, 8.742_278e-8, 3.430_249e-15];
const MINUS_HALF_PI: [f32; 3] = [-FRAC_PI_2, 4.371_139e-8, 1.715_124_5e-15];

/// (sin r / r - 1) / r^2, in powers of r^2.
const SINE: [f32; 4] = [-0.166_666_63, 0.008_333_142, -0.000_198_139_82, 2.613_001e-6];

/// tan r = r (1 + p r^2) / (1 + q r^2 + s r^4).
const TANGENT_P: f32 = -0.095_800_98;
const TANGENT_Q: f32 = -0.429_134_85;
const TANGENT_S: f32 = 0.009_716_379;

fn clamped(x: f64) -> f64 {
    x.clamp(-f64::from(ARGUMENT_MAX), f64::from(ARGUMENT_MAX))
}

fn sin(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, -ARGUMENT_MAX, ARGUMENT_MAX);
    let per_half_turn = b.constant(FRAC_1_PI);
    let t = b.mul(x, per_half_turn);
    let n = b.round(t);
    let r = reduced(b, x, n, MINUS_PI);
    signed_sine(b, r, n, 1.0)
}

fn cos(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, -ARGUMENT_MAX, ARGUMENT_MAX);
    let (per_half_turn, half) = (b.constant(FRAC_1_PI), b.constant(0.5));
    let minus_half = b.constant(-0.5);
    let t = b.fma(x, per_half_turn, minus_half);
    let n = b.round(t);
    let halves = b.add(n, half);
    let r = reduced(b, x, halves, MINUS_PI);
    signed_sine(b, r, n, -1.0)
}

/// x + n * parts.
fn reduced(b: &mut Builder, x: Value, n: Value, parts: [f32; 3]) -> Value {
    parts.iter().fold(x, |r, &part| {
        let part = b.constant(part);
        let r = b.fma(n, part, r);
        b.pin(r)
    })
}

/// floor(n / 2) for an integer n.
fn half_floor(b: &mut Builder, n: Value) -> Value {
    let (half, minus_quarter) = (b.constant(0.5), b.constant(-0.25));
    let t = b.fma(n, half, minus_quarter);
    b.round(t)
}

/// `sign * (-1)^n * sin r` for |r| <= pi/2.
fn signed_sine(b: &mut Builder, r: Value, n: Value, sign: f32) -> Value {
    // (-1)^n = 1 - 2 (n - 2 floor(n / 2))
    let half = half_floor(b, n);
    let [unit, minus_two, four] = [1.0, -2.0, 4.0].map(|c| b.constant(sign * c));
    let t = b.fma(n, minus_two, unit);
    let parity = b.fma(half, four, t);
    let signed = b.mul(r, parity);
    let z = b.mul(r, r);
    let tail = horner(b, z, &SINE);
    let cube = b.mul(signed, z);
    b.fma(cube, tail, signed)
}

fn tan(b: &mut Builder, x: Value) -> Value {
    let x = b.clamp(x, -ARGUMENT_MAX, ARGUMENT_MAX);
    let per_quarter_turn = b.constant(FRAC_2_PI);
    let t = b.mul(x, per_quarter_turn);
    let n = b.round(t);
    let r = reduced(b, x, n, MINUS_HALF_PI);
    let z = b.mul(r, r);
    let p = b.constant(TANGENT_P);
    let cube = b.mul(r, z);
    let sine = b.fma(cube, p, r);
    let cosine = horner(b, z, &[1.0, TANGENT_Q, TANGENT_S]);
    // tan(r + pi/2) = -1 / tan r
    let half = half_floor(b, n);
    let even = b.add(half, half);
    let minus_cosine = b.neg(cosine);
    let numerator = b.select_lt(even, n, minus_cosine, sine);
    let denominator = b.select_lt(even, n, sine, cosine);
    b.div(numerator, denominator)
}
