//! Elementary functions as polynomials over primitives.

mod exp;
mod inverse;
mod power;
mod trig;

pub use exp::EXP;
pub use inverse::{ACOS, ASIN, ATAN};
pub use power::{POW, SQRT};
pub use trig::{COS, SIN, TAN};

use super::builder::Builder;
use super::function::Budget;
use super::interval::Interval;
use super::tape::Value;

/// The polynomial with these coefficients, lowest power first.
pub(super) fn horner(b: &mut Builder, x: Value, coefficients: &[f32]) -> Value {
    let (&highest, rest) = coefficients.split_last().expect("a polynomial has a coefficient");
    let highest = b.constant(highest);
    rest.iter().rev().fold(highest, |sum, &c| {
        let c = b.constant(c);
        b.fma(sum, x, c)
    })
}

/// Encloses what lies within the budget of the exact values between two bounds.
pub(super) fn enclosure(budget: Budget, lo: f64, hi: f64) -> Interval {
    // Half an ulp more for the bounds' own rounding.
    let relative = (budget.ulp + 0.5) * f64::from(f32::EPSILON);
    Interval::new(lo as f32, hi as f32).widened(relative as f32, budget.absolute as f32)
}
