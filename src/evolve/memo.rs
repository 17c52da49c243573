//! What has been judged already, and how.

use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use super::canonical::canonical;
use super::individual::Individual;
use crate::expr::Tree;

/// The fitness of every expression judged so far. The keys are canonical trees
/// themselves, not their hashes: two expressions can never be taken for one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(from = "Vec<Individual>", into = "Vec<Individual>")]
pub struct Memo {
    known: FxHashMap<Tree, f64>,
}

impl Memo {
    /// The fitness of an expression, if it or a variant of it with operands
    /// exchanged has been judged.
    pub fn get(&self, tree: &Tree) -> Option<f64> {
        self.known.get(&canonical(tree)).copied()
    }

    /// The expressions among `trees` that are yet to be judged, canonical, each
    /// once, in the order of their first appearance.
    pub fn missing<'a>(&self, trees: impl IntoIterator<Item = &'a Tree>) -> Vec<Tree> {
        let mut seen = rustc_hash::FxHashSet::default();
        let mut missing = Vec::new();
        for tree in trees {
            let tree = canonical(tree);
            if !self.known.contains_key(&tree) && seen.insert(tree.clone()) {
                missing.push(tree);
            }
        }
        missing
    }

    /// Remembers a canonical expression's fitness.
    pub fn insert(&mut self, judged: Individual) {
        self.known.insert(judged.tree, judged.fitness);
    }

    /// How many expressions have been judged.
    pub fn len(&self) -> usize {
        self.known.len()
    }

    /// Whether nothing has been judged yet.
    pub fn is_empty(&self) -> bool {
        self.known.is_empty()
    }
}

impl From<Vec<Individual>> for Memo {
    fn from(judged: Vec<Individual>) -> Self {
        Self { known: judged.into_iter().map(|i| (i.tree, i.fitness)).collect() }
    }
}

/// In order, so that equal memos are written as equal files.
impl From<Memo> for Vec<Individual> {
    fn from(memo: Memo) -> Self {
        let mut judged: Self =
            memo.known.into_iter().map(|(tree, fitness)| Individual { tree, fitness }).collect();
        judged.sort_unstable();
        judged
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_with_operands_exchanged_are_one_entry() {
        let [one, ab, ba] = ["1", "1 + 2", "2 + 1"].map(|text| text.parse().unwrap());
        let mut memo = Memo::default();
        let missing = memo.missing([&ba, &ab, &one]);
        assert_eq!(missing, [ab.clone(), one]);
        memo.insert(Individual { tree: ab, fitness: 3.0 });
        assert_eq!(memo.get(&ba), Some(3.0));
        assert!(memo.missing([&ba]).is_empty());
    }
}
