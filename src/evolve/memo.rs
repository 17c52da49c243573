//! What has been judged already, and how.

use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use super::canonical::canonical;
use super::individual::{Individual, Judgement};
use super::race::{Bar, Entrant};
use crate::expr::Tree;

/// The verdicts on the expressions judged so far. The keys are canonical trees themselves, not
/// their hashes: two expressions can never be taken for one.
///
/// Between generations those that were not bred for longest are [forgotten](Self::forget) if
/// they are too many. What is forgotten depends on the generations alone, and neither on
/// batches nor on whether the search was resumed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Memo {
    #[serde(with = "ordered")]
    known: FxHashMap<Tree, Entry>,
    forgotten: Forgotten,
}

/// What is known of an expression.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry {
    verdict: Judgement,
    /// The latest generation that bred it.
    bred: u32,
}

/// How many verdicts were forgotten.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Forgotten {
    all: usize,
    dropped: usize,
}

/// What an expression counts beside its nodes.
const ENTRY: usize = 16;

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
        self.known.get(&canonical(tree)).map(|entry| entry.verdict)
    }

    /// The expressions among those that a generation bred that are yet to be judged,
    /// canonical, each once, in the order of their first appearance. Who was dropped races
    /// again if the bar is now weaker than the value that it was given.
    pub fn missing<'a, 'b>(
        &mut self,
        generation: u32,
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
        newcomers.retain(|newcomer| {
            let Some(entry) = self.known.get_mut(&newcomer.tree) else { return true };
            entry.bred = generation;
            match entry.verdict {
                Judgement::Full(_) => false,
                Judgement::Dropped(value) => newcomer.bar.is_none_or(|bar| bar.fitness > value),
            }
        });
        newcomers
    }

    /// Remembers the verdict on a canonical expression that a generation bred; whether it is
    /// the first that is known.
    pub fn insert(&mut self, generation: u32, judged: Individual) -> bool {
        let entry = Entry { verdict: judged.verdict(), bred: generation };
        self.known.insert(judged.tree, entry).is_none()
    }

    /// Forgets as few as it takes so that the others have no more than so many nodes, each
    /// counting as 16 more than it has: first those that were not bred for longest; of one
    /// generation the largest.
    pub fn forget(&mut self, most: usize) {
        let cost = |tree: &Tree| tree.len() + ENTRY;
        let mut sum: usize = self.known.keys().map(cost).sum();
        if sum <= most {
            return;
        }
        let mut all: Vec<(&Tree, &Entry)> = self.known.iter().collect();
        all.sort_unstable_by(|(a, x), (b, y)| {
            x.bred.cmp(&y.bred).then(b.len().cmp(&a.len())).then_with(|| a.cmp(b))
        });
        let mut gone: Vec<Tree> = Vec::new();
        for (tree, entry) in all {
            if sum <= most {
                break;
            }
            sum -= cost(tree);
            self.forgotten.all += 1;
            self.forgotten.dropped += usize::from(!entry.verdict.is_full());
            gone.push(tree.clone());
        }
        for tree in gone {
            self.known.remove(&tree);
        }
    }

    /// How many expressions were dropped from every race they ran.
    pub fn dropped(&self) -> usize {
        let known = self.known.values().filter(|entry| !entry.verdict.is_full()).count();
        known + self.forgotten.dropped
    }

    /// How many expressions have been judged; one that was judged again after it was
    /// forgotten counts again.
    pub fn len(&self) -> usize {
        self.known.len() + self.forgotten.all
    }

    /// Whether nothing has been judged yet.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Verdicts in order, so that equal memos are written as equal files.
mod ordered {
    use rustc_hash::FxHashMap;
    use serde::{Deserialize, Deserializer, Serializer};

    use super::Entry;
    use crate::evolve::individual::Individual;
    use crate::expr::Tree;

    pub(super) fn serialize<S: Serializer>(
        known: &FxHashMap<Tree, Entry>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let judged = known
            .iter()
            .map(|(tree, entry)| (Individual::new(tree.clone(), entry.verdict), entry.bred));
        let mut judged: Vec<(Individual, u32)> = judged.collect();
        judged.sort_unstable();
        serializer.collect_seq(judged)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<FxHashMap<Tree, Entry>, D::Error> {
        let judged = Vec::<(Individual, u32)>::deserialize(deserializer)?;
        let entry = |(individual, bred): (Individual, u32)| {
            let verdict = individual.verdict();
            (individual.tree, Entry { verdict, bred })
        };
        Ok(judged.into_iter().map(entry).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_with_operands_exchanged_are_one_entry() {
        let [one, ab, ba] = ["1", "1 + 2", "2 + 1"].map(|text| text.parse().unwrap());
        let mut memo = Memo::default();
        let missing = memo.missing(0, [(&ba, None), (&ab, None), (&one, None)]);
        assert_eq!(missing, [&ab, &one].map(|t| Newcomer { tree: t.clone(), bar: None }));
        memo.insert(0, Individual::new(ab, Judgement::Full(3.0)));
        assert_eq!(memo.get(&ba), Some(Judgement::Full(3.0)));
        assert!(memo.missing(0, [(&ba, None)]).is_empty());
    }

    #[test]
    fn an_expression_meets_the_weaker_bar_and_races_again_for_a_weaker_one_only() {
        let [tree, bar] = ["2", "1"].map(|text| text.parse::<Tree>().unwrap());
        let bars = [1.0, 3.0].map(|f| Individual::new(bar.clone(), Judgement::Full(f)));
        let mut memo = Memo::default();
        let missing = memo.missing(0, [(&tree, Some(&bars[1])), (&tree, Some(&bars[0]))]);
        assert_eq!(missing, [Newcomer { tree: tree.clone(), bar: Some(&bars[1]) }]);
        assert_eq!(memo.missing(0, [(&tree, Some(&bars[1])), (&tree, None)])[0].bar, None);
        assert!(memo.insert(0, Individual::new(tree.clone(), Judgement::Dropped(2.0))));
        assert!(memo.missing(0, [(&tree, Some(&bars[0]))]).is_empty());
        assert_eq!(memo.missing(0, [(&tree, Some(&bars[1]))]).len(), 1);
        assert_eq!(memo.missing(0, [(&tree, None)]).len(), 1);
        assert!(!memo.insert(0, Individual::new(tree, Judgement::Full(2.0))));
        assert_eq!((memo.len(), memo.dropped()), (1, 0));
    }

    #[test]
    fn those_not_bred_for_longest_are_forgotten_and_counted() {
        let trees: Vec<Tree> =
            ["1", "2", "exp(3)", "4 + 5"].map(|text| text.parse().unwrap()).into();
        let mut memo = Memo::default();
        for (k, tree) in trees.iter().enumerate() {
            let verdict = match k {
                1 => Judgement::Dropped(1.0),
                _ => Judgement::Full(k as f64),
            };
            assert!(memo.insert(k as u32 / 2, Individual::new(tree.clone(), verdict)));
        }
        let known = |memo: &Memo| trees.iter().map(|t| memo.get(t).is_some()).collect::<Vec<_>>();
        let all = 4 * ENTRY + 1 + 1 + 2 + 3;
        memo.forget(all);
        assert_eq!(known(&memo), [true; 4]);
        // The first is bred again.
        assert!(memo.missing(2, [(&trees[0], None)]).is_empty());
        let mut fewer = memo.clone();
        fewer.forget(all - 1);
        assert_eq!(known(&fewer), [true, false, true, true]);
        assert_eq!((fewer.len(), fewer.dropped()), (4, 1));
        // Of one generation the larger one.
        fewer.forget(all - ENTRY - 2);
        assert_eq!(known(&fewer), [true, false, true, false]);
        assert!(fewer.insert(3, Individual::new(trees[1].clone(), Judgement::Dropped(2.0))));
        assert_eq!((fewer.len(), fewer.dropped()), (5, 2));

        let written = serde_json::to_string(&memo).unwrap();
        let mut read: Memo = serde_json::from_str(&written).unwrap();
        assert_eq!(serde_json::to_string(&read).unwrap(), written);
        read.forget(all - 1);
        assert_eq!(known(&read), [true, false, true, true]);
        read.forget(0);
        assert!(known(&read).iter().all(|known| !known) && !read.is_empty());
    }
}
