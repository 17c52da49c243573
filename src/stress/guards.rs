//! Where and why the guards of weighted means act, by the exact sums.

use serde::Serialize;

use super::trial::Trial;
use crate::backend::TRUSTED_SUM;
use crate::backend::reference::meaning::Weighed;

/// Numbers of pixels of a gather that keep what was to be averaged: of the paper's filters
/// the noisy colour.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Guards {
    /// The stage's name.
    pub stage: String,
    /// Pixels that it has in all.
    pub pixels: usize,
    /// Kept, as the weights sum to less than [`TRUSTED_SUM`]: nothing in the
    /// window is alike.
    pub vanished: usize,
    /// Kept, as the sum is less than
    /// [`TRUSTED_SHARE`](crate::backend::TRUSTED_SHARE) of that of the weights' magnitudes:
    /// they cancel.
    pub cancelled: usize,
    /// Kept, as the sums left the range of `f32`.
    pub overflowed: usize,
    /// Of which back ends promise nothing: those above, but for overflows, and those so
    /// close to them that rounding decides.
    pub unpromised: usize,
    /// Those of them where weights cancel, and do not just vanish.
    pub doubtful: usize,
}

impl Guards {
    /// Counts the pixels of a trial's gathers.
    pub(super) fn of(trial: &Trial<'_>) -> Vec<Self> {
        let stages = &trial.filter.stages;
        let name = |gather: &Weighed| stages[gather.stage].name.clone();
        trial.meaning.gathers.iter().map(|gather| Self::count(name(gather), gather)).collect()
    }

    fn count(stage: String, gather: &Weighed) -> Self {
        let mut guards = Self { stage, pixels: gather.sums.len(), ..Self::default() };
        for sums in &gather.sums {
            let total = sums.total.abs();
            let unpromised = !sums.is_promised();
            guards.unpromised += usize::from(unpromised);
            // Few weights of both signs may vanish too, together.
            let cancels = total < sums.magnitude / 2.0;
            guards.doubtful += usize::from(unpromised && cancels);
            if total < f64::from(TRUSTED_SUM) && !cancels {
                guards.vanished += 1;
            } else if !sums.is_trusted() {
                guards.cancelled += 1;
            } else if sums.overflows() {
                guards.overflowed += 1;
            }
        }
        guards
    }
}
