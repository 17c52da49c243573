//! Workers: other processes, here or on other machines, that judge children for a search.
//!
//! A farm starts a command per worker and talks to it over standard streams, so that whatever
//! starts commands elsewhere (ssh, Slurm, MPI's launchers, containers) can place it. What a
//! worker is asked determines its answer, so that it does not matter which worker answers, how
//! many there are, or how often one is lost: its jobs are asked again.

mod link;
mod news;
mod place;
mod queue;

use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rayon::prelude::*;

use super::evaluator::{Batch, Evaluator};
use super::judge::Verdict;
use super::protocol::{Briefing, Setup, Task, ToWorker, line};
use crate::evolve::Error;
pub use link::Launch;
pub use news::News;
use place::Place;
use queue::{Deserted, Queue, Step};

/// Most time from one sign of a worker's life to the next.
const HEARTBEAT: Duration = Duration::from_secs(15);

/// On which terms workers are employed.
#[derive(Clone, Debug)]
pub struct Terms {
    /// How to start each.
    pub places: Vec<Launch>,
    /// The scenes to train on, as the command line has them; workers look for the same.
    pub scenes: Vec<String>,
    /// How long a worker may be silent before it counts as lost, also while it starts; none for
    /// ever.
    pub timeout: Option<Duration>,
}

/// No worker could be employed.
#[derive(Debug, thiserror::Error)]
#[error("no worker could be employed, as {0}")]
struct NoWorker(String);

/// Workers that judge for one search. They end with it, also when it is killed: their input does.
pub struct Farm {
    queue: Arc<Queue>,
    threads: Mutex<Vec<JoinHandle<()>>>,
    hear: Arc<place::Hear>,
    /// Whether it was said that nobody is left.
    deserted: Mutex<bool>,
}

impl Farm {
    /// Starts the workers. `hear` is told what becomes of them, from any thread.
    ///
    /// # Errors
    /// If threads cannot be started.
    pub fn start(
        briefing: Briefing,
        terms: Terms,
        hear: impl Fn(News) + Send + Sync + 'static,
    ) -> Result<Self, Error> {
        let Terms { places, scenes, timeout } = terms;
        let probe = briefing.probe.clone();
        let heartbeat = timeout.map_or(HEARTBEAT, |limit| HEARTBEAT.min(limit / 4));
        let heartbeat = heartbeat.as_millis() as u64;
        let setup = ToWorker::Setup(Box::new(Setup { briefing, scenes, heartbeat }));
        let setup: Arc<str> = line(&setup).into();
        let channels: Vec<_> = places.iter().map(|_| mpsc::channel()).collect();
        let senders = channels.iter().map(|(sender, _)| sender.clone()).collect();
        let farm = Self {
            queue: Arc::new(Queue::new(senders)),
            threads: Mutex::default(),
            hear: Arc::new(hear),
            deserted: Mutex::default(),
        };
        for (launch, (sender, events)) in places.into_iter().zip(channels) {
            let place = Place {
                launch,
                setup: Arc::clone(&setup),
                probe: probe.clone(),
                timeout,
                queue: Arc::clone(&farm.queue),
                events,
                sender,
                hear: Arc::clone(&farm.hear),
            };
            let name = place.launch.name.clone();
            let thread = thread::Builder::new().name(name).spawn(move || place.keep());
            farm.threads().push(thread.map_err(Error::fitness)?);
        }
        Ok(farm)
    }

    fn threads(&self) -> std::sync::MutexGuard<'_, Vec<JoinHandle<()>>> {
        self.threads.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Says once that nobody is left; fails if nobody ever was there.
    fn desert(&self, Deserted { was_ready, reason }: Deserted) -> Result<(), Error> {
        if !was_ready {
            return Err(Error::fitness(NoWorker(reason)));
        }
        let mut said = self.deserted.lock().unwrap_or_else(PoisonError::into_inner);
        if !std::mem::replace(&mut *said, true) {
            (self.hear)(News::Deserted);
        }
        Ok(())
    }
}

impl Evaluator for Farm {
    fn evaluate(&self, batch: &Batch<'_>) -> Result<Option<Vec<Verdict>>, Error> {
        let first = self.queue.next_number();
        let written = |(index, job)| {
            let id = first + index as u64;
            line(&ToWorker::Judge(Task::of(id, job)))
        };
        let lines = batch.jobs.par_iter().enumerate().map(written);
        self.queue.begin(first, lines.collect());
        loop {
            if (batch.ended)() {
                self.queue.abandon();
                return Ok(None);
            }
            let Step { fresh, own, deserted, verdicts } = self.queue.step();
            (0..fresh).for_each(|_| (batch.heard)());
            if verdicts.is_some() {
                return Ok(verdicts);
            }
            match deserted {
                Some(deserted) => self.desert(deserted)?,
                None if own.is_empty() => {}
                None => (self.hear)(News::Spoilt { children: own.len() }),
            }
            let judge = |index: &usize| {
                if let Some(verdict) = (batch.judge)(&batch.jobs[*index])? {
                    self.queue.settle(first + *index as u64, verdict);
                }
                Ok(())
            };
            own.par_iter().try_for_each(judge).map_err(|error: crate::tune::Error| {
                self.queue.abandon();
                Error::fitness(error)
            })?;
        }
    }

    fn release(&self) {
        self.queue.end();
        for thread in self.threads().drain(..) {
            // One that panicked has said so.
            let _ = thread.join();
        }
    }
}

impl Drop for Farm {
    fn drop(&mut self) {
        self.release();
    }
}
