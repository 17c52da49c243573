//! A search laid down in a file, to go on from.

use std::path::Path;

use serde::{Deserialize, Serialize, de::Error as _};

use super::error::Error;
use super::hall::HallOfFame;
use super::history::Row;
use super::islands::{Population, best};
use super::memo::Memo;
use super::race::Work;
use super::settings::Settings;
use crate::scene::Fingerprint;
use crate::tune::{SealedError, read_sealed, write_sealed};

/// The layout of the file; raised with every change to it.
const FORMAT: &str = "tamis-search-4";

/// Everything that a search knows between two generations, and all that it has
/// judged. Random numbers need no state: their streams are named.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// What the fitness called itself.
    pub(super) identity: String,
    /// What it judged by.
    pub(super) pictures: Vec<Fingerprint>,
    pub(super) settings: Settings,
    pub(super) state: State,
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
    /// Reads a checkpoint.
    ///
    /// # Errors
    /// If the file cannot be read, is none, or is damaged.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let checkpoint: Self = read_sealed(path, FORMAT)?;
        if checkpoint.is_whole() {
            return Ok(checkpoint);
        }
        let source = serde_json::Error::custom("its parts do not fit together");
        Err(SealedError::Content { path: path.to_owned(), source }.into())
    }

    /// Holds what was read to what a search relies on.
    fn is_whole(&self) -> bool {
        let Self { settings, state, .. } = self;
        let begun = state.next > 0;
        let islands = if begun { settings.islands } else { 0 };
        state.islands.len() == islands
            && state.islands.iter().all(|p| p.len() == settings.island_size)
            && state.history.len() == islands * state.next as usize
            && state.islands.iter().all(|p| best(p).full)
            && (state.hall.members().is_empty() == state.memo.is_empty())
            && !(begun && state.memo.is_empty())
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
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        Ok(write_sealed(path, FORMAT, self)?)
    }
}
