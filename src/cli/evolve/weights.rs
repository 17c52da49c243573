//! A search for weights of one window, from scenes to a filter file.

mod browser;
mod page;
mod progress;
mod provisional;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::record::{self, Origin};
use super::{
    BEST, CHECKPOINT, Evolve, HISTORY, PAGE, SCENES, SUMMARY, interrupted, no_checkpoint,
    no_provisional, repeat,
};
use crate::backend::{Backend, BackendError, PAIRS, Stoppable};
use crate::cli::backend::Processor;
use crate::cli::error::Error;
use crate::cli::log::Log;
use crate::cli::measure::Measuring;
use crate::cli::recall::Recall;
use crate::cli::{Report, resolve, scenes};
use crate::evolve::{
    self, Checkpoint, Coverage, Event, Fitness, ImageFitness, Outcome, Restriction, Search,
    Settings, TrainingScene, history,
};
use crate::expr::{Feature, PlaneId, Tree, codebook};
use crate::filter::{Filter, Gather, Window};
use crate::image::write_atomically;
use crate::plan::{Passes, Precision};
use crate::report::{ScoreTable, Total, number};
use crate::scene::{Fact, Facts, LoadOptions, Needs, RawScene, Scene, SceneFiles, load_reference};
use crate::stress::{Engine, Ground, SEED, Screen, certify};
use progress::Progress;
use provisional::Provisional;

/// What a bred filter is compared with at the end.
const RIVALS: [&str; 3] = ["bilateral", "cross-bilateral", "kan2017"];

/// What a search breeds on, unless told.
const DEFAULT_SCENES: &str = "data/train";

impl Evolve {
    /// Searches for weights; `settings` are those of a new search, and nothing for one that
    /// goes on.
    pub(super) fn run_for_weights(
        &self,
        settings: Option<Settings>,
        log: Log,
    ) -> Result<Report, Error> {
        let backend = self.backend.open(self.lanes.lanes)?;
        let _lock = self.claim()?;
        let (checkpoint, mut settings) = match settings {
            Some(settings) => (None, settings),
            None => {
                let checkpoint = Checkpoint::read(&self.out.join(CHECKPOINT))?;
                let settings = checkpoint.settings().clone();
                (Some(checkpoint), self.told(settings)?)
            }
        };
        let arguments = self.scenes()?;
        let files = scenes::find(&arguments)?;
        let training = load(&files, &settings, log)?;
        if checkpoint.is_none() {
            forbid_absent(&mut settings, &training, log);
            if !self.parameters.gives("initial") {
                begin_with_what_is_there(&mut settings, log);
            }
        }
        let stop = Arc::new(AtomicBool::new(false));
        let backend = Stoppable::new(&*backend, Arc::clone(&stop), pairs(self.backend));
        let window = Window::dense(settings.radius);
        let coverage = Coverage::of(&settings);
        let fitness = ImageFitness::new(training, window, coverage, &backend)
            .together(settings.together)
            .minimizing(settings.error)
            .breeding_at(settings.precision)
            .racing(&settings.racing, settings.seed);
        let fitness = match self.require_stable {
            true => fitness.restricted(stable_only(&files, window, &backend, &stop)?),
            false => fitness,
        };
        let mut search = match checkpoint {
            Some(checkpoint) => Search::resume(checkpoint.until(settings.generations), &fitness)?,
            None => Search::new(settings.clone(), &fitness)?,
        };
        let recall = Recall::of(&arguments, &[]);
        recall.write(&self.out.join(SCENES))?;
        let switches: &[&str] = if self.require_stable { &["--require-stable"] } else { &[] };
        let mut origin = Origin {
            settings: &settings,
            backend: backend.name(),
            require_stable: self.require_stable,
            command: repeat::command(&settings, &recall, &self.out, switches),
            scenes: files.len(),
            scores: None,
        };
        let (outcome, kept) = match self.search(&mut search, &origin, &stop, log) {
            Ok(found) => found,
            Err(error) => {
                // What was found before is not lost.
                let Some(best) = search.best() else { return Err(error) };
                log.error(&error);
                return Ok(Report { bytes: format!("{}\n", best.tree).into_bytes(), good: false });
            }
        };
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
        let filter = Filter::single("best", best.tree.clone(), settings.radius);
        let scores = scores(&filter, &settings, &backend, &files, &stop);
        if let Err(error) = &scores {
            log.error(error);
        }
        origin.scores = scores.as_ref().ok().and_then(Option::as_ref);
        let written = self.write(&origin, &outcome, &filter, kept, log);
        let bytes = record::report(&origin, &outcome, &self.out).into_bytes();
        Ok(Report { bytes, good: written && scores.is_ok() })
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

    /// Runs the search to its end, however that comes. Also says whether it can be resumed.
    fn search<F: Fitness>(
        &self,
        search: &mut Search<'_, F>,
        origin: &Origin<'_>,
        stop: &Arc<AtomicBool>,
        log: Log,
    ) -> Result<(Outcome, bool), Error> {
        let control = self.control(stop, log);
        let mut progress = Progress::new(log, origin.settings.generations, control.time_limit);
        let mut provisional = Provisional::new(origin, &self.out);
        let mut kept = false;
        let outcome = search.run(&control, &mut |event| {
            if let Event::Checkpoint { written, failure, .. } = event {
                kept = written;
                if let Some(failure) = failure {
                    progress.warn(no_checkpoint(failure));
                }
            }
            if let Some(failure) = provisional.hear(event) {
                progress.warn(no_provisional(&failure));
            }
            progress.hear(event);
        });
        progress.finish();
        Ok((outcome.map_err(interrupted)?, kept))
    }

    /// Writes what was found, as far as that can be done; returns whether all of it was.
    fn write(
        &self,
        origin: &Origin<'_>,
        outcome: &Outcome,
        filter: &Filter,
        kept: bool,
        log: Log,
    ) -> bool {
        if let Some(scores) = origin.scores {
            scores.failures().into_iter().for_each(|failure| log.say(failure));
        }
        let mut there: Vec<PathBuf> = Vec::new();
        let files = [
            (BEST, filter.to_toml(record::training(origin, outcome))),
            (SUMMARY, page::summary(origin, outcome)),
            (PAGE, browser::finished(origin, outcome)),
            (HISTORY, history::csv(&outcome.history)),
        ];
        let all = files.len();
        for (name, text) in files {
            let path = self.out.join(name);
            match write_atomically(&path, text.as_bytes()) {
                Ok(()) => there.push(path),
                Err(error) => log.error(&error.into()),
            }
        }
        let good = there.len() == all;
        if kept {
            there.push(self.out.join(CHECKPOINT));
        }
        let names: Vec<String> = there.iter().map(|path| path.display().to_string()).collect();
        if !names.is_empty() {
            log.say(format_args!("wrote {}", names.join(", ")));
        }
        good
    }
}

/// How much a back end is given at once: half a second's work on one thread, about.
fn pairs(processor: Processor) -> usize {
    match processor {
        Processor::Jit => PAIRS,
        // With a sixteenth of it a search took 2.3 seconds to stop on two busy cores.
        Processor::Interp => PAIRS / 32,
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
    stop: &Arc<AtomicBool>,
) -> Result<Restriction<'a>, Error> {
    let read = |scene: &SceneFiles| {
        let raw = RawScene::read(&scene.noisy, &Needs::everything(), &LoadOptions::default())?;
        Ok(Ground::real(raw))
    };
    let grounds = files.iter().map(read).collect::<Result<Vec<Ground>, Error>>()?;
    let screen = Screen::new(&grounds, window, backend, SEED)?;
    let stop = Arc::clone(stop);
    let objection = move |tree: &Tree| {
        let filter = Filter::of_gather("finalist", Gather::of_color(tree.clone(), window));
        let checked = filter.check().expect("searches breed weights");
        let engine = Engine {
            name: backend.name().to_owned(),
            backend: Ok(backend),
            precision: Precision::Standard,
        };
        let certificate = certify(&checked, &grounds, &[engine], SEED)?;
        // A back end that was stopped may count as one that failed.
        if stop.load(Ordering::Relaxed) {
            return Err(BackendError::Stopped.into());
        }
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

/// The bred filter and its rivals on the training scenes, all at one radius; none if somebody
/// asks to stop.
fn scores(
    best: &Filter,
    settings: &Settings,
    backend: &dyn Backend,
    files: &[SceneFiles],
    stop: &AtomicBool,
) -> Result<Option<ScoreTable>, Error> {
    let mut filters = vec![best.clone()];
    for name in RIVALS {
        filters.push(resolve::resolve(name, Some(settings.radius))?);
    }
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let measuring = Measuring { backend, passes: Passes::ALL, options: LoadOptions::default() };
    // What there is to say of the scenes was said when the search loaded them.
    let measure = |files| measuring.table(files, &filters, Total::Sum, Log::new(true));
    let mut table = measure(&[])?;
    for scene in files {
        table.scenes.extend(measure(std::slice::from_ref(scene))?.scenes);
        // A filter that was stopped counts as one that cannot run.
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
    }
    Ok(Some(table))
}
