//! Programs as they are bred: filters without anything that does not count.

use std::collections::{BTreeMap, BTreeSet};

use crate::expr::constants::Constants;
use crate::expr::op::Op;
use crate::expr::symbol::{LayerRef, StageSignal, Symbol, Variadic};
use crate::expr::tree::Tree;
use crate::filter::{Filter, Gather, Grid, Stage, StageKind};

/// A filter that makes sense and in which every stage and every constant is read.
///
/// Its holes are the formulas of its stages: what a map computes, what a gather averages, its
/// weight and its variance. Its skeleton is the rest: which stages there are, in which order,
/// with which windows and grids.
#[derive(Clone, Debug, PartialEq)]
pub struct Genome(Filter);

/// The shape of a program: everything but the values of its constants and the names.
pub type Shape = Vec<(bool, [u32; 2], Vec<Vec<Symbol>>)>;

impl Genome {
    /// The filter without stages and constants that nobody reads, and without terms that add
    /// nothing; nothing if it makes no sense.
    pub fn new(filter: Filter) -> Option<Self> {
        let mut filter = filter;
        loop {
            // What a simpler formula does not read, others may have been made for.
            let less = pruned(with_trees(filter.clone(), simple));
            if less == filter {
                break;
            }
            filter = less;
        }
        filter.check().ok()?;
        Some(Self(filter))
    }

    /// The filter.
    pub fn filter(&self) -> &Filter {
        &self.0
    }

    /// The same program with other values of its constants.
    ///
    /// # Panics
    /// If the filter has other constants.
    #[must_use]
    pub fn with_constants_of(&self, tuned: &Filter) -> Self {
        let mut filter = self.0.clone();
        filter.constants.set_values(&tuned.constants.values());
        Self(filter)
    }

    /// What a reader has to read: nodes of formulas, and the numbers of layers.
    pub fn size(&self) -> usize {
        self.0.size()
    }

    /// What tells the program from others that are not merely tuned differently.
    pub fn shape(&self) -> Shape {
        let stage = |stage: &Stage| {
            let window = match &stage.kind {
                StageKind::Map(_) => [0, 0],
                StageKind::Gather(gather) => [gather.window.radius, gather.window.dilation],
            };
            let formulas = stage.trees().map(|tree| tree.symbols().to_vec()).collect();
            (stage.grid == Grid::Half, window, formulas)
        };
        self.0.stages.iter().map(stage).collect()
    }
}

/// A tree with other symbols in the places of its own, of the same arity and width.
pub(super) fn renamed(tree: &Tree, rename: impl Fn(Symbol) -> Symbol) -> Tree {
    let symbols: Vec<Symbol> = tree.symbols().iter().map(|&symbol| rename(symbol)).collect();
    Tree::new(symbols).expect("the same widths in the same places")
}

/// The filter with every formula made anew.
pub(super) fn with_trees(mut filter: Filter, change: impl Fn(&Tree) -> Tree) -> Filter {
    for stage in &mut filter.stages {
        match &mut stage.kind {
            StageKind::Map(value) => *value = change(value),
            StageKind::Gather(Gather { of, weight, variance, .. }) => {
                *of = change(of);
                *weight = change(weight);
                if let Some(variance) = variance {
                    *variance = change(variance);
                }
            }
        }
    }
    filter
}

/// Without stages, constants and layers that nobody reads.
fn pruned(mut filter: Filter) -> Filter {
    let mut read: BTreeSet<u16> = BTreeSet::new();
    let mut variances: BTreeSet<u16> = BTreeSet::new();
    for (k, stage) in (0u16..).zip(&filter.stages).collect::<Vec<_>>().into_iter().rev() {
        if usize::from(k) + 1 < filter.stages.len() && !read.contains(&k) {
            continue;
        }
        for &symbol in stage.trees().flat_map(Tree::symbols) {
            if let Symbol::Stage(signal) = symbol {
                read.insert(signal.stage);
                if signal.variance {
                    variances.insert(signal.stage);
                }
            }
        }
    }
    let last = filter.stages.len() - 1;
    let kept = |k: usize| k == last || read.contains(&(k as u16));
    let numbers: BTreeMap<u16, u16> =
        (0..filter.stages.len()).filter(|&k| kept(k)).map(|k| k as u16).zip(0..).collect();
    let stages = std::mem::take(&mut filter.stages).into_iter().enumerate();
    filter.stages = stages
        .filter(|&(k, _)| kept(k))
        .map(|(k, mut stage)| {
            if let StageKind::Gather(gather) = &mut stage.kind
                && !variances.contains(&(k as u16))
            {
                gather.variance = None;
            }
            stage
        })
        .collect();
    // In the order of their names, which is that of a file.
    let used = |pick: fn(Symbol) -> Option<u16>, name: &dyn Fn(u16) -> String| {
        let symbols = filter.stages.iter().flat_map(Stage::trees).flat_map(Tree::symbols);
        let all: BTreeSet<u16> = symbols.filter_map(|&symbol| pick(symbol)).collect();
        let mut all: Vec<u16> = all.into_iter().collect();
        all.sort_by_key(|&k| name(k));
        all
    };
    let Constants { params, layers } = &filter.constants;
    let used_params = used(
        |symbol| match symbol {
            Symbol::Param(k) => Some(k),
            _ => None,
        },
        &|k| params[usize::from(k)].name.clone(),
    );
    let used_layers = used(
        |symbol| match symbol {
            Symbol::Linear(layer) => Some(layer.layer),
            _ => None,
        },
        &|k| layers[usize::from(k)].name.clone(),
    );
    filter.constants = Constants {
        params: used_params.iter().map(|&k| params[usize::from(k)].clone()).collect(),
        layers: used_layers.iter().map(|&k| layers[usize::from(k)].clone()).collect(),
    };
    let places = |used: Vec<u16>| used.into_iter().zip(0..).collect::<BTreeMap<u16, u16>>();
    let (params, layers) = (places(used_params), places(used_layers));
    let rename = |symbol: Symbol| match symbol {
        Symbol::Stage(signal) => {
            // A stage may read itself in a child that is refused afterwards.
            let stage = numbers.get(&signal.stage).copied().unwrap_or(u16::MAX);
            Symbol::Stage(StageSignal { stage, ..signal })
        }
        Symbol::Param(k) => Symbol::Param(params[&k]),
        Symbol::Linear(layer) => Symbol::Linear(LayerRef { layer: layers[&layer.layer], ..layer }),
        other => other,
    };
    with_trees(filter, |tree| renamed(tree, rename))
}

/// The formula without operations on numbers that change nothing.
fn simple(tree: &Tree) -> Tree {
    struct Part {
        symbols: Vec<Symbol>,
        width: usize,
    }
    let number = |part: &Part| match part.symbols.as_slice() {
        [symbol] => symbol.number(),
        _ => None,
    };
    let mut stack: Vec<Part> = Vec::new();
    for &symbol in tree.symbols() {
        let mut operands = stack.split_off(stack.len() - symbol.arity());
        let widths: Vec<usize> = operands.iter().map(|part| part.width).collect();
        let width = symbol.width(&widths).expect("the tree is well-formed");
        let numbers: Vec<Option<f32>> = operands.iter().map(number).collect();
        // Which operand the whole is, if it is one.
        let same = match (symbol, numbers.as_slice()) {
            (Symbol::Op(Op::Mul), [Some(1.0), _] | [_, Some(0.0)])
            | (Symbol::Op(Op::Add), [Some(0.0), _]) => Some(1),
            (Symbol::Op(Op::Mul), [_, Some(1.0)] | [Some(0.0), _])
            | (Symbol::Op(Op::Add | Op::Sub), [_, Some(0.0)])
            | (Symbol::Op(Op::Div | Op::Pow), [_, Some(1.0)]) => Some(0),
            (Symbol::Many(Variadic::Mean, 1) | Symbol::Part(0), _) if widths == [1] => Some(0),
            (Symbol::At(_), [Some(_)]) => Some(0),
            _ => None,
        };
        let part = match same.filter(|&k| operands[k].width == width) {
            Some(k) => operands.swap_remove(k),
            None => {
                let parts = operands.into_iter().flat_map(|part| part.symbols);
                Part { symbols: parts.chain([symbol]).collect(), width }
            }
        };
        stack.push(part);
    }
    Tree::new(stack.swap_remove(0).symbols).expect("operands of the same width")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::shipped;

    fn parse(text: &str) -> Filter {
        Filter::parse(text, "x.toml".as_ref()).expect("a filter")
    }

    #[test]
    fn what_nobody_reads_is_gone() {
        let text = r#"
version = 2
name = "x"
[params]
a = 1.5
b = 2.5
c = 3.5
[[stage]]
name = "unread"
map = "color * a"
[[stage]]
name = "light"
map = "color * b + 0"
[[stage]]
name = "out"
gather = "light * 1"
weight = "exp(-(c * distance2(normal, normal)))"
variance = "cVariance"
radius = 2
"#;
        let genome = Genome::new(parse(text)).expect("it makes sense");
        let names: Vec<&str> = genome.filter().stages.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, ["light", "out"]);
        let params: Vec<f32> = genome.filter().constants.values();
        assert_eq!(params, [2.5, 3.5]);
        let gather = genome.filter().gathers().next().expect("one");
        assert!(gather.variance.is_none(), "nobody reads it");
        assert_eq!(gather.of.len(), 1);
        assert_eq!(genome.size(), 3 + 1 + 7);
        let again = Genome::new(genome.filter().clone()).expect("it still makes sense");
        assert_eq!(again, genome);
    }

    #[test]
    fn shipped_programs_have_nothing_to_spare() {
        for filter in shipped::programs() {
            let stages = filter.stages.len();
            let constants = filter.constants.values().len();
            let genome = Genome::new(filter).expect("they make sense");
            assert_eq!(genome.filter().stages.len(), stages, "{}", genome.filter().name);
            assert_eq!(genome.filter().constants.values().len(), constants);
        }
    }

    #[test]
    fn a_factor_of_nothing_keeps_the_width() {
        let simple = |text: &str| {
            let filter = parse(&format!(
                "version = 2\nname = \"x\"\n[[stage]]\nname = \"y\"\nmap = \"{text}\"\n"
            ));
            let StageKind::Map(value) = &filter.stages[0].kind else { panic!("a map") };
            simple(value).len()
        };
        // One wide, and so no result of three.
        assert_eq!(simple("color * 0"), 3);
        assert_eq!(simple("color + mean(color) * 0"), 1);
        assert_eq!(simple("pow(color, 1) / 1"), 1);
    }
}
