//! Arithmetic and distances: the rows that need no approximation.
//!
//! These use the [`Builder`]'s contractible arithmetic, and clamp into
//! ±[`LIMIT`] what the operands' ranges do not already keep inside.

use super::builder::{Builder, DIVISOR_MIN, LIMIT};
use super::function::{Binary, Budget, Fast, Unary};
use super::interval::Interval;
use super::op::{VectorFunction, limited};
use super::tape::Value;

/// One correctly rounded operation.
const ROUNDED: Budget = Budget { ulp: 0.5, absolute: f32::MIN_POSITIVE as f64 };

/// The same of a fast shader.
const FAST: Fast = Fast { within: LIMIT, budget: ROUNDED };

fn bounded(range: Interval) -> Interval {
    range.clamped(-LIMIT, LIMIT)
}

/// Negation.
pub const NEG: Unary = Unary {
    meaning: |x| -x,
    build: Builder::neg,
    range: |x| -x,
    budget: ROUNDED,
    fast: FAST,
    short: None,
};

/// Sum.
pub const ADD: Binary = Binary {
    meaning: |x, y| limited(x + y),
    build: |b, x, y| {
        let sum = b.sum(x, y);
        b.limited(sum)
    },
    range: |x, y| bounded(x + y),
    budget: ROUNDED,
    fast: FAST,
    short: None,
};

/// Difference.
pub const SUB: Binary = Binary {
    meaning: |x, y| limited(x - y),
    build: |b, x, y| {
        let difference = b.difference(x, y);
        b.limited(difference)
    },
    range: |x, y| bounded(x - y),
    budget: ROUNDED,
    fast: FAST,
    short: None,
};

/// Product.
pub const MUL: Binary = Binary {
    meaning: |x, y| limited(x * y),
    build: |b, x, y| {
        let product = b.product(x, y);
        b.limited(product)
    },
    range: |x, y| bounded(x * y),
    budget: ROUNDED,
    fast: FAST,
    short: None,
};

/// Quotient. The reciprocal of a constant divisor is rounded before the
/// product is, which makes 1.5 units of it.
pub const DIV: Binary = Binary {
    meaning: |x, y| {
        let least = f64::from(DIVISOR_MIN);
        limited(x / if y < 0.0 { y.min(-least) } else { y.max(least) })
    },
    build: |b, x, y| {
        let divisor = away_from_zero(b, y);
        let quotient = b.quotient(x, divisor);
        b.limited(quotient)
    },
    range: |x, y| {
        let divisor = if y.lo >= 0.0 {
            Interval::new(y.lo.max(DIVISOR_MIN), y.hi.max(DIVISOR_MIN))
        } else if y.hi < 0.0 {
            Interval::new(y.lo.min(-DIVISOR_MIN), y.hi.min(-DIVISOR_MIN))
        } else {
            return Interval::new(-LIMIT, LIMIT);
        };
        // One part in a million covers the rounding of a reciprocal.
        bounded((x / divisor).widened(1e-6, f32::MIN_POSITIVE))
    },
    budget: Budget { ulp: 1.5, absolute: f32::MIN_POSITIVE as f64 },
    fast: Fast { within: LIMIT, budget: Budget { ulp: 4.0, absolute: f32::MIN_POSITIVE as f64 } },
    short: None,
};

/// Keeps a divisor [`DIVISOR_MIN`] away from zero, on its own side.
fn away_from_zero(b: &mut Builder, y: Value) -> Value {
    let (least, greatest) = (b.constant(DIVISOR_MIN), b.constant(-DIVISOR_MIN));
    let positive = b.max(y, least);
    let negative = b.min(y, greatest);
    b.select_below(y, 0.0, negative, positive)
}

/// Scalar product.
pub const DOT: VectorFunction = VectorFunction {
    meaning: |pairs| limited(pairs.iter().map(|(x, y)| x * y).sum()),
    build: |b, pairs| {
        let sum = fold(b, pairs, Builder::product, Builder::sum);
        b.limited(sum)
    },
    differences: false,
    budget: Budget { ulp: 0.5, absolute: 4e-7 },
};

/// Euclidean distance.
pub const DISTANCE2: VectorFunction = VectorFunction {
    meaning: |pairs| limited(pairs.iter().map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()),
    build: |b, pairs| {
        let squares = fold(
            b,
            pairs,
            |b, x, y| {
                // The square of y - x is the same value as that of x - y.
                let (x, y) = if y < x { (y, x) } else { (x, y) };
                let d = b.sub(x, y);
                b.mul(d, d)
            },
            Builder::sum,
        );
        let distance = b.sqrt(squares);
        b.limited(distance)
    },
    differences: true,
    budget: Budget { ulp: 3.0, absolute: 1e-19 },
};

/// Manhattan distance.
pub const DISTANCE1: VectorFunction = VectorFunction {
    meaning: |pairs| limited(pairs.iter().map(|(x, y)| (x - y).abs()).sum()),
    build: |b, pairs| {
        let sum = fold(b, pairs, distance, Builder::sum);
        b.limited(sum)
    },
    differences: true,
    budget: Budget { ulp: 2.0, absolute: f32::MIN_POSITIVE as f64 },
};

/// Chebyshev distance.
pub const DISTANCE_MAX: VectorFunction = VectorFunction {
    meaning: |pairs| limited(pairs.iter().map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)),
    build: |b, pairs| {
        let greatest = fold(b, pairs, distance, Builder::max);
        b.limited(greatest)
    },
    differences: true,
    budget: ROUNDED,
};

fn distance(b: &mut Builder, x: Value, y: Value) -> Value {
    let difference = b.sub(x, y);
    b.abs(difference)
}

fn fold(
    b: &mut Builder,
    pairs: &[(Value, Value)],
    term: impl Fn(&mut Builder, Value, Value) -> Value,
    combine: impl Fn(&mut Builder, Value, Value) -> Value,
) -> Value {
    let mut terms = Vec::with_capacity(pairs.len());
    for &(x, y) in pairs {
        terms.push(term(b, x, y));
    }
    terms.into_iter().reduce(|x, y| combine(b, x, y)).expect("a vector has at least one component")
}
