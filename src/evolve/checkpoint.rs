//! A search laid down in a file, to go on from.

use std::path::Path;

use serde::{Deserialize, Serialize, de};

use super::error::Error;
use super::hall::HallOfFame;
use super::history::Row;
use super::islands::{Population, best};
use super::memo::Memo;
use super::race::Work;
use super::settings::Settings;
use crate::image::write_atomically;

/// The layout of the file; raised with every change to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Format {
    #[serde(rename = "tamis-search-3")]
    V3,
}

impl Format {
    /// What the file's first member says in every version.
    const NAME: &str = "tamis-search-3";
}

/// Everything that a search knows between two generations, and all that it has
/// judged. Random numbers need no state: their streams are named.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    format: Format,
    /// What the fitness called itself.
    pub(super) identity: String,
    pub(super) settings: Settings,
    pub(super) state: State,
}

/// The one member that every version of the file has.
#[derive(Deserialize)]
struct Label {
    format: String,
}

/// How far a search has come.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct State {
    /// The generation to be formed next; 0 is the initial population.
    pub(super) next: u32,
    /// The islands after the generation before; none before the initial one.
    pub(super) islands: Vec<Population>,
    /// Expressions bred in all complete generations, judged before or not.
    pub(super) bred: usize,
    pub(super) work: Work,
    pub(super) hall: HallOfFame,
    pub(super) history: Vec<Row>,
    pub(super) memo: Memo,
}

impl State {
    /// The state before the initial population.
    pub(super) fn new(settings: &Settings) -> Self {
        Self {
            next: 0,
            islands: Vec::new(),
            bred: 0,
            work: Work::default(),
            hall: HallOfFame::new(settings.finalists),
            history: Vec::new(),
            memo: Memo::default(),
        }
    }
}

impl Checkpoint {
    pub(super) fn new(identity: String, settings: Settings, state: State) -> Self {
        Self { format: Format::V3, identity, settings, state }
    }

    /// Reads a checkpoint.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let contents =
            std::fs::read(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
        serde_json::from_slice(&contents).and_then(Self::checked).map_err(|source| {
            let path = path.to_owned();
            match serde_json::from_slice(&contents) {
                Ok(Label { format }) if format != Format::NAME => {
                    Error::Format { path, found: format, read: Format::NAME }
                }
                Ok(_) | Err(_) => Error::Checkpoint { path, source },
            }
        })
    }

    /// Holds what was read to what a search relies on.
    fn checked(self) -> Result<Self, serde_json::Error> {
        let Self { settings, state, .. } = &self;
        let begun = state.next > 0;
        let islands = if begun { settings.islands } else { 0 };
        let whole = state.islands.len() == islands
            && state.islands.iter().all(|p| p.len() == settings.island_size)
            && state.history.len() == islands * state.next as usize
            && state.islands.iter().all(|p| best(p).full)
            && (state.hall.members().is_empty() == state.memo.is_empty())
            && !(begun && state.memo.is_empty());
        if whole { Ok(self) } else { Err(de::Error::custom("its parts do not fit together")) }
    }

    /// What the search was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The same, to be resumed up to another last generation.
    #[must_use]
    pub fn until(mut self, generations: u32) -> Self {
        self.settings.generations = generations;
        self
    }

    /// Writes it; a file of that name stays whole until the new one is.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let json = serde_json::to_vec(self)
            .map_err(|source| Error::Checkpoint { path: path.to_owned(), source })?;
        Ok(write_atomically(path, &json)?)
    }
}
