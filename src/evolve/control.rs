//! What may end a search early, and what lets it go on another day.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How a run is to be watched over. None of it changes what a search that gets
/// to its end finds.
#[derive(Clone, Debug, Default)]
pub struct Control {
    /// Set this (on Ctrl-C, say) and the search ends after the running batch.
    pub stop: Arc<AtomicBool>,
    /// Ends the search after the batch in which the time is up. The one thing
    /// here that a clock decides, and only where the user asks for it.
    pub time_limit: Option<Duration>,
    /// Where and how often to write checkpoints.
    pub checkpoints: Option<Checkpoints>,
}

/// Where and how often checkpoints are written. One more is written when the
/// search ends, early or not.
#[derive(Clone, Debug)]
pub struct Checkpoints {
    /// The file.
    pub path: PathBuf,
    /// Generations from one to the next; 0 for the one at the end only.
    pub interval: u32,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// After its last generation.
    Finished,
    /// Because it was asked to stop.
    Stopped,
    /// Because its time was up.
    TimeLimit,
}

/// A control in force, since a moment.
pub(super) struct Watch<'a> {
    control: &'a Control,
    started: Instant,
}

impl<'a> Watch<'a> {
    pub(super) fn start(control: &'a Control) -> Self {
        Self { control, started: Instant::now() }
    }

    /// Why to end now, if there is a reason.
    pub(super) fn ending(&self) -> Option<Ending> {
        if self.control.stop.load(Ordering::Relaxed) {
            Some(Ending::Stopped)
        } else if self.control.time_limit.is_some_and(|limit| self.started.elapsed() >= limit) {
            Some(Ending::TimeLimit)
        } else {
            None
        }
    }
}
