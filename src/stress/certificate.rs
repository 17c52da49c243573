//! What was measured, with the verdict.

use serde::Serialize;

use super::accuracy::SceneAccuracy;
use super::behaviour::Behaviour;
use super::invariance::Invariance;
use super::sensitivity::Sensitivity;
use super::verdict::{Reason, Verdict};
use super::{Checked, Engine};
use crate::filter::show;

/// A filter's stability certificate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Certificate {
    /// The filter's name.
    pub filter: String,
    /// Its stages, as a person would write them.
    pub text: String,
    /// How many they are.
    pub stages: usize,
    /// How far around a pixel it looks, in pixels.
    pub reach: usize,
    /// Names the random numbers that scenes and noise are made of.
    pub seed: u64,
    /// The gravest of the reasons.
    pub verdict: Verdict,
    /// What is wrong with the filter, the gravest first; nothing if it is stable.
    pub reasons: Vec<Reason>,
    /// What ran the filter.
    pub engines: Vec<EngineEntry>,
    /// Accuracy and guards, scene by scene.
    pub scenes: Vec<SceneAccuracy>,
    /// What noise does: per scene, feature and kind of noise.
    pub sensitivity: Vec<Sensitivity>,
    /// What units and orientation do: per scene and change.
    pub invariance: Vec<Invariance>,
    /// What becomes of bad features.
    pub behaviour: Vec<Behaviour>,
}

/// What was to run the filter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EngineEntry {
    /// Its name.
    pub name: String,
    /// How far from exact it may be.
    pub bound: Option<f64>,
    /// Why it is not there, if it is not.
    pub absent: Option<String>,
}

impl Certificate {
    /// One without figures.
    pub(super) fn new(checked: &Checked<'_>, engines: &[Engine<'_>], seed: u64) -> Self {
        let entry = |engine: &Engine<'_>| EngineEntry {
            name: engine.name.clone(),
            bound: engine
                .backend
                .as_ref()
                .ok()
                .map(|backend| backend.agreement().bound(engine.precision)),
            absent: engine.backend.as_ref().err().cloned(),
        };
        Self {
            filter: checked.filter().name.clone(),
            text: show(checked),
            stages: checked.filter().stages.len(),
            reach: checked.receptive_field(),
            seed,
            verdict: Verdict::Stable,
            reasons: Vec::new(),
            engines: engines.iter().map(entry).collect(),
            scenes: Vec::new(),
            sensitivity: Vec::new(),
            invariance: Vec::new(),
            behaviour: Vec::new(),
        }
    }

    /// Why the filter should not be used, if it should not.
    pub fn objection(&self) -> Option<&str> {
        let gravest = self.reasons.first().filter(|reason| reason.verdict == Verdict::Unstable);
        gravest.map(|reason| reason.text.as_str())
    }
}
