//! `tamis tune`: the constants of a program, from scenes to a filter file.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use indicatif::ProgressBar;

use super::backend::{LanesArgs, OnProcessor, Processor};
use super::error::Error;
use super::log::Log;
use super::recall::Recall;
use super::{interrupt, resolve, scenes};
use crate::backend::{Backend, Differentiator};
use crate::filter::Filter;
use crate::image::{Lock, check_folder, write_atomically};
use crate::report::chart::{Chart, Point, Series};
use crate::report::{Align, Format, Table, number};
use crate::tune::{
    Checkpoint, Checkpoints, Control, Ending, Event, Loss, Outcome, Row, Settings, Tuner,
    TuningScene, csv,
};

const EXAMPLES: &str = "\
Examples:
  tamis tune tamis --scenes shots/train --validate shots/check -o mine.toml
  tamis tune tamis -o mine.toml --resume
  tamis denoise frame.exr -o clean.exr --filter mine.toml

A scene is a folder with reference.exr and 4spp.exr, or 1spp.exr, 16spp.exr and so on;
all that there are are tuned on, each of them as often. Tuned are [params], but for
those that say `tune = false`, and [layers]; constants whose bounds are positive by
their logarithms.

Writes the filter, and beside it its history (.csv), a chart of it (.svg) and a
checkpoint (.json), all named after it. Ctrl-C ends the run with what is best so far
written; --resume goes on from there, on the same scenes. The same seed finds the same constants with any
number of threads.";

/// What the list of a run's scenes is called after the output.
const SCENES: &str = "scenes.json";

/// Tune a program's constants on scenes, by gradients.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Tune {
    /// The program: a name or a file
    #[arg(value_name = "FILTER")]
    filter: String,

    /// Folders with 4spp.exr (or the like) and reference.exr in or below them, or pairs of
    /// files
    #[arg(long, num_args = 1.., value_name = scenes::VALUE, required_unless_present = "resume")]
    scenes: Vec<PathBuf>,

    /// Scenes that are not tuned on: the constants that are best there are the result
    #[arg(long, num_args = 1.., value_name = scenes::VALUE)]
    validate: Vec<PathBuf>,

    /// Where the tuned filter goes
    #[arg(short, long, value_name = "FILE.toml")]
    output: PathBuf,

    /// Go on from the checkpoint beside the output
    #[arg(long)]
    resume: bool,

    /// Replace what an older run left beside the output
    #[arg(long, conflicts_with = "resume")]
    overwrite: bool,

    /// End the run after so many seconds
    #[arg(long, value_name = "SECONDS")]
    max_time: Option<u32>,

    /// Steps between checkpoints; 0 for one at the end only
    #[arg(long, value_name = "N", default_value_t = 250)]
    checkpoint_every: u32,

    #[command(flatten)]
    parameters: Parameters,

    /// What runs the filter
    #[arg(long, value_enum, value_name = "BACKEND", default_value_t = Processor::DEFAULT)]
    backend: Processor,

    #[command(flatten)]
    lanes: LanesArgs,
}

/// What decides what a run finds.
#[derive(Debug, Args)]
struct Parameters {
    /// Names all random numbers [default: 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Steps; the rates fall to nothing until the last [default: 3000]
    #[arg(long, value_name = "N")]
    steps: Option<u32>,

    /// Parts of images per step [default: 4]
    #[arg(long, value_name = "N")]
    batch: Option<usize>,

    /// Columns and rows of a part [default: 112]
    #[arg(long, value_name = "PIXELS")]
    crop: Option<usize>,

    /// What is made small [default: balanced]
    #[arg(long, value_enum, value_name = "LOSS")]
    loss: Option<Loss>,

    /// How far a step moves a constant, at most about [default: 0.02]
    #[arg(long, value_name = "X")]
    rate: Option<f64>,

    /// How far a step moves a number of a layer [default: 0.004]
    #[arg(long, value_name = "X")]
    layer_rate: Option<f64>,

    /// What W of layers loses of itself per step, times its rate [default: 0.01]
    #[arg(long, value_name = "X")]
    decay: Option<f64>,

    /// The share of parts without some of the features, or without variances [default: 0.4]
    #[arg(long, value_name = "X")]
    drop: Option<f64>,

    /// Stops by which light is made brighter or darker, at most [default: 0.5]
    #[arg(long, value_name = "X")]
    stops: Option<f32>,

    /// The share of parts that are made less noisy [default: 0.15]
    #[arg(long, value_name = "X")]
    clean: Option<f64>,

    /// Steps between trials on the validation scenes [default: 250]
    #[arg(long, value_name = "N")]
    interval: Option<u32>,

    /// Trials without a better one after which the run ends; 0 for never [default: 0]
    #[arg(long, value_name = "N")]
    patience: Option<u32>,
}

impl ValueEnum for Loss {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        Some(clap::builder::PossibleValue::new(self.name()).help(self.doc()))
    }
}

impl Parameters {
    fn apply(&self, settings: &mut Settings) {
        fn set<T: Copy>(to: &mut T, from: Option<T>) {
            *to = from.unwrap_or(*to);
        }
        set(&mut settings.seed, self.seed);
        set(&mut settings.steps, self.steps);
        set(&mut settings.batch, self.batch);
        set(&mut settings.crop, self.crop);
        set(&mut settings.loss, self.loss);
        set(&mut settings.rate, self.rate);
        set(&mut settings.layer_rate, self.layer_rate);
        set(&mut settings.decay, self.decay);
        set(&mut settings.drop, self.drop);
        set(&mut settings.stops, self.stops);
        set(&mut settings.clean, self.clean);
        set(&mut settings.interval, self.interval);
        set(&mut settings.patience, self.patience);
    }

    /// The flags that were given, as they are written.
    fn given(&self) -> Vec<&'static str> {
        let flags = [
            ("--seed", self.seed.is_some()),
            ("--steps", self.steps.is_some()),
            ("--batch", self.batch.is_some()),
            ("--crop", self.crop.is_some()),
            ("--loss", self.loss.is_some()),
            ("--rate", self.rate.is_some()),
            ("--layer-rate", self.layer_rate.is_some()),
            ("--decay", self.decay.is_some()),
            ("--drop", self.drop.is_some()),
            ("--stops", self.stops.is_some()),
            ("--clean", self.clean.is_some()),
            ("--interval", self.interval.is_some()),
            ("--patience", self.patience.is_some()),
        ];
        flags.into_iter().filter(|(_, given)| *given).map(|(flag, _)| flag).collect()
    }
}

/// A run on a back end.
struct Tuning<'a> {
    command: &'a Tune,
    log: Log,
}

impl OnProcessor for Tuning<'_> {
    type Output = String;

    fn on(self, backend: &(impl Backend + Differentiator)) -> Result<String, Error> {
        self.command.run_on(backend, self.log)
    }
}

impl Tune {
    pub(super) fn run(&self, log: Log) -> Result<String, Error> {
        self.backend.run(self.lanes.lanes, Tuning { command: self, log })
    }

    fn run_on(&self, backend: &(impl Backend + Differentiator), log: Log) -> Result<String, Error> {
        let filter = resolve::resolve(&self.filter, None)?;
        let given = self.parameters.given();
        if self.resume && !given.is_empty() {
            return Err(Error::Usage(format!(
                "--resume goes on with the parameters that the run was started with; leave {} \
                 out, or start a new run without --resume",
                given.join(", ")
            )));
        }
        let _lock = self.claim()?;
        let checkpoint = self.beside("json");
        if checkpoint.exists() && !self.resume && !self.overwrite {
            let run = checkpoint.display().to_string();
            return Err(Error::OlderRun { run, option: "--output" });
        }
        let (scenes, validate) = self.scenes()?;
        let checkpoint = match self.resume {
            true => Some(Checkpoint::read(&checkpoint)?),
            false => None,
        };
        // A filter that cannot be read does not cost the time to load a hundred scenes.
        let mut settings = Settings::default();
        self.parameters.apply(&mut settings);
        settings.validate()?;
        let training = load(&scenes, &filter)?;
        let validation = match validate.is_empty() {
            true => Vec::new(),
            false => load(&validate, &filter)?,
        };
        if validation.is_empty() {
            log.say("no validation scenes: the result is the average of the last constants");
        }
        let levels = |scenes: &[TuningScene]| scenes.iter().map(|s| s.levels.len()).sum::<usize>();
        let mut tuner = match checkpoint {
            Some(checkpoint) => {
                Tuner::resume(checkpoint, filter.clone(), &training, &validation, backend)?
            }
            None => Tuner::new(filter.clone(), settings, &training, &validation, backend)?,
        };
        log.say(format_args!(
            "tuning {} constants on {} images of {}, validating on {} of {}; sets of features: {}",
            filter.constants.values().len(),
            levels(&training),
            number::plural(training.len(), "scene"),
            levels(&validation),
            number::plural(validation.len(), "scene"),
            tuner.feature_sets().join("; "),
        ));
        Recall::of(&scenes, &validate).write(&self.beside(SCENES))?;
        let outcome = self.tune(&mut tuner, log)?;
        let origin = training_table(tuner.settings(), &outcome, &filter, &training, &validation);
        let name = self.output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let tuned = Filter { name: name.clone(), ..outcome.filter.clone() };
        for (path, text) in [
            (self.output.clone(), tuned.to_toml(origin)),
            (self.beside("csv"), csv(&outcome.history)),
            (self.beside("svg"), chart(&name, &outcome.history).svg()),
        ] {
            write_atomically(&path, text.as_bytes())?;
        }
        let files = ["csv", "svg", "json"].map(|end| self.beside(end).display().to_string());
        log.say(format_args!("wrote {}, {}", self.output.display(), files.join(", ")));
        Ok(format!(
            "{}\n{}; the constants are those after step {}\n",
            table(&outcome.history),
            match outcome.ending {
                Ending::Finished => "finished",
                Ending::Stopped => "stopped by the user",
                Ending::TimeLimit => "stopped by the time limit",
            },
            outcome.step,
        ))
    }

    /// Checks that the output's folder can be written, and keeps others away from it.
    fn claim(&self) -> Result<Lock, Error> {
        let option = "--output";
        let folder = match self.output.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            Some(_) | None => Path::new("."),
        };
        check_folder(folder).map_err(|source| Error::Unwritable { option, source })?;
        Lock::take(&self.beside("lock")).map_err(|source| Error::Locked { option, source })
    }

    /// The scenes to tune on and to judge by, as arguments; those of a run that goes on are
    /// remembered.
    fn scenes(&self) -> Result<(Vec<PathBuf>, Vec<PathBuf>), Error> {
        let mut arguments = (self.scenes.clone(), self.validate.clone());
        if self.resume {
            let remembered = Recall::read(&self.beside(SCENES))?;
            if arguments.0.is_empty() {
                arguments.0 = remembered.scenes();
            }
            if arguments.1.is_empty() {
                arguments.1 = remembered.validate();
            }
        }
        Ok(arguments)
    }

    /// A file named after the output.
    fn beside(&self, extension: &str) -> PathBuf {
        self.output.with_extension(extension)
    }

    fn tune<B: Backend + Differentiator>(
        &self,
        tuner: &mut Tuner<'_, B>,
        log: Log,
    ) -> Result<Outcome, Error> {
        let stop = Arc::new(AtomicBool::new(false));
        interrupt::raise(&stop, log, "stopping after this step");
        let control = Control {
            stop,
            time_limit: self.max_time.map(|seconds| Duration::from_secs(seconds.into())),
            checkpoints: Some(Checkpoints {
                path: self.beside("json"),
                interval: self.checkpoint_every,
            }),
        };
        let mut progress = Progress::new(log, tuner.settings().steps);
        let history = self.beside("csv");
        let mut rows: Vec<Row> = Vec::new();
        let outcome = tuner.run(&control, &mut |event| {
            progress.hear(event);
            if let Event::Row(row) = event {
                rows.push(row.clone());
                // Only to be looked at: what counts is written at the end.
                let _ = write_atomically(&history, csv(&rows).as_bytes());
            }
        });
        progress.finish();
        Ok(outcome?)
    }
}

/// Scenes with what a filter reads.
fn load(arguments: &[PathBuf], filter: &Filter) -> Result<Vec<TuningScene>, Error> {
    let checked = filter.check().expect("filters that are read make sense");
    let files = scenes::find(arguments)?;
    let scene = |files| TuningScene::load(files, &checked.needs(), checked.reach());
    Ok(files.iter().map(scene).collect::<Result<_, crate::tune::Error>>()?)
}

/// A line that redraws itself on a terminal, and the rows of the history elsewhere.
struct Progress {
    log: Log,
    bar: Option<ProgressBar>,
    started: Instant,
    first: Option<u32>,
    row: String,
}

impl Progress {
    fn new(log: Log, steps: u32) -> Self {
        let bar = log.bar(steps.into());
        Self { log, bar, started: Instant::now(), first: None, row: String::new() }
    }

    fn hear(&mut self, event: Event<'_>) {
        match event {
            Event::Unwritten(error) => {
                let warn = || {
                    self.log.warn(format_args!(
                        "warning: {error}; the run goes on, but cannot be resumed unless a later \
                         checkpoint can be written"
                    ));
                };
                match &self.bar {
                    Some(bar) => bar.suspend(warn),
                    None => warn(),
                }
            }
            Event::Step { step, of } => {
                let first = *self.first.get_or_insert(step - 1);
                let done = f64::from(step - first);
                let left = f64::from(of - step);
                let left = self.started.elapsed().mul_f64(left / done);
                if let Some(bar) = &self.bar {
                    bar.set_position(step.into());
                    let left = number::clock(left);
                    bar.set_message(format!("step {step}/{of}  {}  {left} left", self.row));
                }
            }
            Event::Row(row) => {
                self.row = match row.validation.is_nan() {
                    true => format!("training {:.4}", row.training),
                    false => format!(
                        "training {:.4}  validation {:.4}  RelMSE {} ({})",
                        row.training,
                        row.validation,
                        number::error(row.rel_mse),
                        number::error(row.trimmed_rel_mse),
                    ),
                };
                if self.bar.is_none() {
                    let time = number::clock(self.started.elapsed());
                    self.log.say(format_args!("{time}  step {}  {}", row.step, self.row));
                }
            }
        }
    }

    fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Where the constants come from, as the filter's file tells. Nothing in it hangs on a clock
/// or on the number of threads.
fn training_table(
    settings: &Settings,
    outcome: &Outcome,
    filter: &Filter,
    training: &[TuningScene],
    validation: &[TuningScene],
) -> toml::Table {
    let mut table = toml::Table::new();
    let mut put = |key: &str, value: toml::Value| table.insert(key.to_owned(), value);
    put("program", concat!("tamis ", env!("CARGO_PKG_VERSION")).into());
    put("tuned-from", filter.name.clone().into());
    put("step", i64::from(outcome.step).into());
    if let Some(row) = outcome.history.iter().find(|row| row.step == outcome.step)
        && !row.validation.is_nan()
    {
        put("validation-score", row.validation.into());
        put("validation-rel-mse", row.rel_mse.into());
        put("validation-trimmed-rel-mse", row.trimmed_rel_mse.into());
    }
    let names = |scenes: &[TuningScene]| {
        let name = |scene: &TuningScene| toml::Value::from(scene.name.clone());
        toml::Value::Array(scenes.iter().map(name).collect())
    };
    put("scenes", names(training));
    put("validation-scenes", names(validation));
    put("parameters", toml::Value::try_from(settings).expect("settings are TOML"));
    table
}

/// The most rows of the table that is printed.
const COURSE: usize = 16;

fn table(rows: &[Row]) -> String {
    let right = ["training", "validation", "RelMSE", "trimmed"].map(|name| (name, Align::Right));
    let mut table = Table::new([("step", Align::Right)].into_iter().chain(right));
    let every = rows.len().div_ceil(COURSE).max(1);
    let shown = rows.iter().enumerate().filter(|(k, _)| k % every == 0 || k + 1 == rows.len());
    let cell = |x: f64, text: String| if x.is_nan() { "-".to_owned() } else { text };
    for (_, row) in shown {
        table.row([
            row.step.to_string(),
            cell(row.training, format!("{:.4}", row.training)),
            cell(row.validation, format!("{:.4}", row.validation)),
            cell(row.rel_mse, number::error(row.rel_mse)),
            cell(row.trimmed_rel_mse, number::error(row.trimmed_rel_mse)),
        ]);
    }
    table.render(Format::Plain)
}

/// The errors on the validation scenes over the steps; without any, what the score of the
/// parts that were drawn stands for.
fn chart(name: &str, rows: &[Row]) -> Chart {
    let series = |shape: &str, value: fn(&Row) -> f64| Series {
        color: name.to_owned(),
        shape: shape.to_owned(),
        points: rows
            .iter()
            .map(|row| Point {
                x: f64::from(row.step),
                y: value(row),
                label: String::new(),
                title: format!("step {}: {}", row.step, number::error(value(row))),
            })
            .collect(),
    };
    let validated = rows.iter().any(|row| !row.validation.is_nan());
    Chart {
        title: format!("Tuning {name}"),
        subtitle: match validated {
            true => "Geometric means over the validation scenes".to_owned(),
            false => "Loss of the parts that were drawn".to_owned(),
        },
        x: "steps".to_owned(),
        y: if validated { "RelMSE" } else { "loss" }.to_owned(),
        series: match validated {
            true => vec![
                series("RelMSE", |row| row.rel_mse),
                series("without the worst 0.1%", |row| row.trimmed_rel_mse),
            ],
            false => vec![series("loss", |row| row.training.exp())],
        },
        colors: "filter".to_owned(),
        shapes: "error".to_owned(),
        labels: String::new(),
        front: "no earlier one errs less".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    #[test]
    fn files_are_named_after_the_output() {
        let names = ["csv", "json"].map(|end| Path::new("runs/mine.toml").with_extension(end));
        assert_eq!(names, [PathBuf::from("runs/mine.csv"), PathBuf::from("runs/mine.json")]);
    }
}
