//! Judged programs as JSON, to the bit: in checkpoints, and on the way to workers and back.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::genome::Genome;
use super::judge::Judged;
use crate::evolve::encoding;
use crate::filter::{Filter, FilterFileError};

/// A number that is read back to the bit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Exact(#[serde(with = "encoding::exact")] pub(super) f64);

/// A filter as the text of a filter file: its constants are the shortest decimals that read back
/// to the same.
pub(super) fn text(filter: &Filter) -> String {
    filter.to_toml(toml::Table::new())
}

/// A program with how it does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WrittenProgram {
    filter: String,
    scores: Vec<Exact>,
    error: Exact,
    cost: Exact,
    steps: u32,
}

impl WrittenProgram {
    pub(super) fn of(judged: &Judged) -> Self {
        Self {
            filter: text(judged.genome.filter()),
            scores: judged.scores.iter().map(|&score| Exact(score)).collect(),
            error: Exact(judged.error),
            cost: Exact(judged.cost),
            steps: judged.steps,
        }
    }

    /// What was written; `path` only names it in errors.
    ///
    /// # Errors
    /// If its filter is none.
    pub(super) fn read(self, path: &Path) -> Result<Judged, FilterFileError> {
        Ok(Judged {
            genome: genome(&self.filter, path)?,
            scores: self.scores.iter().map(|score| score.0).collect(),
            error: self.error.0,
            cost: self.cost.0,
            steps: self.steps,
        })
    }
}

/// The program that a text is of; `path` only names it in errors.
///
/// # Errors
/// If it is none.
pub(super) fn genome(text: &str, path: &Path) -> Result<Genome, FilterFileError> {
    let filter = Filter::parse(text, path)?;
    Ok(Genome::new(filter).expect("a filter that was parsed makes sense"))
}
