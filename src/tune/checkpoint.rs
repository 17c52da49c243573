//! A run laid down in a file, to go on from, and its history.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::loss::PARTS;
use super::optimizer::Position;
use super::sealed::{read_sealed, write_sealed};
use super::settings::Settings;
use crate::scene::Fingerprint;

/// The layout of the file; raised with every change to it.
const FORMAT: &str = "tamis-tuning-2";

/// Everything that a run knows between two steps.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// The filter as it was begun with.
    pub(super) filter: String,
    /// The scenes' names with their sample counts.
    pub(super) scenes: Vec<String>,
    /// Their pictures.
    pub(super) pictures: Vec<Fingerprint>,
    pub(super) settings: Settings,
    pub(super) state: State,
}

/// How far a run has come.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct State {
    /// The step to be made next.
    pub(super) next: u32,
    #[serde(with = "position")]
    pub(super) position: Position,
    /// By scene and sample count, what the parts of the loss are by now; not a number of
    /// images that have not been drawn yet.
    #[serde(with = "norms")]
    pub(super) norms: Vec<Vec<[f64; PARTS]>>,
    /// The constants of the best trial, and its score.
    pub(super) best: Option<Best>,
    /// Trials since then.
    pub(super) waiting: u32,
    /// The sum of the scores of the parts that were drawn since the last row.
    #[serde(with = "exact")]
    pub(super) lost: f64,
    /// How many they are.
    pub(super) drawn: u32,
    pub(super) history: Vec<Row>,
}

/// What was best on the validation scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Best {
    pub(super) step: u32,
    #[serde(with = "exact")]
    pub(super) score: f64,
    #[serde(with = "bits")]
    pub(super) values: Vec<f64>,
}

/// A row of the history: what the run had come to after a step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Steps that were made.
    pub step: u32,
    /// The mean score of the parts since the last row: of noisy parts, as they were drawn.
    #[serde(with = "exact")]
    pub training: f64,
    /// The score on the validation scenes; not a number where there are none.
    #[serde(with = "exact")]
    pub validation: f64,
    /// The geometric mean of their RelMSE.
    #[serde(with = "exact")]
    pub rel_mse: f64,
    /// The same without the worst 0.1% of the pixels of each.
    #[serde(with = "exact")]
    pub trimmed_rel_mse: f64,
}

/// Rows as comma-separated values, under a header.
pub fn csv(rows: &[Row]) -> String {
    let mut csv = String::from("step,training,validation,rel_mse,trimmed_rel_mse\n");
    for row in rows {
        let Row { step, training, validation, rel_mse, trimmed_rel_mse } = row;
        csv += &format!("{step},{training},{validation},{rel_mse},{trimmed_rel_mse}\n");
    }
    csv
}

impl Checkpoint {
    /// Reads a checkpoint.
    ///
    /// # Errors
    /// If the file cannot be read, is none, or is damaged.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Ok(read_sealed(path, FORMAT)?)
    }

    /// What the run was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Writes it; a file of that name stays whole until the new one is.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        Ok(write_sealed(path, FORMAT, self)?)
    }
}

/// Numbers by their bits: JSON has no infinity, and its readers may be an ulp off.
mod exact {
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(value.to_bits())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        u64::deserialize(from).map(f64::from_bits)
    }
}

/// The same of lists.
mod bits {
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(
        values: &[f64],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(values.iter().map(|x| x.to_bits()))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
        let bits = Vec::<u64>::deserialize(from)?;
        Ok(bits.into_iter().map(f64::from_bits).collect())
    }
}

/// The same of positions.
mod position {
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

    use super::Position;

    pub(super) fn serialize<S: Serializer>(
        position: &Position,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let Position { at, first, second, average } = position;
        let bits = |values: &Vec<f64>| values.iter().map(|x| x.to_bits()).collect::<Vec<u64>>();
        [at, first, second, average].map(bits).serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Position, D::Error> {
        let [at, first, second, average] = <[Vec<u64>; 4]>::deserialize(from)?
            .map(|bits| bits.into_iter().map(f64::from_bits).collect::<Vec<f64>>());
        let whole = [&first, &second, &average].iter().all(|other| other.len() == at.len());
        match whole {
            true => Ok(Position { at, first, second, average }),
            false => Err(de::Error::custom("its parts do not fit together")),
        }
    }
}

/// The same of running means.
mod norms {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::PARTS;

    pub(super) fn serialize<S: Serializer>(
        norms: &[Vec<[f64; PARTS]>],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let bits = |levels: &Vec<[f64; PARTS]>| -> Vec<[u64; PARTS]> {
            levels.iter().map(|parts| parts.map(f64::to_bits)).collect()
        };
        norms.iter().map(bits).collect::<Vec<_>>().serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Vec<Vec<[f64; PARTS]>>, D::Error> {
        let bits = Vec::<Vec<[u64; PARTS]>>::deserialize(from)?;
        let levels = |levels: Vec<[u64; PARTS]>| {
            levels.into_iter().map(|parts| parts.map(f64::from_bits)).collect()
        };
        Ok(bits.into_iter().map(levels).collect())
    }
}
