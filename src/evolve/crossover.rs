//! Crossover (Section 4.1 of the paper).

use rand::RngExt;
use rand::seq::IndexedRandom;

use super::rng::Stream;
use super::settings::Settings;
use super::variation::{ATTEMPTS, positions_of_sort};
use crate::expr::Tree;

/// A child of two trees.
///
/// One node of each is the crossover point, the second's of the sort that the
/// first's is (the grammar of Figure 2 allows no other exchange); the subtrees
/// below change places; and one of the two results is the child. Where both
/// exceed the limits other points are tried, and in the end the child is the
/// first parent.
pub fn crossover(first: &Tree, second: &Tree, settings: &Settings, rng: &mut Stream) -> Tree {
    for _ in 0..ATTEMPTS {
        let at = rng.random_range(0..first.len());
        let partners = positions_of_sort(second, first.symbols()[at].sort());
        let Some(&from) = partners.choose(rng) else { continue };
        let exchanged = [(first, at, second, from), (second, from, first, at)];
        let child = exchanged.into_iter().find_map(|(host, gap, donor, graft)| {
            let child = host.replace(gap, &donor.subtree(graft)).expect("the points' sorts agree");
            settings.admit(&child).then_some(child)
        });
        if let Some(child) = child {
            return child;
        }
    }
    first.clone()
}
