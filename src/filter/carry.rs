//! Another picture through the weights of a picture.
//!
//! What a filter gives is mostly *linear* in the noisy colour once its weights are known: a
//! mean of means of products with what does not hang on the colour, or as weights do. Then
//! there is a filter of another picture (a layer, the alpha) by the very weights that the
//! colour gets, and pictures that add up to the colour add up to its result.
//!
//! It has the stages of the first, for the weights, and beside each that carries the colour on
//! one that does the same with [`Feature::Layer`]. Which they are is read off the formulas:
//!
//! | formula | carries |
//! |---|---|
//! | `color`, a stage that carries | itself |
//! | `-a`, `a[i]`, `a[1, -2]`, `mean(a)`, `luminance(a)` | if a does |
//! | `a + b`, `a - b`, `join(a, b)` | if both do |
//! | `a * b` | if one does: the other is a weight |
//! | `a / b` | if a does |
//! | anything else (`log(color)`, `max(color, 0)`, a layer of weights) | no: it is a weight |

use super::{Filter, Gather, Stage, StageKind};
use crate::expr::feature::Feature;
use crate::expr::op::Op;
use crate::expr::symbol::{StageSignal, Symbol, Variadic};
use crate::expr::tree::Tree;

impl Filter {
    /// The filter of `otherLayer` by the weights of the colour; nothing if this one's result is no
    /// weighted mean of the colour.
    pub fn carrying(&self) -> Option<Self> {
        let mut carried: Vec<Option<u16>> = Vec::with_capacity(self.stages.len());
        let mut stages = self.stages.clone();
        for stage in &self.stages {
            let kind = match &stage.kind {
                StageKind::Map(value) => carry(value, &carried).map(StageKind::Map),
                StageKind::Gather(gather) => carry(&gather.of, &carried)
                    .map(|of| StageKind::Gather(Gather { of, variance: None, ..gather.clone() })),
            };
            carried.push(kind.and_then(|kind| {
                let number = u16::try_from(stages.len()).ok()?;
                stages.push(Stage { name: free_name(&stages, &stage.name), kind, ..stage.clone() });
                Some(number)
            }));
        }
        // The result's is the last that was made, and so the last stage.
        carried.last().copied().flatten()?;
        let filter = Self { stages, ..self.clone() };
        filter.check().ok()?;
        Some(filter)
    }
}

/// A name that no stage has.
fn free_name(stages: &[Stage], name: &str) -> String {
    let mut free = format!("carried_{name}");
    while stages.iter().any(|stage| stage.name == free) {
        free.push('_');
    }
    free
}

/// A formula in postfix order, and what it becomes of the other picture, if it carries.
struct Part {
    plain: Vec<Symbol>,
    carried: Option<Vec<Symbol>>,
}

/// The formula of the other picture.
fn carry(tree: &Tree, stages: &[Option<u16>]) -> Option<Tree> {
    let mut stack: Vec<Part> = Vec::new();
    for &symbol in tree.symbols() {
        let operands = stack.split_off(stack.len() - symbol.arity());
        let carried = carried(symbol, &operands, stages);
        let mut plain: Vec<Symbol> = operands.into_iter().flat_map(|part| part.plain).collect();
        plain.push(symbol);
        stack.push(Part { plain, carried });
    }
    let symbols = stack.pop()?.carried?;
    Some(Tree::new(symbols).expect("the same widths in the same places"))
}

fn carried(symbol: Symbol, operands: &[Part], stages: &[Option<u16>]) -> Option<Vec<Symbol>> {
    let all = |picks: &[Option<&Vec<Symbol>>]| -> Option<Vec<Symbol>> {
        let mut symbols = Vec::new();
        for pick in picks {
            symbols.extend(*pick.as_ref()?);
        }
        symbols.push(symbol);
        Some(symbols)
    };
    let linear = |k: usize| operands[k].carried.as_ref();
    let plain = |k: usize| Some(&operands[k].plain);
    match symbol {
        Symbol::Vector(Feature::Color) => Some(vec![Symbol::Vector(Feature::Layer)]),
        Symbol::Stage(signal) if !signal.variance => {
            let stage = stages.get(usize::from(signal.stage)).copied().flatten()?;
            Some(vec![Symbol::Stage(StageSignal { stage, ..signal })])
        }
        Symbol::Op(Op::Neg) | Symbol::At(_) | Symbol::Part(_) => all(&[linear(0)]),
        Symbol::Op(Op::Add | Op::Sub) => all(&[linear(0), linear(1)]),
        Symbol::Op(Op::Mul) => match (linear(0), linear(1)) {
            (Some(a), None) => all(&[Some(a), plain(1)]),
            (None, Some(b)) => all(&[plain(0), Some(b)]),
            _ => None,
        },
        Symbol::Op(Op::Div) => all(&[linear(0), plain(1)]),
        Symbol::Many(Variadic::Join | Variadic::Mean | Variadic::Luminance, _) => {
            all(&(0..operands.len()).map(linear).collect::<Vec<_>>())
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::shipped;

    #[test]
    fn every_shipped_filter_carries_another_picture() {
        for filter in shipped::programs() {
            let carrying = filter.carrying().unwrap_or_else(|| panic!("{}", filter.name));
            let last = carrying.stages.last().expect("some");
            assert!(last.name.starts_with("carried_"), "{}", last.name);
        }
    }

    #[test]
    fn what_is_no_mean_of_the_colour_carries_nothing() {
        for formula in ["color * color", "color + 0.1", "max(color, 0)", "exp(color)", "albedo"] {
            let text = format!(
                "version = 2\nname = \"x\"\n[[stage]]\nname = \"y\"\nmap = \"{formula}\"\n"
            );
            let filter = Filter::parse(&text, "x.toml".as_ref()).expect("a filter");
            assert!(filter.carrying().is_none(), "{formula}");
        }
        for formula in ["color / (1 + mean(color))", "0.5 * color[1, 0] - -color * albedo"] {
            let text = format!(
                "version = 2\nname = \"x\"\n[[stage]]\nname = \"y\"\nmap = \"{formula}\"\n"
            );
            let filter = Filter::parse(&text, "x.toml".as_ref()).expect("a filter");
            assert!(filter.carrying().is_some(), "{formula}");
        }
    }
}
