//! Floor 7: whether a filter can be relied on: its stability certificate.
//!
//! [`certify`] filters scenes made to be difficult ([`adversary`]) and scenes of the
//! caller's, and measures
//!
//! - how far every back end is from the filter's exact meaning ([`accuracy`]),
//! - where and why the guards of weighted means act ([`guards`]),
//! - how much of the result changes with the last bit of each feature, and with noise
//!   of a thousandth ([`sensitivity`]),
//! - whether exposure, unit and place of the world, and orientation matter
//!   ([`invariance`]),
//! - what becomes of features that are missing, constant or no numbers ([`behaviour`]).
//!
//! What is too much is decided in one place, with the reasons: [`verdict`]. For searches,
//! which meet thousands of filters, a [`Screen`] tells in a tenth of a second which need
//! not ask for a certificate.
//!
//! What it promises: for one seed, and on one machine, the same certificate with any
//! number of threads. What it does not know: whether the filter is any good.

pub mod accuracy;
pub mod adversary;
pub mod behaviour;
pub mod certificate;
pub mod guards;
pub mod invariance;
mod judge;
mod peak;
mod screen;
pub mod sensitivity;
mod trial;
pub mod verdict;

use crate::backend::{Backend, BackendError, Interpreter};
use crate::filter::Checked;
use crate::plan::{PlanError, Precision};
use crate::scene::{RawScene, SceneError};

pub use certificate::Certificate;
pub use peak::Peak;
pub use screen::Screen;
pub use verdict::{Reason, Verdict};

use trial::Trial;

/// The radius that scenes of the caller's are filtered with, if the filter is one of the
/// paper's and its own is not smaller: what is ill-conditioned shows in windows of any size,
/// and 25 taps, exactly computed for all pixels, take seconds.
pub const REAL_RADIUS: u32 = 2;

/// The seed of certificates, unless another is asked for.
pub const SEED: u64 = 1;

/// A scene to be filtered.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Its features, before normalisation.
    pub raw: RawScene,
    /// Where they come from.
    pub kind: Kind,
    /// Radius of the window of a filter of the paper's, at most its own. Programs run whole:
    /// each window is made for what the others do.
    pub radius: u32,
}

/// What kind of scene it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Rendered.
    Real,
    /// Made, of numbers that a renderer might write.
    Made,
    /// Made, of numbers at the ends of the range. Results are held to their exact
    /// meaning there too, but neither noise nor another unit says anything, as it
    /// leaves the range.
    Extreme,
}

impl Ground {
    /// A rendered scene, read with at least what the filter [reads](Checked::needs).
    pub fn real(raw: RawScene) -> Self {
        Self { raw, kind: Kind::Real, radius: REAL_RADIUS }
    }
}

/// A back end under the name that reports have for it.
pub struct Engine<'a> {
    /// The name.
    pub name: String,
    /// The back end, or why there is none here.
    pub backend: Result<&'a dyn Backend, String>,
    /// How accurate its plans are made.
    pub precision: Precision,
}

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
pub enum StressError {
    /// A scene cannot be loaded, or lacks what the filter reads.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The filter cannot be planned.
    #[error("{scene}: {source}")]
    Plan {
        /// For which scene.
        scene: String,
        /// Why.
        source: PlanError,
    },
    /// The back end that everything is measured with failed.
    #[error("{scene}: {source}")]
    Run {
        /// On which scene.
        scene: String,
        /// Why.
        source: BackendError,
    },
}

/// Measures how a filter bears being computed, and bears its inputs: on scenes made
/// from `seed`, and on `real` ones. All but the accuracy is measured with the first
/// of the engines that is there, at standard precision.
///
/// # Errors
/// If a real scene lacks what the filter reads, or that engine fails.
pub fn certify(
    checked: &Checked<'_>,
    real: &[Ground],
    engines: &[Engine<'_>],
    seed: u64,
) -> Result<Certificate, StressError> {
    let filter = checked.filter();
    let mut present = engines.iter().filter_map(|engine| engine.backend.as_ref().ok().copied());
    let backend: &dyn Backend = present.next().unwrap_or(&Interpreter);
    let made = adversary::grounds(seed, filter.paper().map(|gather| gather.window));
    let mut certificate = Certificate::new(checked, engines, seed);
    for (k, ground) in made.iter().chain(real).enumerate() {
        let trial = Trial::new(ground, checked, backend)?;
        certificate.scenes.push(accuracy::SceneAccuracy::of(&trial, engines));
        if ground.kind != Kind::Extreme {
            let stream = adversary::Stream { seed, scene: k as u64 };
            certificate.sensitivity.extend(sensitivity::measure(&trial, backend, stream)?);
            certificate.invariance.extend(invariance::measure(&trial, backend)?);
        }
    }
    certificate.behaviour = behaviour::observe(checked, backend, seed)?;
    judge::judge(&mut certificate);
    Ok(certificate)
}

#[cfg(test)]
mod tests;
