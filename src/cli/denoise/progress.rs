//! How far a run is: a line that redraws itself on a terminal, which counts several
//! frames, or names the step that a single one is at, and while that is filtered counts its
//! rows. Elsewhere the frames' own remarks tell.

use std::sync::OnceLock;
use std::time::Instant;

use indicatif::ProgressBar;

use crate::cli::log::{Log, style};
use crate::report::number;

pub(super) struct Progress {
    started: Instant,
    frames: usize,
    bar: Option<ProgressBar>,
    /// When a single frame's filtering began.
    filtering: OnceLock<Instant>,
}

impl Progress {
    pub(super) fn new(log: Log, frames: usize) -> Self {
        let bar = if frames > 1 { log.bar(frames as u64) } else { log.spinner() };
        Self { started: Instant::now(), frames, bar, filtering: OnceLock::new() }
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
            if bar.length().is_some() {
                bar.unset_length();
                bar.set_style(style(false));
            }
            bar.set_message(step);
        }
    }

    /// Shows that so many rows of a single frame are filtered, of how many.
    pub(super) fn rows(&self, done: usize, of: usize) {
        let Some(bar) = self.bar.as_ref().filter(|_| self.frames == 1) else { return };
        let took = self.filtering.get_or_init(Instant::now).elapsed();
        if bar.length().is_none() {
            bar.set_length(of as u64);
            bar.set_style(style(true));
        }
        // Threads may tell out of order.
        bar.set_position(bar.position().max(done as u64));
        let left = took.mul_f64((of - done) as f64 / done.max(1) as f64);
        bar.set_message(format!("filtering  row {done}/{of}  {} left", number::clock(left)));
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
