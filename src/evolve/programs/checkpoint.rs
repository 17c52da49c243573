//! A search for programs laid down in a file, to go on from.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::history::Row;
use super::judge::Judged;
use super::settings::Settings;
use super::written::{Exact, WrittenProgram, text};
use crate::evolve::Error;
use crate::filter::{Filter, FilterFileError};
use crate::scene::Fingerprint;
use crate::tune::{SealedError, read_sealed, write_sealed};

/// What the layouts of all versions are called, but for a number.
const KIND: &str = "tamis-programs-";

/// The layout of the file; raised with every change to it.
const FORMAT: &str = "tamis-programs-1";

/// Everything that a search knows between two generations. Random numbers need no state:
/// their streams are named.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// What it began with.
    pub(super) initial: Filter,
    /// What it was told.
    pub(super) settings: Settings,
    /// The pictures that it judges by.
    pub(super) pictures: Vec<Fingerprint>,
    pub(super) state: State,
}

/// How far a search has come.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct State {
    /// The generation to be formed next; 0 is the initial population.
    pub(super) next: u32,
    pub(super) population: Vec<Judged>,
    pub(super) history: Vec<Row>,
    pub(super) judged: u64,
    pub(super) dropped: u64,
    /// The least score on the validation scenes.
    pub(super) validated: Option<f64>,
    /// Trials since then.
    pub(super) waiting: u32,
}

/// The file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    /// As a filter file: its constants are the shortest decimals that read back to the same.
    initial: String,
    settings: Settings,
    pictures: Vec<Fingerprint>,
    next: u32,
    population: Vec<WrittenProgram>,
    history: Vec<Row>,
    judged: u64,
    dropped: u64,
    validated: Option<Exact>,
    waiting: u32,
}

impl Checkpoint {
    /// What the search was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The filter that the search began with.
    pub fn initial(&self) -> &Filter {
        &self.initial
    }

    /// The same search with another number of generations.
    #[must_use]
    pub fn until(self, generations: u32) -> Self {
        Self { settings: Settings { generations, ..self.settings }, ..self }
    }

    /// Whether a file is a checkpoint of a search for programs, of any version.
    pub fn is_one(path: &Path) -> bool {
        let contents = std::fs::read(path).unwrap_or_default();
        contents.starts_with(format!("{{\"format\":\"{KIND}").as_bytes())
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// If the file cannot be read, is none or is damaged.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let written: Written = read_sealed(path, FORMAT)?;
        let content = |error: FilterFileError| SealedError::Content {
            path: path.to_owned(),
            source: serde::de::Error::custom(error),
        };
        let population = written.population.into_iter().map(|member| member.read(path));
        let population = population.collect::<Result<_, _>>().map_err(content)?;
        let state = State {
            next: written.next,
            population,
            history: written.history,
            judged: written.judged,
            dropped: written.dropped,
            validated: written.validated.map(|score| score.0),
            waiting: written.waiting,
        };
        let (settings, pictures) = (written.settings, written.pictures);
        let initial = Filter::parse(&written.initial, path).map_err(content)?;
        Ok(Self { initial, settings, pictures, state })
    }

    /// Writes it; a file of that name stays whole until the new one is.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let State { next, population, history, judged, dropped, validated, waiting } = &self.state;
        let written = Written {
            initial: text(&self.initial),
            settings: self.settings.clone(),
            pictures: self.pictures.clone(),
            next: *next,
            population: population.iter().map(WrittenProgram::of).collect(),
            history: history.clone(),
            judged: *judged,
            dropped: *dropped,
            validated: validated.map(Exact),
            waiting: *waiting,
        };
        Ok(write_sealed(path, FORMAT, &written)?)
    }
}
