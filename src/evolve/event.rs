//! What a search tells while it runs.

use super::error::Error;
use super::history::Row;
use super::individual::Individual;

/// News from a search, for progress lines and logs.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A batch of a generation's new expressions has been judged.
    Batch {
        /// The generation that is being formed; 0 is the initial population.
        generation: u32,
        /// Its expressions judged so far.
        judged: usize,
        /// Its expressions to be judged in all.
        of: usize,
    },
    /// A generation is complete.
    Generation {
        /// Which; 0 is the initial population.
        generation: u32,
        /// The last one.
        of: u32,
        /// One row per island.
        islands: &'a [Row],
        /// The best of the whole run so far.
        best: &'a Individual,
    },
    /// A checkpoint was due, or breeding has ended.
    Checkpoint {
        /// Whether one was asked for and could be written.
        written: bool,
        /// The generations that are complete, the initial one included.
        complete: u32,
        /// The best so far, if anything was judged: not yet judged in full.
        best: Option<&'a Individual>,
        /// How many expressions were judged.
        evaluations: usize,
        /// The rows of all complete generations, one per island.
        rows: &'a [Row],
        /// Why the checkpoint could not be written, if it could not, and no earlier one
        /// failed for the same cause.
        failure: Option<&'a Error>,
    },
    /// The finalists are about to be judged in full.
    Finalists {
        /// How many there are.
        count: usize,
    },
    /// A finalist is about to be compared with its exact meaning.
    Comparison {
        /// Which; 0 is the best.
        rank: usize,
    },
}
