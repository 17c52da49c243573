//! Floor 7: the genetic search for filters (Section 4 of the paper).
//!
//! A [`Search`] takes [`Settings`] and a [`Fitness`] and breeds expressions
//! that make the fitness small:
//!
//! 1. Each island starts from the initial expression and mutants of it
//!    ([`breeding::initial`]).
//! 2. Tournaments ([`selection`]) choose parents; reproduction, [`crossover`]
//!    and [`mutation`] make the next generation of them
//!    ([`breeding::offspring`]).
//! 3. The children that are new, up to the order of commuting operands
//!    ([`canonical`]), are judged, all islands' together, and those that cannot
//!    win only for as long as that is in doubt ([`race`]); the others' fitness is
//!    remembered ([`memo`]).
//! 4. Every few generations each island's best migrates to the next
//!    ([`islands`]).
//! 5. The best of the whole run ([`hall`]) are judged in full at the end, and
//!    the best of those that is computed accurately, and to which there is no other
//!    objection, is the result.
//!
//! Where this goes beyond the paper it says so: the elite is never lost, ties go to
//! the smaller tree, trees have a size limit, expressions that cannot win are dropped
//! early, what magnifies rounding errors does not win, and there is a fifth kind of
//! mutation, off in the paper's preset.
//!
//! The result depends on the settings and the fitness alone. Random streams
//! are named ([`stream`](crate::tune::stream)), orders are total ([`individual`]), and what a clock or
//! a user may end ([`Control`]) can go on from its [`Checkpoint`] to the same
//! result.
//!
//! Only one room of this floor knows of images: [`images`], the paper's
//! fitness. Any function of expressions can be minimised, their length for one:
//!
//! ```
//! use std::convert::Infallible;
//! use tamis::evolve::{Control, Fitness, Preset, Search, Settings};
//! use tamis::expr::Tree;
//!
//! struct Brevity;
//!
//! impl Fitness for Brevity {
//!     type Error = Infallible;
//!
//!     fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
//!         Ok(trees.iter().map(|tree| tree.len() as f64).collect())
//!     }
//!
//!     fn identity(&self) -> String {
//!         "brevity".to_owned()
//!     }
//! }
//!
//! let settings = Settings { generations: 10, ..Preset::Weights.settings() };
//! let outcome = Search::new(settings, &Brevity)?.run(&Control::default(), &mut |_| {})?;
//! assert_eq!(outcome.best().tree.len(), 1);
//! # Ok::<(), tamis::evolve::Error>(())
//! ```

pub mod breeding;
pub mod canonical;
pub mod checkpoint;
pub mod crossover;
mod encoding;
pub mod error;
pub mod event;
pub mod fitness;
pub mod hall;
pub mod history;
pub mod images;
pub mod individual;
pub mod islands;
pub mod materials;
pub mod memo;
pub mod mutation;
pub mod programs;
pub mod race;
pub mod search;
pub mod selection;
pub mod settings;
pub mod summary;
mod variation;

pub use crate::tune::{Checkpoints, Control, Ending};
pub use checkpoint::Checkpoint;
pub use error::{Error, with_causes};
pub use event::Event;
pub use fitness::Fitness;
pub use images::{Coverage, ImageFitness, JudgeError, Restriction, TrainingScene};
pub use individual::{Individual, Judgement};
pub use race::{Bar, Entrant, Ruling, Work};
pub use search::{Finalist, Outcome, Search};
pub use settings::{MutationWeights, Preset, Racing, Settings};
pub use summary::Summary;

#[cfg(test)]
mod tests;
