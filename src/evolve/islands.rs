//! The island model: populations that evolve apart, and the ring between them.

use super::individual::Individual;

/// An island's individuals.
pub type Population = Vec<Individual>;

/// The best individual of an island.
pub fn best(population: &[Individual]) -> &Individual {
    population.iter().min().expect("settings give every island two individuals or more")
}

/// Sends a copy of each island's best to the next one, around the ring, where
/// it takes the place of the worst (Section 4, after Brady et al. 2014). All
/// depart before any arrives, and an island's own best is never displaced.
pub fn migrate(islands: &mut [Population]) {
    let mut migrants: Vec<Individual> = islands.iter().map(|p| best(p).clone()).collect();
    migrants.rotate_right(1);
    for (population, migrant) in islands.iter_mut().zip(migrants) {
        let worst = population.iter_mut().max().expect("islands are not empty");
        *worst = migrant;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::Tree;

    #[test]
    fn the_best_moves_on_around_the_ring_and_the_worst_makes_room() {
        let individual =
            |fitness: f64| Individual { tree: Tree::constant(fitness as f32), fitness, full: true };
        let island = |values: [f64; 3]| values.map(individual).to_vec();
        let mut islands =
            [island([5.0, 1.0, 9.0]), island([2.0, 8.0, 6.0]), island([7.0, 4.0, 3.0])];
        migrate(&mut islands);
        let values: Vec<Vec<f64>> =
            islands.iter().map(|p| p.iter().map(|i| i.fitness).collect()).collect();
        assert_eq!(values, [[5.0, 1.0, 3.0], [2.0, 1.0, 6.0], [2.0, 4.0, 3.0]]);
    }

    #[test]
    fn a_lone_island_keeps_its_best() {
        let tree = Tree::constant(1.0);
        let mut islands = [[4.0, 2.0]
            .map(|fitness| Individual { tree: tree.clone(), fitness, full: true })
            .to_vec()];
        migrate(&mut islands);
        assert_eq!(best(&islands[0]).fitness, 2.0);
    }
}
