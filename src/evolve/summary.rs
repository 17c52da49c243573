//! Which terms the search came to use (the last analysis of Section 5).

use serde::Serialize;

use crate::expr::{Feature, Op, Quantity, Symbol, Tree};

/// How often a symbol occurs in a set of expressions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Frequency {
    /// How the symbol is written.
    pub name: &'static str,
    /// What it is, in words.
    pub doc: &'static str,
    /// Expressions that use it.
    pub expressions: usize,
    /// Occurrences in all of them together.
    pub occurrences: usize,
}

impl Frequency {
    /// What a term or an operator is; terms that are made of a feature by its name.
    pub fn meaning(&self) -> String {
        match Feature::parse(self.name) {
            Some((feature, Quantity::Gradient)) => format!("gradient of {}", feature.row().name),
            Some((feature, Quantity::Variance)) => format!("variance of {}", feature.row().name),
            Some((_, Quantity::Value)) | None => self.doc.to_owned(),
        }
    }
}

/// What a set of expressions is made of. Symbols that do not occur are listed
/// too: what evolution drops tells as much.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// How many expressions there are.
    pub expressions: usize,
    /// Features, gradients and variances, the most frequent first.
    pub terms: Vec<Frequency>,
    /// Operators, the most frequent first.
    pub operators: Vec<Frequency>,
}

impl Summary {
    /// Counts.
    pub fn new<'a>(trees: impl IntoIterator<Item = &'a Tree>) -> Self {
        let trees: Vec<&Tree> = trees.into_iter().collect();
        let count = |symbol: Symbol, name, doc| {
            let counts = trees.iter().map(|t| t.symbols().iter().filter(|&&s| s == symbol).count());
            let (expressions, occurrences) =
                counts.fold((0, 0), |(e, o), n| (e + usize::from(n > 0), o + n));
            Frequency { name, doc, expressions, occurrences }
        };
        let terms = Feature::terms().filter_map(|(feature, quantity)| {
            let name = feature.spelling(quantity)?;
            Some(count(Symbol::of(feature, quantity)?, name, feature.row().doc))
        });
        let operators = Op::ALL.iter().map(|&op| count(Symbol::Op(op), op.name(), op.row().doc));
        Self { expressions: trees.len(), terms: ranked(terms), operators: ranked(operators) }
    }
}

/// The most frequent first; ties stay in the tables' order.
fn ranked(frequencies: impl Iterator<Item = Frequency>) -> Vec<Frequency> {
    let mut ranked: Vec<Frequency> = frequencies.collect();
    ranked.sort_by_key(|f| std::cmp::Reverse((f.expressions, f.occurrences)));
    ranked
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_are_ranked_by_the_expressions_that_use_them() {
        let trees =
            ["distance2(normal, normal)", "distance2(normal, normal)", "-distance2(depth, depth)"]
                .map(|text| text.parse().unwrap());
        let summary = Summary::new(&trees);
        assert_eq!(summary.expressions, 3);
        let top: Vec<_> =
            summary.terms.iter().map(|f| (f.name, f.expressions, f.occurrences)).take(3).collect();
        assert_eq!(top, [("normal", 2, 4), ("depth", 1, 2), ("worldPosition", 0, 0)]);
        assert_eq!(summary.operators[0].name, "distance2");
        assert_eq!(summary.operators[1].doc, "negation");
    }
}
