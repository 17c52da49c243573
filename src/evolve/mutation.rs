//! The mutations (Section 4.2 of the paper), and one of our own.

use std::f64::consts::TAU;

use rand::RngExt;
use rand::seq::IndexedRandom;

use super::materials::Materials;
use super::settings::{MutationWeights, Settings};
use super::variation::{ATTEMPTS, positions_of_sort};
use crate::expr::{Sort, Symbol, Tree};
use crate::tune::Stream;

/// A kind of mutation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mutation {
    /// A random node becomes a compatible one of the grammar. Its operands stay.
    Replace,
    /// Two random compatible nodes change places with their subtrees, unless
    /// one lies within the other.
    Swap,
    /// A random node with its subtree becomes an expression from the codebook.
    Insert,
    /// A random node with its subtree becomes the constant 1.
    Delete,
    /// A random constant is multiplied by a log-normal factor (an extension).
    Jitter,
}

impl Mutation {
    /// Every kind.
    pub const ALL: [Self; 5] =
        [Self::Replace, Self::Swap, Self::Insert, Self::Delete, Self::Jitter];

    /// How often it is tried, relative to the others.
    fn weight(self, weights: &MutationWeights) -> f64 {
        match self {
            Self::Replace => weights.replace,
            Self::Swap => weights.swap,
            Self::Insert => weights.insert,
            Self::Delete => weights.delete,
            Self::Jitter => weights.jitter,
        }
    }

    /// Applies it once, at random nodes. `None` if it does not apply there.
    pub fn apply(
        self,
        tree: &Tree,
        materials: &Materials,
        jitter_sigma: f64,
        rng: &mut Stream,
    ) -> Option<Tree> {
        let mutant = match self {
            Self::Replace => {
                let at = rng.random_range(0..tree.len());
                let other = materials.vocabulary().replacement(rng, tree.symbols()[at])?;
                tree.with_symbol(at, other)
            }
            Self::Swap => {
                let first = rng.random_range(0..tree.len());
                let partners = positions_of_sort(tree, tree.symbols()[first].sort());
                tree.swap(first, *partners.choose(rng)?)?
            }
            Self::Insert => {
                let scalars = positions_of_sort(tree, Sort::Scalar);
                tree.replace(*scalars.choose(rng)?, materials.codebook().choose(rng)?)
            }
            Self::Delete => {
                let scalars = positions_of_sort(tree, Sort::Scalar);
                tree.replace(*scalars.choose(rng)?, &Tree::constant(1.0))
            }
            Self::Jitter => {
                let numbers = tree.symbols().iter().enumerate();
                let constants: Vec<(usize, f32)> =
                    numbers.filter_map(|(at, symbol)| Some((at, symbol.number()?))).collect();
                let &(at, value) = constants.choose(rng)?;
                let factor = (jitter_sigma * normal(rng)).exp();
                tree.with_symbol(at, Symbol::constant(rounded(f64::from(value) * factor)))
            }
        };
        Some(mutant.expect("a mutation puts nodes where nodes of their sort stood"))
    }
}

/// A mutant of a tree: one mutation of a random kind. Where that breaks the
/// limits, changes nothing or does not apply, another one is tried; in the end
/// the tree stays as it is.
pub fn mutate(tree: &Tree, materials: &Materials, settings: &Settings, rng: &mut Stream) -> Tree {
    for _ in 0..ATTEMPTS {
        let kind = Mutation::ALL
            .choose_weighted(rng, |kind| kind.weight(&settings.mutations))
            .expect("settings hold the weights to finite numbers, one of them positive");
        let mutant = kind.apply(tree, materials, settings.jitter_sigma, rng);
        if let Some(mutant) = mutant.filter(|m| m != tree && settings.admit(m)) {
            return mutant;
        }
    }
    tree.clone()
}

/// A standard normal deviate (Box and Muller).
pub(super) fn normal(rng: &mut Stream) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (TAU * rng.random::<f64>()).cos()
}

/// A constant to three significant digits: more would clutter the expressions,
/// and make two of them differ that filter alike.
fn rounded(x: f64) -> f32 {
    format!("{x:.2e}").parse().expect("Rust reads the numbers it writes")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::evolve::settings::Preset;
    use crate::tune::stream;

    /// Applies a kind at many random places; the distinct results as text.
    fn mutants(kind: Mutation, of: &str) -> Vec<String> {
        let materials = Materials::new(&Preset::Weights.settings()).unwrap();
        let tree: Tree = of.parse().unwrap();
        let mut mutants: Vec<String> = (0..300)
            .filter_map(|k| kind.apply(&tree, &materials, 0.5, &mut stream(1, 0, 0, k)))
            .map(|mutant| mutant.to_string())
            .collect();
        mutants.sort_unstable();
        mutants.dedup();
        mutants
    }

    #[test]
    fn delete_puts_the_constant_1_for_any_number() {
        let found = mutants(Mutation::Delete, "exp(-distance2(normal, normal))");
        assert_eq!(found, ["1", "exp(-(1))", "exp(1)"]);
    }

    #[test]
    fn swap_never_takes_a_node_with_its_own_subtree() {
        assert!(mutants(Mutation::Swap, "exp(sin(sqrt(0.2)))").is_empty());
        let found = mutants(Mutation::Swap, "sin(0.2) / cos(3)");
        assert_eq!(
            found,
            ["3 / cos(sin(0.2))", "cos(3) / sin(0.2)", "sin(3) / cos(0.2)", "sin(cos(3)) / 0.2"]
        );
    }

    #[test]
    fn insert_puts_an_entry_of_the_codebook_for_any_number() {
        let found = mutants(Mutation::Insert, "1");
        assert!(found.contains(&"mitchell(distance2(normal, normal))".to_owned()), "{found:?}");
        let materials = Materials::new(&Preset::Weights.settings()).unwrap();
        let entries: Vec<String> = materials.codebook().iter().map(Tree::to_string).collect();
        assert!(found.iter().all(|mutant| entries.contains(mutant)));
    }

    #[test]
    fn jitter_keeps_a_constants_sign_and_three_digits_of_it() {
        assert!(mutants(Mutation::Jitter, "exp(distance2(normal, normal))").is_empty());
        for mutant in mutants(Mutation::Jitter, "0.3333") {
            let value: f64 = mutant.parse().unwrap();
            assert!(value > 0.0 && mutant.trim_start_matches(['0', '.']).len() <= 4, "{mutant}");
        }
    }

    proptest! {
        #[test]
        fn replace_and_jitter_keep_the_shape_and_swap_the_symbols(seed in 0..u64::MAX) {
            let settings = Preset::Weights.settings();
            let materials = Materials::new(&settings).unwrap();
            let mut rng = stream(seed, 0, 0, 0);
            let mut tree = materials.initial().clone();
            for _ in 0..5 {
                tree = mutate(&tree, &materials, &settings, &mut rng);
            }
            for kind in [Mutation::Replace, Mutation::Jitter] {
                if let Some(mutant) = kind.apply(&tree, &materials, 0.5, &mut rng) {
                    let pairs = || tree.symbols().iter().zip(mutant.symbols());
                    prop_assert_eq!(mutant.len(), tree.len());
                    prop_assert!(pairs().all(|(a, b)| a.operands() == b.operands()));
                    prop_assert!(pairs().filter(|(a, b)| a != b).count() <= 1);
                }
            }
            if let Some(mutant) = Mutation::Swap.apply(&tree, &materials, 0.5, &mut rng) {
                let sorted = |t: &Tree| {
                    let mut symbols = t.symbols().to_vec();
                    symbols.sort_unstable();
                    symbols
                };
                prop_assert_eq!(sorted(&mutant), sorted(&tree));
            }
        }
    }
}
