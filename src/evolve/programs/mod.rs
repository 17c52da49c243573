//! The search over programs.
//!
//! What gradients cannot find is structure: which statistics, which features where, how many
//! passes with which taps, which functions. A [`Search`] breeds whole programs:
//!
//! 1. A [`Genome`] is a filter in which everything is read. It begins with mutants of a filter
//!    that somebody wrote.
//! 2. Parents are chosen by the scenes and by three goals, error, run time and size
//!    ([`selection`]); mutation and crossover make children, formula by formula and stage by
//!    stage.
//! 3. A child inherits its parents' constants, and a few steps of gradient descent tune them
//!    before it is judged ([`Judge`]). Some of the population are tuned further.
//! 4. Who stays is said by non-dominated sorting, so that the front of error, time and size is
//!    never lost. Every few generations the best is tried on scenes that nothing is bred on.
//! 5. The winner is the program of the front that is best on those scenes, and is tuned once
//!    more.
//!
//! The run time is [predicted](crate::plan::Program::cost) and not measured, and random streams
//! are named, so that a search is the same on any machine with any number of threads.
//!
//! Nearly all of the time goes into judging children, which an [`Evaluator`] does: this process,
//! or a [`Farm`] of workers that [`serve`] it on as many machines.

mod checkpoint;
mod crossover;
mod draft;
mod evaluator;
mod farm;
mod genome;
pub mod history;
mod judge;
mod mutation;
mod protocol;
mod search;
pub mod selection;
mod serve;
mod settings;
mod written;

pub use checkpoint::Checkpoint;
pub use evaluator::{Batch, Evaluator, InProcess};
pub use farm::{Farm, Launch, News, Terms};
pub use genome::{Genome, Shape};
pub use history::Row;
pub use judge::{Bar, Job, Judge, Judged, Verdict};
pub use protocol::Briefing;
pub use search::{Event, Finalist, Outcome, Search};
pub use serve::{ServeError, serve};
pub use settings::{SEED, Settings};

use crate::filter::Filter;

/// What searches begin with unless they are told another: three passes over the light, whose
/// taps get farther apart (an edge-avoiding à-trous filter).
///
/// # Panics
/// Never: a test parses it.
pub fn seed() -> Filter {
    let text = include_str!("seed.toml");
    Filter::parse(text, "seed.toml".as_ref()).expect("a test parses it")
}

#[cfg(test)]
mod tests;
