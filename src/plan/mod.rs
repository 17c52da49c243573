//! Floor 4: from expressions and facts to a [`Plan`], the only thing that a
//! back end accepts.
//!
//! ```text
//!   trees ──merge──▶ trees ──lower──▶ one tape ─hoist──▶ tap tape    (per offset)
//!                     ▲ │                ▲           ├─▶ pixel tape  (per pixel)
//!                ranges │         facts, fold,       └─▶ pair tape   (per pair)
//!                    support      share, ranges,
//!                       ▼         contract
//!                     taps
//! ```
//!
//! `symmetry` lowers every weight a second time, with the pixels of the pair
//! exchanged, into the same tape: where the two are one value, or share most of
//! what they are made of, CPU back ends compute half of the pairs.
//!
//! A plan's fields are private: what a back end sees has been through here, so
//! it may rely on what is promised below and contains no policy of its own.

mod adjoint;
mod cost;
mod fuse;
mod gradient;
mod hoist;
mod kernel;
mod lift;
mod lower;
mod merge;
mod passes;
mod places;
mod precision;
mod schedule;
mod support;
mod symmetry;
mod taps;
mod window;

use std::collections::BTreeSet;
use std::ops::Range;

use crate::expr::builder::LIMIT;
use crate::expr::feature::PlaneId;
use crate::expr::interval::Interval;
use crate::expr::tree::Tree;
use crate::filter::{Carrying, Checked, Window};
use crate::scene::facts::{Fact, Facts};

pub use cost::Effort;
pub use gradient::{Factor, Gradient, Total};
pub use hoist::Tapes;
pub use kernel::{
    BoxKernel, Columns, Edges, GatherKernel, Kernel, Linear, Look, MapKernel, PairLoop,
    ResampleKernel, SumKernel, TransposeKernel,
};
pub use lower::Read;
pub use passes::{PASSES, PassRow, Passes};
pub use places::{Place, Places};
pub use precision::Precision;
pub use schedule::{Output, Program};
pub use taps::{Run, Taps};
pub use window::WindowPlan;

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
    /// The window's taps are all the same pixel.
    #[error("the taps of a window must be at least one pixel apart, but its dilation is 0")]
    Dilation,
    /// The window is larger than is accepted.
    #[error("a window that reaches {reach} pixels is too large; at most {max} are accepted", max = Window::MAX_RADIUS)]
    Window {
        /// How far it reaches.
        reach: u32,
    },
}

/// What a plan takes for granted of the planes that it was made for, also of those that no
/// tape reads in the end: they were left out because of what is known of them.
fn assumed(planes: impl Iterator<Item = PlaneId>, facts: &Facts, passes: Passes) -> Facts {
    Facts::from_planes(planes.map(|plane| match passes.facts {
        true => (plane, facts.get(plane)),
        false => (plane, Fact::Range(Interval::ENTIRE)),
    }))
}

/// What is known of a feature's plane; everything if facts are not to be used.
fn feature_range(fact: Fact, passes: Passes) -> Interval {
    match fact {
        Fact::Constant(x) if passes.facts => Interval::point(x),
        Fact::Range(range) if passes.facts => range,
        Fact::Absent | Fact::Constant(_) | Fact::Range(_) => Interval::new(-LIMIT, LIMIT),
    }
}

/// What a filter becomes for scenes of which some facts hold: the only thing that back ends
/// run.
#[derive(Clone, Debug)]
pub enum Plan {
    /// Weights over one window of the noisy colour.
    Window(Box<WindowPlan>),
    /// A program.
    Program(Box<Program>),
}

impl Plan {
    /// Plans one or several weights over one window of the noisy colour. Several share
    /// every common value, and are normalised each on its own.
    ///
    /// # Errors
    /// If a weight is no number or reads what is absent, or the window is none.
    pub fn new(
        weights: &[Tree],
        window: Window,
        facts: &Facts,
        passes: Passes,
    ) -> Result<Self, PlanError> {
        WindowPlan::new(weights, window, facts, passes).map(Self::from)
    }

    /// Plans a filter.
    ///
    /// # Errors
    /// If a feature is absent that the filter cannot do without.
    pub fn of(filter: &Checked<'_>, facts: &Facts, passes: Passes) -> Result<Self, PlanError> {
        match filter.filter().paper() {
            Some(gather) => {
                Self::new(std::slice::from_ref(&gather.weight), gather.window, facts, passes)
            }
            None => Ok(Self::Program(Box::new(Program::new(filter, facts, passes)?))),
        }
    }

    /// Plans a filter of several pictures by the weights of the first.
    ///
    /// # Errors
    /// If a feature is absent that the filter cannot do without.
    ///
    /// # Panics
    /// If the filter makes no sense.
    pub fn of_pictures(
        carrying: &Carrying,
        facts: &Facts,
        passes: Passes,
    ) -> Result<Self, PlanError> {
        let checked = carrying.filter.check().expect("it was checked when it was made");
        let program = Program::of_pictures(&checked, &carrying.results(), facts, passes)?;
        Ok(Self::Program(Box::new(program)))
    }

    /// The weights over one window, unless it is a program.
    pub fn window(&self) -> Option<&WindowPlan> {
        match self {
            Self::Window(plan) => Some(plan),
            Self::Program(_) => None,
        }
    }

    /// The rows of an image of so many that rows of the result hang on. Of a part of the image
    /// that has these rows, they get the same bits.
    pub fn rows(&self, rows: Range<usize>, height: usize) -> Range<usize> {
        match self {
            Self::Window(plan) => {
                let reach = plan.support().reach() as usize;
                rows.start.saturating_sub(reach)..(rows.end + reach).min(height)
            }
            Self::Program(program) => program.rows(rows, height),
        }
    }

    /// The features' planes that are read.
    pub fn inputs(&self) -> BTreeSet<PlaneId> {
        match self {
            Self::Window(plan) => plan.planes(),
            Self::Program(program) => program.inputs.clone(),
        }
    }
}

impl From<WindowPlan> for Plan {
    fn from(plan: WindowPlan) -> Self {
        Self::Window(Box::new(plan))
    }
}
