//! Changes to the skeleton: which stages there are, with which windows and grids.

use rand::RngExt;
use rand::seq::IndexedRandom;

use super::formulas::paired;
use crate::evolve::programs::draft::{Draft, Hole, Node};
use crate::evolve::programs::genome::{renamed, with_trees};
use crate::expr::symbol::{StageSignal, Symbol};
use crate::expr::tree::Tree;
use crate::filter::{Gather, Grid, Stage, StageKind, Window};

/// Windows that bred passes have at most.
const WIDEST: u32 = 5;

/// The farthest that bred taps are apart.
const FARTHEST: u32 = 16;

/// Puts a stage in after the first `at` ones; who reads a later one still does.
fn insert(draft: &mut Draft<'_>, at: usize, stage: Stage) {
    let later = |symbol| match symbol {
        Symbol::Stage(signal) if usize::from(signal.stage) >= at => {
            Symbol::Stage(StageSignal { stage: signal.stage + 1, ..signal })
        }
        other => other,
    };
    draft.filter = with_trees(draft.filter.clone(), |tree| renamed(tree, later));
    draft.filter.stages.insert(at, stage);
}

/// Lets the stages from one on, or those of them that `which` picks, read another one in a
/// stage's place.
fn redirect(
    draft: &mut Draft<'_>,
    from: usize,
    old: u16,
    new: Symbol,
    mut which: impl FnMut() -> bool,
) {
    for stage in from..draft.filter.stages.len() {
        if !which() {
            continue;
        }
        let holes: Vec<Hole> = draft.holes().into_iter().filter(|h| h.stage == stage).collect();
        for hole in holes {
            let tree = renamed(draft.tree(hole), |symbol| match symbol {
                Symbol::Stage(signal) if signal.stage == old && !signal.variance => new,
                Symbol::Stage(signal) if signal.stage == old => match new {
                    Symbol::Stage(new) => Symbol::Stage(StageSignal { variance: true, ..new }),
                    _ => symbol,
                },
                other => other,
            });
            draft.fill(hole, tree);
        }
    }
}

/// What a gather gives is averaged once more, by a weight like its own with constants of its
/// own, its taps mostly twice as far apart.
pub(super) fn add_pass(draft: &mut Draft<'_>) -> Option<()> {
    let stages = draft.filter.stages.iter().enumerate();
    let gathers: Vec<usize> = stages
        .filter(|(_, stage)| matches!(stage.kind, StageKind::Gather(_)))
        .map(|(k, _)| k)
        .collect();
    let at = *gathers.choose(draft.rng)?;
    let width = draft.width(at) as u16;
    let StageKind::Gather(gather) = draft.filter.stages[at].kind.clone() else { return None };
    let signal = StageSignal { stage: at as u16, width, variance: false };
    let of = Tree::leaf(Symbol::Stage(signal)).ok()?;
    let variance = gather.variance.is_some().then(|| {
        Tree::leaf(Symbol::Stage(StageSignal { variance: true, ..signal })).expect("a leaf")
    });
    let mut window = gather.window;
    if draft.rng.random_bool(0.7) && 2 * window.dilation <= FARTHEST {
        window.dilation *= 2;
    }
    // What it averages is what the one before gave, also where its weight looks at that.
    let weight = draft.with_own_constants(&gather.weight);
    let read = gather.of.symbols();
    let weight = match read {
        [Symbol::Stage(_) | Symbol::Vector(_)] if draft.rng.random_bool(0.7) => {
            let old = read[0];
            renamed(&weight, |symbol| if symbol == old { Symbol::Stage(signal) } else { symbol })
        }
        _ => weight,
    };
    let name = draft.fresh(&draft.filter.stages[at].name);
    let grid = draft.filter.stages[at].grid;
    let was_last = at + 1 == draft.filter.stages.len();
    let kind = StageKind::Gather(Gather { of, weight, window, variance });
    insert(draft, at + 1, Stage { name, kind, grid });
    if !was_last {
        let new = Symbol::Stage(StageSignal { stage: at as u16 + 1, ..signal });
        redirect(draft, at + 2, at as u16, new, || true);
    }
    Some(())
}

/// A number that a formula reads becomes a stage with a new formula.
pub(super) fn add_map(draft: &mut Draft<'_>) -> Option<()> {
    let is_leaf = |tree: &Tree, node: Node| {
        let symbol = tree.symbols()[node.at];
        let alone = !tree
            .symbols()
            .get(node.at + 1)
            .is_some_and(|&after| matches!(after, Symbol::At(_) | Symbol::Part(_)));
        symbol.arity() == 0 && alone && node.width <= 3
    };
    let (hole, node) = draft.pick(is_leaf)?;
    let formula = draft.grow(hole.stage, node.width, false)?;
    let formula = Tree::new(formula).ok().filter(|formula| formula.len() > 2)?;
    let name = draft.fresh("value");
    let width = formula.width() as u16;
    let grid = if draft.rng.random_bool(0.3) { Grid::Half } else { Grid::Full };
    let at = hole.stage;
    insert(draft, at, Stage { name, kind: StageKind::Map(formula), grid });
    let signal = Symbol::Stage(StageSignal { stage: at as u16, width, variance: false });
    let hole = Hole { stage: at + 1, ..hole };
    let mut symbols = draft.tree(hole).symbols().to_vec();
    symbols[node.at] = signal;
    let tree = paired(symbols, node.at)?;
    draft.fill(hole, tree);
    Some(())
}

/// Who reads a stage reads what it is made of: a signal of as many components.
pub(super) fn remove_stage(draft: &mut Draft<'_>) -> Option<()> {
    let count = draft.filter.stages.len();
    if count < 2 {
        return None;
    }
    let at = draft.rng.random_range(0..count);
    let width = draft.width(at);
    let made_of: Vec<Symbol> = draft.filter.stages[at]
        .trees()
        .flat_map(Tree::symbols)
        .copied()
        .filter(|&symbol| symbol.width(&[]) == Some(width))
        .filter(|symbol| !matches!(symbol, Symbol::Stage(signal) if signal.variance))
        .collect();
    let new = *made_of.choose(draft.rng)?;
    if at + 1 == count {
        // The result is then what it was made of.
        let Symbol::Stage(signal) = new else { return None };
        draft.filter.stages.truncate(usize::from(signal.stage) + 1);
        return Some(());
    }
    redirect(draft, at + 1, at as u16, new, || true);
    Some(())
}

/// Some of a stage's readers get a copy of it, with constants of its own.
pub(super) fn copy_stage(draft: &mut Draft<'_>) -> Option<()> {
    let count = draft.filter.stages.len();
    let at = draft.rng.random_range(0..count);
    if at + 1 == count {
        return None;
    }
    let mut stage = draft.filter.stages[at].clone();
    match &mut stage.kind {
        StageKind::Map(value) => *value = draft.with_own_constants(value),
        StageKind::Gather(gather) => gather.weight = draft.with_own_constants(&gather.weight),
    }
    stage.name = draft.fresh(&stage.name);
    let width = draft.width(at) as u16;
    insert(draft, at + 1, stage);
    let new = Symbol::Stage(StageSignal { stage: at as u16 + 1, width, variance: false });
    let readers: Vec<bool> =
        (at + 2..draft.filter.stages.len()).map(|_| draft.rng.random_bool(0.5)).collect();
    let mut picked = readers.into_iter();
    redirect(draft, at + 2, at as u16, new, || picked.next().unwrap_or(false));
    Some(())
}

/// A window of a gather, to be changed.
fn window<'d>(draft: &'d mut Draft<'_>) -> Option<&'d mut Window> {
    let count = draft.filter.gathers().count();
    let which = draft.rng.random_range(0..count.max(1));
    draft.filter.gathers_mut().nth(which).map(|gather| &mut gather.window)
}

/// Taps twice or half as far apart.
pub(super) fn dilate(draft: &mut Draft<'_>) -> Option<()> {
    let farther = draft.rng.random_bool(0.5);
    let window = window(draft)?;
    window.dilation = match farther {
        true if window.dilation < FARTHEST => 2 * window.dilation,
        true => return None,
        false if window.dilation > 1 => window.dilation / 2,
        false => return None,
    };
    Some(())
}

/// A window wider or narrower by one.
pub(super) fn resize(draft: &mut Draft<'_>) -> Option<()> {
    let wider = draft.rng.random_bool(0.5);
    let window = window(draft)?;
    window.radius = match wider {
        true if window.radius < WIDEST => window.radius + 1,
        false if window.radius > 1 => window.radius - 1,
        _ => return None,
    };
    Some(())
}

/// A stage goes to the other grid.
pub(super) fn halve(draft: &mut Draft<'_>) -> Option<()> {
    let count = draft.filter.stages.len();
    let at = draft.rng.random_range(0..count);
    if at + 1 == count {
        return None;
    }
    let grid = &mut draft.filter.stages[at].grid;
    *grid = if *grid == Grid::Full { Grid::Half } else { Grid::Full };
    Some(())
}
