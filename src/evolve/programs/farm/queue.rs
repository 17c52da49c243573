//! The jobs of a batch, between the search and the places where workers are.

use std::collections::VecDeque;
use std::mem::take;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::link::Event;
use crate::evolve::programs::judge::Verdict;

/// A job that so many workers were lost with is judged in the coordinator.
const STRIKES: u32 = 3;

/// How long the search waits for verdicts before it looks whether it is to end.
const LOOK: Duration = Duration::from_millis(50);

/// The jobs of a batch.
pub(super) struct Queue {
    state: Mutex<State>,
    changed: Condvar,
    /// A way to every place.
    places: Vec<Sender<Event>>,
}

#[derive(Default)]
struct State {
    /// The number of the batch's first job; numbers are never used again.
    first: u64,
    jobs: Vec<Queued>,
    /// Those that nobody has.
    waiting: VecDeque<usize>,
    /// Those that the search is to judge itself.
    aside: Vec<usize>,
    /// Verdicts since the search last looked.
    fresh: usize,
    /// Places that are not given up.
    open: usize,
    /// Whether a worker ever was ready.
    was_ready: bool,
    /// Why the first place was given up.
    reason: Option<String>,
    ended: bool,
}

struct Queued {
    line: Arc<str>,
    /// Workers that were lost with it.
    strikes: u32,
    verdict: Option<Verdict>,
}

/// What the search has to do next.
#[derive(Debug, Default)]
pub(super) struct Step {
    /// Verdicts that came in.
    pub(super) fresh: usize,
    /// Jobs to be judged by the search itself.
    pub(super) own: Vec<usize>,
    /// Why no worker is left, if none is.
    pub(super) deserted: Option<Deserted>,
    /// All verdicts, if they are there.
    pub(super) verdicts: Option<Vec<Verdict>>,
}

/// No place is left.
#[derive(Debug)]
pub(super) struct Deserted {
    /// Whether a worker ever was ready.
    pub(super) was_ready: bool,
    /// Why the first place was given up.
    pub(super) reason: String,
}

impl Queue {
    pub(super) fn new(places: Vec<Sender<Event>>) -> Self {
        let state = State { open: places.len(), ..State::default() };
        Self { state: Mutex::new(state), changed: Condvar::new(), places }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wake(&self) {
        // Of a place that is given up nobody listens.
        self.places.iter().for_each(|place| drop(place.send(Event::Wake)));
    }

    /// The number of the next batch's first job.
    pub(super) fn next_number(&self) -> u64 {
        let state = self.state();
        state.first + state.jobs.len() as u64
    }

    /// Begins a batch, whose jobs are these lines, numbered from `first` on.
    pub(super) fn begin(&self, first: u64, lines: Vec<String>) {
        let mut state = self.state();
        state.first = first;
        state.waiting = (0..lines.len()).collect();
        state.aside.clear();
        state.fresh = 0;
        let queued = |line: String| Queued { line: line.into(), strikes: 0, verdict: None };
        state.jobs = lines.into_iter().map(queued).collect();
        drop(state);
        self.wake();
    }

    /// Gives the batch up. What workers are at counts for nothing.
    pub(super) fn abandon(&self) {
        self.begin(self.next_number(), Vec::new());
    }

    /// Ends everything: no place starts a worker from now on.
    pub(super) fn end(&self) {
        self.state().ended = true;
        self.wake();
    }

    pub(super) fn has_ended(&self) -> bool {
        self.state().ended
    }

    /// A job for a worker, with its number.
    pub(super) fn take(&self) -> Option<(u64, Arc<str>)> {
        let mut state = self.state();
        let index = state.waiting.pop_front()?;
        Some((state.first + index as u64, Arc::clone(&state.jobs[index].line)))
    }

    /// Takes a verdict in, unless the batch that it is of is over.
    pub(super) fn settle(&self, number: u64, verdict: Verdict) {
        let mut state = self.state();
        if let Some(queued) = state.job(number) {
            queued.verdict = Some(verdict);
            state.fresh += 1;
            drop(state);
            self.changed.notify_all();
        }
    }

    /// Takes back what a worker had when it was lost.
    pub(super) fn give_back(&self, numbers: impl IntoIterator<Item = u64>) {
        let mut state = self.state();
        for number in numbers {
            let Some(queued) = state.job(number) else { continue };
            queued.strikes += 1;
            let spoilt = queued.strikes >= STRIKES;
            let index = (number - state.first) as usize;
            match spoilt {
                true => state.aside.push(index),
                // First: whoever waits for the batch waits for it.
                false => state.waiting.push_front(index),
            }
        }
        drop(state);
        self.changed.notify_all();
        self.wake();
    }

    /// A worker has the scenes and judges alike.
    pub(super) fn ready(&self) {
        self.state().was_ready = true;
    }

    /// A place is given up.
    pub(super) fn close(&self, reason: String) {
        let mut state = self.state();
        state.open -= 1;
        state.reason.get_or_insert(reason);
        drop(state);
        self.changed.notify_all();
    }

    /// What the search has to do next; waits for that, but only for a moment.
    pub(super) fn step(&self) -> Step {
        let idle = |state: &mut State| {
            let to_do = state.fresh > 0 || !state.aside.is_empty() || state.open == 0;
            !to_do && state.jobs.iter().any(|queued| queued.verdict.is_none())
        };
        let waited = self.changed.wait_timeout_while(self.state(), LOOK, idle);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let mut step =
            Step { fresh: take(&mut state.fresh), own: take(&mut state.aside), ..Step::default() };
        if state.open == 0 {
            step.own.extend(take(&mut state.waiting));
            let reason = state.reason.clone().unwrap_or_default();
            step.deserted = Some(Deserted { was_ready: state.was_ready, reason });
        }
        if state.jobs.iter().all(|queued| queued.verdict.is_some()) {
            state.first += state.jobs.len() as u64;
            let jobs = take(&mut state.jobs);
            step.verdicts = Some(jobs.into_iter().filter_map(|queued| queued.verdict).collect());
        }
        step
    }
}

impl State {
    /// The job of that number, unless it is of another batch or was judged.
    fn job(&mut self, number: u64) -> Option<&mut Queued> {
        let index = usize::try_from(number.checked_sub(self.first)?).ok()?;
        self.jobs.get_mut(index).filter(|queued| queued.verdict.is_none())
    }
}
