//! An expression with its fitness, and the order among such.

use std::cmp::Ordering;

use serde::{Deserialize, Serialize};

use super::encoding;
use crate::expr::Tree;

/// What came of a race for one entrant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Judgement {
    /// It was judged in full: its fitness.
    Full(f64),
    /// It was dropped: an estimate of its fitness, no better than the bar's.
    Dropped(f64),
}

impl Judgement {
    /// What it is selected by.
    pub fn value(self) -> f64 {
        match self {
            Self::Full(value) | Self::Dropped(value) => value,
        }
    }

    /// Whether it was judged in full.
    pub fn is_full(self) -> bool {
        matches!(self, Self::Full(_))
    }
}

/// A judged expression.
///
/// Individuals are ordered, the better one first: by fitness, then those judged
/// in full before those dropped from a [`race`](super::race), then the smaller
/// tree, then the trees' own order. The order is total, so that no choice in a
/// search depends on who came first.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Individual {
    /// The expression.
    #[serde(with = "encoding::expression")]
    pub tree: Tree,
    /// Its fitness: lower is better.
    #[serde(with = "encoding::exact")]
    pub fitness: f64,
    /// Whether it was judged in full, or its fitness is an estimate.
    pub full: bool,
}

impl Individual {
    /// An expression with the verdict on it.
    pub fn new(tree: Tree, verdict: Judgement) -> Self {
        Self { tree, fitness: verdict.value(), full: verdict.is_full() }
    }

    /// The verdict on it.
    pub fn verdict(&self) -> Judgement {
        if self.full { Judgement::Full(self.fitness) } else { Judgement::Dropped(self.fitness) }
    }
}

impl Ord for Individual {
    fn cmp(&self, other: &Self) -> Ordering {
        self.fitness
            .total_cmp(&other.fitness)
            .then_with(|| other.full.cmp(&self.full))
            .then_with(|| self.tree.len().cmp(&other.tree.len()))
            .then_with(|| self.tree.cmp(&other.tree))
    }
}

impl PartialOrd for Individual {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Individual {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Individual {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_equal_fitness_the_smaller_tree_is_better_and_an_estimate_worse() {
        let [small, large, best, hopeless, dropped] = [
            ("1", Judgement::Full(2.0)),
            ("exp(1)", Judgement::Full(2.0)),
            ("exp(1)", Judgement::Full(1.0)),
            ("1", Judgement::Full(f64::INFINITY)),
            ("1", Judgement::Dropped(2.0)),
        ]
        .map(|(text, verdict)| Individual::new(text.parse().unwrap(), verdict));
        let mut all = [&hopeless, &dropped, &large, &small, &best];
        all.sort();
        assert_eq!(all, [&best, &small, &large, &dropped, &hopeless]);
    }
}
