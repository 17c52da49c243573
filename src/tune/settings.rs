//! What a run is told.

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::loss::Loss;

/// Everything that decides what a run finds, beside the filter and the scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Names all random numbers.
    pub seed: u64,
    /// Steps of the optimizer; its rates fall to nothing until the last.
    pub steps: u32,
    /// Parts of images per step.
    pub batch: usize,
    /// Columns and rows of a part, an even number.
    pub crop: usize,
    /// What is made small.
    pub loss: Loss,
    /// How far a step moves single constants, at most about; of those whose bounds are
    /// positive, their logarithms.
    pub rate: f64,
    /// The same of the numbers of layers.
    pub layer_rate: f64,
    /// The share of themselves that W of layers loses per step, times its rate.
    pub decay: f64,
    /// The share of parts that are filtered without some of the features, or without variances.
    pub drop: f64,
    /// By how many stops light is made brighter or darker, at most: what filters see is in
    /// units of the exposure, which a few lamps may move as far.
    pub stops: f32,
    /// The share of parts that are made less noisy than they were rendered, as if with up to
    /// 64 times as many samples: so that clean images stay clean.
    pub clean: f64,
    /// Steps from one trial on the validation scenes to the next.
    pub interval: u32,
    /// Trials in a row of which none is the best so far, after which the run ends; 0 for
    /// never.
    pub patience: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            seed: 1,
            steps: 3000,
            batch: 4,
            crop: 112,
            loss: Loss::Balanced,
            rate: 0.02,
            layer_rate: 0.004,
            decay: 0.01,
            drop: 0.4,
            stops: 0.5,
            clean: 0.15,
            interval: 250,
            patience: 0,
        }
    }
}

impl Settings {
    /// Checks that they make sense.
    ///
    /// # Errors
    /// For the first that does not.
    pub fn validate(&self) -> Result<(), Error> {
        let refuse = |name, value: String, wanted| Err(Error::Setting { name, value, wanted });
        let positive = |x: f64| x > 0.0 && x.is_finite();
        match self {
            Self { steps, .. } if !(1..=100_000_000).contains(steps) => {
                refuse("steps", steps.to_string(), "from 1 to 100000000")
            }
            Self { batch, .. } if !(1..=10_000).contains(batch) => {
                refuse("batch", batch.to_string(), "from 1 to 10000")
            }
            Self { interval: 0, .. } => refuse("interval", "0".to_owned(), "at least 1"),
            Self { crop, .. } if !(8..=65_536).contains(crop) || crop % 2 != 0 => {
                refuse("crop", crop.to_string(), "an even number from 8 to 65536")
            }
            Self { rate, .. } if !positive(*rate) => {
                refuse("rate", rate.to_string(), "greater than 0")
            }
            Self { layer_rate, .. } if !positive(*layer_rate) => {
                refuse("layer-rate", layer_rate.to_string(), "greater than 0")
            }
            Self { decay, .. } if !(0.0..=1.0).contains(decay) => {
                refuse("decay", decay.to_string(), "between 0 and 1")
            }
            Self { drop, .. } if !(0.0..=1.0).contains(drop) => {
                refuse("drop", drop.to_string(), "between 0 and 1")
            }
            Self { clean, .. } if !(0.0..=1.0).contains(clean) => {
                refuse("clean", clean.to_string(), "between 0 and 1")
            }
            Self { stops, .. } if !(0.0..=8.0).contains(stops) => {
                refuse("stops", stops.to_string(), "between 0 and 8")
            }
            _ => Ok(()),
        }
    }
}
