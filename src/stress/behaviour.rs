//! What becomes of features that are missing, constant or no numbers.

use serde::Serialize;

use super::adversary::steps_alone;
use super::sensitivity::stored;
use super::trial::{Trial, filter, prepare};
use super::{Ground, StressError};
use crate::backend::Backend;
use crate::backend::reference::meaning;
use crate::expr::{Feature, Quantity};
use crate::filter::Checked;
use crate::scene::{RawScene, SceneError};

/// What is wrong with a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// It is not there.
    Missing,
    /// It is zero everywhere.
    Zero,
    /// It is one value everywhere.
    Constant,
    /// One pixel is NaN in all components.
    Nan,
    /// One pixel is infinite in all components.
    Infinite,
}

impl Fault {
    /// All.
    pub const ALL: [Self; 5] =
        [Self::Missing, Self::Zero, Self::Constant, Self::Nan, Self::Infinite];
}

/// What a filter does about it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "outcome")]
pub enum Outcome {
    /// It is not applied, and the error names what is missing.
    Refused,
    /// It is applied, perhaps with what stands in for what is missing.
    Filtered {
        /// The greatest difference from exact of a pixel of which back ends promise
        /// anything; none of a scene with a bad pixel, which once repaired is like others.
        difference: Option<f64>,
        /// Pixels that are no numbers.
        broken: usize,
        /// Pixels that changed although the bad one is out of their reach.
        escaped: usize,
    },
}

/// What a filter does about one fault of one feature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Behaviour {
    /// The feature or variance, as expressions spell it.
    pub feature: &'static str,
    /// What is wrong with it.
    pub fault: Fault,
    /// What becomes of it.
    #[serde(flatten)]
    pub outcome: Outcome,
}

/// Gives a filter each fault of each feature that it reads.
pub(super) fn observe(
    checked: &Checked<'_>,
    backend: &dyn Backend,
    seed: u64,
) -> Result<Vec<Behaviour>, StressError> {
    let ground = Ground { radius: RADIUS, ..steps_alone(seed) };
    let trial = Trial::new(&ground, checked, backend)?;
    let mut behaviour = Vec::new();
    for key in stored(checked, &ground.raw) {
        for fault in Fault::ALL {
            // Without a colour there is no image.
            if fault == Fault::Missing && key == (Feature::Color, Quantity::Value) {
                continue;
            }
            let feature = key.0.spelling(key.1).expect("what is stored has a spelling");
            let outcome = outcome(&trial, &ground, key, fault, backend)?;
            behaviour.push(Behaviour { feature, fault, outcome });
        }
    }
    Ok(behaviour)
}

fn outcome(
    trial: &Trial<'_>,
    ground: &Ground,
    key: (Feature, Quantity),
    fault: Fault,
    backend: &dyn Backend,
) -> Result<Outcome, StressError> {
    let (raw, bad) = match fault {
        Fault::Missing => {
            let mut raw = ground.raw.clone();
            raw.features.remove(&key);
            (raw, None)
        }
        Fault::Zero => (with(&ground.raw, key, |_, _| 0.0), None),
        Fault::Constant => (with(&ground.raw, key, |component, _| component[HIT]), None),
        Fault::Nan => bad_pixel(trial, key, f32::NAN)?,
        Fault::Infinite => bad_pixel(trial, key, f32::INFINITY)?,
    };
    let checked = trial.checked();
    let scene = match prepare(raw, &checked) {
        Err(StressError::Scene(
            SceneError::NotGiven { .. } | SceneError::MissingFeature { .. },
        )) if fault == Fault::Missing => {
            return Ok(Outcome::Refused);
        }
        other => other?,
    };
    let filtered = filter(&scene, &checked, backend)?;
    let difference = || {
        let exact = meaning::of(&scene, &checked).pixels;
        let promised = exact.iter().zip(&filtered).filter(|(exact, _)| exact.promised);
        promised.map(|(exact, &color)| exact.difference(color)).fold(0.0, f64::max)
    };
    let reach = checked.receptive_field() + DERIVED;
    let width = scene.layout().width();
    let far = |k: usize, bad: usize| {
        (k % width).abs_diff(bad % width) > reach || (k / width).abs_diff(bad / width) > reach
    };
    let pixels = filtered.iter().zip(&trial.filtered).enumerate();
    Ok(Outcome::Filtered {
        difference: bad.is_none().then(difference),
        broken: filtered.iter().filter(|c| c.iter().any(|c| !c.is_finite())).count(),
        escaped: match bad {
            Some(bad) => pixels.filter(|&(k, (now, then))| far(k, bad) && now != then).count(),
            None => 0,
        },
    })
}

/// The radius of windows: facts about planes are the same for any.
const RADIUS: u32 = 2;

/// A pixel that hits something.
const HIT: usize = 500;

/// How much further than its stages a pixel looks: gradients and estimated variances
/// are made of neighbours.
const DERIVED: usize = 1;

/// The scene with one quantity changed, given a component and one of its samples.
fn with(raw: &RawScene, key: (Feature, Quantity), change: impl Fn(&[f32], f32) -> f32) -> RawScene {
    let mut raw = raw.clone();
    for component in raw.features.get_mut(&key).into_iter().flatten() {
        *component = component.iter().map(|&x| change(component, x)).collect();
    }
    raw
}

/// The scene with a sample that is no number, and where. Its repair may move the
/// median that all pixels are measured by; so a pixel is taken whose does not. If there
/// is none, no place is told.
fn bad_pixel(
    trial: &Trial<'_>,
    key: (Feature, Quantity),
    value: f32,
) -> Result<(RawScene, Option<usize>), StressError> {
    let raw = &trial.ground.raw;
    let spoilt = |bad: usize| {
        let mut raw = raw.clone();
        let components = raw.features.get_mut(&key).into_iter().flatten();
        components.for_each(|component| component[bad] = value);
        raw
    };
    for bad in HIT..raw.width * raw.height {
        let spoilt = spoilt(bad);
        let scene = prepare(spoilt.clone(), &trial.checked())?;
        if scene.normalization() == trial.scene.normalization() {
            return Ok((spoilt, Some(bad)));
        }
    }
    Ok((spoilt(HIT), None))
}
