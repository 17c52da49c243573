//! What the search minimises.

use crate::expr::Tree;

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
    /// A value is never NaN; `+inf` says that an expression is good for nothing.
    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Self::Error>;

    /// Judges expressions by everything there is. The finalists are chosen by
    /// this, and it is what gets reported.
    fn evaluate_full(&self, trees: &[Tree]) -> Result<Vec<f64>, Self::Error> {
        self.evaluate(trees)
    }

    /// Names what expressions are judged against (scenes, subset, radius, …).
    /// A checkpoint is only resumed under the name that it was written under,
    /// because values of another fitness would mean nothing.
    fn identity(&self) -> String;
}
