//! Gathers as kernels: what is averaged, what weighs it, and means by the same weight together.

use std::collections::{BTreeMap, BTreeSet};

use super::{Component, Scheduler, not_a_point};
use crate::expr::builder::{Builder, DIVISOR_MIN, LIMIT};
use crate::expr::feature::PlaneId;
use crate::expr::interval::Interval;
use crate::expr::symbol::{Source, StagePlane, Symbol};
use crate::expr::tape::{Input, Instr, Side};
use crate::expr::tree::Tree;
use crate::filter::{Gather, Stage, StageKind};
use crate::plan::fuse::number;
use crate::plan::hoist::Tapes;
use crate::plan::kernel::{BoxKernel, GatherKernel, Kernel, PairLoop};
use crate::plan::lift::{changes, lift};
use crate::plan::lower::Read;
use crate::plan::taps::Taps;
use crate::plan::window::{Around, Averaged};
use crate::plan::{PlanError, WindowPlan};

/// What is left of a gather for its adjoint.
#[derive(Clone)]
pub(in crate::plan) struct Gathered {
    /// Its weight, in which features that are absent are replaced.
    pub(in crate::plan) weight: Tree,
    /// What the weight computes of one pixel alone: formulas, and where their values stand.
    pub(in crate::plan) lifted: Vec<(Tree, Vec<(StagePlane, Component)>)>,
    /// The planes that are averaged, by component.
    pub(in crate::plan) of: Vec<(StagePlane, Component)>,
    /// The plane of variances.
    pub(in crate::plan) variance: Option<StagePlane>,
    /// One over the sum of the weights; `None` of a mean by equal weights that is summed down
    /// columns and along rows.
    pub(in crate::plan) inverse: Option<StagePlane>,
    /// The taps that count, and how far they reach.
    pub(in crate::plan) taps: Taps,
    pub(in crate::plan) reach: usize,
}

/// Windows from this radius on are summed down columns and then along rows: the kernel of a
/// smaller one keeps its sums in registers, and is faster.
const SEPARATED: u32 = 3;

impl Scheduler<'_> {
    /// The planes of a signal that is averaged: those of an earlier stage as they are,
    /// anything else by a map.
    fn planes(&mut self, of: &Tree) -> Vec<(StagePlane, Component)> {
        if let [Symbol::Stage(signal)] = of.symbols() {
            let planes = signal.planes().map(|plane| {
                let known = self.known[&plane];
                match known.constant {
                    true => (plane, known),
                    false => (stage_plane(self.on_grid(Source::Stage(plane))), known),
                }
            });
            return planes.collect();
        }
        let stage = self.hidden_stage();
        let known = self.map(of, stage);
        self.known.extend(known.iter().copied());
        known
    }

    pub(super) fn gather(&mut self, gather: &Gather, stage: usize) -> Result<(), PlanError> {
        let of = self.planes(&gather.of);
        let variance = gather.variance.as_ref().map(|variance| self.planes(variance)[0]);
        // A mean of equal numbers is that number.
        let averaged: Vec<usize> = (0..of.len()).filter(|&k| !of[k].1.constant).collect();
        let plane =
            |component: usize| StagePlane { stage: stage as u16, component: component as u16 };
        for (k, &(_, component)) in of.iter().enumerate() {
            self.known.insert(plane(k), component);
        }

        let mut weight = self.substituted(&gather.weight);
        let mut lifted = Vec::new();
        if self.tuned {
            let (filter, known) = (self.filter.filter(), self.changing.clone());
            let changes = |symbol| changes(symbol, filter, &known);
            weight = lift(&weight, &changes, |map| {
                let stage = self.hidden_stage();
                let known = self.map(&map, stage);
                self.known.extend(known.iter().copied());
                self.changing.insert(stage);
                lifted.push((map, known));
                stage
            });
        }
        if variance.is_none() && self.joins(gather, &weight, stage, &of, &averaged) {
            return Ok(());
        }
        let variance = variance.map(|(source, known)| (self.stored(source, known), known));
        let channels = averaged.len() + usize::from(variance.is_some()) + 1;
        let range = |source| self.range(source);
        let constants = &self.filter.filter().constants;
        let (step, tuned) = (self.grid.step() as i32, self.tuned);
        let around = Around { range: &range, step, constants, tuned };
        let averaged_by = Averaged { channels, squared: variance.is_some() };
        let weights = std::slice::from_ref(&weight);
        let plan = WindowPlan::gather(weights, gather.window, around, averaged_by, self.passes)?;
        let whole = Interval::new(-LIMIT, LIMIT);
        let hull = |range: Interval| match plan.signed() || !self.passes.facts {
            true => whole,
            false => range,
        };
        let mut writes = Vec::with_capacity(averaged.len());
        for &k in &averaged {
            let range = hull(of[k].1.range);
            self.known.insert(plane(k), Component { range, constant: false });
            writes.push((plane(k), range));
        }
        let variance = variance.map(|(source, known)| {
            // Squares of weights are not negative, and sum to no more than the square of
            // their sum.
            let range = hull(known.range.hull(Interval::point(0.0)));
            self.known.insert(plane(of.len()), Component { range, constant: false });
            (source, plane(of.len()), range)
        });
        let channels = averaged.iter().map(|&k| of[k].0).collect();
        let mut gathered = Gathered {
            weight,
            lifted,
            of,
            variance: variance.map(|(source, ..)| source),
            inverse: None,
            taps: plan.taps().clone(),
            reach: plan.support().reach() as usize,
        };
        let large = gather.window.radius >= SEPARATED;
        if self.passes.separate && large && variance.is_none() && has_equal_weights(&plan) {
            let (window, grid) = (gather.window, self.grid);
            self.kernels.push(Kernel::Box(BoxKernel { channels, writes, window, grid }));
            self.gathered.insert(stage, gathered);
            return Ok(());
        }
        if self.tuned {
            gathered.inverse = Some(self.unknown());
        }
        let inverse = gathered.inverse;
        let pairs = self.pairs(
            plan.mirrored().unwrap_or(plan.tapes()),
            plan.mirrored().is_some(),
            plan.taps(),
            gathered.reach,
            plan.reads(),
        );
        let (signed, grid) = (plan.signed(), self.grid);
        self.kernels.push(Kernel::Gather(GatherKernel {
            pairs,
            signed,
            channels,
            writes,
            variance,
            inverse,
            stages: vec![stage],
            grid,
        }));
        self.gathered.insert(stage, gathered);
        Ok(())
    }

    /// Has a gather's planes averaged by the kernel of an earlier one with the same weight, if
    /// there is one and what is averaged does not hang on it. What that takes moves before the
    /// kernel.
    fn joins(
        &mut self,
        gather: &Gather,
        weight: &Tree,
        stage: usize,
        of: &[(StagePlane, Component)],
        averaged: &[usize],
    ) -> bool {
        let filter = self.filter.filter();
        let same = |(&earlier, gathered): (&usize, &Gathered)| {
            let Stage { kind: StageKind::Gather(other), grid, .. } = &filter.stages[earlier] else {
                return false;
            };
            *grid == self.grid && other.window == gather.window && gathered.weight == *weight
        };
        if !self.passes.dedupe || self.tuned {
            return false;
        }
        let Some((&earlier, _)) = self.gathered.iter().find(|&entry| same(entry)) else {
            return false;
        };
        let is_it = |kernel: &Kernel| matches!(kernel, Kernel::Gather(other) if other.stages.contains(&earlier));
        // Means over windows by equal weights have kernels of their own.
        let Some(at) = self.kernels.iter().position(is_it) else { return false };
        // The kernels behind it that what is averaged takes.
        let mut wanted: BTreeSet<StagePlane> = averaged.iter().map(|&k| of[k].0).collect();
        let mut moved: Vec<usize> = Vec::new();
        for k in (at..self.kernels.len()).rev() {
            if self.kernels[k].writes().iter().any(|plane| wanted.contains(plane)) {
                if k == at {
                    return false;
                }
                wanted.extend(self.kernels[k].looks().into_iter().map(|look| look.plane));
                moved.push(k);
            }
        }
        for (place, &k) in (at..).zip(moved.iter().rev()) {
            let kernel = self.kernels.remove(k);
            self.kernels.insert(place, kernel);
        }
        let Kernel::Gather(kernel) = &mut self.kernels[at + moved.len()] else {
            unreachable!("it was found there")
        };
        kernel.stages.push(stage);
        let whole = Interval::new(-LIMIT, LIMIT);
        for &k in averaged {
            let (source, component) = of[k];
            let range = match kernel.signed || !self.passes.facts {
                true => whole,
                false => component.range,
            };
            let plane = StagePlane { stage: stage as u16, component: k as u16 };
            self.known.insert(plane, Component { range, constant: false });
            kernel.channels.push(source);
            kernel.writes.push((plane, range));
        }
        true
    }

    /// A plane that holds what is known, also if that is a constant.
    fn stored(&mut self, plane: StagePlane, known: Component) -> StagePlane {
        if !known.constant {
            return plane;
        }
        let stage = self.hidden_stage();
        let copy = StagePlane { stage, component: 0 };
        let mut b = Builder::new(self.passes.rules());
        let x = b.constant(known.range.lo);
        let tape = b.finish(&[x]);
        let known = Component { constant: false, range: not_a_point(known.range) };
        self.known.insert(copy, known);
        self.push_map(tape, Vec::new(), &[(copy, known)]);
        copy
    }

    /// A loop over pairs, after the map of what it takes per pixel.
    pub(in crate::plan) fn pairs(
        &mut self,
        tapes: &Tapes,
        mirrored: bool,
        taps: &Taps,
        reach: usize,
        reads: &[Read],
    ) -> PairLoop {
        let signals: Vec<Source> = reads.iter().map(|read| self.on_grid(read.source)).collect();
        // Features of another grid are planes of a kernel that resamples them.
        let named = tapes.pixel.inputs().chain(tapes.pair.inputs());
        let named: BTreeSet<PlaneId> = named
            .filter_map(|input| match input {
                Input::Plane(plane, _) => Some(plane),
                Input::Offset(_)
                | Input::PerPixel(..)
                | Input::PerTap(_)
                | Input::Signal(..)
                | Input::Constant(_) => None,
            })
            .collect();
        let features: BTreeMap<PlaneId, Source> =
            named.into_iter().map(|plane| (plane, self.on_grid(Source::Feature(plane)))).collect();

        let hidden = self.hidden_stage();
        let mut reads: Vec<Read> = Vec::new();
        let pixel = tapes.pixel.with_inputs(|input| {
            let source = match input {
                Input::Plane(plane, Side::I) => features[&plane],
                Input::Signal(k, Side::I) => signals[k as usize],
                Input::Constant(_) => return input,
                Input::Plane(_, Side::J)
                | Input::Signal(_, Side::J)
                | Input::Offset(_)
                | Input::PerPixel(..)
                | Input::PerTap(_) => unreachable!("the pixel tape reads planes at i only"),
            };
            let read = Read { source, shift: [0, 0] };
            Input::Signal(number(&mut reads, read), Side::I)
        });
        let per_pixel: Vec<(StagePlane, Component)> = (0..)
            .map(|component| StagePlane { stage: hidden, component })
            .zip(pixel.results())
            .map(|(plane, &r)| (plane, Component { range: pixel.range(r), constant: false }))
            .collect();
        self.push_map(pixel, reads, &per_pixel);

        let mut reads: Vec<StagePlane> = Vec::new();
        let pair = tapes.pair.with_inputs(|input| match input {
            Input::PerPixel(k, side) => {
                Input::Signal(number(&mut reads, per_pixel[k as usize].0), side)
            }
            Input::Signal(k, side) => {
                let plane = stage_plane(signals[k as usize]);
                Input::Signal(number(&mut reads, plane), side)
            }
            Input::Plane(plane, side) => match features[&plane] {
                Source::Feature(_) => input,
                Source::Stage(plane) => Input::Signal(number(&mut reads, plane), side),
            },
            Input::Offset(_) | Input::PerTap(_) | Input::Constant(_) => input,
        });
        let runs = if mirrored { taps.half() } else { taps.runs() }.to_vec();
        PairLoop { tap: tapes.tap.clone(), pair, mirrored, runs, reach, reads }
    }
}

/// Whether a plan's weight is one number, which is large enough to be trusted.
fn has_equal_weights(plan: &WindowPlan) -> bool {
    let (pair, total) = (plan.pair(), plan.support() == plan.window());
    let weight = match pair.instr(pair.results()[0]) {
        Instr::Const(bits) => f32::from_bits(bits),
        Instr::Input(_) | Instr::Prim(..) => 0.0,
    };
    total && weight > DIVISOR_MIN
}

fn stage_plane(source: Source) -> StagePlane {
    match source {
        Source::Stage(plane) => plane,
        Source::Feature(_) => unreachable!("gathers read features as planes"),
    }
}
