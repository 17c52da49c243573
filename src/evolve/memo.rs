//! What has been judged already, and how.

use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use super::canonical::canonical;
use super::individual::{Individual, Judgement};
use super::race::{Bar, Entrant};
use crate::expr::Tree;

/// The verdict on every expression judged so far. The keys are canonical trees
/// themselves, not their hashes: two expressions can never be taken for one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(from = "Vec<Individual>", into = "Vec<Individual>")]
pub struct Memo {
    known: FxHashMap<Tree, Judgement>,
}

/// An expression to be judged, and the weakest of the bars that the islands on
/// which it was bred hold it to.
#[derive(Clone, Debug, PartialEq)]
pub struct Newcomer<'a> {
    /// The expression, canonical.
    pub tree: Tree,
    /// The bar; none if an island has none.
    pub bar: Option<&'a Individual>,
}

impl Newcomer<'_> {
    /// The same as a race wants it.
    pub fn entrant(&self) -> Entrant<'_> {
        let bar = self.bar.map(|bar| Bar { tree: &bar.tree, fitness: bar.fitness });
        Entrant { tree: &self.tree, bar }
    }
}

impl Memo {
    /// The verdict on an expression, if it or a variant of it with operands
    /// exchanged has been judged.
    pub fn get(&self, tree: &Tree) -> Option<Judgement> {
        self.known.get(&canonical(tree)).copied()
    }

    /// The expressions among those bred that are yet to be judged, canonical, each
    /// once, in the order of their first appearance. Who was dropped races again
    /// if the bar is now weaker than the value that it was given.
    pub fn missing<'a, 'b>(
        &self,
        bred: impl IntoIterator<Item = (&'b Tree, Option<&'a Individual>)>,
    ) -> Vec<Newcomer<'a>> {
        let mut places = FxHashMap::default();
        let mut newcomers: Vec<Newcomer<'a>> = Vec::new();
        for (tree, bar) in bred {
            let tree = canonical(tree);
            let at = *places.entry(tree.clone()).or_insert(newcomers.len());
            match newcomers.get_mut(at) {
                Some(newcomer) => newcomer.bar = newcomer.bar.zip(bar).map(|(a, b)| a.max(b)),
                None => newcomers.push(Newcomer { tree, bar }),
            }
        }
        newcomers.retain(|newcomer| match self.known.get(&newcomer.tree) {
            None => true,
            Some(Judgement::Full(_)) => false,
            Some(&Judgement::Dropped(value)) => newcomer.bar.is_none_or(|bar| bar.fitness > value),
        });
        newcomers
    }

    /// Remembers the verdict on a canonical expression; whether it is the first.
    pub fn insert(&mut self, judged: Individual) -> bool {
        let verdict = judged.verdict();
        self.known.insert(judged.tree, verdict).is_none()
    }

    /// How many expressions were dropped from every race they ran.
    pub fn dropped(&self) -> usize {
        self.known.values().filter(|verdict| !verdict.is_full()).count()
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
        Self { known: judged.into_iter().map(|i| (i.tree.clone(), i.verdict())).collect() }
    }
}

/// In order, so that equal memos are written as equal files.
impl From<Memo> for Vec<Individual> {
    fn from(memo: Memo) -> Self {
        let individual = |(tree, verdict)| Individual::new(tree, verdict);
        let mut judged: Self = memo.known.into_iter().map(individual).collect();
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
        let missing = memo.missing([(&ba, None), (&ab, None), (&one, None)]);
        assert_eq!(missing, [&ab, &one].map(|t| Newcomer { tree: t.clone(), bar: None }));
        memo.insert(Individual::new(ab, Judgement::Full(3.0)));
        assert_eq!(memo.get(&ba), Some(Judgement::Full(3.0)));
        assert!(memo.missing([(&ba, None)]).is_empty());
    }

    #[test]
    fn an_expression_meets_the_weaker_bar_and_races_again_for_a_weaker_one_only() {
        let [tree, bar] = ["2", "1"].map(|text| text.parse::<Tree>().unwrap());
        let bars = [1.0, 3.0].map(|f| Individual::new(bar.clone(), Judgement::Full(f)));
        let mut memo = Memo::default();
        let missing = memo.missing([(&tree, Some(&bars[1])), (&tree, Some(&bars[0]))]);
        assert_eq!(missing, [Newcomer { tree: tree.clone(), bar: Some(&bars[1]) }]);
        assert_eq!(memo.missing([(&tree, Some(&bars[1])), (&tree, None)])[0].bar, None);
        assert!(memo.insert(Individual::new(tree.clone(), Judgement::Dropped(2.0))));
        assert!(memo.missing([(&tree, Some(&bars[0]))]).is_empty());
        assert_eq!(memo.missing([(&tree, Some(&bars[1]))]).len(), 1);
        assert_eq!(memo.missing([(&tree, None)]).len(), 1);
        assert!(!memo.insert(Individual::new(tree, Judgement::Full(2.0))));
        assert_eq!((memo.len(), memo.dropped()), (1, 0));
    }
}
