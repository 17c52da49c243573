//! `tamis evolve`: searches, from scenes to filter files.

mod pace;
mod parameters;
mod preset;
mod programs;
mod record;
mod repeat;
mod weights;
mod worker;
mod workers;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Args;

use super::Report;
use super::backend::{LanesArgs, Processor};
use super::error::Error;
use super::log::Log;
use super::{interrupt, scenes};
use crate::evolve::{self, Checkpoints, Control};
use crate::image::{ImageError, Lock, check_folder};
use crate::tune::SealedError;
use parameters::{Parameters, Tabled};
use preset::Preset;
pub(super) use worker::Worker;
use workers::WorkersArgs;

const BEST: &str = "best.toml";
const HISTORY: &str = "history.csv";
const PAGE: &str = "report.html";
const SUMMARY: &str = "summary.md";
const CHECKPOINT: &str = "checkpoint.json";
const SCENES: &str = "scenes.json";
const LOCK: &str = "search.lock";

const EXAMPLES: &str = "\
Examples:
  tamis evolve --preset quick
  tamis evolve --preset programs --initial tamis-formula --max-nodes 1500 --out runs/1
  tamis evolve --scenes renders/a renders/b --validate renders/c --max-time 600
  tamis evolve --preset paper --seed 7 --out runs/7
  tamis evolve --out runs/7 --resume --generations 400
  tamis evolve --preset programs --worker-command 'ssh node7 tamis worker'

Writes best.toml (the filter and where it comes from), summary.md, history.csv
and checkpoint.json into the output folder, and of programs front/, those of which none is
better by error, predicted time and size, with a chart, front.svg, and history.jsonl.
report.html is a page for a browser, written anew with every generation (of weights with every
checkpoint). Does not write over an older
search, unless with --overwrite. With every checkpoint best.toml is the best so far. Ctrl-C ends the
search at once with that; --resume goes on from there, on the same scenes. The same seed finds
the same filter with any number of threads and workers. One search at a time writes into a folder.

Values in brackets are the presets' own.";

/// Search for a filter on training scenes.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Evolve {
    /// Folders with 4spp.exr and reference.exr in or below them, or pairs of files
    /// [default: data/corpus/train and data/train, for weights the latter; with --resume those
    /// that the search was started with]
    #[arg(long, num_args = 1.., value_name = scenes::VALUE)]
    scenes: Vec<PathBuf>,

    /// Scenes that nothing is bred on: the program that is best there is the result. Searches
    /// for programs alone have them [default: data/corpus/validate, if --scenes is not given]
    #[arg(long, num_args = 1.., value_name = scenes::VALUE)]
    validate: Vec<PathBuf>,

    /// What is searched: programs, in two minutes (quick) or hours (programs), or weights of
    /// one window, in a minute (weights) or as the paper does, in half an hour (paper)
    /// [default: quick]
    #[arg(long, value_enum, value_name = "PRESET", hide_default_value = true)]
    preset: Option<Preset>,

    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,

    /// What runs the filters
    #[arg(long, value_enum, value_name = "BACKEND", default_value_t = Processor::DEFAULT)]
    backend: Processor,

    #[command(flatten)]
    lanes: LanesArgs,

    /// Go on from the checkpoint in the output folder
    #[arg(long, conflicts_with = "preset")]
    resume: bool,

    /// Replace what an older search left in the output folder
    #[arg(long, conflicts_with = "resume")]
    overwrite: bool,

    /// End the search after so many seconds
    #[arg(long, value_name = "SECONDS")]
    max_time: Option<u32>,

    /// Generations between checkpoints, from the initial one on; 0 for one at the end only
    #[arg(long, value_name = "N", default_value_t = 5)]
    checkpoint_every: u32,

    /// Breed nothing whose results hang on the last bit of a feature or are far from
    /// exact, and let no finalist win that `tamis stress` finds unstable on the training
    /// scenes
    #[arg(long)]
    require_stable: bool,

    #[command(flatten)]
    workers: WorkersArgs,

    #[command(flatten)]
    parameters: Parameters,
}

impl Evolve {
    pub(super) fn run(&self, log: Log) -> Result<Report, Error> {
        let fixed = self.parameters.fixed();
        if self.resume && !fixed.is_empty() {
            return Err(Error::Usage(format!(
                "--resume goes on with the parameters that the search was started with; leave \
                 {} out, or start a new search without --resume",
                fixed.join(", ")
            )));
        }
        let preset = self.preset.unwrap_or(Preset::Quick);
        let checkpoint = self.out.join(CHECKPOINT);
        // Parameters that make no sense are refused before anything is read or written.
        match (self.resume, preset.programs(), preset.weights()) {
            (true, ..) if evolve::programs::Checkpoint::is_one(&checkpoint) => {
                programs::run(self, None, log)
            }
            (false, Some(settings), _) => programs::run(self, Some(self.told(settings)?), log),
            (resume, _, settings) => {
                self.refuse_what_programs_have()?;
                let settings = settings.filter(|_| !resume);
                self.run_for_weights(settings.map(|s| self.told(s)).transpose()?, log)
            }
        }
    }

    /// Settings as the command line changes them, if they make sense.
    fn told<S: Tabled>(&self, mut settings: S) -> Result<S, Error> {
        self.parameters.apply(&mut settings)?;
        settings.validated()?;
        Ok(settings)
    }

    fn refuse_what_programs_have(&self) -> Result<(), Error> {
        let option = match (self.validate.is_empty(), self.workers.are_given()) {
            (true, false) => return Ok(()),
            (false, _) => "--validate is",
            (true, true) => "--workers and --worker-command are",
        };
        let text = format!("{option} of searches for programs (--preset quick or programs)");
        Err(Error::Usage(text))
    }

    /// Makes the output folder, checks that it can be written, and keeps others out of it.
    fn claim(&self) -> Result<Lock, Error> {
        let path = || self.out.display().to_string();
        let checkpoint = self.out.join(CHECKPOINT);
        if !self.resume {
            let made = std::fs::create_dir_all(&self.out);
            made.map_err(|source| Error::Folder { path: path(), option: "--out", source })?;
        } else if let Err(source) = std::fs::metadata(&checkpoint) {
            // Where there is no run, none is to be locked.
            let error = SealedError::Read { path: checkpoint, source };
            return Err(evolve::Error::from(error).into());
        }
        check_folder(&self.out).map_err(|source| Error::Unwritable { option: "--out", source })?;
        let lock = Lock::take(&self.out.join(LOCK));
        let lock = lock.map_err(|source| Error::Locked { option: "--out", source })?;
        self.spare_older_runs()?;
        Ok(lock)
    }

    /// Checks that nothing of an older search would be replaced by accident.
    fn spare_older_runs(&self) -> Result<(), Error> {
        let there = |name: &&str| self.out.join(name).exists();
        let older = [CHECKPOINT, BEST, HISTORY, SUMMARY].iter().any(there);
        if older && !self.resume && !self.overwrite {
            let run = self.out.display().to_string();
            return Err(Error::OlderRun { run, option: "--out" });
        }
        Ok(())
    }

    /// What watches over a search: the flag, the time, the checkpoints. Ctrl-C raises the flag
    /// from now on.
    fn control(&self, stop: &Arc<AtomicBool>, log: Log) -> Control {
        interrupt::raise(stop, log, "stopping: the result is the best so far");
        Control {
            stop: Arc::clone(stop),
            time_limit: self.max_time.map(|seconds| Duration::from_secs(seconds.into())),
            checkpoints: Some(Checkpoints {
                path: self.out.join(CHECKPOINT),
                interval: self.checkpoint_every,
            }),
        }
    }
}

/// Why a search ended, with what it can be resumed from.
fn interrupted(error: evolve::Error) -> Error {
    match error {
        evolve::Error::Fitness { source, checkpoint: Some(checkpoint) } => {
            Error::Interrupted { source, checkpoint }
        }
        other => other.into(),
    }
}

/// What is said of a checkpoint that cannot be written.
fn no_checkpoint(failure: &evolve::Error) -> String {
    format!(
        "warning: {failure}; the search goes on, but cannot be resumed unless a later checkpoint \
         can be written"
    )
}

/// What is said of a provisional result that cannot be written.
fn no_provisional(failure: &ImageError) -> String {
    format!("warning: {failure}; the search goes on without writing its best so far")
}
