//! Floor 2: from expressions and facts to a [`Plan`], the only thing that a
//! back end accepts.
//!
//! ```text
//!   trees ──merge──▶ trees ──lower──▶ one tape ──rate──▶ tap tape    (per offset)
//!                       ▲                ▲           ├─▶ pixel tape  (per pixel i)
//!                     ranges      facts, fold,       └─▶ pair tape   (per pair)
//!                                 share, ranges,
//!                                 contract
//! ```
//!
//! A plan's fields are private: what a back end sees has been through here, so
//! it may rely on what is promised below and contains no policy of its own.

pub mod file;
mod filter;
mod lower;
mod merge;
mod passes;
mod rate;

use std::collections::BTreeSet;

use crate::expr::builder::{Builder, LIMIT};
use crate::expr::feature::PlaneId;
use crate::expr::interval::Interval;
use crate::expr::tape::{Input, Tape};
use crate::expr::tree::Tree;
use crate::scene::facts::{Fact, Facts};

pub use filter::{Filter, Source, Stage, Window};
pub use passes::{PASSES, PassRow, Passes};

/// Why no plan can be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlanError {
    /// The expression reads what the scene does not have.
    #[error("the filter reads `{term}`, which the scene does not have")]
    Missing {
        /// The term as expressions spell it.
        term: String,
        /// Whose.
        plane: PlaneId,
    },
    /// The expression is a bare vector.
    #[error("the weight must be a number, but `{0}` is a vector")]
    Vector(String),
    /// The window is larger than is accepted.
    #[error("a window that reaches {reach} pixels is too large; at most {max} are accepted", max = Window::MAX_RADIUS)]
    Window {
        /// How far it reaches.
        reach: u32,
    },
}

/// Weights over a window, ready for any back end.
///
/// Promises: the tapes' results are finite for all feature values within the
/// facts that the plan was made with; the pair tape reads planes at i and j,
/// `PerPixel` and `PerTap` values; the pixel tape reads planes at i; the tap
/// tape reads offsets.
#[derive(Clone, Debug)]
pub struct Plan {
    window: Window,
    tap: Tape,
    pixel: Tape,
    pair: Tape,
    signed: bool,
}

impl Plan {
    /// Plans one or several weights over one window. Several weights share
    /// every common value, and are normalised each on its own.
    pub fn new(
        weights: &[Tree],
        window: Window,
        facts: &Facts,
        passes: Passes,
    ) -> Result<Self, PlanError> {
        if window.reach() > Window::MAX_RADIUS {
            return Err(PlanError::Window { reach: window.reach() });
        }
        for weight in weights {
            check(weight, facts)?;
        }
        let range = |plane| match facts.get(plane) {
            Fact::Constant(x) if passes.facts => Interval::point(x),
            Fact::Range(range) if passes.facts => range,
            Fact::Absent | Fact::Constant(_) | Fact::Range(_) => Interval::new(-LIMIT, LIMIT),
        };
        let at = lower::Surroundings { range: &range, window };
        let mut b = Builder::new(passes.rules());
        let mut results = Vec::with_capacity(weights.len());
        for weight in weights {
            let merged;
            let weight = if passes.merge {
                merged = merge::merge(weight, &lower::ranges(weight, &at));
                &merged
            } else {
                weight
            };
            let nodes = lower::lower(&mut b, weight, &at);
            results.push(nodes[weight.root()].expect("the root is a scalar, as checked above"));
        }
        let tape = b.finish(&results);
        let signed = tape.results().iter().any(|&r| tape.range(r).lo < 0.0);
        let rate::Split { tap, pixel, pair } = rate::split(&tape, passes.rate);
        Ok(Self { window, tap, pixel, pair, signed })
    }

    /// Where j ranges.
    pub fn window(&self) -> Window {
        self.window
    }

    /// Computes the `PerTap` inputs of the pair tape from the offset.
    pub fn tap(&self) -> &Tape {
        &self.tap
    }

    /// Computes the `PerPixel` inputs of the pair tape from planes at i.
    pub fn pixel(&self) -> &Tape {
        &self.pixel
    }

    /// Computes the weights.
    pub fn pair(&self) -> &Tape {
        &self.pair
    }

    /// Whether a weight may be negative, so that sums may cancel.
    pub fn signed(&self) -> bool {
        self.signed
    }

    /// The planes that the plan reads; what is not here need not be loaded.
    pub fn planes(&self) -> BTreeSet<PlaneId> {
        self.pixel
            .inputs()
            .chain(self.pair.inputs())
            .filter_map(|input| match input {
                Input::Plane(plane, _) => Some(plane),
                Input::Offset(_) | Input::PerPixel(_) | Input::PerTap(_) => None,
            })
            .collect()
    }
}

fn check(weight: &Tree, facts: &Facts) -> Result<(), PlanError> {
    if weight.sort() != crate::expr::Sort::Scalar {
        return Err(PlanError::Vector(weight.to_string()));
    }
    for plane in weight.planes() {
        if facts.get(plane) == Fact::Absent {
            let spelling = plane.feature.spelling(plane.quantity);
            let term = spelling.expect("trees read only what has a spelling").to_owned();
            return Err(PlanError::Missing { term, plane });
        }
    }
    Ok(())
}
