//! Racing: giving up early on expressions that cannot win.
//!
//! Most children are worse than their parents, and with tournaments of eight
//! what stands in the lower half of an island almost never becomes a parent
//! (in one draw of 256). To learn that an expression belongs there takes a
//! fraction of what judging it takes. So each island holds its newcomers to a
//! [`Bar`], an individual at some quantile of the generation before, and a
//! fitness may drop a newcomer as soon as what it has seen says that it cannot
//! beat the bar. A dropped expression keeps a place, with a value that is an
//! estimate and no better than the bar's; whatever is reported, remembered as
//! the best or handed on as the elite has been judged in full.

use serde::{Deserialize, Serialize};

use super::canonical::canonical;
use super::individual::{Individual, Judgement};
use crate::expr::Tree;

/// What an expression has to beat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bar<'a> {
    /// An expression that has been judged in full.
    pub tree: &'a Tree,
    /// Its fitness, which is finite.
    pub fitness: f64,
}

/// An expression to be judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entrant<'a> {
    /// The expression.
    pub tree: &'a Tree,
    /// What it is held to; without a bar it is judged in full.
    pub bar: Option<Bar<'a>>,
}

/// A verdict and what it took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ruling {
    /// The verdict.
    pub verdict: Judgement,
    /// Work done on this entrant, in the unit of [`Fitness::work`](super::Fitness::work).
    pub work: u64,
}

/// Work done, and what it would have been without racing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Work {
    /// Done.
    pub done: u64,
    /// To judge every expression in full.
    pub exhaustive: u64,
}

/// What newcomers to an island are held to: the individual at a quantile of its
/// population, or the next better one that was judged in full. None if that one
/// is good for nothing itself. The tree is canonical.
pub(super) fn bar(population: &[Individual], quantile: f64) -> Option<Individual> {
    let mut ranked: Vec<&Individual> = population.iter().collect();
    ranked.sort_unstable();
    let at = ((ranked.len() as f64 * quantile) as usize).min(ranked.len() - 1);
    let bar = ranked[..=at].iter().rev().find(|individual| individual.full)?;
    bar.fitness.is_finite().then(|| Individual { tree: canonical(&bar.tree), ..**bar })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_stands_at_its_quantile_and_was_judged_in_full() {
        let individual = |k: usize| Individual {
            tree: Tree::constant(k as f32),
            fitness: if k < 8 { k as f64 } else { f64::INFINITY },
            full: ![3, 4, 5].contains(&k),
        };
        let population: Vec<Individual> = (0..10).rev().map(individual).collect();
        let at = |quantile| bar(&population, quantile).map(|bar| bar.fitness);
        assert_eq!(at(0.0), Some(0.0));
        assert_eq!(at(0.25), Some(2.0));
        assert_eq!(at(0.5), Some(2.0));
        assert_eq!(at(0.75), Some(7.0));
        assert_eq!(at(1.0), None);
    }
}
