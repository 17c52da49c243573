//! Changes within formulas, as the paper's, and to the terms of weights' exponents.

use rand::RngExt;
use rand::seq::IndexedRandom;

use crate::evolve::mutation::normal;
use crate::evolve::programs::draft::{Draft, Hole, Node, Role, exponent};
use crate::expr::constants::Param;
use crate::expr::op::{Form, Op};
use crate::expr::symbol::{Symbol, Variadic};
use crate::expr::tree::Tree;

/// The standard deviation of the logarithm of what a constant is multiplied by.
const JITTER: f64 = 0.5;

/// A symbol becomes another one that takes and gives as many components.
pub(super) fn replace(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, node) = draft.pick(|_, _| true)?;
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
pub(super) fn paired(mut symbols: Vec<Symbol>, at: usize) -> Option<Tree> {
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
pub(super) fn grow(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, node) = draft.pick(|_, _| true)?;
    let by = draft.grow(hole.stage, node.width, node.pair)?;
    draft.graft(hole, node.at, by)
}

/// A node becomes one of its operands.
pub(super) fn shrink(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, node) = draft.pick(|tree, node| tree.symbols()[node.at].arity() > 0)?;
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
pub(super) fn swap(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, first) = draft.pick(|_, _| true)?;
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
pub(super) fn wrap(draft: &mut Draft<'_>) -> Option<()> {
    let (hole, node) = draft.pick(|_, node| node.width <= 3)?;
    let mut by = draft.tree(hole).subtree(node.at).symbols().to_vec();
    let op = *[Op::Add, Op::Mul, Op::Div, Op::Min, Op::Max].choose(draft.rng)?;
    by.extend(draft.grow(hole.stage, 1, node.pair)?);
    by.push(Symbol::Op(op));
    draft.graft(hole, node.at, by)
}

/// A constant is multiplied by something near one.
pub(super) fn jitter(draft: &mut Draft<'_>) -> Option<()> {
    let count = draft.filter.constants.params.len();
    let which = (count > 0).then(|| draft.rng.random_range(0..count))?;
    let Param { value, bounds, .. } = &mut draft.filter.constants.params[which];
    let factor = (JITTER * normal(draft.rng)).exp() as f32;
    *value = (*value * factor).clamp(bounds[0], bounds[1]);
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
pub(super) fn add_term(draft: &mut Draft<'_>) -> Option<()> {
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
pub(super) fn drop_term(draft: &mut Draft<'_>) -> Option<()> {
    let &(hole, at) = exponents(draft).choose(draft.rng)?;
    let terms = terms(draft.tree(hole), at);
    if terms.len() < 2 {
        return None;
    }
    let term = *terms.choose(draft.rng)?;
    draft.graft(hole, term, vec![Symbol::constant(0.0)])
}

/// A weight gets a term of an earlier or later pass, with constants of its own.
pub(super) fn copy_term(draft: &mut Draft<'_>) -> Option<()> {
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
    let own = draft.with_own_constants(&term);
    add(draft, to, own.symbols().to_vec())
}
