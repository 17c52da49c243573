//! The parts of a filter, and the filter without each.

use crate::backend::reference::meaning::Images;
use crate::expr::feature::Feature;
use crate::expr::op::Op;
use crate::expr::symbol::{Symbol, Variadic};
use crate::expr::text::Reads;
use crate::expr::tree::Tree;
use crate::filter::{Checked, Filter, Gather, Stage, StageKind, StandIn, Window, formula, reads};

/// What a part of a filter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A feature that it reads: without it, the file lacks it.
    Feature(Feature),
    /// The variances of colour and features: without them they are estimated.
    Variances,
    /// A weighted mean: without it, every pixel keeps what was to be averaged.
    Pass,
    /// A term of a weight's exponent: without it, it is 0.
    Term,
    /// A factor of a weight: without it, it is 1.
    Factor,
    /// A value that a map makes: without it, it is the same number for all pixels, its mean.
    Value,
}

impl Kind {
    /// What is done to the part to see what it is for.
    pub fn without(self) -> &'static str {
        match self {
            Self::Feature(_) => "absent",
            Self::Variances => "estimated",
            Self::Pass => "left out",
            Self::Term => "0",
            Self::Factor => "1",
            Self::Value => "held at its mean",
        }
    }
}

/// A part of a filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// What it is.
    pub kind: Kind,
    /// The stage that it belongs to, counted from 0; features belong to none.
    pub stage: Option<usize>,
    /// As a person would write it.
    pub text: String,
    pub(super) without: Without,
}

/// What is run to see what a part is for.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Without {
    /// The filter, on a scene that lacks a feature.
    Feature(Feature),
    /// The filter, on a scene without variances.
    Variances,
    /// Another filter.
    Filter(Box<Filter>),
    /// Nothing can: the filter needs the part.
    Nothing,
}

/// The parts of a filter in the order of its stages, features first. `sample` is what its
/// stages give on a part of a scene; means are those over it.
pub(super) fn parts(checked: &Checked<'_>, sample: &Images<'_>) -> Vec<Part> {
    let filter = checked.filter();
    let mut parts: Vec<Part> = reads(checked)
        .into_iter()
        .filter(|(feature, _)| feature.is_stored() && *feature != Feature::Color)
        .map(|(feature, stand_in)| of_feature(feature, stand_in))
        .collect();
    let mut symbols = filter.stages.iter().flat_map(Stage::trees).flat_map(Tree::symbols);
    if symbols.any(|symbol| matches!(symbol, Symbol::Variance(_))) {
        let text = "variances".to_owned();
        parts.push(Part { kind: Kind::Variances, stage: None, text, without: Without::Variances });
    }
    let last = filter.stages.len() - 1;
    for (k, stage) in filter.stages.iter().enumerate() {
        match &stage.kind {
            StageKind::Map(value) if k < last => {
                parts.extend(values(value).into_iter().filter_map(|at| {
                    let mean = mean(&value.subtree(at), stage, sample)?;
                    let name = match at == value.root() {
                        true => stage.name.clone(),
                        false => format!("{}[{}]", stage.name, component(value, at)),
                    };
                    let text = formula(checked, k, &value.subtree(at), Reads::Pixel);
                    let kind = StageKind::Map(value.replace(at, &mean).ok()?);
                    part(filter, k, Kind::Value, format!("{name} = {text}"), kind)
                }));
            }
            // What the result is made of has its parts in the stages before.
            StageKind::Map(_) => {}
            StageKind::Gather(gather) => {
                let alone = Gather { window: Window::dense(0), ..gather.clone() };
                let of = formula(checked, k, &gather.of, Reads::Pixel);
                let text = format!("{} = mean of {of}", stage.name);
                parts.extend(part(filter, k, Kind::Pass, text, StageKind::Gather(alone)));
                parts.extend(terms(&gather.weight).into_iter().filter_map(|(at, kind)| {
                    let nothing = Tree::constant(if kind == Kind::Factor { 1.0 } else { 0.0 });
                    let text = formula(checked, k, &gather.weight.subtree(at), Reads::Pair);
                    let weight = gather.weight.replace(at, &nothing).ok()?;
                    let changed = Gather { weight, ..gather.clone() };
                    part(filter, k, kind, text, StageKind::Gather(changed))
                }));
            }
        }
    }
    parts
}

fn of_feature(feature: Feature, stand_in: Option<StandIn>) -> Part {
    let text = feature.term().to_owned();
    let without = if stand_in.is_some() { Without::Feature(feature) } else { Without::Nothing };
    Part { kind: Kind::Feature(feature), stage: None, text, without }
}

/// A part of a stage; nothing if the filter makes no sense without it.
fn part(
    filter: &Filter,
    stage: usize,
    kind: Kind,
    text: String,
    without: StageKind,
) -> Option<Part> {
    let mut changed = filter.clone();
    changed.stages[stage].kind = without;
    changed.check().ok()?;
    let without = Without::Filter(Box::new(changed));
    Some(Part { kind, stage: Some(stage), text, without })
}

/// The values that a map makes: the components of a list each, else the whole. What reads
/// nothing is none.
fn values(tree: &Tree) -> Vec<usize> {
    let mut at = tree.root();
    if let Symbol::Many(Variadic::Clamp, _) = tree.symbols()[at] {
        at = tree.operands(at)[0];
    }
    let found = match tree.symbols()[at] {
        Symbol::Many(Variadic::Join, _) => tree.operands(at),
        _ => vec![tree.root()],
    };
    let reads = |symbol: &Symbol| symbol.reads().is_some() || matches!(symbol, Symbol::Stage(_));
    let varies = |&at: &usize| tree.symbols()[tree.extent(at)].iter().any(reads);
    found.into_iter().filter(varies).collect()
}

/// Which component of a list an operand begins with.
fn component(tree: &Tree, at: usize) -> usize {
    let widths = tree.widths();
    let list = (0..tree.len()).find(|&list| {
        matches!(tree.symbols()[list], Symbol::Many(Variadic::Join, _))
            && tree.operands(list).contains(&at)
    });
    let before = tree.operands(list.expect("values stand in lists"));
    before.into_iter().take_while(|&other| other != at).map(|other| widths[other]).sum()
}

/// The mean of a formula's every component, as a formula.
fn mean(tree: &Tree, stage: &Stage, sample: &Images<'_>) -> Option<Tree> {
    let components = sample.map(tree, stage.grid);
    let mean = |values: &Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let mut symbols: Vec<Symbol> =
        components.iter().map(|values| Symbol::constant(mean(values) as f32)).collect();
    if symbols.len() > 1 {
        symbols.push(Symbol::Many(Variadic::Join, u8::try_from(symbols.len()).ok()?));
    }
    Tree::new(symbols).ok()
}

/// Where a weight's terms and factors stand.
fn terms(tree: &Tree) -> Vec<(usize, Kind)> {
    let mut found = Vec::new();
    factors(tree, tree.root(), &mut found);
    // In the order in which they are read.
    found.sort_by_key(|&(at, _)| at);
    found
}

fn factors(tree: &Tree, at: usize, found: &mut Vec<(usize, Kind)>) {
    let operands = tree.operands(at);
    match tree.symbols()[at] {
        Symbol::Op(Op::Mul) => operands.into_iter().for_each(|at| factors(tree, at, found)),
        Symbol::Op(Op::Exp) => addends(tree, operands[0], found),
        symbol if symbol.number().is_some() => {}
        _ => found.push((at, Kind::Factor)),
    }
}

fn addends(tree: &Tree, at: usize, found: &mut Vec<(usize, Kind)>) {
    let operands = tree.operands(at);
    let symbols = tree.symbols();
    let fixed =
        |&at: &usize| symbols[at].number().is_some() || matches!(symbols[at], Symbol::Param(_));
    let is_sum = |&at: &usize| matches!(symbols[at], Symbol::Op(Op::Add | Op::Sub | Op::Neg));
    match symbols[at] {
        Symbol::Op(Op::Add | Op::Sub | Op::Neg) => {
            operands.into_iter().for_each(|at| addends(tree, at, found));
        }
        // A bound of the whole.
        Symbol::Op(Op::Min | Op::Max) if operands.iter().filter(|at| fixed(at)).count() == 1 => {
            operands.into_iter().filter(|at| !fixed(at)).for_each(|at| addends(tree, at, found));
        }
        // A sum in a unit of its own.
        Symbol::Op(Op::Mul | Op::Div) if is_sum(&operands[0]) && fixed(&operands[1]) => {
            addends(tree, operands[0], found);
        }
        Symbol::Op(Op::Mul) if is_sum(&operands[1]) && fixed(&operands[0]) => {
            addends(tree, operands[1], found);
        }
        symbol if symbol.number().is_some() => {}
        _ => found.push((at, Kind::Term)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::shipped;

    fn weight(text: &str) -> Vec<(String, Kind)> {
        let tree = crate::expr::text::parse_scalar(text).expect("it parses");
        let found = terms(&tree).into_iter();
        found.map(|(at, kind)| (tree.subtree(at).to_string(), kind)).collect()
    }

    #[test]
    fn exponents_have_terms_and_products_have_factors() {
        let text = "exp(-min(distance2(normal, normal) * 4 + 2 * distance2(pixel, pixel), 60))";
        let expected = ["distance2(normal, normal) * 4", "2 * distance2(pixel, pixel)"];
        assert_eq!(weight(text), expected.map(|text| (text.to_owned(), Kind::Term)));
        let text = "exp(-(dVariance + 1) / 2) * (2 - min(dVariance, 2))";
        assert_eq!(
            weight(text),
            [
                ("dVariance".to_owned(), Kind::Term),
                ("2 - min(dVariance, 2)".to_owned(), Kind::Factor)
            ]
        );
        assert_eq!(weight("1"), []);
    }

    #[test]
    fn lists_are_taken_apart_and_wholes_are_not() {
        let filter = shipped::best();
        let checked = filter.check().expect("it ships");
        let k = filter.stages.iter().position(|stage| stage.name == "stats").expect("it has some");
        let StageKind::Map(value) = &filter.stages[k].kind else { panic!("a map") };
        let found = values(value);
        assert!(found.len() > 20, "{}", found.len());
        assert_eq!(
            found.iter().map(|&at| component(value, at)).collect::<Vec<_>>()[..3],
            [0, 1, 2]
        );
        let base = &filter.stages[0];
        let StageKind::Map(value) = &base.kind else { panic!("a map") };
        assert_eq!(values(value), [value.root()], "{}", formula(&checked, 0, value, Reads::Pixel));
    }
}
