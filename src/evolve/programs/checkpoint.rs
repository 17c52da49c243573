//! A search for programs laid down in a file, to go on from.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::genome::Genome;
use super::history::Row;
use super::judge::Judged;
use super::settings::Settings;
use crate::evolve::{Error, encoding};
use crate::filter::Filter;
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
    population: Vec<Member>,
    history: Vec<Row>,
    judged: u64,
    dropped: u64,
    validated: Option<Exact>,
    waiting: u32,
}

#[derive(Serialize, Deserialize)]
struct Exact(#[serde(with = "encoding::exact")] f64);

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Member {
    filter: String,
    scores: Vec<Exact>,
    error: Exact,
    cost: Exact,
    steps: u32,
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
        let parsed = |text: &str| {
            Filter::parse(text, path).map_err(|error| SealedError::Content {
                path: path.to_owned(),
                source: serde::de::Error::custom(error),
            })
        };
        let population = written.population.iter().map(|member| {
            let genome =
                Genome::new(parsed(&member.filter)?).expect("a filter that was parsed makes sense");
            Ok(Judged {
                genome,
                scores: member.scores.iter().map(|score| score.0).collect(),
                error: member.error.0,
                cost: member.cost.0,
                steps: member.steps,
            })
        });
        let state = State {
            next: written.next,
            population: population.collect::<Result<_, Error>>()?,
            history: written.history,
            judged: written.judged,
            dropped: written.dropped,
            validated: written.validated.map(|score| score.0),
            waiting: written.waiting,
        };
        let (settings, pictures) = (written.settings, written.pictures);
        Ok(Self { initial: parsed(&written.initial)?, settings, pictures, state })
    }

    /// Writes it; a file of that name stays whole until the new one is.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let text = |filter: &Filter| filter.to_toml(toml::Table::new());
        let State { next, population, history, judged, dropped, validated, waiting } = &self.state;
        let member = |judged: &Judged| Member {
            filter: text(judged.genome.filter()),
            scores: judged.scores.iter().map(|&score| Exact(score)).collect(),
            error: Exact(judged.error),
            cost: Exact(judged.cost),
            steps: judged.steps,
        };
        let written = Written {
            initial: text(&self.initial),
            settings: self.settings.clone(),
            pictures: self.pictures.clone(),
            next: *next,
            population: population.iter().map(member).collect(),
            history: history.clone(),
            judged: *judged,
            dropped: *dropped,
            validated: validated.map(Exact),
            waiting: *waiting,
        };
        Ok(write_sealed(path, FORMAT, &written)?)
    }
}
