//! The search's progress: a line that redraws itself on a terminal, and a line
//! every so often elsewhere.

use std::fmt::Display;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use crate::cli::evolve::pace::Pace;
use crate::cli::log::Log;
use crate::evolve::Event;
use crate::report::number;

/// Seconds between lines where nothing can be redrawn.
const PAUSE: Duration = Duration::from_secs(10);

/// Fractions of a generation that the bar can show.
const FINENESS: u64 = 1000;

pub(super) struct Progress {
    log: Log,
    started: Instant,
    time_limit: Option<Duration>,
    bar: Option<ProgressBar>,
    last_line: Option<Instant>,
    /// The generation that this run starts with, once it is known.
    first: Option<u32>,
    /// How many generations there are, the initial one included.
    generations: u32,
    /// Best error per island after the last complete generation.
    best: Vec<f64>,
    /// Expressions judged in this run.
    judged: usize,
    /// Those of them that belong to the generation being formed.
    current: usize,
    pace: Pace,
    /// When the generation being formed was begun.
    begun: Instant,
}

impl Progress {
    pub(super) fn new(log: Log, generations: u32, time_limit: Option<Duration>) -> Self {
        let bar = log.bar(0);
        Self {
            log,
            started: Instant::now(),
            time_limit,
            bar,
            last_line: None,
            first: None,
            generations: generations + 1,
            best: Vec::new(),
            judged: 0,
            current: 0,
            pace: Pace::default(),
            begun: Instant::now(),
        }
    }

    /// Takes news in.
    pub(super) fn hear(&mut self, event: Event<'_>) {
        match event {
            Event::Batch { generation, judged, of } => {
                self.judged += judged - self.current;
                self.current = judged;
                self.show(generation, judged as f64 / of.max(1) as f64, false);
            }
            Event::Generation { generation, of, islands, .. } => {
                self.current = 0;
                self.best = islands.iter().map(|row| row.best).collect();
                self.pace.add(self.begun.elapsed());
                self.show(generation, 1.0, generation == of);
                self.begun = Instant::now();
            }
            Event::Checkpoint { .. } => {}
            Event::Finalists { count } => {
                self.tell(format!("judging {} on all pixels", number::plural(count, "finalist")));
            }
            Event::Comparison { rank } => {
                self.tell(format!("comparing finalist {} with its exact meaning", rank + 1));
            }
        }
    }

    /// Writes a warning, the line cleared meanwhile.
    pub(super) fn warn(&self, warning: impl Display) {
        match &self.bar {
            Some(bar) => bar.suspend(|| self.log.warn(warning)),
            None => self.log.warn(warning),
        }
    }

    /// Says what is under way.
    fn tell(&self, text: String) {
        match &self.bar {
            Some(bar) => bar.set_message(text),
            None => self.log.say(text),
        }
    }

    /// Clears the line.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn show(&mut self, generation: u32, share: f64, always: bool) {
        let first = *self.first.get_or_insert(generation);
        let done = f64::from(generation - first) + share;
        let all = f64::from(self.generations.saturating_sub(first)).max(1.0);
        let elapsed = self.started.elapsed();
        let after = f64::from((self.generations - 1).saturating_sub(generation));
        let mut left = self.pace.left(after, share, self.begun.elapsed());
        if let Some(limit) = self.time_limit {
            left = left.min(limit.saturating_sub(elapsed));
        }
        let text = format!(
            "generation {generation}/{}  best {}  {:.0} evaluations/s  {} left",
            self.generations - 1,
            if self.best.is_empty() {
                "-".to_owned()
            } else {
                self.best.iter().map(|&x| number::error(x)).collect::<Vec<_>>().join(" ")
            },
            self.judged as f64 / elapsed.as_secs_f64().max(1e-3),
            number::clock(left),
        );
        match &self.bar {
            Some(bar) => {
                bar.set_length((all * FINENESS as f64) as u64);
                bar.set_position((done * FINENESS as f64) as u64);
                bar.set_message(text);
            }
            None if always || self.last_line.is_none_or(|then| then.elapsed() >= PAUSE) => {
                self.last_line = Some(Instant::now());
                self.log.say(text);
            }
            None => {}
        }
    }
}
