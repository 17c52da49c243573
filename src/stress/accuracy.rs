//! How far back ends are from a filter's exact meaning.

use serde::Serialize;

use super::guards::Guards;
use super::trial::{Trial, filter_at};
use super::{Engine, Kind, Peak};

/// A scene, and how back ends did on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneAccuracy {
    /// Its name.
    pub scene: String,
    /// Where it comes from.
    pub kind: Kind,
    /// How far around a pixel the filter looked, in pixels.
    pub reach: usize,
    /// Number of pixels.
    pub pixels: usize,
    /// Of so many of them back ends promise nothing.
    pub unpromised: usize,
    /// Where the guards act, gather by gather.
    pub guards: Vec<Guards>,
    /// Per engine, in the certificate's order.
    pub accuracy: Vec<Accuracy>,
}

/// How far one back end is from exact.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Accuracy {
    /// The greatest [difference](crate::backend::reference::oracle::Pixel::difference) of a pixel
    /// of which back ends promise anything.
    Measured(Peak),
    /// It could not run.
    Failed {
        /// Why.
        failure: String,
    },
}

impl SceneAccuracy {
    /// Has everybody filter the scene.
    pub(super) fn of(trial: &Trial<'_>, engines: &[Engine<'_>]) -> Self {
        let width = trial.scene.layout().width();
        let accuracy = engines.iter().map(|engine| {
            let backend = match &engine.backend {
                Ok(backend) => *backend,
                Err(absent) => return Accuracy::Failed { failure: absent.clone() },
            };
            match filter_at(engine.precision, &trial.scene, &trial.checked(), backend) {
                Ok(filtered) => {
                    let pixels = &trial.meaning.pixels;
                    let difference = |k: usize| (k, pixels[k].difference(filtered[k]));
                    Accuracy::Measured(Peak::of(trial.promised().map(difference), width))
                }
                Err(error) => Accuracy::Failed { failure: error.to_string() },
            }
        });
        let accuracy = accuracy.collect();
        let pixels = trial.meaning.pixels.len();
        Self {
            scene: trial.scene.name().to_owned(),
            kind: trial.ground.kind,
            reach: trial.checked().receptive_field(),
            pixels,
            unpromised: pixels - trial.promised().count(),
            guards: Guards::of(trial),
            accuracy,
        }
    }
}
