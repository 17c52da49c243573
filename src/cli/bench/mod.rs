//! `tamis bench`: run time against error, everybody in one run.
//!
//! Every filter on every back end with every radius, and what others offer, if it
//! is there: exported C through compilers, Open Image Denoise. All of them filter
//! each scene in turn, round by round ([`contest`]), so that times can be compared
//! on a machine that is not alone; results are held to the reference, and those of
//! filters to their exact meaning ([`exact`]). Who fails has a dash in the table
//! and a remark on stderr.

mod compiled;
mod contest;
mod engine;
mod exact;
mod oidn;
mod program;

use std::fs;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use clap::Args;

use super::apply::{needs, reach};
use super::backend::{Lanes, Tier, tiers};
use super::error::Error;
use super::log::Log;
use super::scenes;
use super::score::filters;
use crate::filter::{Filter, Window};
use crate::image::write_atomically;
use crate::plan::Precision;
use crate::report::{Format, Tradeoff};
use crate::scene::{Facts, LoadOptions, Needs, Scene, load_reference};
use compiled::Compiled;
use contest::{Contest, Contestant, Entrant, Round};
use engine::{Choice, Engine, OnEngine};
use oidn::{Given, Oidn};

const EXAMPLES: &str = "\
Examples:
  tamis bench
  tamis bench --filters tamis cross-bilateral --radii 5 8 10 --rounds 9
  tamis bench --backend jit gpu --gpu 0
  tamis bench --cc clang gcc --oidn ~/oidn/bin/oidnDenoise -o out/rivals

Times are of the filtering alone, on all threads; of OIDN, what it reports of its
filter's execution, with the whole process in a column of its own. Compiling
includes planning, and of OIDN it is the initialisation of its filter. RelMSE is
the geometric mean over the scenes, in parentheses without the worst 0.1% of the
pixels. `from f64` is the greatest relative difference from the exact filter, on
a sample of rows. A dash stands where there is no such figure.

Written are table.md, bench.json and pareto.svg.";

/// The radii at which filters are compared, beside their own.
const RADII: [u32; 2] = [5, 10];

/// Measure run time against error.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Bench {
    /// Filters: names, files or expressions [default: all that have names]
    #[arg(long, num_args = 1.., value_name = "FILTER")]
    filters: Vec<String>,

    /// Folders with 4spp.exr and reference.exr in or below them, or pairs of files
    #[arg(long, num_args = 1.., value_name = scenes::VALUE, default_value = "data/test")]
    scenes: Vec<PathBuf>,

    /// What runs the filters [default: all that need no GPU]
    #[arg(long, num_args = 1.., value_enum, value_name = "BACKEND")]
    backend: Vec<Choice>,

    /// Bits of the vectors of machine code, each of them a back end of its own
    #[arg(long, num_args = 1.., value_enum, value_name = "BITS", default_value = "auto")]
    lanes: Vec<Lanes>,

    /// How accurate filters are run, each a back end of its own; `exact` is one for all
    /// [default: standard, on a GPU also fast]
    #[arg(long, num_args = 1.., value_name = "PRECISION", value_parser = tiers())]
    precision: Vec<Tier>,

    /// Which GPU: an index or a part of its name (see `tamis gpus`) [default: the
    /// best]
    #[arg(long, value_name = "NAME|INDEX")]
    gpu: Option<String>,

    /// Window radii in pixels [default: 5, 10 and the filter's own]
    #[arg(long, num_args = 1.., value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(..=i64::from(Window::MAX_RADIUS)))]
    radii: Vec<u32>,

    /// C compilers that exported filters are compiled with
    #[arg(long, num_args = 1.., value_name = "PATH")]
    cc: Vec<PathBuf>,

    /// Open Image Denoise's program [default: `oidnDenoise` if it is on the PATH]
    #[arg(long, value_name = "PATH")]
    oidn: Option<PathBuf>,

    /// Measurements of each, of which the median counts
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..))]
    rounds: u16,

    /// The folder for the table, the figures and the chart
    #[arg(long, short, value_name = "DIR", default_value = "out/bench")]
    output: PathBuf,

    /// Print JSON
    #[arg(long, conflicts_with = "markdown")]
    json: bool,

    /// Print a Markdown table
    #[arg(long)]
    markdown: bool,
}

impl Bench {
    pub(super) fn run(&self, log: Log) -> Result<String, Error> {
        if self.gpu.is_some() && !self.backend.contains(&Choice::Gpu) {
            return Err(Error::Usage("--gpu: only `--backend gpu` uses one".to_owned()));
        }
        for compiler in &self.cc {
            program::check(compiler, "--cc", "--version")?;
        }
        if let Some(oidn) = &self.oidn {
            program::check(oidn, "--oidn", "--help")?;
        }
        let filters = self.filters()?;
        let found = scenes::find(&self.scenes)?;
        let threads = rayon::current_num_threads();
        let entrants = self.entrants(&filters, threads)?;
        // Minutes may pass before there is something to write.
        fs::create_dir_all(&self.output).map_err(|source| Error::Folder {
            path: self.output.display().to_string(),
            option: "--output",
            source,
        })?;

        let all = filters.iter().map(needs).chain(Given::ALL.map(Given::needs));
        let all = all.fold(Needs::nothing(), Needs::union);
        let pad = filters.iter().map(reach).max().unwrap_or(0);
        let mut contest = Contest::of(entrants, usize::from(self.rounds));
        for files in &found {
            log.say(format_args!("{}: {} rounds", files.name, self.rounds));
            let scene = Scene::load(&files.noisy, &all, pad, &LoadOptions::default())?;
            let facts = Facts::of(&scene);
            let reference = load_reference(&files.reference)?;
            contest.run(&Round { scene, facts, reference })?;
        }
        let (grounds, entries) = contest.finish();
        let rounds = usize::from(self.rounds);
        let tradeoff = Tradeoff { grounds, entries, threads, rounds };
        for failure in tradeoff.failures() {
            log.say(failure);
        }
        let json = tradeoff.to_json();
        let markdown = tradeoff.render(Format::Markdown);
        for (name, text) in
            [("table.md", &markdown), ("bench.json", &json), ("pareto.svg", &tradeoff.chart())]
        {
            write_atomically(&self.output.join(name), text.as_bytes())?;
        }
        log.say(format_args!("{}: table.md, bench.json, pareto.svg", self.output.display()));
        Ok(match (self.json, self.markdown) {
            (true, _) => json,
            (false, true) => markdown,
            (false, false) => tradeoff.render(Format::Plain),
        })
    }

    /// Every filter with every radius, each pair once.
    fn filters(&self) -> Result<Vec<Filter>, Error> {
        let radii = if self.radii.is_empty() { &RADII[..] } else { &self.radii };
        let mut all = Vec::new();
        for own in filters(&self.filters, None)? {
            // The windows of a program have radii of their own.
            let sizes: Result<Vec<Filter>, Error> = match own.paper() {
                None => Ok(Vec::new()),
                Some(_) => radii.iter().map(|&r| Ok(own.clone().resized(r)?)).collect(),
            };
            let mut sizes = sizes?;
            if self.radii.is_empty() || sizes.is_empty() {
                sizes.push(own);
            }
            sizes.sort_by_key(reach);
            sizes.dedup();
            all.extend(sizes);
        }
        Ok(all)
    }

    /// How accurate a back end is to run filters.
    fn precisions(&self, choice: Choice) -> Vec<Precision> {
        if self.precision.is_empty() {
            return match choice {
                Choice::Jit | Choice::Interp => vec![Precision::Standard],
                Choice::Gpu => Precision::ALL.into(),
            };
        }
        let code = |tier: &Tier| match tier {
            Tier::Code(precision) => Some(*precision),
            Tier::Exact => None,
        };
        self.precision.iter().filter_map(code).collect()
    }

    /// Everybody who takes part, in the order of the rows.
    fn entrants(&self, filters: &[Filter], threads: usize) -> Result<Vec<Entrant>, Error> {
        let processors = Choice::processors();
        let choices = if self.backend.is_empty() { &processors } else { &self.backend };
        let mut engines: Vec<Rc<Engine>> = Vec::new();
        for choice in choices {
            let precisions = self.precisions(*choice);
            let opened = choice.open(&precisions, &self.lanes, self.gpu.as_deref())?;
            engines.extend(opened.into_iter().map(Rc::new));
        }
        if self.precision.contains(&Tier::Exact) {
            engines.push(Rc::new(Engine::exact()));
        }
        let mut entrants = Vec::new();
        for filter in filters {
            let mut enter = |engine: String, contestant| {
                let meaning = filter.paper().cloned();
                let radius = meaning.as_ref().map(|gather| gather.window.radius);
                let filter = filter.name.clone();
                entrants.push(Entrant { filter, engine, radius, meaning, contestant });
            };
            for engine in &engines {
                let contestant = OnEngine { engine: Rc::clone(engine), filter: filter.clone() };
                enter(engine.name.clone(), Ok(Box::new(contestant)));
            }
            for compiler in &self.cc {
                let compiled = Compiled::new(filter, compiler, threads);
                enter(called(compiler), compiled.map(|c| Box::new(c) as Box<dyn Contestant>));
            }
        }
        let oidn = self.oidn.clone().or_else(|| program::on_the_path(oidn::NAME));
        for (program, given) in oidn.iter().flat_map(|p| Given::ALL.map(|given| (p, given))) {
            entrants.push(Entrant {
                filter: given.title(),
                engine: "oidn".to_owned(),
                radius: None,
                meaning: None,
                contestant: Ok(Box::new(Oidn { program: program.clone(), given, threads })),
            });
        }
        Ok(entrants)
    }
}

/// What the table calls a compiler.
fn called(compiler: &Path) -> String {
    let name = compiler.file_name().unwrap_or(compiler.as_os_str());
    format!("C, {}", name.to_string_lossy())
}
