//! Crossover (Section 4.1 of the paper).

use rand::RngExt;
use rand::seq::IndexedRandom;

use super::settings::Settings;
use super::variation::{ATTEMPTS, positions_of_sort};
use crate::expr::Tree;
use crate::tune::Stream;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evolve::settings::Preset;
    use crate::tune::stream;

    #[test]
    fn a_child_is_one_parent_with_a_part_of_the_other() {
        let first: Tree = "exp(distance2(normal, normal))".parse().unwrap();
        let second: Tree = "sin(0.2) * 3".parse().unwrap();
        let settings = Preset::Paper.settings();
        let parts = |tree: &Tree| (0..tree.len()).map(|at| tree.subtree(at)).collect::<Vec<_>>();
        let hosts = |host: &Tree, donor: &Tree, child: &Tree| {
            (0..host.len()).any(|at| {
                parts(donor).iter().any(|part| host.replace(at, part).as_ref() == Ok(child))
            })
        };
        for index in 0..200 {
            let child = crossover(&first, &second, &settings, &mut stream(1, 0, 0, index));
            assert!(hosts(&first, &second, &child) || hosts(&second, &first, &child), "{child}");
        }
    }

    #[test]
    fn where_no_child_is_small_enough_the_first_parent_stays() {
        let settings = Settings { max_nodes: 2, ..Preset::Paper.settings() };
        let first: Tree = "distance2(normal, normal)".parse().unwrap();
        let second: Tree = "distance1(depth, depth)".parse().unwrap();
        for index in 0..50 {
            let child = crossover(&first, &second, &settings, &mut stream(1, 0, 0, index));
            assert_eq!(child, first);
        }
    }
}
