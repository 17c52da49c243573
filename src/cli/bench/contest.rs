//! A contest: everybody filters the same scene, round by round.
//!
//! On a machine that others use too, only what was measured side by side can be
//! compared: so nobody runs twice before everybody has run once, and medians
//! count. Who fails drops out, with the reason; the others go on.

use std::time::Duration;

use super::exact::ExactImages;
use crate::cli::error::Error;
use crate::filter::Gather;
use crate::image::{Image, Metrics};
use crate::report::{Entry, Ground, Outcome};
use crate::scene::{Facts, Scene};

/// A scene to be filtered, and what the result should be.
pub(super) struct Round {
    pub(super) scene: Scene,
    pub(super) facts: Facts,
    pub(super) reference: Image,
}

/// A way to filter.
pub(super) trait Contestant {
    /// Does what is to be done once per scene, before the first pixel.
    fn enter<'a>(&'a self, round: &'a Round) -> Result<Box<dyn Runner + 'a>, Error>;
}

/// A way to filter one scene, ready to run again and again.
pub(super) trait Runner {
    /// Filters the whole scene.
    fn run(&mut self) -> Result<Lap, Error>;

    /// What the last run made.
    fn result(&mut self) -> Result<Image, Error>;

    /// What preparing it took, if that is known.
    fn compile(&self) -> Option<Duration>;
}

/// What one run took.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lap {
    /// The filtering alone.
    pub(super) time: Duration,
    /// All of a program that was started for it.
    pub(super) process: Option<Duration>,
}

/// A contestant with what the table says of it.
pub(super) struct Entrant {
    pub(super) filter: String,
    pub(super) engine: String,
    pub(super) radius: Option<u32>,
    /// What its results should be but for rounding, if they have a formula.
    pub(super) meaning: Option<Gather>,
    /// The contestant, or why it cannot take part.
    pub(super) contestant: Result<Box<dyn Contestant>, Error>,
}

/// Everybody's results so far.
pub(super) struct Contest {
    entrants: Vec<Entrant>,
    outcomes: Vec<Result<Vec<Outcome>, String>>,
    grounds: Vec<Ground>,
    rounds: usize,
}

impl Contest {
    /// A contest that has not begun.
    pub(super) fn of(entrants: Vec<Entrant>, rounds: usize) -> Self {
        let begun = |entrant: &Entrant| match &entrant.contestant {
            Ok(_) => Ok(Vec::new()),
            Err(error) => Err(error.to_string()),
        };
        let outcomes = entrants.iter().map(begun).collect();
        Self { entrants, outcomes, grounds: Vec::new(), rounds }
    }

    /// Measures everybody on one more scene.
    ///
    /// # Errors
    /// If the scene and its reference do not fit.
    pub(super) fn run(&mut self, round: &Round) -> Result<(), Error> {
        self.grounds.push(Ground {
            scene: round.scene.name().to_owned(),
            pixels: round.scene.layout().pixels(),
            noisy: Metrics::of(&round.scene.noisy(), &round.reference)?,
        });
        let mut running: Vec<(usize, Box<dyn Runner + '_>, Vec<Lap>)> = Vec::new();
        for (k, entrant) in self.entrants.iter().enumerate() {
            let (Ok(contestant), Ok(_)) = (&entrant.contestant, &self.outcomes[k]) else {
                continue;
            };
            match contestant.enter(round) {
                Ok(runner) => running.push((k, runner, Vec::with_capacity(self.rounds))),
                Err(error) => self.outcomes[k] = Err(error.to_string()),
            }
        }
        for _ in 0..self.rounds {
            running.retain_mut(|(k, runner, laps)| match runner.run() {
                Ok(lap) => {
                    laps.push(lap);
                    true
                }
                Err(error) => {
                    self.outcomes[*k] = Err(error.to_string());
                    false
                }
            });
        }
        let mut meanings: Vec<(&Gather, ExactImages)> = Vec::new();
        for (k, mut runner, laps) in running {
            let meaning = self.entrants[k].meaning.as_ref();
            if let Some(stage) = meaning.filter(|s| meanings.iter().all(|(other, _)| other != s)) {
                meanings.push((stage, ExactImages::of(&round.scene, stage)));
            }
            let exact = meanings.iter().find(|(stage, _)| Some(*stage) == meaning);
            let outcome = judge(round, &mut *runner, &laps, exact.map(|(_, exact)| exact));
            match (&mut self.outcomes[k], outcome) {
                (Ok(outcomes), Ok(outcome)) => outcomes.push(outcome),
                (own, Err(error)) => *own = Err(error.to_string()),
                (Err(_), Ok(_)) => unreachable!("who has failed does not run"),
            }
        }
        Ok(())
    }

    /// The scenes and the rows.
    pub(super) fn finish(self) -> (Vec<Ground>, Vec<Entry>) {
        let entries = self.entrants.into_iter().zip(self.outcomes).map(|(entrant, outcomes)| {
            let Entrant { filter, engine, radius, .. } = entrant;
            Entry { filter, engine, radius, outcomes }
        });
        (self.grounds, entries.collect())
    }
}

fn judge(
    round: &Round,
    runner: &mut dyn Runner,
    laps: &[Lap],
    exact: Option<&ExactImages>,
) -> Result<Outcome, Error> {
    let image = runner.result()?;
    let processes: Option<Vec<Duration>> = laps.iter().map(|lap| lap.process).collect();
    Ok(Outcome {
        time: median(laps.iter().map(|lap| lap.time).collect()),
        process: processes.map(median),
        compile: runner.compile(),
        metrics: Metrics::of(&image, &round.reference)?,
        difference: exact.map(|exact| exact.difference(&image)),
    })
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort();
    times.get(times.len() / 2).copied().unwrap_or_default()
}
