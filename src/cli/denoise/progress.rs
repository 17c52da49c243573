//! How far a run is: a line that redraws itself on a terminal, which counts several
//! frames, and names the step that a single one is at. Elsewhere the frames' own remarks
//! tell.

use std::time::Instant;

use indicatif::ProgressBar;

use crate::cli::log::Log;
use crate::report::number;

pub(super) struct Progress {
    started: Instant,
    frames: usize,
    bar: Option<ProgressBar>,
}

impl Progress {
    pub(super) fn new(log: Log, frames: usize) -> Self {
        let bar = if frames > 1 { log.bar(frames as u64) } else { log.spinner() };
        Self { started: Instant::now(), frames, bar }
    }

    /// Clears the line while others write theirs.
    pub(super) fn aside<T>(&self, say: impl FnOnce() -> T) -> T {
        match &self.bar {
            Some(bar) => bar.suspend(say),
            None => say(),
        }
    }

    /// Shows what is done with a single frame. Several are at several steps at a time.
    pub(super) fn step(&self, step: &'static str) {
        if let Some(bar) = self.bar.as_ref().filter(|_| self.frames == 1) {
            bar.set_message(step);
        }
    }

    /// Shows that so many frames are done; `skipped` of them took no time.
    pub(super) fn advance(&self, done: usize, skipped: usize) {
        let Some(bar) = self.bar.as_ref().filter(|_| self.frames > 1) else { return };
        let each = self.started.elapsed().div_f64((done - skipped).max(1) as f64);
        bar.set_position(done as u64);
        bar.set_message(format!(
            "frame {done}/{}  {} per frame  {} left",
            self.frames,
            number::duration(each),
            number::clock(each.mul_f64((self.frames - done) as f64)),
        ));
    }

    /// Clears the line.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
