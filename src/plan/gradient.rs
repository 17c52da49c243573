//! Reverse mode through a program: one schedule of its kernels and of their adjoints.
//!
//! ```text
//! stages ──▶ kernels ─▶ colours ─▶ loss ─▶ what is owed to the colours ─▶ kernels ─▶ totals
//!            forward                                                      backward
//! ```
//!
//! The adjoint of a value is the derivative of the loss by it: what is *owed* to it. Stages
//! are visited from the last to the first, when all that read them have been.
//!
//! * The adjoint of a **map** is a map: the tree in [reverse](super::adjoint). What is owed to
//!   places beside the pixel is handed back by a [transpose](Linear::Shifts).
//! * The adjoint of a **gather** ĉ_i = Σ_j c_j w(i, j) / S_i is a map, which makes
//!   u_i = owed_i / S_i, and a [sum over pairs](SumKernel). A pixel is the one end of some
//!   pairs and the other end of others; both are computed at once, with the pixels exchanged:
//!
//!   | owed to | Σ over j of |
//!   |---|---|
//!   | c_i | w(j, i) u_j |
//!   | what w reads at i | o(i, j) ∂w(i, j)/∂x_i + o(j, i) ∂w(j, i)/∂x_i |
//!   | constants of w | o(i, j) ∂w(i, j)/∂θ |
//!
//!   where o(i, j) = u_i · (c_j - ĉ_i) is what is owed to w(i, j). Where the guard kept c_i,
//!   u_i is 0, and c_i is owed what ĉ_i is. A variance Σ v_j w² / S² adds to them.
//! * Means by equal weights and changes of the grid have transposes of their own.
//!
//! Constants that may be tuned are inputs of this code, so that it is compiled once for all
//! of their values. What is owed to them is summed over all pixels ([`Total`]).
//!
//! What is owed is total like everything else: sums that are not finite, or beyond ±LIMIT,
//! count as 0 where they are read, so that a single pixel cannot spoil a gradient.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::adjoint::{self, Adjoints, LayerAdjoint};
use super::hoist;
use super::kernel::{Kernel, Linear, SumKernel, TransposeKernel};
use super::lift::changes;
use super::lower::{self, Read, Surroundings};
use super::schedule::{Component, Gathered, Output, Program, Scheduler};
use super::{Passes, PlanError, merge};
use crate::expr::builder::{Builder, LIMIT};
use crate::expr::derivative::inside;
use crate::expr::interval::Interval;
use crate::expr::symbol::{LayerRef, Place, Source, StagePlane, Symbol};
use crate::expr::tape::{Input, Instr, Side, Tape, Value};
use crate::expr::tree::Tree;
use crate::filter::{Checked, Filter, Gather, StageKind};
use crate::scene::Facts;

/// A program and the adjoints of its kernels, ready for a back end.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// The kernels, forward and backward. What they compute is needed for whole images.
    pub program: Program,
    /// Where the kernels that go backward begin.
    pub backward: usize,
    /// By component of the colour: where the derivative of the loss by it is to be put, in
    /// units of the exposure; `None` where nothing hangs on it.
    pub owed: [Option<StagePlane>; 3],
    /// What is summed over all pixels, for which constants.
    pub totals: Vec<Total>,
}

/// The derivative of the loss by one constant, or by a layer's.
#[derive(Clone, Debug)]
pub enum Total {
    /// The sum of a plane.
    Sum {
        /// Which constant, in the order of [`Constants`](crate::expr::Constants).
        constant: usize,
        /// The plane.
        plane: StagePlane,
    },
    /// Of a layer W x + b, the sums of the products of what is owed to its results and of
    /// what it was applied to.
    Layer {
        /// Which constant is the first of the layer's.
        start: usize,
        /// By row of W, what is owed to the result.
        outputs: Vec<Option<Factor>>,
        /// By column of W, what the layer was applied to.
        inputs: Vec<Factor>,
    },
}

/// What a product is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Factor {
    /// A plane.
    Plane(StagePlane),
    /// The same number everywhere.
    Constant(f32),
}

impl Gradient {
    /// Schedules a filter and its adjoint for scenes of which these facts are known.
    ///
    /// # Errors
    /// If a feature is absent that the filter cannot do without.
    pub fn new(filter: &Checked<'_>, facts: &Facts, passes: Passes) -> Result<Self, PlanError> {
        let mut scheduler = Scheduler::new(filter, facts, passes, true)?;
        scheduler.forward()?;
        let last = filter.filter().stages.len() as u16 - 1;
        let output = scheduler.output(last);
        let owed = output.map(|output| match output {
            Output::Plane(_) => Some(scheduler.unknown()),
            Output::Constant(_) => None,
        });
        scheduler.kernels.push(Kernel::Given(owed.iter().copied().flatten().collect()));
        let (kept, totals) = Reverse::new(&mut scheduler).run(output, owed);
        let program = scheduler.finish(&[last], kept);
        let given = |kernel: &Kernel| matches!(kernel, Kernel::Given(_));
        // Nothing hangs on a constant: all that is left is forward.
        let backward = program.kernels.iter().position(given).unwrap_or(program.kernels.len());
        Ok(Self { program, backward, owed, totals })
    }
}

/// Where what is owed to a value has been left, plane by plane.
type Debts = BTreeMap<StagePlane, Vec<StagePlane>>;

struct Reverse<'s, 'a> {
    scheduler: &'s mut Scheduler<'a>,
    debts: Debts,
    kept: BTreeSet<StagePlane>,
    totals: Vec<Total>,
}

/// A value that a tape computes, and the plane it goes to.
#[derive(Default)]
struct Results {
    values: Vec<Value>,
    planes: Vec<(StagePlane, Component)>,
}

impl Results {
    fn add(&mut self, scheduler: &mut Scheduler<'_>, value: Value) -> StagePlane {
        let plane = scheduler.unknown();
        self.values.push(value);
        self.planes.push((plane, scheduler.known[&plane]));
        plane
    }
}

/// What is owed, from all planes that hold some of it; `None` if that is nothing.
fn owed(b: &mut Builder, at: &Surroundings<'_>, planes: &[StagePlane]) -> Option<Value> {
    let part = |&plane: &StagePlane, b: &mut Builder| {
        let x = at.read(b, Source::Stage(plane), Place::Side(Side::I));
        let sound = inside(b, x, LIMIT, x);
        b.assume(sound, Interval::new(-LIMIT, LIMIT));
        sound
    };
    let mut sum: Option<Value> = None;
    for plane in planes {
        let part = part(plane, b);
        sum = Some(match sum {
            Some(sum) => b.add(sum, part),
            None => part,
        });
    }
    sum
}

impl<'s, 'a> Reverse<'s, 'a> {
    fn new(scheduler: &'s mut Scheduler<'a>) -> Self {
        let (debts, kept, totals) = (Debts::new(), BTreeSet::new(), Vec::new());
        Self { scheduler, debts, kept, totals }
    }

    /// Adds the kernels that go backward. Returns the planes that are to be kept for the
    /// totals, and those.
    fn run(
        mut self,
        output: [Output; 3],
        owed: [Option<StagePlane>; 3],
    ) -> (BTreeSet<StagePlane>, Vec<Total>) {
        for (output, owed) in output.into_iter().zip(owed) {
            if let (Output::Plane(plane), Some(owed)) = (output, owed) {
                self.debts.entry(plane).or_default().push(owed);
            }
        }
        let filter = self.scheduler.filter.filter();
        for (k, stage) in filter.stages.iter().enumerate().rev() {
            if !self.scheduler.changing.contains(&(k as u16)) {
                continue;
            }
            self.scheduler.grid = stage.grid;
            let stage_planes = |plane: &StagePlane| usize::from(plane.stage) == k;
            let known = self.scheduler.known.iter();
            let known = known.filter(|(plane, _)| stage_planes(plane));
            let planes: Vec<(StagePlane, Component)> =
                known.map(|(&plane, &component)| (plane, component)).collect();
            for &(plane, _) in &planes {
                self.settle_other_grid(plane);
            }
            match &stage.kind {
                StageKind::Map(value) => self.map(value, &planes),
                StageKind::Gather(gather) => self.gather(gather, k),
            }
        }
        (self.kept, self.totals)
    }

    /// Hands back what is owed to a plane where it stands on the other grid.
    fn settle_other_grid(&mut self, plane: StagePlane) {
        let copies = self.scheduler.resampled.iter();
        let copy = copies.filter(|(source, _)| *source == Source::Stage(plane));
        let copy: Vec<StagePlane> = copy.map(|&(_, copy)| copy).collect();
        for copy in copy {
            let Some(debts) = self.debts.remove(&copy) else { continue };
            for debt in debts {
                let writes = self.scheduler.unknown();
                let (of, reads, grid) = (Linear::Resample, vec![debt], self.scheduler.grid);
                let kernel = TransposeKernel { of, reads, writes, grid };
                self.scheduler.kernels.push(Kernel::Transpose(kernel));
                self.debts.entry(plane).or_default().push(writes);
            }
        }
    }

    /// What is owed to planes that are not one number everywhere.
    fn debts_of(&mut self, planes: &[(StagePlane, Component)]) -> Vec<Vec<StagePlane>> {
        let debts = planes.iter().map(|(plane, component)| match component.constant {
            true => Vec::new(),
            false => self.debts.remove(plane).unwrap_or_default(),
        });
        debts.collect()
    }

    /// The adjoint of a map, with the planes of its components.
    fn map(&mut self, value: &Tree, planes: &[(StagePlane, Component)]) {
        let debts = self.debts_of(planes);
        if debts.iter().all(Vec::is_empty) {
            return;
        }
        let filter = self.scheduler.filter.filter();
        let value = self.scheduler.substituted(value);
        let reads = RefCell::default();
        let mut b = Builder::new(self.scheduler.passes.rules());
        let adjoints = self.scheduler.with_surroundings(&reads, None, |at| {
            let nodes = lower::lower(&mut b, &value, at);
            let result: Vec<Option<Value>> =
                debts.iter().map(|planes| owed(&mut b, at, planes)).collect();
            let changes = |symbol| changes(symbol, filter, &self.scheduler.changing);
            adjoint::reverse(&mut b, &value, &nodes, &result, at, &changes)
        });

        let mut results = Results::default();
        let Adjoints { reads: owed_to, params, layers } = adjoints;
        let mut handed: BTreeMap<StagePlane, Vec<(StagePlane, [i8; 2])>> = BTreeMap::new();
        for ((plane, place), value) in owed_to {
            let shift = match place {
                Place::Side(_) => [0, 0],
                Place::Shift(dx, dy) => [dx, dy],
            };
            // What is the same everywhere is nobody's debt.
            if self.scheduler.known[&plane].constant {
                continue;
            }
            let Source::Stage(read) = self.scheduler.on_grid(Source::Stage(plane)) else {
                unreachable!("stages are read as stages")
            };
            let plane = results.add(self.scheduler, value);
            handed.entry(read).or_default().push((plane, shift));
        }
        for (k, value) in params {
            let plane = results.add(self.scheduler, value);
            self.total(usize::from(k), plane);
        }
        for LayerAdjoint { layer, outputs, inputs } in layers {
            let start = filter.constants.start_of_layer(layer.layer.into());
            let mut factor = |value: Value, b: &Builder| match b.instr(value) {
                Instr::Const(bits) => Factor::Constant(f32::from_bits(bits)),
                // What stands in a plane already.
                Instr::Input(Input::Signal(k, _)) => {
                    let read: Read = reads.borrow()[k as usize];
                    match (self.scheduler.on_grid(read.source), read.shift) {
                        (Source::Stage(plane), [0, 0]) => Factor::Plane(plane),
                        _ => Factor::Plane(results.add(self.scheduler, value)),
                    }
                }
                Instr::Input(_) | Instr::Prim(..) => {
                    Factor::Plane(results.add(self.scheduler, value))
                }
            };
            let outputs: Vec<Option<Factor>> =
                outputs.iter().map(|value| value.map(|value| factor(value, &b))).collect();
            let inputs: Vec<Factor> = inputs.iter().map(|&value| factor(value, &b)).collect();
            for factor in outputs.iter().flatten().chain(&inputs) {
                if let Factor::Plane(plane) = *factor {
                    self.kept.insert(plane);
                }
            }
            self.totals.push(Total::Layer { start, outputs, inputs });
        }
        self.push_map(b.finish(&results.values), reads.into_inner(), &results);

        for (plane, parts) in handed {
            match parts.as_slice() {
                &[(part, [0, 0])] => self.debts.entry(plane).or_default().push(part),
                parts => {
                    let writes = self.scheduler.unknown();
                    let (reads, shifts) = parts.iter().copied().unzip();
                    let (of, grid) = (Linear::Shifts(shifts), self.scheduler.grid);
                    let kernel = TransposeKernel { of, reads, writes, grid };
                    self.scheduler.kernels.push(Kernel::Transpose(kernel));
                    self.debts.entry(plane).or_default().push(writes);
                }
            }
        }
    }

    fn push_map(&mut self, tape: Tape, reads: Vec<Read>, results: &Results) {
        let on_grid = |read: Read| Read { source: self.scheduler.on_grid(read.source), ..read };
        let reads = reads.into_iter().map(on_grid).collect();
        self.scheduler.push_map(tape, reads, &results.planes);
    }

    fn total(&mut self, constant: usize, plane: StagePlane) {
        self.kept.insert(plane);
        self.totals.push(Total::Sum { constant, plane });
    }

    fn gather(&mut self, gather: &Gather, stage: usize) {
        let gathered = self.scheduler.gathered[&stage].clone();
        let width = gathered.of.len();
        let mean =
            |component: usize| StagePlane { stage: stage as u16, component: component as u16 };
        let means: Vec<(StagePlane, Component)> =
            (0..width).map(|k| (mean(k), gathered.of[k].1)).collect();
        let debts = self.debts_of(&means);
        let debt_of_variance = self.debts.remove(&mean(width)).unwrap_or_default();
        if debts.iter().all(Vec::is_empty) && debt_of_variance.is_empty() {
            return;
        }
        let filter = self.scheduler.filter.filter();
        let reads = |tree: &Tree| {
            tree.symbols().iter().any(|&symbol| changes(symbol, filter, &self.scheduler.changing))
        };
        let (of_changes, weight_changes) = (reads(&gather.of), reads(&gathered.weight));
        let variance_changes = gather.variance.as_ref().is_some_and(reads);
        let owed_to_of = match gathered.inverse {
            None => self.equal_weights(gather, &debts, of_changes),
            Some(inverse) => {
                let means: Vec<StagePlane> = means.iter().map(|&(plane, _)| plane).collect();
                let shares = self.shares(
                    &debts,
                    &debt_of_variance,
                    &means,
                    mean(width),
                    inverse,
                    [weight_changes, of_changes, variance_changes],
                );
                self.pairs(
                    gather,
                    &gathered,
                    shares,
                    [weight_changes, of_changes, variance_changes],
                )
            }
        };
        let all = gathered.of.iter().map(|&(plane, _)| plane).chain(gathered.variance);
        for (plane, parts) in all.zip(owed_to_of) {
            self.debts.entry(plane).or_default().extend(parts);
        }
        for (map, planes) in &gathered.lifted {
            self.map(map, planes);
        }
        let is_signal = |tree: &Tree| matches!(tree.symbols(), [Symbol::Stage(_)]);
        if of_changes && !is_signal(&gather.of) {
            self.map(&gather.of, &gathered.of);
        }
        let variance = gather.variance.as_ref().zip(gathered.variance);
        if let Some((tree, plane)) =
            variance.filter(|(tree, _)| variance_changes && !is_signal(tree))
        {
            let known = self.scheduler.known[&plane];
            self.map(tree, &[(plane, known)]);
        }
    }

    /// What is owed to the components of a mean by equal weights.
    fn equal_weights(
        &mut self,
        gather: &Gather,
        debts: &[Vec<StagePlane>],
        of_changes: bool,
    ) -> Vec<Vec<StagePlane>> {
        let mut all = Vec::with_capacity(debts.len());
        for debts in debts {
            let mut parts = Vec::new();
            for &debt in debts.iter().filter(|_| of_changes) {
                let writes = self.scheduler.unknown();
                let (of, grid) = (Linear::Box(gather.window), self.scheduler.grid);
                let kernel = TransposeKernel { of, reads: vec![debt], writes, grid };
                self.scheduler.kernels.push(Kernel::Transpose(kernel));
                parts.push(writes);
            }
            all.push(parts);
        }
        all
    }

    /// The map of what the adjoint of a gather takes per pixel.
    fn shares(
        &mut self,
        debts: &[Vec<StagePlane>],
        debt_of_variance: &[StagePlane],
        means: &[StagePlane],
        variance: StagePlane,
        inverse: StagePlane,
        [weight_changes, of_changes, variance_changes]: [bool; 3],
    ) -> Shares {
        let reads = RefCell::default();
        let mut b = Builder::new(self.scheduler.passes.rules());
        let (mut results, mut shares) = (Results::default(), Shares::default());
        let mut parts: Vec<(Part, Value)> = Vec::new();
        self.scheduler.with_surroundings(&reads, None, |at| {
            let here = Place::Side(Side::I);
            let inverse = at.read(&mut b, Source::Stage(inverse), here);
            let zero = b.constant(0.0);
            // Where the guard acts, the inverse is 0.
            let size = b.abs(inverse);
            let kept = |b: &mut Builder, debt| b.select_lt(zero, size, zero, debt);
            let mut offset: Option<Value> = None;
            let add = |b: &mut Builder, sum: &mut Option<Value>, x: Value| {
                *sum = Some(match *sum {
                    Some(sum) => b.sum(sum, x),
                    None => x,
                });
            };
            for (k, debts) in debts.iter().enumerate() {
                let Some(debt) = owed(&mut b, at, debts) else { continue };
                let share = b.mul(debt, inverse);
                parts.push((Part::Share(k), share));
                if of_changes {
                    let kept = kept(&mut b, debt);
                    parts.push((Part::Kept(k), kept));
                }
                let mean = at.read(&mut b, Source::Stage(means[k]), here);
                let product = b.product(share, mean);
                add(&mut b, &mut offset, product);
            }
            if let Some(debt) = owed(&mut b, at, debt_of_variance) {
                let once = b.mul(debt, inverse);
                let share = b.mul(once, inverse);
                parts.push((Part::Square, share));
                if variance_changes {
                    let kept = kept(&mut b, debt);
                    parts.push((Part::Kept(debts.len()), kept));
                }
                let (two, variance) =
                    (b.constant(2.0), at.read(&mut b, Source::Stage(variance), here));
                let doubled = b.product(once, two);
                let product = b.product(doubled, variance);
                add(&mut b, &mut offset, product);
            }
            if let Some(offset) = offset.filter(|_| weight_changes) {
                parts.push((Part::Offset, offset));
            }
        });
        shares.of = vec![None; debts.len()];
        shares.kept = vec![None; debts.len() + 1];
        for (part, value) in parts {
            let plane = results.add(self.scheduler, value);
            match part {
                Part::Share(k) => shares.of[k] = Some(plane),
                Part::Kept(k) => shares.kept[k] = Some(plane),
                Part::Square => shares.square = Some(plane),
                Part::Offset => shares.offset = Some(plane),
            }
        }
        self.push_map(b.finish(&results.values), reads.into_inner(), &results);
        shares
    }

    /// The sums over pairs. Returns what is owed to the components of what is averaged, and to
    /// its variance.
    fn pairs(
        &mut self,
        gather: &Gather,
        gathered: &Gathered,
        shares: Shares,
        [weight_changes, of_changes, variance_changes]: [bool; 3],
    ) -> Vec<Vec<StagePlane>> {
        let filter = self.scheduler.filter.filter();
        let window = gather.window;
        let weight = gathered.weight.clone();
        let reads = RefCell::default();
        let mut b = Builder::new(self.scheduler.passes.rules());
        let merges = self.scheduler.passes.merge;
        // By what it is owed to: the terms of pixel i, and those of pixel j.
        let terms = self.scheduler.with_surroundings(&reads, Some(window), |at| {
            let weight = match merges {
                true => merge::merge(&weight, &lower::ranges(&weight, at)),
                false => weight.clone(),
            };
            let changes = |symbol| changes(symbol, filter, &self.scheduler.changing);
            let [own, other] = [false, true].map(|mirrored| {
                let at = Surroundings { mirrored, ..*at };
                let nodes = lower::lower(&mut b, &weight, &at);
                let w = nodes.last().expect("a tree has a root")[0];
                let [i, j] = [Side::I, Side::J].map(Place::Side);
                let adjoints = Adjoints::default();
                let mut end = End { w, shares: Vec::new(), square: None, adjoints };
                let read = |b: &mut Builder, plane, place| at.read(b, Source::Stage(plane), place);
                let mut owed_to_w: Option<Value> = None;
                for (share, &(plane, known)) in shares.of.iter().zip(&gathered.of) {
                    let share = share.map(|share| read(&mut b, share, i));
                    end.shares.push(share);
                    if let Some(share) = share.filter(|_| weight_changes && !known.constant) {
                        let c = read(&mut b, plane, j);
                        owed_to_w = Some(match owed_to_w {
                            Some(sum) => b.fma(share, c, sum),
                            None => b.mul(share, c),
                        });
                    }
                }
                end.square = shares.square.map(|square| read(&mut b, square, i));
                if let (Some(square), Some(v), true) =
                    (end.square, gathered.variance, weight_changes)
                {
                    let v = read(&mut b, v, j);
                    let (two, weighed) = (b.constant(2.0), b.mul(square, v));
                    let weighed = b.mul(weighed, w);
                    let doubled = b.mul(weighed, two);
                    owed_to_w = Some(match owed_to_w {
                        Some(sum) => b.add(sum, doubled),
                        None => doubled,
                    });
                }
                if let (Some(sum), Some(offset)) = (owed_to_w, shares.offset) {
                    let offset = read(&mut b, offset, i);
                    let result = b.sub(sum, offset);
                    end.adjoints =
                        adjoint::reverse(&mut b, &weight, &nodes, &[Some(result)], &at, &changes);
                }
                end
            });
            Terms::of(&mut b, filter, [own, other], [of_changes, variance_changes])
        });

        let mut owed_to_of: Vec<Vec<StagePlane>> = vec![Vec::new(); gathered.of.len() + 1];
        for (parts, kept) in owed_to_of.iter_mut().zip(&shares.kept) {
            parts.extend(*kept);
        }
        let values = [0, 1].map(|end| terms.0.iter().map(move |(_, term)| term[end]));
        let values: Vec<Value> = values.into_iter().flatten().collect();
        let mut writes = Vec::with_capacity(terms.0.len());
        for (to, _) in &terms.0 {
            let plane = self.scheduler.unknown();
            writes.push(plane);
            match *to {
                To::Averaged(k) => owed_to_of[k].push(plane),
                To::Constant(k) => self.total(k, plane),
                To::Plane(source) => {
                    if self.scheduler.known[&source].constant {
                        continue;
                    }
                    let Source::Stage(read) = self.scheduler.on_grid(Source::Stage(source)) else {
                        unreachable!("stages are read as stages")
                    };
                    self.debts.entry(read).or_default().push(plane);
                }
            }
        }
        if !writes.is_empty() {
            let tapes = hoist::split(&b.finish(&values), self.scheduler.passes.hoist, true);
            let reads = reads.into_inner();
            let Gathered { taps, reach, .. } = gathered;
            let pairs = self.scheduler.pairs(&tapes, true, taps, *reach, &reads);
            let grid = self.scheduler.grid;
            self.scheduler.kernels.push(Kernel::Sum(SumKernel { pairs, writes, grid }));
        }
        owed_to_of
    }
}

/// What the adjoint of a gather takes per pixel.
#[derive(Default)]
struct Shares {
    /// By component of what is averaged: what is owed to its mean, over the sum of the weights.
    of: Vec<Option<StagePlane>>,
    /// What is owed to the variance, over the square of the sum of the weights.
    square: Option<StagePlane>,
    /// What of the debts of weights does not hang on pixel j.
    offset: Option<StagePlane>,
    /// By component, the variance last: what is owed to pixel i alone, where a guard kept it.
    kept: Vec<Option<StagePlane>>,
}

/// What [`Shares`] has planes of.
enum Part {
    Share(usize),
    Kept(usize),
    Square,
    Offset,
}

/// Of pairs with one end at pixel i: w(i, j), and what is owed to whom because of it.
struct End {
    w: Value,
    shares: Vec<Option<Value>>,
    square: Option<Value>,
    adjoints: Adjoints,
}

/// Whom something is owed to.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum To {
    /// A component of what is averaged, the variance last.
    Averaged(usize),
    /// A plane that the weight reads.
    Plane(StagePlane),
    /// A constant, in the order of all.
    Constant(usize),
}

/// What a pair adds to what is owed: at pixel i, and at pixel j.
struct Terms(Vec<(To, [Value; 2])>);

impl Terms {
    /// The terms of a pair, from w(i, j) and from w(j, i).
    fn of(
        b: &mut Builder,
        filter: &Filter,
        ends: [End; 2],
        [of_changes, variance_changes]: [bool; 2],
    ) -> Self {
        let mut terms: BTreeMap<To, [Option<Value>; 2]> = BTreeMap::new();
        let mut add = |b: &mut Builder, to: To, end: usize, value: Value| {
            let sum = &mut terms.entry(to).or_default()[end];
            *sum = Some(match *sum {
                Some(sum) => b.sum(sum, value),
                None => value,
            });
        };
        for (end, End { w, shares, square, adjoints }) in ends.into_iter().enumerate() {
            // Where pixel i is the one end, pixel j is the other.
            let other = 1 - end;
            for (k, share) in shares.iter().enumerate() {
                if let Some(share) = share.filter(|_| of_changes) {
                    let term = b.mul(w, share);
                    add(b, To::Averaged(k), other, term);
                }
            }
            if let Some(square) = square.filter(|_| variance_changes) {
                let once = b.mul(w, square);
                let term = b.mul(once, w);
                add(b, To::Averaged(shares.len()), other, term);
            }
            for ((plane, place), value) in adjoints.reads {
                let at = match place {
                    Place::Side(Side::J) => other,
                    Place::Side(Side::I) | Place::Shift(..) => end,
                };
                add(b, To::Plane(plane), at, value);
            }
            for (k, value) in adjoints.params {
                add(b, To::Constant(k.into()), end, value);
            }
            for LayerAdjoint { layer, outputs, inputs } in adjoints.layers {
                let LayerRef { layer, .. } = layer;
                let start = filter.constants.start_of_layer(layer.into());
                let block = &filter.constants.layers[usize::from(layer)];
                for (row, output) in outputs.into_iter().enumerate() {
                    let Some(output) = output else { continue };
                    for (column, &x) in inputs.iter().enumerate() {
                        let term = b.mul(output, x);
                        add(b, To::Constant(start + block.place(row, column)), end, term);
                    }
                    add(b, To::Constant(start + block.place(row, inputs.len())), end, output);
                }
            }
        }
        let zero = b.constant(0.0);
        let whole = |[at_i, at_j]: [Option<Value>; 2]| [at_i.unwrap_or(zero), at_j.unwrap_or(zero)];
        Self(terms.into_iter().map(|(to, term)| (to, whole(term))).collect())
    }
}
