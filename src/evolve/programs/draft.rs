//! A program that is being changed: its holes, what they may read, and new formulas for them.

use rand::RngExt;
use rand::seq::IndexedRandom;

use crate::expr::constants::Param;
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::expr::op::{Form, Op};
use crate::expr::symbol::{Place, StageSignal, Symbol, Variadic};
use crate::expr::tape::Side;
use crate::expr::tree::Tree;
use crate::filter::{Filter, Stage, StageKind, StandIn};
use crate::tune::Stream;

use super::genome::{Genome, renamed};

/// Levels of a formula that is made from nothing.
const DEPTH: u32 = 3;

/// The greatest width that new formulas make or read whole.
const WIDE: usize = 3;

/// A place for a formula.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Hole {
    /// The stage, counted from 0.
    pub(super) stage: usize,
    /// Which of its formulas.
    pub(super) role: Role,
}

/// What a formula is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// What a map computes.
    Value,
    /// What a gather averages.
    Of,
    /// A gather's weight.
    Weight,
    /// The variance of what it averages.
    Variance,
}

/// A node of a formula, and what may stand in its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Node {
    /// Its position.
    pub(super) at: usize,
    /// How many components it has.
    pub(super) width: usize,
    /// Whether it may look at both pixels of a pair.
    pub(super) pair: bool,
}

/// A program under change.
pub(super) struct Draft<'a> {
    pub(super) filter: Filter,
    /// What formulas may read of the features.
    pub(super) features: &'a [(Feature, Quantity)],
    pub(super) rng: &'a mut Stream,
}

impl<'a> Draft<'a> {
    pub(super) fn new(
        genome: &Genome,
        features: &'a [(Feature, Quantity)],
        rng: &'a mut Stream,
    ) -> Self {
        Self { filter: genome.filter().clone(), features, rng }
    }

    /// The program as it is by now, if it makes sense.
    pub(super) fn genome(self) -> Option<Genome> {
        let mut filter = self.filter;
        let reads: Vec<Feature> = filter
            .stages
            .iter()
            .flat_map(Stage::trees)
            .flat_map(Tree::symbols)
            .filter_map(|symbol| Some(symbol.reads()?.0))
            .collect();
        for feature in reads {
            let listed = filter.absent.iter().any(|&(known, _)| known == feature);
            if !listed && let Some(stand_in) = stand_in(feature) {
                filter.absent.push((feature, stand_in));
            }
        }
        filter.absent.sort_by_key(|&(feature, _)| feature);
        Genome::new(filter)
    }

    /// Every hole.
    pub(super) fn holes(&self) -> Vec<Hole> {
        let stages = self.filter.stages.iter().enumerate();
        let holes = stages.flat_map(|(stage, s)| {
            let roles: &[Role] = match &s.kind {
                StageKind::Map(_) => &[Role::Value],
                StageKind::Gather(gather) if gather.variance.is_some() => {
                    &[Role::Of, Role::Weight, Role::Variance]
                }
                StageKind::Gather(_) => &[Role::Of, Role::Weight],
            };
            roles.iter().map(move |&role| Hole { stage, role })
        });
        holes.collect()
    }

    /// The formula in a hole.
    pub(super) fn tree(&self, hole: Hole) -> &Tree {
        match (&self.filter.stages[hole.stage].kind, hole.role) {
            (StageKind::Map(value), _) => value,
            (StageKind::Gather(gather), Role::Weight) => &gather.weight,
            (StageKind::Gather(gather), Role::Variance) => {
                gather.variance.as_ref().expect("holes are of formulas that are there")
            }
            (StageKind::Gather(gather), _) => &gather.of,
        }
    }

    /// Puts another formula into a hole.
    pub(super) fn fill(&mut self, hole: Hole, tree: Tree) {
        match (&mut self.filter.stages[hole.stage].kind, hole.role) {
            (StageKind::Map(value), _) => *value = tree,
            (StageKind::Gather(gather), Role::Weight) => gather.weight = tree,
            (StageKind::Gather(gather), Role::Variance) => gather.variance = Some(tree),
            (StageKind::Gather(gather), _) => gather.of = tree,
        }
    }

    /// The nodes of a hole's formula that may be changed: of a weight exp(-min(x, c)) those of
    /// x, which may be any number.
    pub(super) fn nodes(&self, hole: Hole) -> Vec<Node> {
        let tree = self.tree(hole);
        let symbols = tree.symbols();
        let widths = tree.widths();
        let mut pair = vec![hole.role == Role::Weight; tree.len()];
        for at in (0..tree.len()).rev() {
            let alone = match symbols[at] {
                Symbol::At(_) => true,
                Symbol::Op(op) => matches!(op.row().form, Form::Vectors(_)),
                _ => false,
            };
            if alone || !pair[at] {
                for operand in tree.operands(at) {
                    pair[operand] = false;
                }
            }
        }
        let open = match hole.role {
            Role::Weight => exponent(tree).map_or(0..tree.len(), |at| tree.extent(at)),
            Role::Value | Role::Of | Role::Variance => 0..tree.len(),
        };
        open.map(|at| Node { at, width: widths[at], pair: pair[at] }).collect()
    }

    /// Puts another formula into the place of a node.
    pub(super) fn graft(&mut self, hole: Hole, at: usize, by: Vec<Symbol>) -> Option<()> {
        let tree = self.tree(hole).replace(at, &Tree::new(by).ok()?).ok()?;
        self.fill(hole, tree);
        Some(())
    }

    /// A hole and a node in it that `fits`.
    pub(super) fn pick(&mut self, fits: impl Fn(&Tree, Node) -> bool) -> Option<(Hole, Node)> {
        let hole = *self.holes().choose(self.rng)?;
        let tree = self.tree(hole);
        let nodes: Vec<Node> =
            self.nodes(hole).into_iter().filter(|&node| fits(tree, node)).collect();
        Some((hole, *nodes.choose(self.rng)?))
    }

    /// What formulas of a stage may read: features and earlier stages, with their widths.
    pub(super) fn signals(&self, stage: usize) -> Vec<(Symbol, usize)> {
        let features = self.features.iter().filter_map(|&(feature, quantity)| {
            let symbol = Symbol::of(feature, quantity)?;
            Some((symbol, PlaneId::components(feature, quantity)))
        });
        let mut signals: Vec<(Symbol, usize)> = features.collect();
        for k in 0..stage {
            let width = self.width(k);
            let signal = StageSignal { stage: k as u16, width: width as u16, variance: false };
            signals.push((Symbol::Stage(signal), width));
            if let StageKind::Gather(gather) = &self.filter.stages[k].kind
                && gather.variance.is_some()
            {
                signals.push((Symbol::Stage(StageSignal { variance: true, ..signal }), 1));
            }
        }
        signals
    }

    /// How many components a stage gives.
    pub(super) fn width(&self, stage: usize) -> usize {
        match &self.filter.stages[stage].kind {
            StageKind::Map(value) => value.width(),
            StageKind::Gather(gather) => gather.of.width(),
        }
    }

    /// A name that no stage and no constant has yet: another one's with another number, or a
    /// word with one.
    pub(super) fn fresh(&self, like: &str) -> String {
        let start = like.trim_end_matches(|c: char| c.is_ascii_digit());
        let start = if start.len() == like.len() { format!("{like}_") } else { start.to_owned() };
        let stages = self.filter.stages.iter().map(|stage| stage.name.as_str());
        let params = self.filter.constants.params.iter().map(|param| param.name.as_str());
        let layers = self.filter.constants.layers.iter().map(|layer| layer.name.as_str());
        let taken: Vec<&str> = stages.chain(params).chain(layers).collect();
        let mut names = (1..).map(|k| format!("{start}{k}"));
        names.find(|name| !taken.contains(&name.as_str())).expect("there are more numbers")
    }

    /// A new constant that may be tuned, with a name like another's.
    pub(super) fn param(&mut self, like: &str, value: f32, bounds: [f32; 2]) -> Symbol {
        let name = self.fresh(like);
        let value = value.clamp(bounds[0], bounds[1]);
        self.filter.constants.params.push(Param { name, value, bounds, tuned: true });
        Symbol::Param((self.filter.constants.params.len() - 1) as u16)
    }

    /// The formula with copies of the single constants that it reads.
    pub(super) fn with_own_constants(&mut self, tree: &Tree) -> Tree {
        let mut copies: Vec<(u16, Symbol)> = Vec::new();
        for &symbol in tree.symbols() {
            if let Symbol::Param(k) = symbol
                && !copies.iter().any(|&(known, _)| known == k)
            {
                let Param { name, value, bounds, .. } =
                    self.filter.constants.params[usize::from(k)].clone();
                let copy = self.param(&name, value, bounds);
                copies.push((k, copy));
            }
        }
        renamed(tree, |symbol| match symbol {
            Symbol::Param(k) => {
                copies.iter().find(|&&(known, _)| known == k).expect("all were copied").1
            }
            other => other,
        })
    }

    /// A positive one, of any magnitude.
    fn magnitude(&mut self) -> Symbol {
        let value = self.rng.random_range(-3.0f32..2.0).exp();
        self.param("scale", value, [1e-4, 1e3])
    }

    /// One of either sign.
    pub(super) fn coefficient(&mut self) -> Symbol {
        let value = self.rng.random_range(-1.0f32..1.0);
        self.param("factor", value, [-20.0, 20.0])
    }

    /// A new formula of so many components.
    pub(super) fn grow(&mut self, stage: usize, width: usize, pair: bool) -> Option<Vec<Symbol>> {
        self.grown(stage, width, pair, DEPTH)
    }

    fn grown(&mut self, stage: usize, width: usize, pair: bool, depth: u32) -> Option<Vec<Symbol>> {
        if depth <= 1 || width > WIDE || self.rng.random_bool(0.3) {
            return self.leaf(stage, width, pair);
        }
        let kind = self.rng.random_range(0..8);
        match kind {
            0..=2 => {
                let op = *[Op::Add, Op::Sub, Op::Mul, Op::Div, Op::Min, Op::Max]
                    .choose(self.rng)
                    .expect("some");
                let first = self.grown(stage, width, pair, depth - 1)?;
                let other = if self.rng.random_bool(0.5) { width } else { 1 };
                let second = self.grown(stage, other, pair, depth - 1)?;
                Some([first, second, vec![Symbol::Op(op)]].concat())
            }
            3 => {
                let op = *[Op::Exp, Op::Sqrt, Op::Abs, Op::Tanh, Op::Neg, Op::Logistic]
                    .choose(self.rng)
                    .expect("some");
                let mut symbols = self.grown(stage, width, pair, depth - 1)?;
                symbols.push(Symbol::Op(op));
                Some(symbols)
            }
            _ if width == 1 => self.idiom(stage, pair),
            _ => self.leaf(stage, width, pair),
        }
    }

    fn leaf(&mut self, stage: usize, width: usize, pair: bool) -> Option<Vec<Symbol>> {
        if width == 1 {
            return match self.rng.random_range(0..10) {
                0..=2 => Some(vec![self.coefficient()]),
                3..=5 if pair => self.distance(stage),
                _ => self.scalar(stage, pair),
            };
        }
        let signals = self.signals(stage);
        let fitting: Vec<Symbol> =
            signals.iter().filter(|&&(_, w)| w == width).map(|&(symbol, _)| symbol).collect();
        Some(vec![*fitting.choose(self.rng)?])
    }

    /// A number of a pixel: in a pair of the first, or now and then of the second.
    pub(super) fn scalar(&mut self, stage: usize, pair: bool) -> Option<Vec<Symbol>> {
        let signals = self.signals(stage);
        let &(symbol, width) = signals.choose(self.rng)?;
        let mut symbols = match width {
            1 => vec![symbol],
            3 => {
                let which = *[Variadic::Mean, Variadic::Luminance].choose(self.rng)?;
                vec![symbol, Symbol::Many(which, 1)]
            }
            _ => vec![symbol, Symbol::Part(self.rng.random_range(0..width) as u16)],
        };
        if pair && self.rng.random_bool(0.25) {
            symbols.push(Symbol::At(Place::Side(Side::J)));
        }
        Some(symbols)
    }

    /// How unlike the two pixels of a pair are, squared, by something that both have.
    pub(super) fn distance(&mut self, stage: usize) -> Option<Vec<Symbol>> {
        let signals = self.signals(stage);
        let mut fitting: Vec<Symbol> =
            signals.iter().filter(|&&(_, w)| w <= WIDE).map(|&(symbol, _)| symbol).collect();
        fitting.push(Symbol::Vector(Feature::Pixel));
        let of = *fitting.choose(self.rng)?;
        let square = [Symbol::constant(2.0), Symbol::Op(Op::Pow)];
        let mut symbols = vec![of, of, Symbol::Op(Op::Distance2)];
        symbols.extend(square);
        Some(symbols)
    }

    /// A term of an exponent: how unlike two pixels are, times a number, and mostly less where
    /// something says that they are noisy.
    pub(super) fn term(&mut self, stage: usize) -> Option<Vec<Symbol>> {
        let mut symbols = self.distance(stage)?;
        let factor = self.magnitude();
        symbols.extend([factor, Symbol::Op(Op::Mul)]);
        if self.rng.random_bool(0.5) {
            let noise = self.scalar(stage, false)?;
            let floor = self.magnitude();
            symbols.extend(noise);
            symbols.extend([Symbol::Op(Op::Abs), floor, Symbol::Op(Op::Add), Symbol::Op(Op::Div)]);
        }
        Some(symbols)
    }

    /// What people write about a number: its logarithm, a share, a line, a slope, a median.
    fn idiom(&mut self, stage: usize, pair: bool) -> Option<Vec<Symbol>> {
        if pair {
            return self.term(stage);
        }
        let of = self.scalar(stage, false)?;
        let op = Symbol::Op;
        let zero = Symbol::constant(0.0);
        Some(match self.rng.random_range(0..6) {
            0 => {
                let floor = self.magnitude();
                [of, vec![zero, op(Op::Max), floor, op(Op::Add), op(Op::Log)]].concat()
            }
            1 => {
                let floor = self.magnitude();
                let whole = [of.clone(), vec![op(Op::Abs), floor, op(Op::Add)]].concat();
                [of, vec![op(Op::Abs)], whole, vec![op(Op::Div)]].concat()
            }
            2 => {
                let (slope, start) = (self.coefficient(), self.coefficient());
                [of, vec![slope, op(Op::Mul), start, op(Op::Add)]].concat()
            }
            3 => {
                let slope = self.coefficient();
                [of, vec![slope, op(Op::Mul), op(Op::Tanh)]].concat()
            }
            4 => {
                let places = [[1i8, 0], [-1, 0], [0, 1], [0, -1]];
                let [x, y] = *places.choose(self.rng)?;
                let there = [of.clone(), vec![Symbol::At(Place::Shift(x, y))]].concat();
                [of, there, vec![op(Op::Sub), op(Op::Abs)]].concat()
            }
            _ => {
                let places = (-1..=1).flat_map(|y| (-1..=1).map(move |x| (x, y)));
                let looks = places.flat_map(|(x, y)| {
                    let mut look = of.clone();
                    if (x, y) != (0, 0) {
                        look.push(Symbol::At(Place::Shift(x, y)));
                    }
                    look
                });
                let mut symbols: Vec<Symbol> = looks.collect();
                symbols.push(Symbol::Many(Variadic::Median, 9));
                symbols
            }
        })
    }
}

/// Where the exponent of a weight exp(-min(x, c)) or exp(-x) stands: at x.
pub(super) fn exponent(tree: &Tree) -> Option<usize> {
    let symbols = tree.symbols();
    let root = tree.root();
    if symbols[root] != Symbol::Op(Op::Exp) || symbols[root - 1] != Symbol::Op(Op::Neg) {
        return None;
    }
    let below = root - 2;
    match symbols[below] {
        Symbol::Op(Op::Min) if symbols[below - 1].number().is_some() => {
            tree.operands(below).first().copied()
        }
        _ => Some(below),
    }
}

/// What stands in for a feature that a bred program came to read: what drops its terms.
fn stand_in(feature: Feature) -> Option<StandIn> {
    match feature {
        Feature::Color => None,
        // What is made for every scene is never absent.
        _ if !feature.is_stored() => None,
        Feature::Texture | Feature::SecTexture => Some(StandIn::Constant(0.5)),
        Feature::DirIllumination => Some(StandIn::Feature(Feature::Color)),
        _ => Some(StandIn::Constant(0.0)),
    }
}
