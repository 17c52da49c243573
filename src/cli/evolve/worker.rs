//! `tamis worker`: judges for a search that runs elsewhere.

use std::io::{self, BufRead, IsTerminal, Write};
use std::path::PathBuf;
use std::process::exit;
use std::sync::mpsc::{self, Sender};
use std::thread;

use clap::Args;

use super::programs::load;
use crate::backend::{Backend, Differentiator};
use crate::cli::Report;
use crate::cli::backend::{LanesArgs, OnProcessor, Processor};
use crate::cli::error::Error;
use crate::cli::scenes;
use crate::evolve::programs::{Settings, serve};
use crate::filter::Filter;
use crate::image::remove_temporary_files;

const EXAMPLES: &str = "\
`tamis evolve --workers N` starts workers on this machine, and --worker-command
\"ssh node7 tamis worker\" starts one by any command. Nobody starts one by hand: it
talks with the search on standard input and output, and ends when the input does.

The scenes are looked for where the search has them, relative paths from the
worker's own folder. Pictures that differ from the search's are refused by name.";

/// Judge programs for a search that runs elsewhere; `evolve` starts this
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(in crate::cli) struct Worker {
    /// Where the search's training scenes are on this machine: the same scenes in the same order
    /// [default: where the search has them]
    #[arg(long, num_args = 1.., value_name = scenes::VALUE)]
    scenes: Vec<PathBuf>,

    /// What runs the filters; no result depends on it
    #[arg(long, value_enum, value_name = "BACKEND", default_value_t = Processor::DEFAULT)]
    backend: Processor,

    #[command(flatten)]
    lanes: LanesArgs,
}

impl Worker {
    pub(in crate::cli) fn run(&self) -> Result<Report, Error> {
        if io::stdin().is_terminal() {
            return Err(Error::Usage(
                "a worker talks with a search on standard input and output; start one with \
                 `tamis evolve --workers N` or --worker-command"
                    .to_owned(),
            ));
        }
        self.backend.run(self.lanes.lanes, Serving(self))
    }

    fn load(
        &self,
        scenes: &[String],
        settings: &Settings,
        initial: &Filter,
    ) -> Result<Vec<crate::tune::TuningScene>, Error> {
        let theirs: Vec<PathBuf> = scenes.iter().map(PathBuf::from).collect();
        load(if self.scenes.is_empty() { &theirs } else { &self.scenes }, settings, initial)
    }
}

/// A worker at work.
struct Serving<'a>(&'a Worker);

impl OnProcessor for Serving<'_> {
    type Output = Report;

    fn on(self, backend: &(impl Backend + Differentiator)) -> Result<Report, Error> {
        let (sender, lines) = mpsc::channel();
        let read = move || read(&sender);
        // It reads from the start: a search that ends must not wait for scenes to be loaded.
        thread::Builder::new().name("input".to_owned()).spawn(read).map_err(Error::Thread)?;
        let load = |scenes: &[String], settings: &Settings, initial: &Filter| {
            self.0.load(scenes, settings, initial)
        };
        let good = serve(lines.into_iter(), Output, backend, load)?;
        Ok(Report { bytes: Vec::new(), good })
    }
}

/// Reads lines until the search ends, and then ends this process, whatever it is at: there is
/// nobody to answer to.
fn read(lines: &Sender<String>) {
    for line in io::stdin().lock().lines() {
        let Ok(line) = line else { break };
        if lines.send(line).is_err() {
            // What was wrong with an earlier line is told by whoever found it.
            return;
        }
    }
    leave();
}

fn leave() -> ! {
    remove_temporary_files();
    exit(0)
}

/// Standard output, whose end is that of the process: the search hears nothing any more.
struct Output;

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        io::stdout().write(bytes).map_err(|_| leave())
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stdout().flush().map_err(|_| leave())
    }
}
