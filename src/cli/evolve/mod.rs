//! `tamis evolve`: the search, from scenes to a filter file.

mod page;
mod parameters;
mod preset;
mod programs;
mod progress;
mod record;

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::backend::{LanesArgs, Processor};
use super::error::Error;
use super::log::Log;
use super::measure::Measuring;
use super::recall::Recall;
use super::{interrupt, resolve, scenes};
use crate::backend::Backend;
use crate::evolve::{
    self, Checkpoint, Checkpoints, Control, Coverage, Fitness, ImageFitness, Outcome, Restriction,
    Search, Settings, TrainingScene, history,
};
use crate::expr::{Feature, PlaneId, Tree, codebook};
use crate::filter::{Filter, Gather, Window};
use crate::image::write_atomically;
use crate::plan::{Passes, Precision};
use crate::report::{Format, ScoreTable, Total, number};
use crate::scene::{Fact, Facts, LoadOptions, Needs, RawScene, Scene, SceneFiles, load_reference};
use crate::stress::{Engine, Ground, SEED, Screen, certify};
use parameters::Parameters;
use preset::Preset;
use progress::Progress;
use record::Origin;

/// What a bred filter is compared with at the end.
const RIVALS: [&str; 3] = ["bilateral", "cross-bilateral", "kan2017"];

const BEST: &str = "best.toml";
const HISTORY: &str = "history.csv";
const SUMMARY: &str = "summary.md";
const CHECKPOINT: &str = "checkpoint.json";
const SCENES: &str = "scenes.json";

/// What a search breeds on, unless told.
const DEFAULT_SCENES: &str = "data/train";

const EXAMPLES: &str = "\
Examples:
  tamis evolve --preset quick
  tamis evolve --preset paper --seed 7 --out runs/7
  tamis evolve --out runs/7 --resume --generations 400
  tamis evolve --scenes renders/a renders/b --max-time 600 --radius 8

Writes best.toml (the filter and where it comes from), summary.md, history.csv
and checkpoint.json into the output folder, but not over those of an older search,
unless with --overwrite. Ctrl-C ends the search with the best so far written; --resume
goes on from there, on the same scenes. The same seed finds the same filter with any number of threads.

Values in brackets are the presets' own.";

/// Search for a filter on training scenes.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Evolve {
    /// Folders with 4spp.exr and reference.exr in or below them, or pairs of files
    /// [default: data/train; with --resume those that the search was started with]
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

    /// Generations between checkpoints; 0 for one at the end only
    #[arg(long, value_name = "N", default_value_t = 5)]
    checkpoint_every: u32,

    /// Breed nothing whose results hang on the last bit of a feature or are far from
    /// exact, and let no finalist win that `tamis stress` finds unstable on the training
    /// scenes
    #[arg(long)]
    require_stable: bool,

    #[command(flatten)]
    parameters: Parameters,
}

impl Evolve {
    pub(super) fn run(&self, log: Log) -> Result<String, Error> {
        self.spare_older_runs()?;
        self.spare_what_is_fixed()?;
        let preset = self.preset.unwrap_or(Preset::Quick);
        let programs = match self.resume {
            true => evolve::programs::Checkpoint::is_one(&self.out.join(CHECKPOINT)),
            false => preset.programs().is_some(),
        };
        if programs {
            let mut settings = if self.resume { None } else { preset.programs() };
            if let Some(settings) = &mut settings {
                self.parameters.apply(settings)?;
            }
            return programs::run(self, settings, log);
        }
        self.run_for_weights(preset.weights(), log)
    }

    /// Searches for weights; `settings` are those of a new search.
    fn run_for_weights(&self, settings: Option<Settings>, log: Log) -> Result<String, Error> {
        if !self.validate.is_empty() {
            return Err(Error::Usage(
                "--validate is of searches for programs (--preset quick or programs)".to_owned(),
            ));
        }
        let checkpoint = match self.resume {
            true => Some(Checkpoint::read(&self.out.join(CHECKPOINT))?),
            false => None,
        };
        let settings = checkpoint.as_ref().map(|c| c.settings().clone()).or(settings);
        let mut settings = settings.expect("a search is new or goes on");
        self.parameters.apply(&mut settings)?;
        settings.validate()?;
        let backend = self.backend.open(self.lanes.lanes)?;
        let arguments = self.scenes()?;
        let files = scenes::find(&arguments)?;
        let training = load(&files, &settings, log)?;
        self.make_folder()?;
        if checkpoint.is_none() {
            forbid_absent(&mut settings, &training, log);
            if !self.parameters.gives("initial") {
                begin_with_what_is_there(&mut settings, log);
            }
        }
        let window = Window::dense(settings.radius);
        let coverage = Coverage::of(&settings);
        let fitness = ImageFitness::new(training, window, coverage, &*backend)
            .together(settings.together)
            .minimizing(settings.error)
            .breeding_at(settings.precision)
            .racing(&settings.racing, settings.seed);
        let fitness = match self.require_stable {
            true => fitness.restricted(stable_only(&files, window, &*backend)?),
            false => fitness,
        };
        let mut search = match checkpoint {
            Some(checkpoint) => Search::resume(checkpoint.until(settings.generations), &fitness)?,
            None => Search::new(settings.clone(), &fitness)?,
        };
        Recall::of(&arguments, &[]).write(&self.out.join(SCENES))?;
        let outcome = self.search(&mut search, &settings, log)?;
        let best = outcome.best();
        if let Some(difference) = best.difference.filter(|&d| d > fitness.tolerance()) {
            log.warn(format_args!(
                "warning: no finalist is computed within {} of its exact meaning; the result, the \
                 closest of them, is off by up to {}",
                number::difference(fitness.tolerance()),
                number::difference(difference),
            ));
        }
        if let Some(objection) = &best.objection {
            log.warn(format_args!("warning: no finalist is stable; of the result: {objection}"));
        }
        self.report(&settings, &outcome, &*backend, &files, log)
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

    /// The scenes to breed on, as arguments.
    fn scenes(&self) -> Result<Vec<PathBuf>, Error> {
        if !self.scenes.is_empty() {
            return Ok(self.scenes.clone());
        }
        let remembered = match self.resume {
            true => Recall::read(&self.out.join(SCENES))?.scenes(),
            false => Vec::new(),
        };
        Ok(match remembered.is_empty() {
            true => vec![DEFAULT_SCENES.into()],
            false => remembered,
        })
    }

    /// Checks that a search that goes on is told nothing that it cannot obey.
    fn spare_what_is_fixed(&self) -> Result<(), Error> {
        let fixed = self.parameters.fixed();
        if self.resume && !fixed.is_empty() {
            return Err(Error::Usage(format!(
                "--resume goes on with the parameters that the search was started with; leave \
                 {} out, or start a new search without --resume",
                fixed.join(", ")
            )));
        }
        Ok(())
    }

    fn make_folder(&self) -> Result<(), Error> {
        std::fs::create_dir_all(&self.out).map_err(|source| Error::Folder {
            path: self.out.display().to_string(),
            option: "--out",
            source,
        })
    }

    /// Runs the search to its end, however that comes.
    fn search<F: Fitness>(
        &self,
        search: &mut Search<'_, F>,
        settings: &Settings,
        log: Log,
    ) -> Result<Outcome, Error> {
        let stop = interrupt::flag(log, "stopping: judging the best so far");
        let time_limit = self.max_time.map(|seconds| Duration::from_secs(seconds.into()));
        let control = Control {
            stop,
            time_limit,
            checkpoints: Some(Checkpoints {
                path: self.out.join(CHECKPOINT),
                interval: self.checkpoint_every,
            }),
        };
        let mut progress = Progress::new(log, settings.generations, time_limit);
        let outcome = search.run(&control, &mut |event| progress.hear(event));
        progress.finish();
        outcome.map_err(|error| match error {
            evolve::Error::Fitness { source, checkpoint: Some(checkpoint) } => {
                Error::Interrupted { source, checkpoint }
            }
            other => other.into(),
        })
    }

    /// Measures and writes what was found.
    fn report(
        &self,
        settings: &Settings,
        outcome: &Outcome,
        backend: &dyn Backend,
        files: &[SceneFiles],
        log: Log,
    ) -> Result<String, Error> {
        let best = Filter::single("best", outcome.best().tree.clone(), settings.radius);
        let scores = scores(&best, settings, backend, files)?;
        for failure in scores.failures() {
            log.say(failure);
        }
        let origin = Origin {
            settings,
            backend: backend.name(),
            require_stable: self.require_stable,
            scores: &scores,
        };
        let path = |name: &str| self.out.join(name);
        for (name, text) in [
            (BEST, best.to_toml(record::training(&origin, outcome))),
            (HISTORY, history::csv(&outcome.history)),
            (SUMMARY, page::summary(&origin, outcome)),
        ] {
            write_atomically(&path(name), text.as_bytes())?;
        }
        log.say(format_args!(
            "wrote {}",
            [BEST, SUMMARY, HISTORY, CHECKPOINT]
                .map(|name| path(name).display().to_string())
                .join(", ")
        ));
        Ok(format!(
            "{}\n\ntraining error {} (sum of {} over {}), search {}\n{}\n\n{}",
            outcome.best().tree,
            number::error(outcome.best().full),
            settings.error.title(),
            number::plural(files.len(), "scene"),
            record::ending(outcome.ending),
            record::effort(outcome),
            scores.render(Format::Plain),
        ))
    }
}

/// The training scenes with all that they have, and their references.
fn load(files: &[SceneFiles], settings: &Settings, log: Log) -> Result<Vec<TrainingScene>, Error> {
    let mut training = Vec::with_capacity(files.len());
    for scene in files {
        let pad = settings.radius as usize;
        let noisy = Scene::load(&scene.noisy, &Needs::everything(), pad, &LoadOptions::default())?;
        for note in noisy.notes() {
            log.say(format_args!("{}: {note}", scene.noisy.display()));
        }
        training.push(TrainingScene::new(noisy, load_reference(&scene.reference)?)?);
    }
    Ok(training)
}

/// Keeps out what is unstable on the scenes.
fn stable_only<'a>(
    files: &[SceneFiles],
    window: Window,
    backend: &'a dyn Backend,
) -> Result<Restriction<'a>, Error> {
    let read = |scene: &SceneFiles| {
        let raw = RawScene::read(&scene.noisy, &Needs::everything(), &LoadOptions::default())?;
        Ok(Ground::real(raw))
    };
    let grounds = files.iter().map(read).collect::<Result<Vec<Ground>, Error>>()?;
    let screen = Screen::new(&grounds, window, backend, SEED)?;
    let objection = move |tree: &Tree| {
        let filter = Filter::of_gather("finalist", Gather::of_color(tree.clone(), window));
        let checked = filter.check().expect("searches breed weights");
        let engine = Engine {
            name: backend.name().to_owned(),
            backend: Ok(backend),
            precision: Precision::Standard,
        };
        let certificate = certify(&checked, &grounds, &[engine], SEED)?;
        Ok(certificate.objection().map(str::to_owned))
    };
    Ok(Restriction {
        name: "stable only",
        refuses: Box::new(move |tree| Ok(screen.refuses(tree)?)),
        objection: Box::new(objection),
    })
}

/// Takes what some scene lacks out of the search's vocabulary: a filter that
/// reads it could not be judged.
fn forbid_absent(settings: &mut Settings, training: &[TrainingScene], log: Log) {
    let facts = Facts::of_all(training.iter().map(TrainingScene::scene));
    let terms = Feature::terms().filter(|(feature, _)| feature.is_stored());
    let absent = terms.filter(|&(feature, quantity)| {
        PlaneId::of(feature, quantity).any(|plane| facts.get(plane) == Fact::Absent)
    });
    let names = absent.filter_map(|(feature, quantity)| feature.spelling(quantity));
    let names: Vec<String> = names.map(str::to_owned).collect();
    if !names.is_empty() {
        log.say(format_args!(
            "not used, as not every training scene has them: {}",
            names.join(", ")
        ));
        settings.forbidden.extend(names);
        settings.forbidden.sort();
        settings.forbidden.dedup();
    }
}

/// Lets a search whose preset begins with a filter that reads what is not there
/// begin with the paper's bilateral filter, which reads colour alone.
fn begin_with_what_is_there(settings: &mut Settings, log: Log) {
    let bilateral = evolve::Preset::Paper.settings().initial;
    let reads = |term: &String| {
        let initial = codebook::named(&settings.initial);
        initial.is_some_and(|tree| {
            let spellings = tree.symbols().iter().filter_map(|symbol| symbol.reads());
            spellings.map(|(feature, quantity)| feature.spelling(quantity)).any(|s| s == Some(term))
        })
    };
    if settings.forbidden.iter().any(reads) {
        log.say(format_args!(
            "beginning with `{bilateral}`: `{}` reads what the scenes lack",
            settings.initial
        ));
        settings.initial = bilateral;
    }
}

/// The bred filter and its rivals on the training scenes, all at one radius.
fn scores(
    best: &Filter,
    settings: &Settings,
    backend: &dyn Backend,
    files: &[SceneFiles],
) -> Result<ScoreTable, Error> {
    let mut filters = vec![best.clone()];
    for name in RIVALS {
        filters.push(resolve::resolve(name, Some(settings.radius))?);
    }
    let measuring = Measuring { backend, passes: Passes::ALL, options: LoadOptions::default() };
    // What there is to say of the scenes was said when the search loaded them.
    measuring.table(files, &filters, Total::Sum, Log::new(true))
}
