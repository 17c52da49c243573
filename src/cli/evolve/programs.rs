//! A search for programs, from scenes to filter files.

mod browser;
mod page;
mod progress;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use super::{
    BEST, CHECKPOINT, Evolve, HISTORY, PAGE, SCENES, SUMMARY, interrupted, no_provisional, record,
    repeat,
};
use crate::backend::{Backend, Differentiator};
use crate::cli::backend::OnProcessor;
use crate::cli::error::Error;
use crate::cli::log::Log;
use crate::cli::measure::Measuring;
use crate::cli::recall::Recall;
use crate::cli::{Report, resolve, scenes};
use crate::evolve::programs::{
    Checkpoint, Event, Farm, Finalist, Judge, News, Outcome, SEED, Search, Settings, history, seed,
};
use crate::filter::{Filter, stages};
use crate::image::{ImageError, write_atomically};
use crate::plan::Passes;
use crate::report::{Format, ScoreTable, Total, number};
use crate::scene::{LoadOptions, Needs};
use crate::tune::{Causes, Ending, TuningScene};
use browser::Told;
use page::{chart, front, rivals, summary};
use progress::Progress;

/// The folder of the programs of which none is better by all goals.
const FRONT: &str = "front";

/// A chart of them.
const CHART: &str = "front.svg";

/// The course, an object a line.
const LINES: &str = "history.jsonl";

/// What programs are bred on, and tried on, unless told.
const DEFAULT_SCENES: [&str; 2] = ["data/corpus/train", "data/train"];
const DEFAULT_VALIDATION: &str = "data/corpus/validate";

/// What a bred program is compared with at the end, beside what it began with.
const RIVALS: [&str; 3] = ["cross-bilateral", "kan2017", "tamis"];

/// Runs a search; `settings` are those of a new one, and nothing for one that goes on.
pub(super) fn run(command: &Evolve, settings: Option<Settings>, log: Log) -> Result<Report, Error> {
    command.backend.run(command.lanes.lanes, Breeding { command, settings, log })
}

/// A search on a back end.
struct Breeding<'a> {
    command: &'a Evolve,
    settings: Option<Settings>,
    log: Log,
}

impl OnProcessor for Breeding<'_> {
    type Output = Report;

    fn on(self, backend: &(impl Backend + Differentiator)) -> Result<Report, Error> {
        run_on(self.command, self.settings, backend, self.log)
    }
}

fn run_on(
    command: &Evolve,
    settings: Option<Settings>,
    backend: &(impl Backend + Differentiator),
    log: Log,
) -> Result<Report, Error> {
    if command.require_stable {
        return Err(Error::Usage(
            "--require-stable is of searches for weights (--preset weights or paper); of programs \
             look at the winner with `tamis stress`"
                .to_owned(),
        ));
    }
    let places = command.workers.places(command.backend, command.lanes)?;
    let _lock = command.claim()?;
    let checkpoint = match settings {
        Some(_) => None,
        None => Some(Checkpoint::read(&command.out.join(CHECKPOINT))?),
    };
    let (settings, initial) = match (settings, &checkpoint) {
        (Some(settings), _) => {
            let initial = initial(&settings.initial)?;
            (settings, initial)
        }
        (None, checkpoint) => {
            let checkpoint = checkpoint.as_ref().expect("it was read");
            let settings = command.told(checkpoint.settings().clone())?;
            (settings, checkpoint.initial().clone())
        }
    };
    let (training, validation) = arguments(command)?;
    let load = |arguments: &[PathBuf]| load(arguments, &settings, &initial);
    let (scenes, judges) = (load(&training)?, load(&validation)?);
    let levels = |scenes: &[TuningScene]| scenes.iter().map(|s| s.levels.len()).sum::<usize>();
    log.say(format_args!(
        "breeding programs from `{}` on {} images of {}, trying them on {} of {}",
        settings.initial,
        levels(&scenes),
        number::plural(scenes.len(), "scene"),
        levels(&judges),
        number::plural(judges.len(), "scene"),
    ));
    let judge = Judge::new(settings.clone(), &scenes, &judges, backend)?;
    let mut search = match checkpoint {
        Some(checkpoint) => Search::resume(checkpoint.until(settings.generations), judge)?,
        None => Search::new(initial, judge)?,
    };
    let recall = Recall::of(&training, &validation);
    recall.write(&command.out.join(SCENES))?;
    let told = Told {
        settings: &settings,
        command: repeat::command(&settings, &recall, &command.out, &[]),
    };
    let stop = Arc::new(AtomicBool::new(false));
    let control = command.control(&stop, log);
    let progress = Arc::new(Progress::new(log, settings.generations, control.time_limit));
    if !places.is_empty() {
        let terms = command.workers.terms(places, &training);
        let shown = Arc::clone(&progress);
        let hear = move |news: News| match news.is_warning() {
            true => shown.warn(news),
            false => shown.say(news),
        };
        let briefing = search.briefing().map_err(interrupted)?;
        search = search.judged_by(Farm::start(briefing, terms, hear)?);
    }
    let provisional = Provisional { told: &told, out: &command.out, causes: Mutex::default() };
    let outcome = search.run(&control, &|event| {
        if let Some(failure) = provisional.hear(event) {
            progress.warn(no_provisional(&failure));
        }
        progress.hear(event);
    });
    progress.finish();
    let outcome = outcome.map_err(interrupted)?;
    let judged_by = if validation.is_empty() { &training } else { &validation };
    let scores = match outcome.ending {
        Ending::Finished | Ending::TimeLimit => {
            let begun = search.checkpoint().initial().clone();
            let begun = Filter { name: format!("{}, as it was", begun.name), ..begun };
            Some(scores(&outcome, begun, judged_by, backend)?)
        }
        // Whoever stops a search wants it to end.
        Ending::Stopped => None,
    };
    let scene = match outcome.ending {
        Ending::Finished | Ending::TimeLimit => {
            let scene = judges.first().or(scenes.first()).expect("there is something to breed on");
            let best = outcome.best.judged.genome.filter();
            Some(browser::scene(scene, best, !judges.is_empty(), backend))
        }
        Ending::Stopped => None,
    };
    // What is found is written, whether it can be shown or not.
    let (scene, shown) = match scene.transpose() {
        Ok(scene) => (scene, true),
        Err(error) => {
            log.error(&error);
            (None, false)
        }
    };
    let page = browser::finished(&told, &outcome, scores.as_ref(), scene);
    let report = report(&command.out, &settings, &outcome, scores.as_ref(), page, log);
    Ok(Report { good: report.good && shown, ..report })
}

/// The bred program and its rivals, on the scenes that nothing was bred on if there are any.
fn scores(
    outcome: &Outcome,
    begun: Filter,
    scenes: &[PathBuf],
    backend: &impl Backend,
) -> Result<ScoreTable, Error> {
    let best = outcome.best.judged.genome.filter().clone();
    let mut filters = vec![Filter { name: "best".to_owned(), ..best }, begun];
    for name in RIVALS {
        filters.push(resolve::resolve(name, None)?);
    }
    let measuring = Measuring { backend, passes: Passes::ALL, options: LoadOptions::default() };
    // What there is to say of the scenes was said when the search loaded them.
    measuring.table(&scenes::find(scenes)?, &filters, Total::GeometricMean, Log::new(true))
}

/// The filter to begin with.
fn initial(name: &str) -> Result<Filter, Error> {
    if name == SEED { Ok(seed()) } else { resolve::resolve(name, None) }
}

/// The scenes to breed on and to judge by, as arguments.
fn arguments(command: &Evolve) -> Result<(Vec<PathBuf>, Vec<PathBuf>), Error> {
    let remembered = match command.resume {
        true => Recall::read(&command.out.join(SCENES))?,
        false => Recall::default(),
    };
    let given = !command.scenes.is_empty() || !remembered.scenes().is_empty();
    let or = |first: &Vec<PathBuf>, second: Vec<PathBuf>, third: &[&str]| -> Vec<PathBuf> {
        match (first.is_empty(), second.is_empty()) {
            (false, _) => first.clone(),
            (true, false) => second,
            (true, true) => third.iter().map(PathBuf::from).collect(),
        }
    };
    // Whoever names the scenes to breed on names those to judge by, or has none.
    let judges: &[&str] = if given { &[] } else { &[DEFAULT_VALIDATION] };
    Ok((
        or(&command.scenes, remembered.scenes(), &DEFAULT_SCENES),
        or(&command.validate, remembered.validate(), judges),
    ))
}

/// Scenes with what programs may read and the filter to begin with does.
pub(super) fn load(
    arguments: &[PathBuf],
    settings: &Settings,
    initial: &Filter,
) -> Result<Vec<TuningScene>, Error> {
    if arguments.is_empty() {
        return Ok(Vec::new());
    }
    let checked = initial.check().expect("filters that are read make sense");
    let needs = Needs::terms(settings.vocabulary()?).union(checked.needs());
    let reach = checked.reach().max(settings.max_reach);
    let files = scenes::find(arguments)?;
    let scene = |files| TuningScene::load(files, &needs, reach);
    Ok(files.iter().map(scene).collect::<Result<_, crate::tune::Error>>()?)
}

/// Writes what was found, as far as that can be done, and says it.
fn report(
    out: &Path,
    settings: &Settings,
    outcome: &Outcome,
    scores: Option<&ScoreTable>,
    page: String,
    log: Log,
) -> Report {
    let ending = record::ending(outcome.ending);
    let named = |finalist: &Finalist, name: &str| {
        let filter = Filter { name: name.to_owned(), ..finalist.judged.genome.filter().clone() };
        filter.to_toml(training(settings, finalist, ending))
    };
    let mut files = vec![
        (out.join(BEST), named(&outcome.best, "best")),
        (out.join(HISTORY), history::csv(&outcome.history)),
        (out.join(LINES), history::json_lines(&outcome.history)),
        (out.join(PAGE), page),
        (out.join(SUMMARY), summary(settings, outcome, scores)),
        (out.join(CHART), chart(outcome)),
    ];
    let folder = out.join(FRONT);
    for (finalist, number) in outcome.front.iter().zip(1..) {
        let name = format!("front-{number:02}");
        files.push((folder.join(format!("{name}.toml")), named(finalist, &name)));
    }
    let mut good = true;
    if let Err(source) = make_anew(&folder) {
        let path = folder.display().to_string();
        log.error(&Error::Folder { path, option: "--out", source });
        good = false;
        files.retain(|(path, _)| !path.starts_with(&folder));
    }
    let mut there: Vec<String> = Vec::new();
    for (path, text) in &files {
        match write_atomically(path, text.as_bytes()) {
            Ok(()) if path.starts_with(&folder) => {}
            Ok(()) => there.push(path.display().to_string()),
            Err(error) => {
                log.error(&error.into());
                good = false;
            }
        }
    }
    log.say(format_args!("wrote {} and {}", there.join(", "), folder.display()));
    let best = &outcome.best;
    let mut text = format!(
        "{}\n{}\n",
        stages(&best.judged.genome.filter().check().expect("genomes make sense")),
        front(outcome).render(Format::Plain),
    );
    if let Some(scores) = scores {
        text += &format!("{}\n", rivals(scores).render(Format::Plain));
    }
    text += &format!(
        "search {ending}: {} programs judged, {} given up\n",
        number::count(outcome.judged as usize),
        number::count(outcome.dropped as usize),
    );
    Report { bytes: text.into_bytes(), good }
}

/// Makes a folder; the programs of an older run in it go.
fn make_anew(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with("front-") && name.ends_with(".toml") {
            std::fs::remove_file(path)?;
        }
    }
    Ok(())
}

/// Writes the best so far and the course, for whoever's search is killed.
struct Provisional<'a> {
    told: &'a Told<'a>,
    out: &'a Path,
    causes: Mutex<Causes>,
}

impl Provisional<'_> {
    /// Takes news in. Returns why a file cannot be written, the first time for each cause.
    fn hear(&self, event: Event<'_>) -> Option<ImageError> {
        let Event::Generation { rows, best } = event else { return None };
        let mut causes = self.causes.lock().expect("nobody panics with it");
        let best = Finalist { judged: best.clone(), validation: None, difference: None };
        let filter = Filter { name: "best".to_owned(), ..best.judged.genome.filter().clone() };
        let files = [
            (BEST, filter.to_toml(training(self.told.settings, &best, "under way"))),
            (HISTORY, history::csv(rows)),
            (LINES, history::json_lines(rows)),
            (PAGE, browser::under_way(self.told, rows, &best.judged)),
        ];
        let mut written = files
            .iter()
            .map(|(name, text)| write_atomically(&self.out.join(name), text.as_bytes()));
        written.find_map(Result::err).filter(|error| causes.is_new(error))
    }
}

/// The `[training]` table of a filter file. Nothing in it hangs on a clock or on the number of
/// threads.
fn training(settings: &Settings, finalist: &Finalist, ending: &str) -> toml::Table {
    let mut table = toml::Table::new();
    let mut put = |key: &str, value: toml::Value| table.insert(key.to_owned(), value);
    put("program", concat!("tamis ", env!("CARGO_PKG_VERSION")).into());
    put("score", finalist.judged.error.into());
    if let Some([score, rel_mse, trimmed]) = finalist.validation {
        put("validation-score", score.into());
        put("validation-rel-mse", rel_mse.into());
        put("validation-trimmed-rel-mse", trimmed.into());
    }
    if let Some(difference) = finalist.difference {
        put("difference-from-exact", difference.into());
    }
    put("predicted-nanoseconds-per-pixel", finalist.judged.cost.into());
    put("nodes", (finalist.judged.genome.size() as i64).into());
    put("tuning-steps", i64::from(finalist.judged.steps).into());
    put("ending", ending.into());
    put("parameters", toml::Value::try_from(settings).expect("settings are TOML"));
    table
}
