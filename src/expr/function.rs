//! What a row of the operator table is made of: meaning, making, range, budget.
//!
//! The *meaning* is exact, in f64, and total: a finite value within
//! ±[`LIMIT`] for all finite operands. The *making* emits
//! primitives. The *range* encloses what the made code can return. The *derivative*
//! emits primitives too: what the meaning's derivative is, guards and clamps
//! included ([`derivative`](super::derivative) says what that is at kinks). The
//! *budget* says how far the made code may be from the meaning; tests measure it,
//! and no test has a tolerance of its own.

use super::builder::{Builder, LIMIT};
use super::interval::Interval;
use super::tape::Value;

/// How far the `f32` result of an operator may be from its exact meaning, for
/// operands that are exactly representable: within `ulp` units in the last
/// place of the exact result *or* within `absolute` of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Units in the last place (of `f32`) of the exact result.
    pub ulp: f64,
    /// Absolute difference, for results near a zero of the function.
    pub absolute: f64,
}

impl Budget {
    /// Whether `got` is near enough to `exact`.
    pub fn allows(self, got: f32, exact: f64) -> bool {
        let error = (f64::from(got) - exact).abs();
        error <= self.absolute || error <= self.ulp * ulp(exact)
    }
}

/// The spacing of `f32` at `x`.
pub fn ulp(x: f64) -> f64 {
    let exponent = x.abs().max(f64::from(f32::MIN_POSITIVE)).log2().floor();
    (exponent - 23.0).exp2()
}

/// What a shader holds to that is told to be fast: it uses built-in functions
/// where it may, and the compiler may contract and reassociate. What is lost by
/// that grows with the operands, so a bound goes with the budget.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fast {
    /// The budget holds for operands within ± this.
    pub within: f32,
    /// What WGSL guarantees, for what is used.
    pub budget: Budget,
}

/// A function of one scalar.
#[derive(Clone, Copy, Debug)]
pub struct Unary {
    /// The exact meaning.
    pub meaning: fn(f64) -> f64,
    /// Emits the function of a value.
    pub build: fn(&mut Builder, Value) -> Value,
    /// Encloses every result that `build`'s code gives on the operand's range.
    pub range: fn(Interval) -> Interval,
    /// Emits the derivative, given the operand and what `build` gave for it.
    pub derivative: fn(&mut Builder, Value, Value) -> Value,
    /// How far apart the two may be.
    pub budget: Budget,
    /// How far apart they may be in a fast shader.
    pub fast: Fast,
    /// The same function in fewer primitives and with a wider budget, where there is
    /// something to be saved.
    pub short: Option<&'static Unary>,
}

/// A function of two scalars.
#[derive(Clone, Copy, Debug)]
pub struct Binary {
    /// The exact meaning.
    pub meaning: fn(f64, f64) -> f64,
    /// Emits the function of two values.
    pub build: fn(&mut Builder, Value, Value) -> Value,
    /// Encloses every result that `build`'s code gives on the operands' ranges.
    pub range: fn(Interval, Interval) -> Interval,
    /// Emits the derivatives by either operand, given the operands and what `build` gave
    /// for them.
    pub derivatives: fn(&mut Builder, Value, Value, Value) -> [Value; 2],
    /// How far apart the two may be.
    pub budget: Budget,
    /// How far apart they may be in a fast shader.
    pub fast: Fast,
    /// The same function in fewer primitives and with a wider budget, where there is
    /// something to be saved.
    pub short: Option<&'static Binary>,
}

/// Emits the derivatives with respect to both components of every pair, given the pairs and
/// the function's own result.
pub type PairDerivatives = fn(&mut Builder, &[(Value, Value)], Value) -> Vec<(Value, Value)>;

/// A function of a vector at pixel i and a vector at pixel j, given as pairs of
/// components. A narrower vector is padded with zero components.
#[derive(Clone, Copy, Debug)]
pub struct VectorFunction {
    /// The exact meaning.
    pub meaning: fn(&[(f64, f64)]) -> f64,
    /// Emits the function of component pairs.
    pub build: fn(&mut Builder, &[(Value, Value)]) -> Value,
    /// Emits the derivatives by both components of every pair, given the pairs and what
    /// `build` gave for them.
    pub derivatives: PairDerivatives,
    /// Whether the function looks at nothing but the components' differences,
    /// so that both vectors may be shifted alike.
    pub differences: bool,
    /// How far apart meaning and code may be, for components within [-1, 1].
    pub budget: Budget,
}

/// Clamps an exact result into ±[`LIMIT`].
pub(super) fn limited(x: f64) -> f64 {
    x.clamp(-f64::from(LIMIT), f64::from(LIMIT))
}
