//! How a generation is made of the one before (Section 4.4 of the paper).

use rand::RngExt;

use super::crossover::crossover;
use super::individual::Individual;
use super::islands::best;
use super::materials::Materials;
use super::mutation::mutate;
use super::selection::tournament;
use super::settings::Settings;
use crate::expr::Tree;
use crate::tune::stream;

/// The occupant of a place in a new generation.
#[derive(Clone, Debug)]
pub enum Child {
    /// Reproduced from the previous generation, and judged there.
    Judged(Individual),
    /// New, and yet to be judged.
    New(Tree),
}

impl Child {
    /// The expression, if it is yet to be judged.
    pub fn tree(&self) -> Option<&Tree> {
        match self {
            Self::Judged(_) => None,
            Self::New(tree) => Some(tree),
        }
    }
}

/// Where an individual-to-be stands; names its random stream.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Which generation; 0 is the initial population.
    pub generation: u32,
    /// Which island.
    pub island: usize,
    /// Which place on it.
    pub index: usize,
}

/// An individual of the initial population: the initial expression itself in
/// the first place of each island, else a random mutant of it (Section 4).
pub fn initial(place: Place, materials: &Materials, settings: &Settings) -> Child {
    let mut tree = materials.initial().clone();
    if place.index > 0 {
        let mut rng = stream(settings.seed, place.island, place.generation, place.index);
        for _ in 0..rng.random_range(1..=settings.initial_mutations) {
            tree = mutate(&tree, materials, settings, &mut rng);
        }
    }
    Child::New(tree)
}

/// An individual of a later generation, from its island's previous one.
///
/// The first place is the island's best, always. The others are shared out
/// between reproduction, crossover and mutation in that order, by the
/// settings' shares; every parent is the winner of a tournament.
pub fn offspring(
    place: Place,
    previous: &[Individual],
    materials: &Materials,
    settings: &Settings,
) -> Child {
    if place.index == 0 {
        return Child::Judged(best(previous).clone());
    }
    let mut rng = stream(settings.seed, place.island, place.generation, place.index);
    let parent = tournament(previous, settings.tournament, &mut rng);
    let share = (place.index as f64 + 0.5) / previous.len() as f64;
    if share < settings.reproduction {
        Child::Judged(parent.clone())
    } else if share < settings.reproduction + settings.crossover {
        let other = tournament(previous, settings.tournament, &mut rng);
        Child::New(crossover(&parent.tree, &other.tree, settings, &mut rng))
    } else {
        Child::New(mutate(&parent.tree, materials, settings, &mut rng))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evolve::settings::Preset;

    #[test]
    fn a_generation_is_shared_out_as_the_paper_says_and_starts_with_the_elite() {
        let settings = Preset::Paper.settings();
        let materials = Materials::new(&settings).unwrap();
        let previous: Vec<Individual> = (0..100)
            .map(|k| Individual {
                tree: Tree::constant(100.0 - k as f32),
                fitness: f64::from(100 - k),
                full: true,
            })
            .collect();
        let children: Vec<Child> = (0..100)
            .map(|index| {
                let place = Place { generation: 1, island: 0, index };
                offspring(place, &previous, &materials, &settings)
            })
            .collect();
        let judged = children.iter().filter(|c| matches!(c, Child::Judged(_))).count();
        assert_eq!(judged, 10);
        assert!(matches!(&children[0], Child::Judged(elite) if elite.fitness == 1.0));
    }
}
