//! What changes a program at random.
//!
//! | changes | |
//! |---|---|
//! | formulas, as the paper's do | replace, grow, shrink, swap, wrap, jitter |
//! | the exponents of weights | add a term, drop one, copy one from another pass |
//! | skeletons | a further pass, a new map, a stage less, a copy of one for some of its readers, dilation, radius, half resolution |
//! | what is read | a feature less; a constant of its own for one of its places |
//! | layers | a formula in the place of one |

use rand::RngExt;
use rand::seq::IndexedRandom;

use super::draft::{Draft, Hole, Node, Role, exponent};
use super::genome::{Genome, renamed, with_trees};
use crate::expr::constants::{Layer, Param};
use crate::expr::feature::{Feature, Quantity};
use crate::expr::op::{Form, Op};
use crate::expr::symbol::{LayerRef, StageSignal, Symbol, Variadic};
use crate::expr::tree::Tree;
use crate::filter::{Gather, Grid, Stage, StageKind, Window};
use crate::tune::Stream;

/// How often a change is tried anew that does not apply, makes no sense or changes nothing.
const ATTEMPTS: usize = 24;

/// Windows that bred passes have at most.
const WIDEST: u32 = 5;

/// The farthest that bred taps are apart.
const FARTHEST: u32 = 16;

/// Inputs of a row of a layer that a formula in its place keeps.
const KEPT: usize = 2;

/// The standard deviation of the logarithm of what a constant is multiplied by.
const JITTER: f32 = 0.5;

/// A kind of change; nothing if it does not apply where it was tried.
pub(super) type Change = fn(&mut Draft<'_>) -> Option<()>;

/// Every kind, with how often it is tried.
pub(super) const CHANGES: &[(f64, Change)] = &[
    (2.0, replace),
    (2.0, grow),
    (2.0, shrink),
    (0.5, swap),
    (1.5, wrap),
    (0.5, jitter),
    (2.0, add_term),
    (1.5, drop_term),
    (1.0, copy_term),
    (1.5, add_pass),
    (1.5, add_map),
    (1.5, remove_stage),
    (0.5, copy_stage),
    (1.0, dilate),
    (1.0, resize),
    (0.7, halve),
    (0.7, drop_feature),
    (0.7, untie),
    (1.0, unlayer),
];

impl Genome {
    /// A mutant: mostly one change, now and then more, with formulas that read `features`.
    /// Nothing if no change that was tried makes a program that makes sense and that `admits`
    /// takes.
    pub fn mutant(
        &self,
        features: &[(Feature, Quantity)],
        rng: &mut Stream,
        admits: impl Fn(&Self) -> bool,
    ) -> Option<Self> {
        for _ in 0..ATTEMPTS {
            let mut draft = Draft::new(self, features, rng);
            let mut changed = false;
            loop {
                let &(_, change) = CHANGES
                    .choose_weighted(draft.rng, |&(share, _)| share)
                    .expect("shares of many");
                let before = draft.filter.clone();
                match change(&mut draft) {
                    Some(()) => changed = true,
                    None => draft.filter = before,
                }
                if draft.rng.random_bool(0.7) {
                    break;
                }
            }
            let child = draft.genome().filter(|child| changed && child != self && admits(child));
            if child.is_some() {
                return child;
            }
        }
        None
    }
}

/// A hole and a node in it that `fits`.
fn pick(draft: &mut Draft<'_>, fits: impl Fn(&Tree, Node) -> bool) -> Option<(Hole, Node)> {
    let hole = *draft.holes().choose(draft.rng)?;
    let tree = draft.tree(hole);
    let nodes: Vec<Node> = draft.nodes(hole).into_iter().filter(|&node| fits(tree, node)).collect();
    Some((hole, *nodes.choose(draft.rng)?))
}

/// A symbol becomes another one that takes and gives as many components.
fn replace(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, node) = pick(draft, |_, _| true)?;
    let symbol = draft.tree(hole).symbols()[node.at];
    let others: Vec<Symbol> = match symbol {
        Symbol::Op(op) => {
            let form = std::mem::discriminant(&op.row().form);
            let ops = Op::ALL.iter().copied().filter(|&other| other != op);
            ops.filter(|other| std::mem::discriminant(&other.row().form) == form)
                .map(Symbol::Op)
                .collect()
        }
        Symbol::Vector(_) | Symbol::Variance(_) | Symbol::Gradient(_) | Symbol::Stage(_) => {
            let signals = draft.signals(hole.stage).into_iter();
            signals.filter(|&(s, w)| w == node.width && s != symbol).map(|(s, _)| s).collect()
        }
        Symbol::Many(Variadic::Mean, 1) => vec![Symbol::Many(Variadic::Luminance, 1)],
        Symbol::Many(Variadic::Luminance, 1) => vec![Symbol::Many(Variadic::Mean, 1)],
        _ => return None,
    };
    let other = *others.choose(draft.rng)?;
    let mut symbols = draft.tree(hole).symbols().to_vec();
    symbols[node.at] = other;
    if let (Symbol::Op(op), Some(&first)) = (symbol, symbols.get(node.at.wrapping_sub(2)))
        && matches!(op.row().form, Form::Vectors(_))
        && symbols[node.at - 1] != first
    {
        // Two unlike signals have no distance.
        return None;
    }
    let tree = paired(symbols, node.at)?;
    draft.fill(hole, tree);
    Some(())
}

/// A tree whose function of two vectors above a changed leaf has the same one on both sides.
fn paired(mut symbols: Vec<Symbol>, at: usize) -> Option<Tree> {
    let leaf = symbols[at];
    let is_pair = |symbols: &[Symbol], op: usize| matches!(symbols.get(op), Some(Symbol::Op(op)) if matches!(op.row().form, Form::Vectors(_)));
    if leaf.arity() == 0 {
        if is_pair(&symbols, at + 1) && at > 0 && symbols[at - 1].arity() == 0 {
            symbols[at - 1] = leaf;
        } else if is_pair(&symbols, at + 2) && symbols[at + 1].arity() == 0 {
            symbols[at + 1] = leaf;
        }
    }
    Tree::new(symbols).ok()
}

/// A node becomes a new formula.
fn grow(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, node) = pick(draft, |_, _| true)?;
    let by = draft.grow(hole.stage, node.width, node.pair)?;
    draft.graft(hole, node.at, by)
}

/// A node becomes one of its operands.
fn shrink(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, node) = pick(draft, |tree, node| tree.symbols()[node.at].arity() > 0)?;
    let tree = draft.tree(hole);
    let operands = tree.operands(node.at);
    let fitting: Vec<Tree> = operands
        .into_iter()
        .map(|operand| tree.subtree(operand))
        .filter(|operand| operand.width() == node.width)
        .collect();
    let by = fitting.choose(draft.rng)?.symbols().to_vec();
    draft.graft(hole, node.at, by)
}

/// Two nodes of a formula change places.
fn swap(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, first) = pick(draft, |_, _| true)?;
    let nodes = draft.nodes(hole).into_iter();
    let others: Vec<Node> = nodes
        .filter(|node| node.width == first.width && node.pair == first.pair && node.at != first.at)
        .collect();
    let second = others.choose(draft.rng)?;
    let tree = draft.tree(hole).swap(first.at, second.at)?.ok()?;
    draft.fill(hole, tree);
    Some(())
}

/// A node becomes an operand of a new operation.
fn wrap(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, node) = pick(draft, |_, node| node.width <= 3)?;
    let mut by = draft.tree(hole).subtree(node.at).symbols().to_vec();
    let op = *[Op::Add, Op::Mul, Op::Div, Op::Min, Op::Max].choose(draft.rng)?;
    by.extend(draft.grow(hole.stage, 1, node.pair)?);
    by.push(Symbol::Op(op));
    draft.graft(hole, node.at, by)
}

/// A constant is multiplied by something near one.
fn jitter(draft: &mut Draft<'_>) -> Option<()> {
    let deviate: f32 = (0..12).map(|_| draft.rng.random::<f32>()).sum::<f32>() - 6.0;
    let count = draft.filter.constants.params.len();
    let which = (count > 0).then(|| draft.rng.random_range(0..count))?;
    let Param { value, bounds, .. } = &mut draft.filter.constants.params[which];
    *value = (*value * (JITTER * deviate).exp()).clamp(bounds[0], bounds[1]);
    Some(())
}

/// The stages that average by a weight exp(-x), and where x stands.
fn exponents(draft: &Draft<'_>) -> Vec<(Hole, usize)> {
    let holes = draft.holes().into_iter().filter(|hole| hole.role == Role::Weight);
    holes.filter_map(|hole| Some((hole, exponent(draft.tree(hole))?))).collect()
}

/// The terms of a sum: where they stand.
fn terms(tree: &Tree, at: usize) -> Vec<usize> {
    let (mut open, mut terms) = (vec![at], Vec::new());
    while let Some(at) = open.pop() {
        match tree.symbols()[at] {
            Symbol::Op(Op::Add) => open.extend(tree.operands(at)),
            _ => terms.push(at),
        }
    }
    terms
}

/// A weight gets a further term; a pass by equal weights gets its first.
fn add_term(draft: &mut Draft<'_>) -> Option<()> {
    let holes = draft.holes().into_iter().filter(|hole| hole.role == Role::Weight);
    let hole = *holes.collect::<Vec<_>>().choose(draft.rng)?;
    let term = draft.term(hole.stage)?;
    add(draft, hole, term)
}

/// Adds a term to a weight's exponent.
fn add(draft: &mut Draft<'_>, hole: Hole, term: Vec<Symbol>) -> Option<()> {
    let tree = draft.tree(hole);
    if let Some(at) = exponent(tree) {
        let mut by = tree.subtree(at).symbols().to_vec();
        by.extend(term);
        by.push(Symbol::Op(Op::Add));
        return draft.graft(hole, at, by);
    }
    if tree.symbols() == [Symbol::constant(1.0)] {
        let bounded = [Symbol::constant(60.0), Symbol::Op(Op::Min), Symbol::Op(Op::Neg)];
        let weight = [term, bounded.to_vec(), vec![Symbol::Op(Op::Exp)]].concat();
        let weight = Tree::new(weight).ok()?;
        draft.fill(hole, weight);
        return Some(());
    }
    None
}

/// A weight loses a term.
fn drop_term(draft: &mut Draft<'_>) -> Option<()> {
    let &(hole, at) = exponents(draft).choose(draft.rng)?;
    let terms = terms(draft.tree(hole), at);
    if terms.len() < 2 {
        return None;
    }
    let term = *terms.choose(draft.rng)?;
    draft.graft(hole, term, vec![Symbol::constant(0.0)])
}

/// A weight gets a term of an earlier or later pass, with constants of its own.
fn copy_term(draft: &mut Draft<'_>) -> Option<()> {
    let all = exponents(draft);
    let &(from, at) = all.choose(draft.rng)?;
    let &(to, _) = all.choose(draft.rng)?;
    if from == to {
        return None;
    }
    let terms = terms(draft.tree(from), at);
    let which = *terms.choose(draft.rng)?;
    let term = draft.tree(from).subtree(which);
    let reads = |symbol: &Symbol| match symbol {
        Symbol::Stage(signal) => usize::from(signal.stage) < to.stage,
        _ => true,
    };
    if !term.symbols().iter().all(reads) {
        return None;
    }
    let own = with_own_constants(draft, &term);
    add(draft, to, own.symbols().to_vec())
}

/// The formula with copies of the single constants that it reads.
fn with_own_constants(draft: &mut Draft<'_>, tree: &Tree) -> Tree {
    let mut copies: Vec<(u16, Symbol)> = Vec::new();
    for &symbol in tree.symbols() {
        if let Symbol::Param(k) = symbol
            && !copies.iter().any(|&(known, _)| known == k)
        {
            let Param { name, value, bounds, .. } =
                draft.filter.constants.params[usize::from(k)].clone();
            let copy = draft.param(&name, value, bounds);
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
fn add_pass(draft: &mut Draft<'_>) -> Option<()> {
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
    let weight = with_own_constants(draft, &gather.weight);
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
fn add_map(draft: &mut Draft<'_>) -> Option<()> {
    let is_leaf = |tree: &Tree, node: Node| {
        let symbol = tree.symbols()[node.at];
        let alone = !tree
            .symbols()
            .get(node.at + 1)
            .is_some_and(|&after| matches!(after, Symbol::At(_) | Symbol::Part(_)));
        symbol.arity() == 0 && alone && node.width <= 3
    };
    let (hole, node) = pick(draft, is_leaf)?;
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
fn remove_stage(draft: &mut Draft<'_>) -> Option<()> {
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
fn copy_stage(draft: &mut Draft<'_>) -> Option<()> {
    let count = draft.filter.stages.len();
    let at = draft.rng.random_range(0..count);
    if at + 1 == count {
        return None;
    }
    let mut stage = draft.filter.stages[at].clone();
    match &mut stage.kind {
        StageKind::Map(value) => *value = with_own_constants(draft, value),
        StageKind::Gather(gather) => gather.weight = with_own_constants(draft, &gather.weight),
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
fn dilate(draft: &mut Draft<'_>) -> Option<()> {
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
fn resize(draft: &mut Draft<'_>) -> Option<()> {
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
fn halve(draft: &mut Draft<'_>) -> Option<()> {
    let count = draft.filter.stages.len();
    let at = draft.rng.random_range(0..count);
    if at + 1 == count {
        return None;
    }
    let grid = &mut draft.filter.stages[at].grid;
    *grid = if *grid == Grid::Full { Grid::Half } else { Grid::Full };
    Some(())
}

/// A feature is read no more: its distances are nothing, and it is a number elsewhere.
fn drop_feature(draft: &mut Draft<'_>) -> Option<()> {
    let read = |symbol: &Symbol| Some(symbol.reads()?.0);
    let stages = draft.filter.stages.iter();
    let mut features: Vec<Feature> =
        stages.flat_map(Stage::trees).flat_map(Tree::symbols).filter_map(read).collect();
    features.sort_unstable();
    features.dedup();
    features.retain(|feature| !matches!(feature, Feature::Color | Feature::Pixel));
    let gone = *features.choose(draft.rng)?;
    let holes = draft.holes();
    for hole in holes {
        // From the end, so that positions before stay what they are.
        let mut at = draft.tree(hole).len();
        while at > 0 {
            at -= 1;
            let symbols = draft.tree(hole).symbols();
            let Some(&symbol) = symbols.get(at) else { continue };
            let is_gone = |symbol: Symbol| symbol.reads().is_some_and(|(f, _)| f == gone);
            let distance = matches!(symbol, Symbol::Op(op) if matches!(op.row().form, Form::Vectors(_)))
                && at >= 2
                && is_gone(symbols[at - 1])
                && is_gone(symbols[at - 2]);
            if distance {
                draft.graft(hole, at, vec![Symbol::constant(0.0)])?;
                at = at.saturating_sub(2);
            } else if is_gone(symbol) && symbol.width(&[]) == Some(1) {
                draft.graft(hole, at, vec![Symbol::constant(0.0)])?;
            } else if is_gone(symbol) {
                let grey = Symbol::constant(0.5);
                let wide = vec![grey, grey, grey, Symbol::Many(Variadic::Join, 3)];
                draft.graft(hole, at, wide)?;
            }
        }
    }
    Some(())
}

/// One of the places that read a constant gets one of its own.
fn untie(draft: &mut Draft<'_>) -> Option<()> {
    let is_param = |tree: &Tree, node: Node| matches!(tree.symbols()[node.at], Symbol::Param(_));
    let (hole, node) = pick(draft, is_param)?;
    let tree = draft.tree(hole).subtree(node.at);
    let own = with_own_constants(draft, &tree);
    draft.graft(hole, node.at, own.symbols().to_vec())
}

/// A layer of statistics becomes sums of the few inputs that weigh most in each row, with
/// constants of their own.
fn unlayer(draft: &mut Draft<'_>) -> Option<()> {
    let is_layer = |tree: &Tree, node: Node| {
        let stands_on = node.at.checked_sub(1).map(|below| tree.symbols()[below]);
        matches!(tree.symbols()[node.at], Symbol::Linear(_))
            && matches!(stands_on, Some(Symbol::Stage(_)))
    };
    let holes = draft.holes();
    let found: Vec<(Hole, Node)> = holes
        .into_iter()
        .flat_map(|hole| draft.nodes(hole).into_iter().map(move |node| (hole, node)))
        .filter(|&(hole, node)| is_layer(draft.tree(hole), node))
        .collect();
    let &(hole, node) = found.choose(draft.rng)?;
    let symbols = draft.tree(hole).symbols();
    let (Symbol::Linear(LayerRef { layer, .. }), input) = (symbols[node.at], symbols[node.at - 1])
    else {
        return None;
    };
    let Layer { name, weights, bias } = draft.filter.constants.layers[usize::from(layer)].clone();
    let mut by = Vec::new();
    for (row, &start) in weights.iter().zip(&bias) {
        let mut order: Vec<usize> = (0..row.len()).collect();
        order.sort_by(|&a, &b| row[b].abs().total_cmp(&row[a].abs()));
        by.push(draft.param(&name, start, [-20.0, 20.0]));
        for &column in order.iter().take(KEPT) {
            let factor = draft.param(&name, row[column], [-20.0, 20.0]);
            by.extend([input, Symbol::Part(column as u16), factor]);
            by.extend([Symbol::Op(Op::Mul), Symbol::Op(Op::Add)]);
        }
    }
    if weights.len() > 1 {
        by.push(Symbol::Many(Variadic::Join, u8::try_from(weights.len()).ok()?));
    }
    draft.graft(hole, node.at, by)
}

/// A change at a random place of a program, if it applies there and leaves one that makes sense.
#[cfg(test)]
pub(super) fn change_alone(
    genome: &Genome,
    features: &[(Feature, Quantity)],
    rng: &mut Stream,
    change: Change,
) -> Option<Genome> {
    let mut draft = Draft::new(genome, features, rng);
    change(&mut draft)?;
    draft.genome().filter(|child| child != genome)
}
