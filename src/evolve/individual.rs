//! An expression with its fitness, and the order among such.

use std::cmp::Ordering;

use serde::{Deserialize, Serialize};

use super::encoding;
use crate::expr::Tree;

/// A judged expression.
///
/// Individuals are ordered, the better one first: by fitness, then the smaller
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
}

impl Ord for Individual {
    fn cmp(&self, other: &Self) -> Ordering {
        self.fitness
            .total_cmp(&other.fitness)
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
    fn at_equal_fitness_the_smaller_tree_is_better() {
        let [small, large, best, hopeless] =
            [("1", 2.0), ("exp(1)", 2.0), ("exp(1)", 1.0), ("1", f64::INFINITY)]
                .map(|(text, fitness)| Individual { tree: text.parse().unwrap(), fitness });
        let mut all = [&hopeless, &large, &small, &best];
        all.sort();
        assert_eq!(all, [&best, &small, &large, &hopeless]);
    }
}
