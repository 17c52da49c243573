//! Arithmetic and distances: the rows that need no approximation.
//!
//! These use the [`Builder`]'s contractible arithmetic, and clamp into
//! ±[`LIMIT`] what the operands' ranges do not already keep inside.

use super::builder::{Builder, DIVISOR_MIN, LIMIT};
use super::derivative::{sign, unless_limited};
use super::function::{Binary, Budget, Fast, Unary, VectorFunction, limited};
use super::interval::Interval;
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
    derivative: |b, _, _| b.constant(-1.0),
    budget: ROUNDED,
    fast: FAST,
    short: None,
};

/// Absolute value.
pub const ABS: Unary = Unary {
    meaning: f64::abs,
    build: Builder::abs,
    range: Interval::abs,
    derivative: |b, x, _| sign(b, x),
    budget: ROUNDED,
    fast: FAST,
    short: None,
};

/// Leaky rectifier: the operand, or a hundredth of it below zero.
pub const LEAKY: Unary = Unary {
    meaning: |x| x.max(f64::from(LEAK) * x),
    build: |b, x| {
        let leak = b.constant(LEAK);
        let below = b.mul(x, leak);
        b.max(x, below)
    },
    range: |x| x.increasing(|x| x.max(LEAK * x)),
    derivative: |b, x, _| {
        let (leak, one) = (b.constant(LEAK), b.constant(1.0));
        b.select_below(x, 0.0, leak, one)
    },
    budget: ROUNDED,
    fast: FAST,
    short: None,
};

/// The slope of [`LEAKY`] below zero.
const LEAK: f32 = 0.01;

/// Minimum.
pub const MIN: Binary = Binary {
    meaning: f64::min,
    build: Builder::min,
    range: |x, y| Interval::new(x.lo.min(y.lo), x.hi.min(y.hi)),
    derivatives: |b, x, y, _| {
        let (zero, one) = (b.constant(0.0), b.constant(1.0));
        let by_x = b.select_lt(x, y, one, zero);
        [by_x, b.select_lt(x, y, zero, one)]
    },
    budget: ROUNDED,
    fast: FAST,
    short: None,
};

/// Maximum.
pub const MAX: Binary = Binary {
    meaning: f64::max,
    build: Builder::max,
    range: |x, y| Interval::new(x.lo.max(y.lo), x.hi.max(y.hi)),
    derivatives: |b, x, y, _| {
        let (zero, one) = (b.constant(0.0), b.constant(1.0));
        let by_x = b.select_lt(y, x, one, zero);
        [by_x, b.select_lt(y, x, zero, one)]
    },
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
    derivatives: |b, _, _, sum| {
        let one = b.constant(1.0);
        [unless_limited(b, sum, one); 2]
    },
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
    derivatives: |b, _, _, difference| {
        let one = b.constant(1.0);
        let by_x = unless_limited(b, difference, one);
        [by_x, b.neg(by_x)]
    },
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
    derivatives: |b, x, y, product| [y, x].map(|factor| unless_limited(b, product, factor)),
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
    derivatives: |b, _, y, quotient| {
        let divisor = away_from_zero(b, y);
        let one = b.constant(1.0);
        let by_x = b.div(one, divisor);
        let by_x = b.limited(by_x);
        let by_divisor = b.div(quotient, divisor);
        let by_divisor = b.limited(by_divisor);
        let minus_by_y = outside(b, y, DIVISOR_MIN, by_divisor);
        let by_y = b.neg(minus_by_y);
        [by_x, by_y].map(|derivative| unless_limited(b, quotient, derivative))
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
    derivatives: |b, pairs, sum| {
        let by_pair =
            |&(x, y): &(Value, Value)| (unless_limited(b, sum, y), unless_limited(b, sum, x));
        pairs.iter().map(by_pair).collect()
    },
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
    derivatives: |b, pairs, distance| {
        // Below this the derivative fades to 0 where the vectors are equal.
        let least = b.constant(DIVISOR_MIN);
        let divisor = b.max(distance, least);
        let parts = pairs.iter().map(|&(x, y)| {
            let difference = difference(b, x, y);
            let cosine = b.div(difference, divisor);
            b.clamp(cosine, -1.0, 1.0)
        });
        let parts: Vec<Value> = parts.collect();
        opposite(b, distance, parts)
    },
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
    derivatives: |b, pairs, distance| {
        let parts = pairs.iter().map(|&(x, y)| {
            let difference = difference(b, x, y);
            sign(b, difference)
        });
        let parts: Vec<Value> = parts.collect();
        opposite(b, distance, parts)
    },
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
    derivatives: |b, pairs, greatest| {
        let zero = b.constant(0.0);
        // 1 until the first of the greatest components has been met.
        let mut unmet = b.constant(1.0);
        let mut parts = Vec::with_capacity(pairs.len());
        for &(x, y) in pairs {
            let difference = difference(b, x, y);
            let magnitude = b.abs(difference);
            let sign = sign(b, difference);
            let part = b.mul(sign, unmet);
            parts.push(b.select_lt(magnitude, greatest, zero, part));
            unmet = b.select_lt(magnitude, greatest, unmet, zero);
        }
        opposite(b, greatest, parts)
    },
    budget: ROUNDED,
};

/// The derivative where |x| is at least the bound, 0 elsewhere.
fn outside(b: &mut Builder, x: Value, bound: f32, derivative: Value) -> Value {
    let (magnitude, zero) = (b.abs(x), b.constant(0.0));
    b.select_below(magnitude, bound, zero, derivative)
}

/// `x - y`, of the difference that a distance is made from.
fn difference(b: &mut Builder, x: Value, y: Value) -> Value {
    if y < x {
        let negated = b.sub(y, x);
        return b.neg(negated);
    }
    b.sub(x, y)
}

/// The derivatives of a function of differences: by components at j they are minus those
/// by components at i.
fn opposite(b: &mut Builder, result: Value, parts: Vec<Value>) -> Vec<(Value, Value)> {
    let pair = |part| {
        let by_i = unless_limited(b, result, part);
        (by_i, b.neg(by_i))
    };
    parts.into_iter().map(pair).collect()
}

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
