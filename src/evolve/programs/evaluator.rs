//! Who judges the children of a generation: this process, or others for it.

use rayon::prelude::*;

use super::judge::{Job, Verdict};
use crate::evolve::Error;
use crate::tune;

/// The children of a generation, to be judged in any order.
#[derive(Clone, Copy)]
pub struct Batch<'b> {
    /// What is to be judged.
    pub jobs: &'b [Job<'b>],
    /// Judges one in this process; nothing once there is a reason to end.
    pub judge: &'b (dyn Fn(&Job<'b>) -> Result<Option<Verdict>, tune::Error> + Sync),
    /// Whether there is a reason to end.
    pub ended: &'b (dyn Fn() -> bool + Sync),
    /// To be called for every job that is done.
    pub heard: &'b (dyn Fn() + Sync),
}

/// Judges children.
pub trait Evaluator: Send + Sync {
    /// The verdicts on a batch, in the order of its jobs; nothing if there was a reason to end
    /// before all were judged.
    ///
    /// # Errors
    /// If something fails that has nothing to do with the children.
    fn evaluate(&self, batch: &Batch<'_>) -> Result<Option<Vec<Verdict>>, Error>;

    /// Lets go of what it holds: no other batch is coming soon.
    fn release(&self) {}
}

/// Judges on the threads of this process.
#[derive(Clone, Copy, Debug)]
pub struct InProcess;

impl Evaluator for InProcess {
    fn evaluate(&self, batch: &Batch<'_>) -> Result<Option<Vec<Verdict>>, Error> {
        let judge = |job| {
            let verdict = (batch.judge)(job)?;
            verdict.iter().for_each(|_| (batch.heard)());
            Ok(verdict)
        };
        let verdicts = batch.jobs.par_iter().map(judge);
        let verdicts: Result<Option<Vec<Verdict>>, tune::Error> =
            verdicts.collect::<Result<Vec<_>, _>>().map(|all| all.into_iter().collect());
        verdicts.map_err(Error::fitness)
    }
}
