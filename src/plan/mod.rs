//! Floor 2: from expressions and facts to a [`Plan`], the only thing that a
//! back end accepts.
//!
//! ```text
//!   trees ──merge──▶ trees ──lower──▶ one tape ──rate──▶ tap tape    (per offset)
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

mod fuse;
mod kernel;
mod lower;
mod merge;
mod passes;
mod precision;
mod rate;
mod schedule;
mod support;
mod symmetry;
mod taps;

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeSet;

use crate::expr::builder::{Builder, LIMIT};
use crate::expr::constants::Constants;
use crate::expr::feature::PlaneId;
use crate::expr::interval::Interval;
use crate::expr::symbol::Source;
use crate::expr::tape::{Tape, Value};
use crate::expr::tree::Tree;
use crate::filter::Window;
use crate::scene::facts::{Fact, Facts};

pub use kernel::{
    BoxKernel, Columns, Edges, GatherKernel, Kernel, Look, MapKernel, ResampleKernel,
};
pub use lower::Read;
pub use passes::{PASSES, PassRow, Passes};
pub use precision::Precision;
pub use rate::Tapes;
pub use schedule::{Output, Program, Schedule};
pub use taps::{Run, Taps};

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

/// Weights over a window, ready for any back end, for scenes of which its
/// [facts](Plan::facts) hold.
///
/// Promises: the tapes' results are finite for all feature values within the
/// facts that the plan was made with; the pair tape reads planes at i and j,
/// `PerPixel` and `PerTap` values; the pixel tape reads planes at i; the tap
/// tape reads offsets.
#[derive(Clone, Debug)]
pub struct Plan {
    expressions: Vec<Tree>,
    facts: Facts,
    window: Window,
    taps: Taps,
    tapes: Tapes,
    mirrored: Option<Tapes>,
    signed: bool,
    converged: bool,
    channels: usize,
    reads: Vec<Read>,
}

/// Channels of what the paper's filters average: R, G, B and the constant one.
const COLORS: usize = 4;

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

impl Plan {
    /// Plans one or several weights over one window. Several weights share
    /// every common value, and are normalised each on its own.
    pub fn new(
        weights: &[Tree],
        window: Window,
        facts: &Facts,
        passes: Passes,
    ) -> Result<Self, PlanError> {
        for weight in weights {
            check(weight, facts)?;
        }
        let range = |source| match source {
            Source::Feature(plane) => feature_range(facts.get(plane), passes),
            Source::Stage(_) => unreachable!("only programs have stages"),
        };
        let constants = Constants::default();
        let plan = Self::gather(weights, window, &range, 1, &constants, COLORS, false, passes)?;
        Ok(Self { facts: assumed(weights.iter().flat_map(Tree::planes), facts, passes), ..plan })
    }

    /// Plans weights that may read what a program has: `range` is what is known of a
    /// plane, `step` how many of the image's pixels lie between neighbours. They are applied
    /// to so many `channels`, the constant one among them. If `squared`, the squares of the
    /// weights follow them as further weights, and are applied to the last channel alone.
    #[expect(clippy::too_many_arguments, reason = "one caller each for both kinds of filter")]
    fn gather(
        weights: &[Tree],
        window: Window,
        range: &dyn Fn(Source) -> Interval,
        step: i32,
        constants: &Constants,
        channels: usize,
        squared: bool,
        passes: Passes,
    ) -> Result<Self, PlanError> {
        if window.dilation == 0 {
            return Err(PlanError::Dilation);
        }
        if window.reach() > Window::MAX_RADIUS {
            return Err(PlanError::Window { reach: window.reach() });
        }
        let precision = passes.precision;
        let expressions = weights.to_vec();
        let reads = RefCell::default();
        let at = lower::Surroundings {
            range,
            window: Some(window),
            mirrored: false,
            step,
            precision,
            constants,
            reads: &reads,
        };
        let weights: Vec<Cow<'_, Tree>> = weights
            .iter()
            .map(|weight| match passes.merge {
                true => Cow::Owned(merge::merge(weight, &lower::ranges(weight, &at))),
                false => Cow::Borrowed(weight),
            })
            .collect();
        let extents = match passes.support {
            true => support::extents(&weights, window, &at),
            false => support::whole(window),
        };
        let taps = Taps::new(window, &extents);

        let mut b = Builder::new(passes.rules());
        let mut lower_all = |at: &lower::Surroundings<'_>| -> Vec<Value> {
            let mut results: Vec<Value> = Vec::with_capacity(weights.len() * 2);
            for weight in &weights {
                let mut nodes = lower::lower(&mut b, weight, at);
                let root = nodes.pop().expect("a tree has a root");
                results.push(*root.first().expect("the root is a number, as checked before"));
            }
            if squared {
                let squares: Vec<Value> = results.iter().map(|&w| b.product(w, w)).collect();
                results.extend(squares.into_iter().map(|square| b.limited(square)));
            }
            results
        };
        let results = lower_all(&at);
        let both = passes.symmetry.then(|| {
            let back = lower_all(&lower::Surroundings { mirrored: true, ..at });
            [results.clone(), back].concat()
        });
        let both = both.map(|results| b.clone().finish(&results));
        let tape = b.finish(&results);
        let signed = tape.results().iter().any(|&r| tape.range(r).lo < 0.0);
        let tapes = rate::split(&tape, passes.rate, false);
        let mirrored = both.map(|tape| rate::split(&tape, passes.rate, true));
        let sums = if squared { channels } else { channels * weights.len() };
        let mirrored = mirrored.filter(|mirrored| symmetry::pays(&tapes, mirrored, sums, &taps));
        let reads = reads.into_inner();
        let (converged, facts) = (passes.converged, Facts::default());
        Ok(Self {
            expressions,
            facts,
            window,
            taps,
            tapes,
            mirrored,
            signed,
            converged,
            channels,
            reads,
        })
    }

    /// The weights as they were given, for whoever wants to know what they mean.
    pub fn expressions(&self) -> &[Tree] {
        &self.expressions
    }

    /// What the plan takes for granted of the planes that its weights read. Back ends
    /// refuse scenes of which it does not hold: their results would be wrong.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Where j ranges.
    pub fn window(&self) -> Window {
        self.window
    }

    /// The smallest window around the taps that count.
    pub fn support(&self) -> Window {
        Window { radius: self.taps.radius(self.window.dilation), ..self.window }
    }

    /// The taps that count, in the order of summation.
    pub fn taps(&self) -> &Taps {
        &self.taps
    }

    /// The tapes of all weights, w(i, j) each.
    pub fn tapes(&self) -> &Tapes {
        &self.tapes
    }

    /// Computes the `PerTap` inputs of the pair tape from the offset.
    pub fn tap(&self) -> &Tape {
        &self.tapes.tap
    }

    /// Computes the `PerPixel` inputs of the pair tape from planes at i.
    pub fn pixel(&self) -> &Tape {
        &self.tapes.pixel
    }

    /// Computes the weights.
    pub fn pair(&self) -> &Tape {
        &self.tapes.pair
    }

    /// The tapes whose pair tape computes w(i, j) for every weight and after them
    /// w(j, i) for every weight, if that costs clearly less than computing them
    /// apart. What they give for [`Taps::half`] has the bits of what the plain
    /// tapes give for all taps.
    pub fn mirrored(&self) -> Option<&Tapes> {
        self.mirrored.as_ref()
    }

    /// How many weights there are.
    pub fn weights(&self) -> usize {
        self.tapes.pair.results().len()
    }

    /// How many channels the weights are multiplied with, the constant one among them.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The planes that the tapes read as [`Signal`](crate::expr::tape::Input::Signal)s.
    pub fn reads(&self) -> &[Read] {
        &self.reads
    }

    /// Whether a weight may be negative, so that sums may cancel.
    pub fn signed(&self) -> bool {
        self.signed
    }

    /// Whether pixels may be left as they are whose window holds one colour.
    pub fn skips_converged(&self) -> bool {
        self.converged
    }

    /// The planes that are read at every pixel. Scenes must also have those that
    /// [`facts`](Self::facts) made superfluous, so that it can be checked whether they are.
    pub fn planes(&self) -> BTreeSet<PlaneId> {
        self.tapes.planes()
    }
}

fn check(weight: &Tree, facts: &Facts) -> Result<(), PlanError> {
    if weight.width() != 1 || weight.sort() != crate::expr::Sort::Scalar {
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
