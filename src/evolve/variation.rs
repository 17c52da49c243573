//! What crossover and mutation have in common.

use crate::expr::{Sort, Tree};

/// How often an operation is tried anew, with other random nodes, when it would
/// break the limits, change nothing or finds no node that it applies to.
pub(super) const ATTEMPTS: usize = 16;

/// The positions of a tree's nodes of one sort.
pub(super) fn positions_of_sort(tree: &Tree, sort: Sort) -> Vec<usize> {
    (0..tree.len()).filter(|&at| tree.symbols()[at].sort() == sort).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::evolve::crossover::crossover;
    use crate::evolve::materials::Materials;
    use crate::evolve::mutation::mutate;
    use crate::evolve::settings::{Preset, Settings};
    use crate::tune::stream;

    proptest! {
        #[test]
        fn variation_keeps_trees_well_formed_and_within_limits(seed in 0..u64::MAX) {
            let initial = "bilateral".to_owned();
            let quick = Preset::Weights.settings();
            let settings = Settings { max_nodes: 40, max_depth: 10, initial, ..quick };
            let materials = Materials::new(&settings).unwrap();
            let mut rng = stream(seed, 0, 0, 0);
            let mut parent = materials.initial().clone();
            for _ in 0..60 {
                let mutant = mutate(&parent, &materials, &settings, &mut rng);
                let child = crossover(&mutant, &parent, &settings, &mut rng);
                for tree in [&mutant, &child] {
                    prop_assert!(Tree::new(tree.symbols()).is_ok());
                    prop_assert_eq!(tree.sort(), Sort::Scalar);
                    prop_assert!(settings.admit(tree));
                }
                parent = child;
            }
        }
    }
}
