//! A child of two programs.

use rand::RngExt;
use rand::seq::IndexedRandom;

use super::draft::{Draft, Node, Role};
use super::genome::Genome;
use crate::expr::constants::Param;
use crate::expr::feature::{Feature, Quantity};
use crate::expr::symbol::{LayerRef, StageSignal, Symbol};
use crate::expr::tree::Tree;
use crate::filter::{Filter, Gather, Stage, StageKind};
use crate::tune::Stream;

/// How often a crossing is tried anew.
const ATTEMPTS: usize = 24;

impl Genome {
    /// A child of this program and another: this one with a formula of the other in a hole of
    /// its kind, with a part of one, or with the other's last stages behind its own first ones.
    ///
    /// Stages that come from the other read what this one calls by the same name, else
    /// something as wide. Constants come along; those of one name and value are one. Nothing
    /// if no crossing that was tried makes a program that makes sense and that `admits` takes.
    pub fn crossed(
        &self,
        with: &Self,
        features: &[(Feature, Quantity)],
        rng: &mut Stream,
        admits: impl Fn(&Self) -> bool,
    ) -> Option<Self> {
        for _ in 0..ATTEMPTS {
            let mut draft = Draft::new(self, features, rng);
            let other = with.filter();
            let crossed = match draft.rng.random_range(0..4) {
                0 => tail(&mut draft, other),
                1 | 2 => hole(&mut draft, other),
                _ => part(&mut draft, other),
            };
            let child = crossed.and_then(|()| draft.genome());
            let child = child.filter(|child| child != self && child != with && admits(child));
            if child.is_some() {
                return child;
            }
        }
        None
    }
}

/// A formula of the second in a hole of its kind and width.
fn hole(draft: &mut Draft<'_>, other: &Filter) -> Option<()> {
    let hole = *draft.holes().choose(draft.rng)?;
    let width = draft.tree(hole).width();
    let named = &draft.filter.stages[hole.stage].name;
    let candidates = formulas(other).into_iter();
    let mut candidates: Vec<(usize, &Tree)> = candidates
        .filter(|&(_, role, tree)| role == hole.role && tree.width() == width)
        .map(|(stage, _, tree)| (stage, tree))
        .collect();
    // Mostly that of the stage's own kin.
    let kin: Vec<(usize, &Tree)> =
        candidates.iter().copied().filter(|&(k, _)| other.stages[k].name == *named).collect();
    if !kin.is_empty() && draft.rng.random_bool(0.7) {
        candidates = kin;
    }
    let &(_, tree) = candidates.choose(draft.rng)?;
    let tree = brought(draft, other, tree, hole.stage)?;
    draft.fill(hole, tree);
    Some(())
}

/// A part of a formula of the second in the place of a node of its width.
fn part(draft: &mut Draft<'_>, other: &Filter) -> Option<()> {
    let hole = *draft.holes().choose(draft.rng)?;
    let nodes = draft.nodes(hole);
    let node: Node = *nodes.choose(draft.rng)?;
    let candidates: Vec<&Tree> = formulas(other)
        .into_iter()
        .filter(|&(_, role, _)| (role == Role::Weight) == (hole.role == Role::Weight))
        .map(|(.., tree)| tree)
        .collect();
    let tree = *candidates.choose(draft.rng)?;
    let places: Vec<usize> =
        (0..tree.len()).filter(|&at| tree.subtree(at).width() == node.width).collect();
    let from = tree.subtree(*places.choose(draft.rng)?);
    let from = brought(draft, other, &from, hole.stage)?;
    draft.graft(hole, node.at, from.symbols().to_vec())
}

/// The first's stages up to one, and the second's behind one.
fn tail(draft: &mut Draft<'_>, other: &Filter) -> Option<()> {
    let kept = draft.rng.random_range(1..=draft.filter.stages.len());
    let from = draft.rng.random_range(0..other.stages.len());
    draft.filter.stages.truncate(kept);
    // Where the second's stages stand in the child.
    let mut moved: Vec<Option<usize>> = vec![None; other.stages.len()];
    for (k, stage) in other.stages.iter().enumerate().skip(from) {
        let at = draft.filter.stages.len();
        let kind = match &stage.kind {
            StageKind::Map(value) => StageKind::Map(carried(draft, other, value, at, &moved)?),
            StageKind::Gather(gather) => {
                let variance = match &gather.variance {
                    Some(variance) => Some(carried(draft, other, variance, at, &moved)?),
                    None => None,
                };
                StageKind::Gather(Gather {
                    of: carried(draft, other, &gather.of, at, &moved)?,
                    weight: carried(draft, other, &gather.weight, at, &moved)?,
                    variance,
                    window: gather.window,
                })
            }
        };
        let taken = draft.filter.stages.iter().any(|known| known.name == stage.name);
        let name = if taken { draft.fresh(&stage.name) } else { stage.name.clone() };
        draft.filter.stages.push(Stage { name, kind, grid: stage.grid });
        moved[k] = Some(at);
    }
    Some(())
}

/// All formulas of a program.
fn formulas(filter: &Filter) -> Vec<(usize, Role, &Tree)> {
    let mut formulas = Vec::new();
    for (k, stage) in filter.stages.iter().enumerate() {
        match &stage.kind {
            StageKind::Map(value) => formulas.push((k, Role::Value, value)),
            StageKind::Gather(gather) => {
                formulas.push((k, Role::Of, &gather.of));
                formulas.push((k, Role::Weight, &gather.weight));
                formulas.extend(gather.variance.iter().map(|tree| (k, Role::Variance, tree)));
            }
        }
    }
    formulas
}

/// A formula of the second as a stage of the first would have it.
fn brought(draft: &mut Draft<'_>, other: &Filter, tree: &Tree, stage: usize) -> Option<Tree> {
    carried(draft, other, tree, stage, &vec![None; other.stages.len()])
}

fn carried(
    draft: &mut Draft<'_>,
    other: &Filter,
    tree: &Tree,
    stage: usize,
    moved: &[Option<usize>],
) -> Option<Tree> {
    let mut symbols = Vec::with_capacity(tree.len());
    for &symbol in tree.symbols() {
        symbols.push(match symbol {
            Symbol::Stage(signal) => match moved[usize::from(signal.stage)] {
                Some(at) => Symbol::Stage(StageSignal { stage: at as u16, ..signal }),
                None => like(draft, other, signal, stage)?,
            },
            Symbol::Param(k) => param(draft, &other.constants.params[usize::from(k)]),
            Symbol::Linear(layer) => {
                let block = &other.constants.layers[usize::from(layer.layer)];
                let known = draft.filter.constants.layers.iter().position(|own| own == block);
                let number = known.unwrap_or_else(|| {
                    let mut block = block.clone();
                    let taken = draft.filter.constants.layers.iter();
                    if taken.into_iter().any(|own| own.name == block.name) {
                        block.name = draft.fresh(&block.name);
                    }
                    draft.filter.constants.layers.push(block);
                    draft.filter.constants.layers.len() - 1
                });
                Symbol::Linear(LayerRef { layer: number as u16, ..layer })
            }
            other => other,
        });
    }
    Tree::new(symbols).ok()
}

/// What stands in a stage of the first for a stage of the second that it reads.
fn like(
    draft: &mut Draft<'_>,
    other: &Filter,
    signal: StageSignal,
    stage: usize,
) -> Option<Symbol> {
    let wanted = &other.stages[usize::from(signal.stage)].name;
    let width = if signal.variance { 1 } else { usize::from(signal.width) };
    let fits = |&(symbol, w): &(Symbol, usize)| {
        let variance = matches!(symbol, Symbol::Stage(s) if s.variance);
        w == width && (variance == signal.variance || signal.variance)
    };
    let signals: Vec<(Symbol, usize)> = draft.signals(stage).into_iter().filter(fits).collect();
    let kin = signals.iter().find(|(symbol, _)| match symbol {
        Symbol::Stage(s) => {
            draft.filter.stages[usize::from(s.stage)].name == *wanted
                && s.variance == signal.variance
        }
        _ => false,
    });
    kin.or_else(|| signals.choose(draft.rng)).map(|&(symbol, _)| symbol)
}

/// A constant of the second: one of that name and value that is there, or a copy.
fn param(draft: &mut Draft<'_>, wanted: &Param) -> Symbol {
    let params = &draft.filter.constants.params;
    let same = params.iter().position(|own| own == wanted);
    if let Some(k) = same {
        return Symbol::Param(k as u16);
    }
    if params.iter().all(|own| own.name != wanted.name) && is_free(draft, &wanted.name) {
        draft.filter.constants.params.push(wanted.clone());
        return Symbol::Param((draft.filter.constants.params.len() - 1) as u16);
    }
    let own = draft.param(&wanted.name, wanted.value, wanted.bounds);
    if let Symbol::Param(k) = own {
        draft.filter.constants.params[usize::from(k)].tuned = wanted.tuned;
    }
    own
}

/// Whether no stage and no layer has a name.
fn is_free(draft: &Draft<'_>, name: &str) -> bool {
    draft.filter.stages.iter().all(|stage| stage.name != name)
        && draft.filter.constants.layers.iter().all(|layer| layer.name != name)
}
