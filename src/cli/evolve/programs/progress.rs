//! The progress of a search for programs.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use crate::cli::evolve::no_checkpoint;
use crate::cli::evolve::pace::Pace;
use crate::cli::log::Log;
use crate::evolve::programs::Event;
use crate::report::number;

/// Seconds between lines where nothing can be redrawn.
const PAUSE: Duration = Duration::from_secs(10);

/// A line that redraws itself on a terminal, and a line every so often elsewhere.
pub(super) struct Progress {
    log: Log,
    bar: Option<ProgressBar>,
    started: Instant,
    time_limit: Option<Duration>,
    generations: u32,
    state: Mutex<Shown>,
}

/// What is shown.
struct Shown {
    /// The generation that this run starts with, once it is known.
    first: Option<u32>,
    row: String,
    last_line: Option<Instant>,
    pace: Pace,
    /// When the generation under way was begun.
    began: Instant,
}

impl Progress {
    pub(super) fn new(log: Log, generations: u32, time_limit: Option<Duration>) -> Self {
        let bar = log.bar(0);
        let started = Instant::now();
        let state = Shown {
            first: None,
            row: String::new(),
            last_line: None,
            pace: Pace::default(),
            began: started,
        };
        Self { log, bar, started, time_limit, generations, state: Mutex::new(state) }
    }

    pub(super) fn hear(&self, event: Event<'_>) {
        let mut state = self.state.lock().expect("nobody panics with it");
        match event {
            Event::Child { generation, judged, of } => {
                self.show(&mut state, generation, judged as f64 / of.max(1) as f64);
            }
            Event::NoCheckpoint(failure) => self.warn(no_checkpoint(failure)),
            Event::Generation { rows, .. } => {
                let row = rows.last().expect("it was just added");
                let took = state.began.elapsed();
                state.pace.add(took);
                state.began = Instant::now();
                state.row = format!("score {:.4}", row.best);
                if !row.validation.is_nan() {
                    state.row += &format!(
                        "  validation {:.4}  RelMSE {} ({})",
                        row.validation,
                        number::error(row.rel_mse),
                        number::error(row.trimmed_rel_mse)
                    );
                    if self.bar.is_none() {
                        let line = format!("generation {}  {}", row.generation, state.row);
                        self.log.say(line);
                        state.last_line = Some(Instant::now());
                    }
                }
                self.show(&mut state, row.generation, 1.0);
            }
            Event::Finish { steps } => {
                let text = format!("tuning the winner by {steps} steps");
                match &self.bar {
                    Some(bar) => bar.set_message(text),
                    None => self.log.say(text),
                }
            }
        }
    }

    fn show(&self, state: &mut Shown, generation: u32, share: f64) {
        const FINENESS: f64 = 1000.0;
        let first = *state.first.get_or_insert(generation);
        let done = f64::from(generation - first) + share;
        let all = f64::from((self.generations + 1).saturating_sub(first)).max(1.0);
        let after = f64::from(self.generations.saturating_sub(generation));
        let mut left = state.pace.left(after, share, state.began.elapsed());
        if let Some(limit) = self.time_limit {
            left = left.min(limit.saturating_sub(self.started.elapsed()));
        }
        let text = format!(
            "generation {generation}/{}  {}  {} left",
            self.generations,
            state.row,
            number::clock(left)
        );
        match &self.bar {
            Some(bar) => {
                bar.set_length((all * FINENESS) as u64);
                bar.set_position((done * FINENESS) as u64);
                bar.set_message(text);
            }
            None if state.last_line.is_none_or(|then| then.elapsed() >= PAUSE) => {
                state.last_line = Some(Instant::now());
                self.log.say(text);
            }
            None => {}
        }
    }

    pub(super) fn say(&self, remark: impl std::fmt::Display) {
        match &self.bar {
            Some(bar) => bar.suspend(|| self.log.say(remark)),
            None => self.log.say(remark),
        }
    }

    pub(super) fn warn(&self, warning: impl std::fmt::Display) {
        match &self.bar {
            Some(bar) => bar.suspend(|| self.log.warn(warning)),
            None => self.log.warn(warning),
        }
    }

    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
