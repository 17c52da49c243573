//! What a weight computes of one pixel alone, as maps of their own.
//!
//! Where constants are tuned, everything that such a value hangs on is owed something. With
//! the value in a plane, pairs owe to that plane, and a map hands on what their sum is: of
//! exp(a + b x_i), pairs see one value and not three.

use std::collections::BTreeSet;

use crate::expr::symbol::{Place, StageSignal, Symbol};
use crate::expr::tape::Side;
use crate::expr::tree::Tree;
use crate::filter::Filter;

/// What a node hangs on.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Rate {
    Uniform,
    Pixel(Side),
    Pair,
}

impl Rate {
    fn join(self, other: Self) -> Self {
        match (self, other) {
            (Self::Uniform, rate) | (rate, Self::Uniform) => rate,
            (a, b) if a == b => a,
            _ => Self::Pair,
        }
    }
}

/// Whether what a leaf, or a layer, reads hangs on a constant that may be tuned; `changing`
/// names the stages that do.
pub(super) fn changes(symbol: Symbol, filter: &Filter, changing: &BTreeSet<u16>) -> bool {
    match symbol {
        Symbol::Param(k) => filter.constants.params[usize::from(k)].tuned,
        Symbol::Linear(_) => true,
        Symbol::Stage(signal) => changing.contains(&signal.stage),
        Symbol::Const(_)
        | Symbol::Variance(_)
        | Symbol::Vector(_)
        | Symbol::Gradient(_)
        | Symbol::Op(_)
        | Symbol::Offset
        | Symbol::At(_)
        | Symbol::Part(_)
        | Symbol::Many(..) => false,
    }
}

/// The weight with its largest parts that hang on one pixel, and on constants that may be
/// tuned, replaced by what `stage` makes of them: the number of a stage for a formula.
pub(super) fn lift(
    weight: &Tree,
    changes: &dyn Fn(Symbol) -> bool,
    mut stage: impl FnMut(Tree) -> u16,
) -> Tree {
    let places = weight.places(false);
    let mut rates: Vec<Rate> = Vec::with_capacity(weight.len());
    let mut changing: Vec<bool> = Vec::with_capacity(weight.len());
    for (position, &symbol) in weight.symbols().iter().enumerate() {
        let operands = weight.operands(position);
        let own = match (symbol, places[position]) {
            (Symbol::Offset, _) => Rate::Pair,
            (symbol, Place::Side(side))
                if symbol.reads().is_some() || matches!(symbol, Symbol::Stage(_)) =>
            {
                Rate::Pixel(side)
            }
            _ => Rate::Uniform,
        };
        rates.push(operands.iter().fold(own, |rate, &k| rate.join(rates[k])));
        changing.push(changes(symbol) || operands.iter().any(|&k| changing[k]));
    }
    // From the root down, so that the largest parts are found; written down from the back.
    let mut symbols: Vec<Symbol> = Vec::with_capacity(weight.len());
    let mut position = weight.len();
    while let Some(last) = position.checked_sub(1) {
        let part = weight.extent(last);
        let computes = weight.symbols()[part.clone()]
            .iter()
            .any(|symbol| matches!(symbol, Symbol::Op(_) | Symbol::Many(..) | Symbol::Linear(_)));
        match rates[last] {
            Rate::Pixel(side) if changing[last] && computes => {
                let here = |symbol: &&Symbol| !matches!(symbol, Symbol::At(_));
                let own: Vec<Symbol> =
                    weight.symbols()[part.clone()].iter().filter(here).copied().collect();
                let map = Tree::new(own).expect("a part of a tree is one");
                let width = map.width() as u16;
                let signal = StageSignal { stage: stage(map), width, variance: false };
                symbols.extend([Symbol::At(Place::Side(side)), Symbol::Stage(signal)]);
                position = part.start;
            }
            Rate::Uniform | Rate::Pixel(_) | Rate::Pair => {
                symbols.push(weight.symbols()[last]);
                position = last;
            }
        }
    }
    symbols.reverse();
    Tree::new(symbols).expect("what replaces a part has its width")
}
