//! Floor 8: the command line, one file per command.
//!
//! What holds of every command:
//! - What it finds out goes to stdout, and nothing else does: a command
//!   *returns* its text (or bytes), and [`main`] prints it; `denoise` alone writes lines and
//!   images as they are done. Progress and remarks go to stderr, through `Log`.
//! - The exit status is 0 if the work is done, 1 if it failed, 2 if the command
//!   line is wrong. What `stress` finds may be bad enough for a 1, too.
//!   A signal that ends the program makes it 128 and the signal's number.
//! - Errors name the file or the option at fault and say what to do.
//! - Files appear whole or not at all.
//! - No result depends on the number of threads.

mod apply;
mod backend;
mod bench;
mod compare;
mod completions;
mod denoise;
mod error;
mod evolve;
mod explain;
mod export;
mod filters;
mod gpus;
mod host;
mod inspect;
mod interrupt;
mod language;
mod log;
mod man;
mod measure;
mod options;
mod recall;
mod resolve;
mod scenes;
mod score;
mod sheet;
mod spare;
mod stress;
mod tune;

use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::process::ExitCode;
use std::time::Instant;

use clap::{CommandFactory, Parser, Subcommand};

use error::Error;
use log::Log;

/// Discovers analytic filters for Monte Carlo noise, and applies them.
///
/// A filter is an expression for the weight that pixel j has in the filtered
/// colour of pixel i, over the features that a renderer writes beside the
/// colour: `tamis language` lists what expressions are made of.
#[derive(Debug, Parser)]
#[command(name = "tamis", version, propagate_version = true, after_help = EXAMPLES)]
struct CommandLine {
    /// Threads to work with [default: one per core]; no result depends on it
    #[arg(long, global = true, value_name = "N")]
    threads: Option<NonZeroUsize>,

    /// Write nothing but errors and warnings to stderr
    #[arg(long, short, global = true)]
    quiet: bool,

    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  tamis denoise render.exr -o clean.exr
  tamis denoise frames/*.exr -o clean/
  tamis inspect render.exr
  tamis compare clean.exr reference.exr
  tamis evolve --preset quick --out out
  tamis denoise render.exr -o clean.exr --filter out/best.toml

Exit status: 0 done, 1 the work failed, 2 the command line is wrong.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Filter noisy images with the features in their files
    Denoise(denoise::Denoise),
    /// Search for a filter on training scenes
    Evolve(evolve::Evolve),
    /// Judge programs for a search that runs elsewhere; `evolve` starts this
    Worker(evolve::Worker),
    /// Tune a program's constants on scenes, by gradients
    Tune(tune::Tune),
    /// Measure how far an image is from its reference
    Compare(compare::Compare),
    /// Measure filters on scenes: one table
    Score(score::Score),
    /// Measure run time against error: a table, a chart and JSON
    Bench(bench::Bench),
    /// Certify that a filter is stable, or say why it is not
    Stress(stress::Stress),
    /// Say what each part of a filter does for a scene, and what time it takes
    Explain(explain::Explain),
    /// Draw a scene noisy, filtered and clean, side by side
    Sheet(sheet::Sheet),
    /// List a file's channels, what they feed, and what is wrong with them
    Inspect(inspect::Inspect),
    /// List the filters that have names
    Filters(filters::Filters),
    /// Write a filter as code or equations to paste elsewhere
    Export(export::Export),
    /// List the GPUs of this computer
    Gpus(gpus::Gpus),
    /// Explain the operators and features of expressions
    Language(language::Language),
    /// Write a shell's completions of commands and options to stdout
    Completions(completions::Completions),
    /// Write manual pages, one per command
    Man(man::Manual),
}

/// What a command found out.
struct Report {
    /// What is printed.
    bytes: Vec<u8>,
    /// Whether whoever looks at the exit status alone may go on.
    good: bool,
}

impl From<Vec<u8>> for Report {
    fn from(bytes: Vec<u8>) -> Self {
        Self { bytes, good: true }
    }
}

impl Command {
    /// Does the work and returns what it found out.
    fn run(&self, log: Log, started: Instant) -> Result<Report, Error> {
        let text = match self {
            Self::Denoise(command) => command.run(log, started),
            Self::Evolve(command) => return command.run(log),
            Self::Worker(command) => return command.run(),
            Self::Tune(command) => command.run(log),
            Self::Compare(command) => command.run(log),
            Self::Score(command) => command.run(log),
            Self::Bench(command) => command.run(log),
            Self::Explain(command) => command.run(log),
            Self::Sheet(command) => command.run(log),
            Self::Inspect(command) => command.run(),
            Self::Filters(command) => command.run(),
            Self::Gpus(command) => command.run(),
            Self::Export(command) => return command.run().map(Report::from),
            Self::Stress(command) => return command.run(log),
            Self::Language(command) => command.run(),
            Self::Completions(command) => return Ok(command.run(CommandLine::command()).into()),
            Self::Man(command) => command.run(CommandLine::command(), log),
        };
        text.map(|text| text.into_bytes().into())
    }
}

/// Runs the program on the process' arguments.
pub fn main() -> ExitCode {
    let started = Instant::now();
    let line = CommandLine::parse();
    let log = Log::new(line.quiet);
    let run = interrupt::listen()
        .and_then(|()| set_threads(line.threads))
        .and_then(|()| line.command.run(log, started));
    match run.and_then(print) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            log.error(&error);
            ExitCode::from(error.status())
        }
    }
}

/// More threads than any computer has cores for would only take its memory.
const MOST_THREADS: usize = 1024;

fn set_threads(threads: Option<NonZeroUsize>) -> Result<(), Error> {
    let Some(threads) = threads else { return Ok(()) };
    if threads.get() > MOST_THREADS {
        return Err(Error::Usage(format!("--threads {threads}: at most {MOST_THREADS}")));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.get());
    pool.build_global().map_err(|source| Error::Threads { threads, source })
}

/// Prints a report, and returns whether it is a good one.
fn print(Report { bytes, good }: Report) -> Result<bool, Error> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(&bytes).and_then(|()| stdout.flush()) {
        // Whoever reads has read enough (`tamis … | head`).
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(good),
        result => result.map(|()| good).map_err(Error::Stdout),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        CommandLine::command().debug_assert();
    }
}
