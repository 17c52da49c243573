//! Where and why the guard of Equation 1 acts, by the exact sums.

use serde::Serialize;

use super::trial::{Trial, overflows};
use crate::backend::{TRUSTED_SHARE, TRUSTED_SUM};

/// Numbers of pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Guards {
    /// Kept noisy, as the weights sum to less than [`TRUSTED_SUM`]: nothing in the
    /// window is alike.
    pub vanished: usize,
    /// Kept noisy, as the sum is less than [`TRUSTED_SHARE`] of that of the weights'
    /// magnitudes: they cancel.
    pub cancelled: usize,
    /// Kept noisy, as the sums left the range of `f32`.
    pub overflowed: usize,
    /// Of which back ends promise nothing: those above, but for overflows, and those so
    /// close to them that rounding decides.
    pub unpromised: usize,
    /// Those of them where weights cancel, and do not just vanish.
    pub doubtful: usize,
}

impl Guards {
    /// Counts the pixels of a trial.
    pub(super) fn of(trial: &Trial<'_>) -> Self {
        let mut guards = Self::default();
        let noisy = trial.scene.noisy();
        for (k, exact) in trial.exact.iter().enumerate() {
            let total = exact.total.abs();
            let unpromised = !exact.is_promised();
            guards.unpromised += usize::from(unpromised);
            // Few weights of both signs may vanish too, together.
            let cancels = total < exact.magnitude / 2.0;
            guards.doubtful += usize::from(unpromised && cancels);
            if total < f64::from(TRUSTED_SUM) && !cancels {
                guards.vanished += 1;
            } else if total < f64::from(TRUSTED_SUM)
                || total < f64::from(TRUSTED_SHARE) * exact.magnitude
            {
                guards.cancelled += 1;
            } else if overflows(exact) && noisy.rgb().map(|c| c[k]) == trial.filtered[k] {
                guards.overflowed += 1;
            }
        }
        guards
    }
}
