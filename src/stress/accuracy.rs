//! How far back ends are from a filter's exact meaning.

use serde::Serialize;

use super::guards::Guards;
use super::trial::{Trial, filter_at};
use super::{Engine, Kind, Peak};

/// A scene, and how back ends did on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scene {
    /// Its name.
    pub scene: String,
    /// Where it comes from.
    pub kind: Kind,
    /// Radius of the window.
    pub radius: u32,
    /// Number of pixels.
    pub pixels: usize,
    /// Where the guard acts.
    pub guards: Guards,
    /// Per engine, in the certificate's order.
    pub accuracy: Vec<Accuracy>,
}

/// How far one back end is from exact.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Accuracy {
    /// The greatest [difference](crate::backend::reference::oracle::Exact::difference) of a pixel
    /// of which back ends promise anything.
    Measured(Peak),
    /// It could not run.
    Failed {
        /// Why.
        failure: String,
    },
}

impl Scene {
    /// Has everybody filter the scene.
    pub(super) fn of(trial: &Trial<'_>, engines: &[Engine<'_>]) -> Self {
        let width = trial.scene.layout().width();
        let accuracy = engines.iter().map(|engine| {
            let filtered = engine.backend.clone().and_then(|backend| {
                filter_at(engine.precision, &trial.scene, &trial.stage, backend)
                    .map_err(|error| error.to_string())
            });
            match filtered {
                Ok(filtered) => {
                    let difference = |k: usize| (k, trial.exact[k].difference(filtered[k]));
                    Accuracy::Measured(Peak::of(trial.promised().map(difference), width))
                }
                Err(failure) => Accuracy::Failed { failure },
            }
        });
        Self {
            scene: trial.scene.name().to_owned(),
            kind: trial.ground.kind,
            radius: trial.stage.window.radius,
            pixels: trial.exact.len(),
            guards: Guards::of(trial),
            accuracy: accuracy.collect(),
        }
    }
}
