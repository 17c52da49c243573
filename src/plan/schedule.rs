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
//! `hoist`); and the loop over its window. What is read on another grid than it stands on
//! goes through a kernel that halves or doubles it. Each stage is lowered with what is
//! known of those before it, so that a value that is the same everywhere is a constant to
//! whoever reads it, and is not stored. Neighbouring maps become one (the pass `inline`).
//! What nobody reads is not computed.
//!
//! Kernels compute rows. Which rows of a kernel some rows of the result take is found
//! backwards, by how far its readers look up and down: [`Program::needed`].

mod gather;

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::fuse::{fuse, number};
use super::hoist;
use super::kernel::{Columns, Edges, Kernel, MapKernel, ResampleKernel};
use super::lift::changes;
use super::lower::{self, Read, Surroundings};
use super::{Passes, PlanError, assumed, feature_range};
use crate::expr::builder::{Builder, LIMIT};
use crate::expr::feature::{Feature, PlaneId};
use crate::expr::interval::Interval;
use crate::expr::symbol::{Source, StagePlane, Symbol};
use crate::expr::tape::{Instr, Tape, Value};
use crate::expr::tree::Tree;
use crate::filter::{Checked, Filter, Gather, Grid, Resolved, StageKind, Window};
use crate::scene::{Fact, Facts};

pub(super) use gather::Gathered;

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
    /// By kernel and what it [looks](Kernel::looks) at: the kernel that writes that.
    pub(super) writers: Vec<Vec<usize>>,
    /// The stages that give results: the last, or of several pictures each one's.
    pub results: Vec<u16>,
    /// What they give.
    pub outputs: Vec<[Output; 3]>,
    /// The features' planes that kernels read.
    pub inputs: BTreeSet<PlaneId>,
    /// What is taken for granted of the features' planes that the filter reads; back ends
    /// refuse scenes of which it does not hold.
    pub facts: Facts,
    /// How far any kernel looks beside a pixel.
    pub reach: usize,
    /// The filter as it was given, for whoever wants to know what it means.
    pub filter: Filter,
}

impl Program {
    /// Schedules a filter for scenes of which these facts are known.
    ///
    /// # Errors
    /// If a feature is absent that the filter cannot do without.
    pub fn new(filter: &Checked<'_>, facts: &Facts, passes: Passes) -> Result<Self, PlanError> {
        let last = filter.filter().stages.len() as u16 - 1;
        Self::of_pictures(filter, &[last], facts, passes)
    }

    /// The same of a filter several of whose stages are results: those of these numbers.
    ///
    /// # Errors
    /// If a feature is absent that the filter cannot do without.
    pub fn of_pictures(
        filter: &Checked<'_>,
        results: &[u16],
        facts: &Facts,
        passes: Passes,
    ) -> Result<Self, PlanError> {
        Scheduler::new(filter, facts, passes, false)?.program(results)
    }

    /// The rows that each kernel has to compute, on its own grid, for these rows of the
    /// result of an image of so many.
    pub fn needed(&self, rows: Range<usize>, height: usize) -> Vec<Range<usize>> {
        // No row yet.
        let nothing = Range { start: usize::MAX, end: 0 };
        let mut needed = vec![nothing; self.kernels.len()];
        let extend = |known: &mut Range<usize>, rows: Range<usize>| {
            *known = known.start.min(rows.start)..known.end.max(rows.end);
        };
        for (k, kernel) in self.kernels.iter().enumerate() {
            let is_result = |&plane: &StagePlane| {
                self.outputs.iter().any(|output| output.contains(&Output::Plane(plane)))
            };
            if kernel.writes().iter().any(is_result) {
                extend(&mut needed[k], rows.clone());
            }
        }
        for (k, kernel) in self.kernels.iter().enumerate().rev() {
            let stands = kernel.stands(needed[k].clone(), height);
            for (look, &writer) in kernel.looks().iter().zip(&self.writers[k]) {
                let last = self.kernels[writer].grid().along(height);
                let start = stands.start.saturating_sub(look.above);
                let end = (stands.end + look.below).min(last);
                extend(&mut needed[writer], start..end);
            }
        }
        needed
    }
}

impl Program {
    /// The rows of the image that rows of the result hang on, from an even one on and to an
    /// even one or the last, so that pixels of half the resolution are made of the same ones.
    pub(super) fn rows(&self, rows: Range<usize>, height: usize) -> Range<usize> {
        let mut all = rows.clone();
        for (kernel, needed) in self.kernels.iter().zip(self.needed(rows, height)) {
            if needed.is_empty() {
                continue;
            }
            // Features are looked at around a pixel, too.
            let (step, reach) = (kernel.grid().step(), kernel.reach());
            let start = (needed.start.saturating_sub(reach)) * step;
            all = all.start.min(start)..all.end.max((needed.end + reach) * step);
        }
        all.start / 2 * 2..all.end.next_multiple_of(2).min(height)
    }
}

/// What is known of a component of a stage.
#[derive(Clone, Copy)]
pub(super) struct Component {
    pub(super) range: Interval,
    /// Whether it is one number everywhere, and stored nowhere.
    pub(super) constant: bool,
}

pub(super) struct Scheduler<'a> {
    pub(super) filter: &'a Checked<'a>,
    facts: &'a Facts,
    pub(super) passes: Passes,
    pub(super) kernels: Vec<Kernel>,
    /// By stage and component, the variance last; hidden stages behind the filter's own.
    pub(super) known: BTreeMap<StagePlane, Component>,
    hidden: u16,
    /// The last plane of which nothing is known, and its grid.
    unknown: Option<(Grid, StagePlane)>,
    /// Of the stage at hand.
    pub(super) grid: Grid,
    /// By stage, hidden ones among them.
    grids: BTreeMap<u16, Grid>,
    /// What stands on another grid as well.
    pub(super) resampled: Vec<(Source, StagePlane)>,
    /// Whether constants that may be tuned are given when the code runs, and gathers note what
    /// their adjoints take.
    tuned: bool,
    /// The stages that hang on such constants, hidden ones among them.
    pub(super) changing: BTreeSet<u16>,
    /// The gathers, by stage.
    pub(super) gathered: BTreeMap<usize, Gathered>,
}

impl<'a> Scheduler<'a> {
    pub(super) fn new(
        filter: &'a Checked<'a>,
        facts: &'a Facts,
        passes: Passes,
        tuned: bool,
    ) -> Result<Self, PlanError> {
        for plane in filter.required().named().into_iter().flatten() {
            if facts.get(*plane) == Fact::Absent {
                let spelling = plane.feature.spelling(plane.quantity);
                let term = spelling.expect("formulas read only what has a spelling").to_owned();
                return Err(PlanError::Missing { term, plane: *plane });
            }
        }
        let hidden = filter.filter().stages.len() as u16;
        Ok(Self {
            filter,
            facts,
            passes,
            kernels: Vec::new(),
            known: BTreeMap::new(),
            hidden,
            unknown: None,
            grid: Grid::Full,
            grids: BTreeMap::new(),
            resampled: Vec::new(),
            tuned,
            changing: if tuned { changing(filter.filter()) } else { BTreeSet::new() },
            gathered: BTreeMap::new(),
        })
    }

    fn program(mut self, results: &[u16]) -> Result<Program, PlanError> {
        self.forward()?;
        Ok(self.finish(results, BTreeSet::new()))
    }

    /// Adds the kernels of all stages.
    pub(super) fn forward(&mut self) -> Result<(), PlanError> {
        let filter = self.filter.filter();
        for (k, stage) in filter.stages.iter().enumerate() {
            self.grid = stage.grid;
            self.grids.insert(k as u16, stage.grid);
            match &stage.kind {
                StageKind::Map(value) => {
                    let values = self.map(value, k as u16);
                    self.known.extend(values);
                }
                StageKind::Gather(gather) => self.gather(gather, k)?,
            }
        }
        Ok(())
    }

    /// Where what a stage gives stands.
    pub(super) fn output(&self, stage: u16) -> [Output; 3] {
        [0, 1, 2].map(|component| {
            let plane = StagePlane { stage, component };
            match self.known[&plane] {
                Component { constant: true, range } => Output::Constant(range.lo),
                Component { constant: false, .. } => Output::Plane(plane),
            }
        })
    }

    /// The schedule of the kernels that are needed for what these stages give, and for other
    /// planes.
    pub(super) fn finish(self, results: &[u16], others: BTreeSet<StagePlane>) -> Program {
        let outputs = results.iter().map(|&stage| self.output(stage)).collect();
        let filter = self.filter.filter();
        let planes = self.filter.needs().named().cloned().unwrap_or_default();
        let facts = assumed(planes.into_iter(), self.facts, self.passes);
        // What is absent is not assumed to be there.
        let present = facts.iter().filter(|&(plane, _)| self.facts.get(plane) != Fact::Absent);
        let facts = Facts::from_planes(present);
        let kernels = match self.passes.inline {
            true => fuse(self.kernels, self.passes.share),
            false => self.kernels,
        };
        finish(kernels, (results.to_vec(), outputs), others, filter.clone(), facts)
    }

    /// A plane on the grid of the stage at hand, where it is resampled unless it stands there.
    pub(super) fn on_grid(&mut self, source: Source) -> Source {
        let grid = match source {
            Source::Feature(_) => Grid::Full,
            Source::Stage(plane) => self.grids[&plane.stage],
        };
        if grid == self.grid {
            return source;
        }
        if let Some(&(_, plane)) = self.resampled.iter().find(|(known, _)| *known == source) {
            return Source::Stage(plane);
        }
        let plane = StagePlane { stage: self.hidden_stage(), component: 0 };
        let range = self.range(source);
        self.known.insert(plane, Component { range, constant: false });
        self.resampled.push((source, plane));
        let (reads, writes, grid) = (source, plane, self.grid);
        self.kernels.push(Kernel::Resample(ResampleKernel { reads, writes, grid }));
        Source::Stage(plane)
    }

    /// Runs `lower` with what is known of everything that formulas may read.
    pub(super) fn with_surroundings<T>(
        &self,
        reads: &RefCell<Vec<Read>>,
        window: Option<Window>,
        lower: impl FnOnce(&Surroundings<'_>) -> T,
    ) -> T {
        let range = |source| self.range(source);
        lower(&Surroundings {
            range: &range,
            window,
            mirrored: false,
            step: self.grid.step() as i32,
            precision: self.passes.precision,
            constants: &self.filter.filter().constants,
            tuned: self.tuned,
            reads,
        })
    }

    /// What is known of a plane; of a feature that is absent, of what stands in for it.
    fn range(&self, source: Source) -> Interval {
        match source {
            Source::Stage(plane) => self.known[&plane].range,
            Source::Feature(plane) => match self.filter.resolve(plane, self.facts) {
                Some(Resolved::Plane(plane)) => {
                    let range = feature_range(self.facts.get(plane), self.passes);
                    // Where a pixel of half the resolution stands beyond the last one's middle.
                    match plane.feature == Feature::Pixel && self.grid == Grid::Half {
                        true => Interval::new(range.lo, range.hi + 0.5),
                        false => range,
                    }
                }
                Some(Resolved::Constant(x)) => Interval::point(x),
                None => Interval::new(-LIMIT, LIMIT),
            },
        }
    }

    /// The formula with features that are absent replaced by those that stand in for them.
    pub(super) fn substituted(&self, tree: &Tree) -> Tree {
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
        let results = self.with_surroundings(&reads, None, |at| {
            lower::lower(&mut b, &value, at).pop().expect("a tree has a root")
        });
        let tape = b.finish(&results);
        let planes = (0..).map(|component| StagePlane { stage, component });
        let known: Vec<(StagePlane, Component)> = planes
            .zip(tape.results())
            .map(|(plane, &r)| (plane, self.component(&tape, r)))
            .collect();
        let reads = reads.into_inner().into_iter();
        let reads = reads.map(|read| Read { source: self.on_grid(read.source), ..read }).collect();
        self.push_map(tape, reads, &known);
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
    pub(super) fn push_map(
        &mut self,
        tape: Tape,
        reads: Vec<Read>,
        known: &[(StagePlane, Component)],
    ) {
        let stored = known.iter().zip(tape.results().to_vec());
        let (writes, results): (Vec<StagePlane>, Vec<Value>) = stored
            .filter(|((_, component), _)| !component.constant)
            .map(|(&(plane, _), result)| (plane, result))
            .unzip();
        if !writes.is_empty() {
            let tape = tape.finish(&results);
            self.kernels.push(Kernel::Map(MapKernel::new(tape, reads, writes, self.grid)));
        }
    }

    /// The number of a stage that the filter does not name.
    pub(super) fn hidden_stage(&mut self) -> u16 {
        self.hidden = self.hidden.checked_add(1).expect("fewer hidden stages than numbers");
        self.grids.insert(self.hidden - 1, self.grid);
        self.hidden - 1
    }

    /// A plane on the grid of the stage at hand of which nothing is known.
    pub(super) fn unknown(&mut self) -> StagePlane {
        // Gradients have thousands: they share the numbers of stages.
        let next =
            self.unknown.filter(|(grid, last)| *grid == self.grid && last.component < u16::MAX);
        let plane = match next {
            Some((_, last)) => StagePlane { component: last.component + 1, ..last },
            None => StagePlane { stage: self.hidden_stage(), component: 0 },
        };
        self.unknown = Some((self.grid, plane));
        self.known.insert(plane, Component { range: Interval::ENTIRE, constant: false });
        plane
    }
}

/// The stages that hang on constants that may be tuned.
fn changing(filter: &Filter) -> BTreeSet<u16> {
    let mut changing = BTreeSet::new();
    for (k, stage) in (0..).zip(&filter.stages) {
        let reads =
            |tree: &Tree| tree.symbols().iter().any(|&symbol| changes(symbol, filter, &changing));
        let changes = match &stage.kind {
            StageKind::Map(value) => reads(value),
            StageKind::Gather(Gather { of, weight, variance, .. }) => {
                reads(of) || reads(weight) || variance.as_ref().is_some_and(reads)
            }
        };
        if changes {
            changing.insert(k);
        }
    }
    changing
}

/// A range that no one takes for a constant: what is stored is read.
fn not_a_point(range: Interval) -> Interval {
    match range.lo == range.hi {
        true => Interval::new(range.lo, range.hi.next_up()),
        false => range,
    }
}

/// Leaves out what nobody needs, and finds who writes what is read.
fn finish(
    kernels: Vec<Kernel>,
    (results, outputs): (Vec<u16>, Vec<[Output; 3]>),
    others: BTreeSet<StagePlane>,
    filter: Filter,
    facts: Facts,
) -> Program {
    let mut buffers: BTreeMap<StagePlane, Edges> =
        others.into_iter().map(|plane| (plane, Edges::default())).collect();
    for &output in outputs.iter().flatten() {
        if let Output::Plane(plane) = output {
            buffers.entry(plane).or_default();
        }
    }
    let mut kept: Vec<Kernel> = Vec::new();
    for kernel in kernels.into_iter().rev() {
        if !kernel.writes().iter().any(|plane| buffers.contains_key(plane)) {
            continue;
        }
        let kernel = match kernel {
            Kernel::Map(map) => Kernel::Map(without_unread(map, &buffers)),
            Kernel::Gather(_)
            | Kernel::Box(_)
            | Kernel::Resample(_)
            | Kernel::Sum(_)
            | Kernel::Transpose(_)
            | Kernel::Given(_) => kernel,
        };
        // A gather's results stand together, whoever needs them.
        for plane in kernel.writes() {
            buffers.entry(plane).or_default();
        }
        for look in kernel.looks() {
            let edges = buffers.entry(look.plane).or_default();
            match look.columns {
                Columns::Own => {}
                Columns::Around => edges.repeated = true,
                Columns::Averaged => edges.zero = true,
            }
        }
        kept.push(kernel);
    }
    kept.reverse();
    let writer = |plane: StagePlane| {
        let writer = kept.iter().position(|kernel| kernel.writes().contains(&plane));
        writer.expect("what is read was written before")
    };
    let writers =
        kept.iter().map(|kernel| kernel.looks().iter().map(|look| writer(look.plane)).collect());
    let writers = writers.collect();
    let inputs = kept.iter().flat_map(Kernel::features).collect();
    let reach = kept.iter().map(Kernel::reach).max().unwrap_or(0);
    Program { kernels: kept, buffers, writers, results, outputs, inputs, facts, reach, filter }
}

/// A map without the results that nobody reads.
fn without_unread(map: MapKernel, buffers: &BTreeMap<StagePlane, Edges>) -> MapKernel {
    let stored = map.writes.iter().zip(map.tape.results());
    let (writes, results): (Vec<StagePlane>, Vec<Value>) =
        stored.filter(|(plane, _)| buffers.contains_key(plane)).unzip();
    let mut reads: Vec<Read> = Vec::new();
    let kept = MapKernel { tape: map.tape.finish(&results), ..map };
    let tape = kept.renumbered(|read| number(&mut reads, read));
    let [uniform, tape] = hoist::uniform(&tape);
    MapKernel { uniform, tape, reads, writes, grid: kept.grid }
}
