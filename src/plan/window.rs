//! One window, and one weight or several over it: filters of the paper's, whole batches of
//! them, and the gathers of programs.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeSet;

use super::{Passes, PlanError, Read, Tapes, Taps, assumed, feature_range};
use super::{hoist, lower, merge, support, symmetry};
use crate::expr::builder::Builder;
use crate::expr::constants::Constants;
use crate::expr::feature::PlaneId;
use crate::expr::interval::Interval;
use crate::expr::symbol::Source;
use crate::expr::tape::{Tape, Value};
use crate::expr::tree::Tree;
use crate::filter::Window;
use crate::scene::facts::{Fact, Facts};

/// Weights over a window, ready for any back end, for scenes of which its
/// [facts](WindowPlan::facts) hold.
///
/// Promises: the tapes' results are finite for all feature values within the
/// facts that the plan was made with; the pair tape reads planes at i and j,
/// `PerPixel` and `PerTap` values; the pixel tape reads planes at i; the tap
/// tape reads offsets.
#[derive(Clone, Debug)]
pub struct WindowPlan {
    expressions: Vec<Tree>,
    facts: Facts,
    window: Window,
    taps: Taps,
    tapes: Tapes,
    mirrored: Option<Tapes>,
    signed: bool,
    uniform: bool,
    channels: usize,
    reads: Vec<Read>,
}

/// What weights look at.
#[derive(Clone, Copy)]
pub(super) struct Around<'a> {
    /// What is known of a plane.
    pub(super) range: &'a dyn Fn(Source) -> Interval,
    /// How many of the image's pixels lie between neighbours.
    pub(super) step: i32,
    /// Constants that have names.
    pub(super) constants: &'a Constants,
    /// Whether their values are given when the code runs.
    pub(super) tuned: bool,
}

/// What weights are applied to.
#[derive(Clone, Copy)]
pub(super) struct Averaged {
    /// How many channels, the constant one among them.
    pub(super) channels: usize,
    /// Whether the squares of the weights follow them as further weights, applied to the
    /// last channel alone.
    pub(super) squared: bool,
}

/// Channels of what the paper's filters average: R, G, B and the constant one.
const COLORS: usize = 4;

impl WindowPlan {
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
        let around = Around { range: &range, step: 1, constants: &constants, tuned: false };
        let averaged = Averaged { channels: COLORS, squared: false };
        let plan = Self::gather(weights, window, around, averaged, passes)?;
        Ok(Self { facts: assumed(weights.iter().flat_map(Tree::planes), facts, passes), ..plan })
    }

    /// Plans weights that may read what a program has, which are applied to what a program
    /// has.
    pub(super) fn gather(
        weights: &[Tree],
        window: Window,
        around: Around<'_>,
        averaged: Averaged,
        passes: Passes,
    ) -> Result<Self, PlanError> {
        let Around { range, step, constants, tuned } = around;
        let Averaged { channels, squared } = averaged;
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
            tuned,
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
        let tapes = hoist::split(&tape, passes.hoist, false);
        let mirrored = both.map(|tape| hoist::split(&tape, passes.hoist, true));
        let sums = if squared { channels } else { channels * weights.len() };
        let mirrored = mirrored.filter(|mirrored| symmetry::pays(&tapes, mirrored, sums, &taps));
        let reads = reads.into_inner();
        let (uniform, facts) = (passes.uniform, Facts::default());
        Ok(Self {
            expressions,
            facts,
            window,
            taps,
            tapes,
            mirrored,
            signed,
            uniform,
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
    pub fn skips_uniform(&self) -> bool {
        self.uniform
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
