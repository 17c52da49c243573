//! How much of the result changes with noise in the input.
//!
//! The noise is put into what the renderer wrote, one feature at a time, so that what
//! is derived from it (gradients, estimated variances, scales) follows. Zeros stay:
//! they say that there is nothing (no hit, no light).

use rand::{Rng, RngExt};
use rayon::prelude::*;
use serde::Serialize;

use super::adversary::Stream;
use super::peak::change;
use super::trial::Trial;
use super::{Peak, StressError};
use crate::backend::Backend;
use crate::expr::builder::LIMIT;
use crate::expr::feature::Unit;
use crate::expr::{Feature, PlaneId, Quantity};
use crate::filter::Checked;
use crate::scene::{RawScene, Scene};

/// Relative noise that no renderer's features are free of.
pub const RELATIVE: f32 = 1e-3;

/// How much noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Noise {
    /// One unit in the last place up or down.
    Ulp,
    /// Up to [`RELATIVE`] of the value up or down, evenly distributed; of positions,
    /// of the distance to the centre of the visible geometry.
    Relative,
}

impl Noise {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Ulp, Self::Relative];
}

/// What noise in one feature of one scene does.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensitivity {
    /// The scene's name.
    pub scene: String,
    /// The feature or variance, as expressions spell it.
    pub feature: &'static str,
    /// How much noise.
    pub noise: Noise,
    /// The greatest relative change of a pixel, of those of which back ends promise
    /// anything.
    pub greatest: Peak,
    /// The relative change that 99.9% of these pixels do not exceed.
    pub most: f64,
}

/// Puts noise into each feature that counts in turn.
pub(super) fn measure(
    trial: &Trial<'_>,
    backend: &dyn Backend,
    stream: Stream,
) -> Result<Vec<Sensitivity>, StressError> {
    let stored = stored(&trial.checked(), &trial.ground.raw);
    let cases: Vec<_> = stored.into_iter().flat_map(|key| Noise::ALL.map(|n| (key, n))).collect();
    let measure = |(k, &(key, noise)): (usize, &((Feature, Quantity), Noise))| {
        let mut rng = stream.numbers(1 + k as u64);
        let raw = noisy(&trial.ground.raw, &trial.scene, key, noise, &mut rng);
        let filtered = trial.with(raw, backend)?;
        let darkest = trial.meaning.darkest;
        let changed = |k: usize| change(trial.filtered[k], filtered[k], darkest);
        let changes: Vec<(usize, f64)> = trial.promised().map(|k| (k, changed(k))).collect();
        let greatest = Peak::of(changes.iter().copied(), trial.scene.layout().width());
        Ok(Sensitivity {
            scene: trial.scene.name().to_owned(),
            feature: key.0.spelling(key.1).expect("what is stored has a spelling"),
            noise,
            greatest,
            most: percentile(changes.into_iter().map(|(_, change)| change).collect()),
        })
    };
    cases.par_iter().enumerate().map(measure).collect()
}

/// What of a scene's features a filter's result depends on: the colour, which it
/// averages, and what the planes that it reads come from.
pub(super) fn stored(checked: &Checked<'_>, raw: &RawScene) -> Vec<(Feature, Quantity)> {
    let needs = checked.needs();
    let reads = |(feature, quantity): (Feature, Quantity)| {
        let estimated = !raw.features.contains_key(&(feature, Quantity::Variance));
        needs.named().into_iter().flatten().any(|plane: &PlaneId| {
            plane.feature == feature
                && match plane.quantity {
                    Quantity::Value | Quantity::Gradient => quantity == Quantity::Value,
                    Quantity::Variance => quantity == Quantity::Variance || estimated,
                }
        })
    };
    let averaged = (Feature::Color, Quantity::Value);
    raw.features.keys().copied().filter(|&key| key == averaged || reads(key)).collect()
}

/// The scene with noise in one of its features.
pub(super) fn noisy(
    raw: &RawScene,
    scene: &Scene,
    key: (Feature, Quantity),
    noise: Noise,
    rng: &mut impl Rng,
) -> RawScene {
    let mut raw = raw.clone();
    let is_place = key.0.row().unit == Unit::Place && key.1 == Quantity::Value;
    let center = scene.normalization().center.filter(|_| is_place).unwrap_or_default();
    let components = raw.features.get_mut(&key).expect("the feature is stored");
    for (c, component) in components.iter_mut().enumerate() {
        let center = center[c.min(2)];
        for x in component.iter_mut().filter(|x| **x != 0.0) {
            let noise = match noise {
                Noise::Ulp if rng.random() => x.next_up(),
                Noise::Ulp => x.next_down(),
                Noise::Relative => *x + RELATIVE * rng.random_range(-1.0..=1.0) * (*x - center),
            };
            *x = noise.clamp(-LIMIT, LIMIT);
        }
    }
    raw
}

/// The value that 99.9% of the values do not exceed; 0 of none.
fn percentile(mut values: Vec<f64>) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let rank = (last as f64 * 0.999).ceil() as usize;
    *values.select_nth_unstable_by(rank, f64::total_cmp).1
}
