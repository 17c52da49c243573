//! Selection by tournament (Section 4.4 of the paper).

use rand::seq::IndexedRandom;

use super::individual::Individual;
use crate::tune::Stream;

/// The winner among `entrants` individuals drawn at random, with replacement.
pub fn tournament<'a>(
    population: &'a [Individual],
    entrants: usize,
    rng: &mut Stream,
) -> &'a Individual {
    (0..entrants)
        .filter_map(|_| population.choose(rng))
        .min()
        .expect("settings hold populations and tournaments to at least one")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::Tree;
    use crate::tune::stream;

    #[test]
    fn a_tournament_prefers_the_fit_and_a_larger_one_more_so() {
        let population: Vec<Individual> = (0..100)
            .map(|k| Individual {
                tree: Tree::constant(k as f32),
                fitness: f64::from(k),
                full: true,
            })
            .collect();
        let mut rng = stream(7, 0, 0, 0);
        let mut mean = |entrants| {
            let drawn = (0..2000).map(|_| tournament(&population, entrants, &mut rng).fitness);
            drawn.sum::<f64>() / 2000.0
        };
        // The least of k uniform draws from 0..1 is 1 / (k + 1) on average.
        assert!((mean(1) - 49.5).abs() < 3.0);
        assert!((mean(8) - 10.6).abs() < 2.0);
    }
}
