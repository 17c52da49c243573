//! A search for programs, from scenes to filter files.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use super::pace::Pace;
use super::parameters::listing;
use super::{BEST, CHECKPOINT, Evolve, HISTORY, SCENES, SUMMARY, record};
use crate::backend::{Backend, Differentiator, Interpreter};
use crate::cli::backend::Processor;
use crate::cli::error::Error;
use crate::cli::log::Log;
use crate::cli::measure::Measuring;
use crate::cli::recall::Recall;
use crate::cli::{Report, interrupt, resolve, scenes};
use crate::evolve;
use crate::evolve::programs::{
    Checkpoint, Event, Finalist, Judge, Outcome, Row, SEED, Search, Settings, history, seed,
};
use crate::filter::{Filter, stages};
use crate::image::{ImageError, Metrics, write_atomically};
use crate::plan::Passes;
use crate::report::chart::{Chart, Point, Series};
use crate::report::{Align, Format, ScoreTable, Table, Total, number};
use crate::scene::{LoadOptions, Needs};
use crate::tune::{Causes, Checkpoints, Control, Ending, TuningScene};

/// The folder of the programs of which none is better by all goals.
const FRONT: &str = "front";

/// A chart of them.
const CHART: &str = "front.svg";

/// What programs are bred on, and tried on, unless told.
const DEFAULT_SCENES: [&str; 2] = ["data/corpus/train", "data/train"];
const DEFAULT_VALIDATION: &str = "data/corpus/validate";

/// What a bred program is compared with at the end, beside what it began with.
const RIVALS: [&str; 3] = ["cross-bilateral", "kan2017", "tamis"];

/// Rows of the table that shows the run's course.
const COURSE: usize = 12;

/// Seconds between lines where nothing can be redrawn.
const PAUSE: Duration = Duration::from_secs(10);

/// Runs a search; `settings` are those of a new one, and nothing for one that goes on.
pub(super) fn run(command: &Evolve, settings: Option<Settings>, log: Log) -> Result<Report, Error> {
    match command.backend {
        Processor::Interp => {
            // What cannot be is said as everywhere.
            command.backend.open(command.lanes.lanes)?;
            run_on(command, settings, &Interpreter, log)
        }
        #[cfg(feature = "jit")]
        Processor::Jit => run_on(command, settings, &command.lanes.lanes.open()?, log),
        #[cfg(not(feature = "jit"))]
        Processor::Jit => {
            Err(command.backend.open(command.lanes.lanes).err().expect("it is absent"))
        }
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
    Recall::of(&training, &validation).write(&command.out.join(SCENES))?;
    let stop = Arc::new(AtomicBool::new(false));
    interrupt::raise(&stop, log, "stopping: the result is the best so far");
    let time_limit = command.max_time.map(|seconds| Duration::from_secs(seconds.into()));
    let control = Control {
        stop: Arc::clone(&stop),
        time_limit,
        checkpoints: Some(Checkpoints {
            path: command.out.join(CHECKPOINT),
            interval: command.checkpoint_every,
        }),
    };
    let progress = Progress::new(log, settings.generations, time_limit);
    let provisional =
        Provisional { settings: &settings, out: &command.out, causes: Mutex::default() };
    let outcome = search.run(&control, &|event| {
        if let Some(failure) = provisional.hear(event) {
            progress.warn(format_args!(
                "warning: {failure}; the search goes on without writing its best so far"
            ));
        }
        progress.hear(event);
    });
    progress.finish();
    let outcome = outcome.map_err(|error| match error {
        evolve::Error::Fitness { source, checkpoint: Some(checkpoint) } => {
            Error::Interrupted { source, checkpoint }
        }
        other => other.into(),
    })?;
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
    Ok(report(&command.out, &settings, &outcome, scores.as_ref(), log))
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

/// Filters with their errors, as means over the scenes; of those that cannot run on one, none.
fn rivals(scores: &ScoreTable) -> Table {
    let mut table = Table::new([
        ("filter", Align::Left),
        ("RelMSE", Align::Right),
        ("without the worst 0.1%", Align::Right),
    ]);
    let row = |table: &mut Table, name: &str, metrics: Vec<&Metrics>| {
        let mean = |figure: fn(&Metrics) -> f64| {
            number::error(Total::GeometricMean.of(metrics.iter().map(|metrics| figure(metrics))))
        };
        table.row([name.to_owned(), mean(|m| m.rel_mse), mean(|m| m.trimmed_rel_mse)]);
    };
    row(&mut table, "none: as rendered", scores.scenes.iter().map(|score| &score.noisy).collect());
    for (k, name) in scores.filters.iter().enumerate() {
        let measured = scores.scenes.iter().map(|score| score.filters[k].as_ref());
        match measured.collect::<Result<Vec<_>, _>>() {
            Ok(measured) => {
                row(&mut table, name, measured.iter().map(|measured| &measured.metrics).collect())
            }
            Err(_) => table.row([name.as_str(), "-", "-"].map(str::to_owned)),
        }
    }
    table
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
fn load(
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
        front(outcome, Format::Plain),
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
    settings: &'a Settings,
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
        let text = filter.to_toml(training(self.settings, &best, "under way"));
        let written = write_atomically(&self.out.join(BEST), text.as_bytes());
        let written = written.and_then(|()| {
            write_atomically(&self.out.join(HISTORY), history::csv(rows).as_bytes())
        });
        written.err().filter(|error| causes.is_new(error))
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

/// The result and the front as a table.
fn front(outcome: &Outcome, format: Format) -> String {
    let mut table = Table::new([
        ("program", Align::Left),
        ("score", Align::Right),
        ("validation", Align::Right),
        ("RelMSE (trimmed)", Align::Right),
        ("ns/pixel", Align::Right),
        ("nodes", Align::Right),
        ("stages", Align::Right),
        ("from exact", Align::Right),
    ]);
    let rows = outcome.front.iter().zip(1..).map(|(f, k)| (format!("front-{k:02}"), f));
    for (name, finalist) in rows.chain([("best".to_owned(), &outcome.best)]) {
        let judged = &finalist.judged;
        let dash = || "-".to_owned();
        let errors = |[_, rel_mse, trimmed]: [f64; 3]| {
            format!("{} ({})", number::error(rel_mse), number::error(trimmed))
        };
        table.row([
            name,
            format!("{:.4}", judged.error),
            finalist.validation.map_or_else(dash, |[score, ..]| format!("{score:.4}")),
            finalist.validation.map_or_else(dash, errors),
            format!("{:.0}", judged.cost),
            judged.genome.size().to_string(),
            judged.genome.filter().stages.len().to_string(),
            finalist.difference.map_or_else(dash, number::difference),
        ]);
    }
    table.render(format)
}

/// The summary of a run, for people: one Markdown page.
fn summary(settings: &Settings, outcome: &Outcome, scores: Option<&ScoreTable>) -> String {
    let best = &outcome.best;
    let filter = best.judged.genome.filter();
    let checked = filter.check().expect("genomes make sense");
    let mut page = format!(
        "# A bred program\n\nSeed {}, from `{}`. The search {} after generation {} of {}; it judged \
         {} programs and gave up {}.\n\n",
        settings.seed,
        settings.initial,
        record::ending(outcome.ending),
        outcome.history.last().map_or(0, |row| row.generation),
        settings.generations,
        outcome.judged,
        outcome.dropped,
    );
    page += &format!("```text\n{}```\n\n", stages(&checked));
    page += "## The front\n\nPrograms of which none is better by score, predicted time and size at \
             once, the fastest first, and the result. RelMSE is of the validation scenes.\n\n";
    page += &front(outcome, Format::Markdown);
    page += &format!("\n![Predicted time against score]({CHART})\n");
    if let Some(scores) = scores {
        page += "\n## Beside other filters\n\nGeometric means over the scenes that nothing was bred \
                 on (the training scenes, if there are none).\n\n";
        page += &rivals(scores).render(Format::Markdown);
    }
    page += "\n## Course\n\n";
    page += &course(&outcome.history);
    page += "\n## Parameters\n\n";
    let columns = ["flag", "value", "meaning"];
    let mut table = Table::new(columns.map(|name| (name, Align::Left)));
    for [flag, value, doc] in listing(settings) {
        table.row([format!("`{flag}`"), value, doc]);
    }
    page += &table.render(Format::Markdown);
    page
}

fn course(rows: &[Row]) -> String {
    let names = ["generation", "best", "median", "validation", "RelMSE", "ns/pixel", "nodes"];
    let mut table = Table::new(names.map(|name| (name, Align::Right)));
    let step = rows.len().div_ceil(COURSE).max(1);
    let shown = rows.iter().enumerate().filter(|(k, _)| k % step == 0 || k + 1 == rows.len());
    let cell = |x: f64, text: String| if x.is_nan() { "-".to_owned() } else { text };
    for (_, row) in shown {
        table.row([
            row.generation.to_string(),
            format!("{:.4}", row.best),
            format!("{:.4}", row.median),
            cell(row.validation, format!("{:.4}", row.validation)),
            cell(row.rel_mse, number::error(row.rel_mse)),
            format!("{:.0}", row.cost),
            row.size.to_string(),
        ]);
    }
    table.render(Format::Markdown)
}

/// Predicted time against the error on the validation scenes, or where there are none on the
/// training scenes.
fn chart(outcome: &Outcome) -> String {
    let error = |finalist: &Finalist| match finalist.validation {
        Some([_, rel_mse, _]) => rel_mse,
        None => finalist.judged.error.exp(),
    };
    let validated = outcome.best.validation.is_some();
    let point = |finalist: &Finalist, label: String| Point {
        x: finalist.judged.cost,
        y: error(finalist),
        title: format!(
            "{label}: {:.0} ns per pixel, {}",
            finalist.judged.cost,
            number::error(error(finalist))
        ),
        label,
    };
    // Each on its own, so that nothing joins them: files in front/ are in the order of time alone.
    let series = |name: &str, point| Series {
        color: name.to_owned(),
        shape: name.to_owned(),
        points: vec![point],
    };
    let front = outcome.front.iter().zip(1..);
    let front = front.map(|(f, k): (_, usize)| series("front", point(f, k.to_string())));
    let best = series("best", point(&outcome.best, "best".to_owned()));
    Chart {
        title: "Bred programs".to_owned(),
        subtitle: match validated {
            true => "Geometric means over the validation scenes".to_owned(),
            false => "Scores on the training scenes".to_owned(),
        },
        x: "predicted nanoseconds per pixel".to_owned(),
        y: if validated { "RelMSE" } else { "loss" }.to_owned(),
        series: front.chain([best]).collect(),
        colors: "programs".to_owned(),
        shapes: "programs".to_owned(),
        labels: "Numbers at marks: files in front/.".to_owned(),
        front: "no faster one errs less".to_owned(),
    }
    .svg()
}

/// A line that redraws itself on a terminal, and a line every so often elsewhere.
struct Progress {
    log: Log,
    bar: Option<ProgressBar>,
    started: Instant,
    time_limit: Option<Duration>,
    generations: u32,
    state: Mutex<Shown>,
}

/// What is shown.
struct Shown {
    /// The generation that this run starts with, once it is known.
    first: Option<u32>,
    row: String,
    last_line: Option<Instant>,
    pace: Pace,
    /// When the generation under way was begun.
    began: Instant,
}

impl Progress {
    fn new(log: Log, generations: u32, time_limit: Option<Duration>) -> Self {
        let bar = log.bar(0);
        let started = Instant::now();
        let state = Shown {
            first: None,
            row: String::new(),
            last_line: None,
            pace: Pace::default(),
            began: started,
        };
        Self { log, bar, started, time_limit, generations, state: Mutex::new(state) }
    }

    fn hear(&self, event: Event<'_>) {
        let mut state = self.state.lock().expect("nobody panics with it");
        match event {
            Event::Child { generation, judged, of } => {
                self.show(&mut state, generation, judged as f64 / of.max(1) as f64);
            }
            Event::NoCheckpoint(failure) => self.warn(format_args!(
                "warning: {failure}; the search goes on, but cannot be resumed unless a later \
                 checkpoint can be written"
            )),
            Event::Generation { rows, .. } => {
                let row = rows.last().expect("it was just added");
                let took = state.began.elapsed();
                state.pace.add(took);
                state.began = Instant::now();
                state.row = format!("score {:.4}", row.best);
                if !row.validation.is_nan() {
                    state.row += &format!(
                        "  validation {:.4}  RelMSE {} ({})",
                        row.validation,
                        number::error(row.rel_mse),
                        number::error(row.trimmed_rel_mse)
                    );
                    if self.bar.is_none() {
                        let line = format!("generation {}  {}", row.generation, state.row);
                        self.log.say(line);
                        state.last_line = Some(Instant::now());
                    }
                }
                self.show(&mut state, row.generation, 1.0);
            }
            Event::Finish { steps } => {
                let text = format!("tuning the winner by {steps} steps");
                match &self.bar {
                    Some(bar) => bar.set_message(text),
                    None => self.log.say(text),
                }
            }
        }
    }

    fn show(&self, state: &mut Shown, generation: u32, share: f64) {
        const FINENESS: f64 = 1000.0;
        let first = *state.first.get_or_insert(generation);
        let done = f64::from(generation - first) + share;
        let all = f64::from((self.generations + 1).saturating_sub(first)).max(1.0);
        let after = f64::from(self.generations.saturating_sub(generation));
        let mut left = state.pace.left(after, share, state.began.elapsed());
        if let Some(limit) = self.time_limit {
            left = left.min(limit.saturating_sub(self.started.elapsed()));
        }
        let text = format!(
            "generation {generation}/{}  {}  {} left",
            self.generations,
            state.row,
            number::clock(left)
        );
        match &self.bar {
            Some(bar) => {
                bar.set_length((all * FINENESS) as u64);
                bar.set_position((done * FINENESS) as u64);
                bar.set_message(text);
            }
            None if state.last_line.is_none_or(|then| then.elapsed() >= PAUSE) => {
                state.last_line = Some(Instant::now());
                self.log.say(text);
            }
            None => {}
        }
    }

    fn warn(&self, warning: impl std::fmt::Display) {
        match &self.bar {
            Some(bar) => bar.suspend(|| self.log.warn(warning)),
            None => self.log.warn(warning),
        }
    }

    fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
