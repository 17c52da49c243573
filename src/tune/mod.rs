//! Floor 6: constants of programs, tuned by gradients.
//!
//! A [`Tuner`] takes a filter, [`Settings`] and scenes at several sample counts, and changes
//! the constants that may be tuned and the blocks of layers so that a [`Loss`] becomes small:
//!
//! 1. Parts of random scenes are drawn ([`draw`]), turned at random, and without some of the
//!    features, as files lack them.
//! 2. The gradient of the loss by every constant is that of
//!    [`Differentiable`](crate::backend::Differentiable) code, a part per thread. What a part
//!    counts is divided by how bad its image is by now, so that no scene outweighs the others
//!    for being noisier ([`loss`]).
//! 3. AdamW moves the constants within their bounds ([`optimizer`]), and a moving average of
//!    them is kept, which is the result.
//! 4. Every so often the average is tried on whole validation scenes. The best of these
//!    trials is what is handed out, and if none was better for a while the run ends.
//!
//! The result depends on the settings, the scenes and the filter alone: streams of random
//! numbers are named ([`stream`]), parts are summed in their order, and what a clock or a user
//! ends goes on from its [`Checkpoint`] to the same bits.

pub mod checkpoint;
pub mod control;
pub mod draw;
mod error;
pub mod loss;
pub mod optimizer;
pub mod rng;
mod scenes;
pub mod sealed;
pub mod settings;
mod trial;
mod tuner;

pub use checkpoint::{Checkpoint, Row, csv};
pub(crate) use control::Watch;
pub use control::{Causes, Checkpoints, Control, Ending, Keeper};
pub use error::Error;
pub use loss::{Loss, Reference};
pub use rng::{Stream, stream};
pub use scenes::{Level, TuningScene, pictures};
pub use sealed::{SealedError, read_sealed, write_sealed};
pub use settings::Settings;
pub use trial::{Score, Trial, scores};
pub use tuner::{Event, Outcome, Tuner};

#[cfg(test)]
mod tests;
