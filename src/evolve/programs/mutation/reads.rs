//! Changes to what is read: features, constants, layers.

use rand::seq::IndexedRandom;

use crate::evolve::programs::draft::{Draft, Hole, Node};
use crate::expr::constants::Layer;
use crate::expr::feature::Feature;
use crate::expr::op::{Form, Op};
use crate::expr::symbol::{LayerRef, Symbol, Variadic};
use crate::expr::tree::Tree;
use crate::filter::Stage;

/// Inputs of a row of a layer that a formula in its place keeps.
const KEPT: usize = 2;

/// A feature is read no more: its distances are nothing, and it is a number elsewhere.
pub(super) fn drop_feature(draft: &mut Draft<'_>) -> Option<()> {
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
pub(super) fn untie(draft: &mut Draft<'_>) -> Option<()> {
    let is_param = |tree: &Tree, node: Node| matches!(tree.symbols()[node.at], Symbol::Param(_));
    let (hole, node) = draft.pick(is_param)?;
    let tree = draft.tree(hole).subtree(node.at);
    let own = draft.with_own_constants(&tree);
    draft.graft(hole, node.at, own.symbols().to_vec())
}

/// A layer of statistics becomes sums of the few inputs that weigh most in each row, with
/// constants of their own.
pub(super) fn unlayer(draft: &mut Draft<'_>) -> Option<()> {
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
