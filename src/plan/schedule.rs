//! A program's schedule: kernels over buffers, in order.
//!
//! ```text
//! stages ──lower──▶ kernels ──needed──▶ kernels that count, with the rows they compute
//!   ▲                 │
//!   └── facts forward ┘
//! ```
//!
//! A map is one kernel. A gather is up to three: a map for what it averages, unless that
//! stands in a buffer already; a map for what its weight computes per pixel (the pass
//! `rate`); and the loop over its window. Each stage is lowered with what is known of
//! those before it, so that a value that is the same everywhere is a constant to whoever
//! reads it, and is not stored. What nobody reads is not computed.
//!
//! Kernels compute rows. How many rows beyond those of the result a kernel has to compute
//! is found backwards from the result, by how far its readers look up and down.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::lower::{self, Read, Surroundings};
use super::{Passes, Plan, PlanError, Run, assumed, feature_range};
use crate::expr::builder::{Builder, LIMIT};
use crate::expr::feature::PlaneId;
use crate::expr::interval::Interval;
use crate::expr::tape::{Input, Instr, Side, Tape, Value};
use crate::expr::tree::{Source, StagePlane, Symbol, Tree};
use crate::filter::{Checked, Gather, Resolved, StageKind};
use crate::scene::{Fact, Facts};

/// A value at every pixel.
#[derive(Clone, Debug)]
pub struct MapKernel {
    /// Computes the results from [`Signal`](Input::Signal)s at pixel i.
    pub tape: Tape,
    /// The planes behind the signals, by their number.
    pub reads: Vec<Read>,
    /// Where the tape's results go.
    pub writes: Vec<StagePlane>,
    /// Rows beyond the result's that have to be computed, above and below.
    pub halo: usize,
}

/// A weighted mean over a window.
#[derive(Clone, Debug)]
pub struct GatherKernel {
    /// Computes what the pair tape reads as [`PerTap`](Input::PerTap), from the offset.
    pub tap: Tape,
    /// Computes the weight, and if there is a variance its square; if `mirrored` the same
    /// for the pixels exchanged after them. Reads features, signals and taps.
    pub pair: Tape,
    /// Whether the pair tape computes both ends of a pair.
    pub mirrored: bool,
    /// Whether a weight may be negative.
    pub signed: bool,
    /// The taps, in the order of summation; half of them if `mirrored`.
    pub runs: Vec<Run>,
    /// How far the taps reach, in pixels.
    pub reach: usize,
    /// The planes behind the signals, by their number.
    pub reads: Vec<StagePlane>,
    /// What is averaged.
    pub channels: Vec<StagePlane>,
    /// Where the means go, and what they are kept within.
    pub writes: Vec<(StagePlane, Interval)>,
    /// The plane of variances, and where the means' variance goes.
    pub variance: Option<(StagePlane, StagePlane, Interval)>,
    /// Which stage it is.
    pub stage: usize,
    /// Rows beyond the result's that have to be computed, above and below.
    pub halo: usize,
}

/// A step of a schedule.
#[derive(Clone, Debug)]
pub enum Kernel {
    /// A value at every pixel.
    Map(MapKernel),
    /// A weighted mean over a window.
    Gather(GatherKernel),
}

impl Kernel {
    /// Rows beyond the result's that have to be computed, above and below.
    pub fn halo(&self) -> usize {
        match self {
            Self::Map(map) => map.halo,
            Self::Gather(gather) => gather.halo,
        }
    }
}

/// How a stage's plane is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    /// With the image's edge repeated beside it: it is looked at.
    pub repeated: bool,
    /// With zeros beside it: it is averaged.
    pub zero: bool,
}

/// A component of the filtered colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// A plane, in units of the exposure.
    Plane(StagePlane),
    /// The same everywhere, in units of the exposure.
    Constant(f32),
}

/// A program, ready for a back end.
#[derive(Clone, Debug)]
pub struct Program {
    /// The kernels in order. Each reads what features and earlier kernels give.
    pub kernels: Vec<Kernel>,
    /// Every plane that kernels write, with how it is stored.
    pub buffers: BTreeMap<StagePlane, Edges>,
    /// The filtered colour.
    pub output: [Output; 3],
    /// The features' planes that kernels read.
    pub inputs: BTreeSet<PlaneId>,
    /// What is taken for granted of the features' planes that the filter reads; back ends
    /// refuse scenes of which it does not hold.
    pub facts: Facts,
    /// How far any kernel looks beside a pixel.
    pub reach: usize,
    /// The filter's stages by name, for reports.
    pub stages: Vec<String>,
}

/// What a filter becomes: the only thing that back ends run filters from.
#[derive(Clone, Debug)]
pub enum Schedule {
    /// A filter of the paper's: one weight over the noisy colour.
    Paper(Box<Plan>),
    /// A program.
    Program(Program),
}

impl Schedule {
    /// Schedules a filter for scenes of which these facts are known.
    ///
    /// # Errors
    /// If a feature is absent that the filter cannot do without.
    pub fn new(filter: &Checked<'_>, facts: &Facts, passes: Passes) -> Result<Self, PlanError> {
        if let Some(gather) = filter.filter().paper()
            && filter.filter().absent.is_empty()
        {
            let weights = std::slice::from_ref(&gather.weight);
            let plan = Plan::new(weights, gather.window, facts, passes)?;
            return Ok(Self::Paper(Box::new(plan)));
        }
        Scheduler::new(filter, facts, passes)?.program().map(Self::Program)
    }

    /// The features' planes that are read.
    pub fn inputs(&self) -> BTreeSet<PlaneId> {
        match self {
            Self::Paper(plan) => plan.planes(),
            Self::Program(program) => program.inputs.clone(),
        }
    }
}

/// What is known of a component of a stage.
#[derive(Clone, Copy)]
struct Component {
    range: Interval,
    /// Whether it is one number everywhere, and stored nowhere.
    constant: bool,
}

struct Scheduler<'a> {
    filter: &'a Checked<'a>,
    facts: &'a Facts,
    passes: Passes,
    kernels: Vec<Kernel>,
    /// By stage and component, the variance last; hidden stages behind the filter's own.
    known: BTreeMap<StagePlane, Component>,
    hidden: u16,
}

impl<'a> Scheduler<'a> {
    fn new(filter: &'a Checked<'a>, facts: &'a Facts, passes: Passes) -> Result<Self, PlanError> {
        for plane in filter.required().named().into_iter().flatten() {
            if facts.get(*plane) == Fact::Absent {
                let spelling = plane.feature.spelling(plane.quantity);
                let term = spelling.expect("formulas read only what has a spelling").to_owned();
                return Err(PlanError::Missing { term, plane: *plane });
            }
        }
        let hidden = filter.filter().stages.len() as u16;
        let (kernels, known) = (Vec::new(), BTreeMap::new());
        Ok(Self { filter, facts, passes, kernels, known, hidden })
    }

    fn program(mut self) -> Result<Program, PlanError> {
        let filter = self.filter.filter();
        for (k, stage) in filter.stages.iter().enumerate() {
            match &stage.kind {
                StageKind::Map(value) => {
                    let values = self.map(value, k as u16);
                    self.known.extend(values);
                }
                StageKind::Gather(gather) => self.gather(gather, k)?,
            }
        }
        let last = filter.stages.len() as u16 - 1;
        let output = [0, 1, 2].map(|component| {
            let plane = StagePlane { stage: last, component };
            match self.known[&plane] {
                Component { constant: true, range } => Output::Constant(range.lo),
                Component { constant: false, .. } => Output::Plane(plane),
            }
        });
        let stages = filter.stages.iter().map(|stage| stage.name.clone()).collect();
        let planes = self.filter.needs().named().cloned().unwrap_or_default();
        let facts = assumed(planes.into_iter(), self.facts, self.passes);
        // What is absent is not assumed to be there.
        let present = facts.iter().filter(|&(plane, _)| self.facts.get(plane) != Fact::Absent);
        let facts = Facts::from_planes(present);
        Ok(finish(self.kernels, output, stages, facts))
    }

    /// Runs `lower` with what is known of everything that formulas may read.
    fn with_surroundings<T>(
        &self,
        reads: &RefCell<Vec<Read>>,
        lower: impl FnOnce(&Surroundings<'_>) -> T,
    ) -> T {
        let range = |source| self.range(source);
        lower(&Surroundings {
            range: &range,
            window: None,
            mirrored: false,
            precision: self.passes.precision,
            constants: &self.filter.filter().constants,
            reads,
        })
    }

    /// What is known of a plane; of a feature that is absent, of what stands in for it.
    fn range(&self, source: Source) -> Interval {
        match source {
            Source::Stage(plane) => self.known[&plane].range,
            Source::Feature(plane) => match self.filter.resolve(plane, self.facts) {
                Some(Resolved::Plane(plane)) => feature_range(self.facts.get(plane), self.passes),
                Some(Resolved::Constant(x)) => Interval::point(x),
                None => Interval::new(-LIMIT, LIMIT),
            },
        }
    }

    /// The formula with features that are absent replaced by those that stand in for them.
    fn substituted(&self, tree: &Tree) -> Tree {
        let symbols: Vec<Symbol> = tree
            .symbols()
            .iter()
            .map(|&symbol| {
                let replaced = || {
                    let (feature, quantity) = symbol.reads()?;
                    let plane = PlaneId { feature, quantity, component: 0 };
                    match self.filter.resolve(plane, self.facts)? {
                        Resolved::Plane(other) if other.feature != feature => {
                            Symbol::of(other.feature, quantity)
                        }
                        Resolved::Plane(_) | Resolved::Constant(_) => None,
                    }
                };
                replaced().unwrap_or(symbol)
            })
            .collect();
        Tree::new(symbols).expect("what stands in has the same width")
    }

    /// Adds the kernel of a map. Returns what is known of its components.
    fn map(&mut self, value: &Tree, stage: u16) -> Vec<(StagePlane, Component)> {
        let value = self.substituted(value);
        let reads = RefCell::default();
        let mut b = Builder::new(self.passes.rules());
        let results = self.with_surroundings(&reads, |at| {
            lower::lower(&mut b, &value, at).pop().expect("a tree has a root")
        });
        let tape = b.finish(&results);
        let planes = (0..).map(|component| StagePlane { stage, component });
        let known: Vec<(StagePlane, Component)> = planes
            .zip(tape.results())
            .map(|(plane, &r)| (plane, self.component(&tape, r)))
            .collect();
        self.push_map(tape, reads.into_inner(), &known);
        known
    }

    fn component(&self, tape: &Tape, result: Value) -> Component {
        let constant = match tape.instr(result) {
            Instr::Const(bits) if self.passes.facts => Some(f32::from_bits(bits)),
            Instr::Const(_) | Instr::Input(_) | Instr::Prim(..) => None,
        };
        match constant {
            Some(x) => Component { range: Interval::point(x), constant: true },
            None if self.passes.facts => {
                Component { range: not_a_point(tape.range(result)), constant: false }
            }
            None => Component { range: Interval::new(-LIMIT, LIMIT), constant: false },
        }
    }

    /// Adds a map that stores those results that are not constants.
    fn push_map(&mut self, tape: Tape, reads: Vec<Read>, known: &[(StagePlane, Component)]) {
        let stored = known.iter().zip(tape.results().to_vec());
        let (writes, results): (Vec<StagePlane>, Vec<Value>) = stored
            .filter(|((_, component), _)| !component.constant)
            .map(|(&(plane, _), result)| (plane, result))
            .unzip();
        if !writes.is_empty() {
            let tape = tape.finish(&results);
            self.kernels.push(Kernel::Map(MapKernel { tape, reads, writes, halo: 0 }));
        }
    }

    /// The number of a stage that the filter does not name.
    fn hidden_stage(&mut self) -> u16 {
        self.hidden += 1;
        self.hidden - 1
    }

    /// The planes of a signal that is averaged: those of an earlier stage as they are,
    /// anything else by a map.
    fn planes(&mut self, of: &Tree) -> Vec<(StagePlane, Component)> {
        if let [Symbol::Stage(signal)] = of.symbols() {
            return signal.planes().map(|plane| (plane, self.known[&plane])).collect();
        }
        let stage = self.hidden_stage();
        let known = self.map(of, stage);
        self.known.extend(known.iter().copied());
        known
    }

    fn gather(&mut self, gather: &Gather, stage: usize) -> Result<(), PlanError> {
        let of = self.planes(&gather.of);
        let variance = gather.variance.as_ref().map(|variance| self.planes(variance)[0]);
        // A mean of equal numbers is that number.
        let averaged: Vec<usize> = (0..of.len()).filter(|&k| !of[k].1.constant).collect();
        let plane =
            |component: usize| StagePlane { stage: stage as u16, component: component as u16 };
        for (k, &(_, component)) in of.iter().enumerate() {
            self.known.insert(plane(k), component);
        }

        let weight = self.substituted(&gather.weight);
        let variance = variance.map(|(source, known)| (self.stored(source, known), known));
        let channels = averaged.len() + usize::from(variance.is_some()) + 1;
        let range = |source| self.range(source);
        let constants = &self.filter.filter().constants;
        let weights = std::slice::from_ref(&weight);
        let squared = variance.is_some();
        let plan = Plan::gather(
            weights,
            gather.window,
            &range,
            constants,
            channels,
            squared,
            self.passes,
        )?;
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
        self.push_gather(&plan, channels, writes, variance, stage);
        Ok(())
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
        let known = Component { constant: false, ..known };
        self.push_map(tape, Vec::new(), &[(copy, known)]);
        copy
    }

    /// Adds the kernels of a gather: a map for what is computed per pixel, and the loop.
    fn push_gather(
        &mut self,
        plan: &Plan,
        channels: Vec<StagePlane>,
        writes: Vec<(StagePlane, Interval)>,
        variance: Option<(StagePlane, StagePlane, Interval)>,
        stage: usize,
    ) {
        let mirrored = plan.mirrored().is_some();
        let tapes = plan.mirrored().unwrap_or(plan.tapes());
        let signal = |k: u32| match plan.reads()[k as usize].source {
            Source::Stage(plane) => plane,
            Source::Feature(_) => unreachable!("gathers read features as planes"),
        };

        let hidden = self.hidden_stage();
        let mut reads: Vec<Read> = Vec::new();
        let pixel = tapes.pixel.with_inputs(|input| {
            let source = match input {
                Input::Plane(plane, Side::I) => Source::Feature(plane),
                Input::Signal(k, Side::I) => Source::Stage(signal(k)),
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
            Input::Signal(k, side) => Input::Signal(number(&mut reads, signal(k)), side),
            Input::Plane(..) | Input::Offset(_) | Input::PerTap(_) => input,
        });
        let taps = plan.taps();
        self.kernels.push(Kernel::Gather(GatherKernel {
            tap: tapes.tap.clone(),
            pair,
            mirrored,
            signed: plan.signed(),
            runs: if mirrored { taps.half() } else { taps.runs() }.to_vec(),
            reach: plan.support().reach() as usize,
            reads,
            channels,
            writes,
            variance,
            stage,
            halo: 0,
        }));
    }
}

/// A range that no one takes for a constant: what is stored is read.
fn not_a_point(range: Interval) -> Interval {
    match range.lo == range.hi {
        true => Interval::new(range.lo, range.hi.next_up()),
        false => range,
    }
}

/// The position of something in a list, at whose end it is put if it is not there yet.
fn number<T: PartialEq>(list: &mut Vec<T>, item: T) -> u32 {
    let position = list.iter().position(|known| *known == item);
    position.unwrap_or_else(|| {
        list.push(item);
        list.len() - 1
    }) as u32
}

/// Leaves out what nobody needs, and finds the rows that kernels compute.
fn finish(kernels: Vec<Kernel>, output: [Output; 3], stages: Vec<String>, facts: Facts) -> Program {
    /// How a plane is needed: the rows beyond the result's, and its edges.
    #[derive(Clone, Copy, Default)]
    struct Need {
        halo: usize,
        edges: Edges,
    }
    let mut needs: BTreeMap<StagePlane, Need> = BTreeMap::new();
    let mut inputs = BTreeSet::new();
    let look = |needs: &mut BTreeMap<StagePlane, Need>, plane, halo: usize| {
        let need = needs.entry(plane).or_default();
        need.halo = need.halo.max(halo);
        need.edges.repeated = true;
    };
    for output in output {
        if let Output::Plane(plane) = output {
            look(&mut needs, plane, 0);
        }
    }
    let mut reach = 0;
    let mut kept: Vec<Kernel> = Vec::new();
    for kernel in kernels.into_iter().rev() {
        match kernel {
            Kernel::Map(map) => {
                let stored = map.writes.iter().zip(map.tape.results());
                let (writes, results): (Vec<StagePlane>, Vec<Value>) =
                    stored.filter(|(plane, _)| needs.contains_key(plane)).unzip();
                let Some(halo) = writes.iter().map(|plane| needs[plane].halo).max() else {
                    continue;
                };
                let tape = map.tape.finish(&results);
                let mut reads: Vec<Read> = Vec::new();
                let tape = tape.with_inputs(|input| match input {
                    Input::Signal(k, side) => {
                        Input::Signal(number(&mut reads, map.reads[k as usize]), side)
                    }
                    Input::Plane(..)
                    | Input::Offset(_)
                    | Input::PerPixel(..)
                    | Input::PerTap(_) => {
                        unreachable!("maps read signals alone")
                    }
                });
                for read in &reads {
                    let [dx, dy] = read.shift.map(|d| usize::from(d.unsigned_abs()));
                    reach = reach.max(dx).max(dy);
                    match read.source {
                        Source::Stage(plane) => look(&mut needs, plane, halo + dy),
                        Source::Feature(plane) => {
                            inputs.insert(plane);
                        }
                    }
                }
                kept.push(Kernel::Map(MapKernel { tape, reads, writes, halo }));
            }
            Kernel::Gather(gather) => {
                let writes = gather.writes.iter().map(|(plane, _)| plane);
                let variance = gather.variance.iter().map(|(_, plane, _)| plane);
                let halo =
                    writes.chain(variance).filter_map(|plane| needs.get(plane)).map(|n| n.halo);
                let Some(halo) = halo.max() else { continue };
                reach = reach.max(gather.reach);
                // Mirrored weights are computed at the rows above for what they owe.
                let (here, there) = match gather.mirrored {
                    true => (halo + gather.reach, halo + gather.reach),
                    false => (halo, halo + gather.reach),
                };
                for input in gather.pair.inputs() {
                    match input {
                        Input::Signal(k, side) => {
                            let plane = gather.reads[k as usize];
                            let rows = if side == Side::I { here } else { there };
                            look(&mut needs, plane, rows);
                        }
                        Input::Plane(plane, _) => {
                            inputs.insert(plane);
                        }
                        Input::Offset(_) | Input::PerPixel(..) | Input::PerTap(_) => {}
                    }
                }
                let variance = gather.variance.iter().map(|(source, ..)| source);
                for plane in gather.channels.iter().chain(variance) {
                    let need = needs.entry(*plane).or_default();
                    need.halo = need.halo.max(there);
                    need.edges.zero = true;
                }
                // Its results stand together, whoever needs them.
                for plane in gather.writes.iter().map(|(plane, _)| plane) {
                    needs.entry(*plane).or_default();
                }
                if let Some((_, plane, _)) = gather.variance {
                    needs.entry(plane).or_default();
                }
                kept.push(Kernel::Gather(GatherKernel { halo, ..gather }));
            }
        }
    }
    kept.reverse();
    let buffers = needs.into_iter().map(|(plane, need)| (plane, need.edges)).collect();
    Program { kernels: kept, buffers, output, inputs, facts, reach, stages }
}
