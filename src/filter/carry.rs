//! Another picture through the weights of a picture.
//!
//! What a filter gives is mostly *linear* in the noisy colour once its weights are known: a
//! mean of means of products with what does not hang on the colour, or as weights do. Then
//! there is a filter of another picture (a layer, the alpha) by the very weights that the
//! colour gets, and pictures that add up to the colour add up to its result.
//!
//! It has the stages of the first, for the weights, and behind each that carries the colour on
//! one per picture that does the same with its part of [`Feature::Layer`]. A mean of the other
//! pictures has the weights of the colour's, so that whoever plans both makes them one. Which
//! stages carry is read off the formulas:
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

/// A filter of several pictures by the weights of the first, which is the colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Carrying {
    /// What is computed.
    pub filter: Filter,
    /// By stage of the filter of the colour alone, the one that does the same; the last gives
    /// the colour.
    pub own: Vec<u16>,
    /// The stages that give the other pictures.
    pub pictures: Vec<u16>,
}

impl Carrying {
    /// The stages that give something: the colour first.
    pub fn results(&self) -> Vec<u16> {
        self.own.last().into_iter().chain(&self.pictures).copied().collect()
    }
}

impl Filter {
    /// The filter of the colour and of so many pictures of `otherLayer` by the weights of the
    /// colour; nothing if this one's result is no weighted mean of the colour.
    ///
    /// # Panics
    /// If there are more than [`Feature::PICTURES`].
    pub fn carrying(&self, pictures: usize) -> Option<Carrying> {
        assert!(pictures <= Feature::PICTURES, "so many are read at a time");
        let mut stages: Vec<Stage> = Vec::new();
        // By stage of this filter: its number among the new ones, and by picture that of the one
        // that does the same with it.
        let mut own: Vec<u16> = Vec::with_capacity(self.stages.len());
        let mut carried: Vec<Vec<Option<u16>>> = vec![Vec::new(); pictures];
        for stage in &self.stages {
            let numbered = |tree: &Tree| renumbered(tree, &own);
            let kind = match &stage.kind {
                StageKind::Map(value) => StageKind::Map(numbered(value)),
                StageKind::Gather(gather) => StageKind::Gather(Gather {
                    of: numbered(&gather.of),
                    weight: numbered(&gather.weight),
                    variance: gather.variance.as_ref().map(numbered),
                    ..gather.clone()
                }),
            };
            let others = carried.iter().enumerate().map(|(picture, known)| {
                let to = Picture { picture, own: &own, carried: known };
                match &stage.kind {
                    StageKind::Map(value) => to.carry(value).map(StageKind::Map),
                    StageKind::Gather(gather) => to.carry(&gather.of).map(|of| {
                        let weight = renumbered(&gather.weight, &own);
                        StageKind::Gather(Gather { of, weight, variance: None, ..gather.clone() })
                    }),
                }
            });
            let others: Vec<Option<StageKind>> = others.collect();
            own.push(u16::try_from(stages.len()).ok()?);
            stages.push(Stage { kind, ..stage.clone() });
            for (picture, kind) in others.into_iter().enumerate() {
                let number = match kind {
                    None => None,
                    Some(kind) => {
                        let number = u16::try_from(stages.len()).ok()?;
                        let name = format!("carried{}_{}", picture + 1, stage.name);
                        let name = self.free_name(name);
                        stages.push(Stage { name, kind, ..stage.clone() });
                        Some(number)
                    }
                };
                carried[picture].push(number);
            }
        }
        let pictures = carried.iter().map(|stages| stages.last().copied().flatten());
        let pictures = pictures.collect::<Option<_>>()?;
        let filter = Self { stages, ..self.clone() };
        filter.check().ok()?;
        Some(Carrying { filter, own, pictures })
    }

    /// A name that no stage has.
    fn free_name(&self, mut name: String) -> String {
        while self.stages.iter().any(|stage| stage.name == name) {
            name.push('_');
        }
        name
    }
}

/// The formula with its stages numbered anew.
fn renumbered(tree: &Tree, own: &[u16]) -> Tree {
    let symbols: Vec<Symbol> = tree.symbols().iter().map(|&symbol| number(symbol, own)).collect();
    Tree::new(symbols).expect("the same widths in the same places")
}

fn number(symbol: Symbol, own: &[u16]) -> Symbol {
    match symbol {
        Symbol::Stage(signal) => {
            Symbol::Stage(StageSignal { stage: own[usize::from(signal.stage)], ..signal })
        }
        other => other,
    }
}

/// A formula in postfix order, and what it becomes of the other picture, if it carries.
struct Part {
    plain: Vec<Symbol>,
    carried: Option<Vec<Symbol>>,
}

/// Another picture, on its way through the stages.
struct Picture<'a> {
    /// Which.
    picture: usize,
    /// The new numbers of the filter's own stages.
    own: &'a [u16],
    /// The stages that do the same with the picture, where they can.
    carried: &'a [Option<u16>],
}

impl Picture<'_> {
    /// The formula of the other picture.
    fn carry(&self, tree: &Tree) -> Option<Tree> {
        let mut stack: Vec<Part> = Vec::new();
        for &symbol in tree.symbols() {
            let operands = stack.split_off(stack.len() - symbol.arity());
            let carried = self.carried(symbol, &operands);
            let mut plain: Vec<Symbol> = operands.into_iter().flat_map(|part| part.plain).collect();
            plain.push(number(symbol, self.own));
            stack.push(Part { plain, carried });
        }
        let symbols = stack.pop()?.carried?;
        Some(Tree::new(symbols).expect("the same widths in the same places"))
    }

    fn carried(&self, symbol: Symbol, operands: &[Part]) -> Option<Vec<Symbol>> {
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
            Symbol::Vector(Feature::Color) => {
                let width = Feature::Color.width();
                let component = |k: usize| {
                    let part = Symbol::Part((width * self.picture + k) as u16);
                    [Symbol::Vector(Feature::Layer), part]
                };
                let join = Symbol::Many(Variadic::Join, width as u8);
                Some((0..width).flat_map(component).chain([join]).collect())
            }
            Symbol::Stage(signal) if !signal.variance => {
                let stage = self.carried.get(usize::from(signal.stage)).copied().flatten()?;
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::shipped;

    #[test]
    fn every_shipped_filter_carries_another_picture() {
        for filter in shipped::programs() {
            let carrying = filter.carrying(2).unwrap_or_else(|| panic!("{}", filter.name));
            let names = carrying.results().into_iter();
            let names = names.map(|k| &carrying.filter.stages[usize::from(k)].name);
            let own = &filter.stages.last().expect("some").name;
            let others = [1, 2].map(|k| format!("carried{k}_{own}"));
            assert!(names.eq([own, &others[0], &others[1]]), "{}", filter.name);
        }
    }

    #[test]
    fn what_is_no_mean_of_the_colour_carries_nothing() {
        for formula in ["color * color", "color + 0.1", "max(color, 0)", "exp(color)", "albedo"] {
            let text = format!(
                "version = 2\nname = \"x\"\n[[stage]]\nname = \"y\"\nmap = \"{formula}\"\n"
            );
            let filter = Filter::parse(&text, "x.toml".as_ref()).expect("a filter");
            assert!(filter.carrying(1).is_none(), "{formula}");
        }
        for formula in ["color / (1 + mean(color))", "0.5 * color[1, 0] - -color * albedo"] {
            let text = format!(
                "version = 2\nname = \"x\"\n[[stage]]\nname = \"y\"\nmap = \"{formula}\"\n"
            );
            let filter = Filter::parse(&text, "x.toml".as_ref()).expect("a filter");
            assert!(filter.carrying(1).is_some(), "{formula}");
        }
    }
}
