//! What the search minimises.

use super::individual::Judgement;
use super::race::{Entrant, Ruling};
use crate::expr::Tree;
use crate::scene::Fingerprint;

/// Judges expressions (Section 4.3 of the paper): lower is better.
///
/// The search is generic over this trait, and knows nothing of images.
pub trait Fitness: Sync {
    /// What can go wrong while judging, for reasons other than the expressions.
    type Error: std::error::Error + Send + Sync + 'static;

    /// Judges expressions for breeding: one value each, in order. May look at a
    /// subset of the training data, but must be a function of the expression
    /// alone: the search remembers values, and never asks twice.
    ///
    /// A value is never NaN; `+inf` says that an expression is good for nothing, and is
    /// remembered like any other. What fails for reasons of the moment (no memory, a lost
    /// device) is an error instead: the search stops, and can be resumed.
    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Self::Error>;

    /// Judges expressions by everything there is. The finalists are chosen by
    /// this, and it is what gets reported.
    fn evaluate_full(&self, trees: &[Tree]) -> Result<Vec<f64>, Self::Error> {
        self.evaluate(trees)
    }

    /// How far what is computed for an expression is from what it means, at worst. A
    /// finalist that is further than [`tolerance`](Self::tolerance) does not win while
    /// another is not: where the expression is used, its rounding errors may grow.
    fn difference(&self, _tree: &Tree) -> Result<f64, Self::Error> {
        Ok(0.0)
    }

    /// The greatest difference that does no harm.
    fn tolerance(&self) -> f64 {
        0.0
    }

    /// Why an expression must not win, whatever its fitness, if there is a reason. It
    /// wins all the same if nobody else may.
    fn objection(&self, _tree: &Tree) -> Result<Option<String>, Self::Error> {
        Ok(None)
    }

    /// Judges expressions for breeding, but may drop those that cannot beat their
    /// bars. Each verdict must be a function of the entrant alone; `Full` values
    /// are those of [`evaluate`](Self::evaluate), `Dropped` ones not below the
    /// bar's. By default nobody is dropped.
    fn race(&self, entrants: &[Entrant<'_>]) -> Result<Vec<Ruling>, Self::Error> {
        self.judge_all(entrants)
    }

    /// A race in which everybody is judged in full.
    fn judge_all(&self, entrants: &[Entrant<'_>]) -> Result<Vec<Ruling>, Self::Error> {
        let trees: Vec<Tree> = entrants.iter().map(|entrant| entrant.tree.clone()).collect();
        let ruling = |value| Ruling { verdict: Judgement::Full(value), work: self.work() };
        Ok(self.evaluate(&trees)?.into_iter().map(ruling).collect())
    }

    /// What judging one expression in full takes, in some unit of work.
    fn work(&self) -> u64 {
        1
    }

    /// Whether an error says no more than that somebody asked to stop while expressions were
    /// judged. What was judged in part is then thrown away, and the search ends as if it had
    /// been stopped before that.
    fn is_stop(_error: &Self::Error) -> bool {
        false
    }

    /// The pictures that expressions are judged by. A checkpoint is only resumed with the
    /// same ones.
    fn pictures(&self) -> Vec<Fingerprint> {
        Vec::new()
    }

    /// Names what expressions are judged against (scenes, subset, radius, …).
    /// A checkpoint is only resumed under the name that it was written under,
    /// because values of another fitness would mean nothing.
    fn identity(&self) -> String;
}
