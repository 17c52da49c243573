//! What may end long work early, and what lets it go on another day.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How a run is to be watched over. None of it changes what one that gets to its end
/// finds.
#[derive(Clone, Debug, Default)]
pub struct Control {
    /// Set this (on Ctrl-C, say) and the run ends after the batch under way.
    pub stop: Arc<AtomicBool>,
    /// Ends the run after the batch in which the time is up. The one thing
    /// here that a clock decides, and only where the user asks for it.
    pub time_limit: Option<Duration>,
    /// Where and how often to write checkpoints.
    pub checkpoints: Option<Checkpoints>,
}

/// Where and how often checkpoints are written. One more is written when the
/// run ends, early or not.
#[derive(Clone, Debug)]
pub struct Checkpoints {
    /// The file.
    pub path: PathBuf,
    /// Generations, or steps, from one to the next; 0 for the one at the end only.
    pub interval: u32,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// With nothing left to do.
    Finished,
    /// Because it was asked to stop.
    Stopped,
    /// Because its time was up.
    TimeLimit,
}

/// A control in force, since a moment.
pub(crate) struct Watch<'a> {
    control: &'a Control,
    started: Instant,
}

impl<'a> Watch<'a> {
    pub(crate) fn start(control: &'a Control) -> Self {
        Self { control, started: Instant::now() }
    }

    /// Why to end now, if there is a reason.
    pub(crate) fn ending(&self) -> Option<Ending> {
        if self.control.stop.load(Ordering::Relaxed) {
            Some(Ending::Stopped)
        } else if self.control.time_limit.is_some_and(|limit| self.started.elapsed() >= limit) {
            Some(Ending::TimeLimit)
        } else {
            None
        }
    }
}
