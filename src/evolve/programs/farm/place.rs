//! A place where a worker is: starts it, gives it work, and starts it anew when it is lost.

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use super::link::{Event, Launch, Link};
use super::news::News;
use super::queue::Queue;
use crate::evolve::programs::protocol::{Answer, FromWorker, Hello, PROGRAM, PROTOCOL, parse};

/// How long a place rests after its first loss; twice as long after every other without a
/// verdict in between.
const FIRST_PAUSE: Duration = Duration::from_millis(250);

/// How long at most.
const LONGEST_PAUSE: Duration = Duration::from_secs(60);

/// Losses in a row, without a verdict in between, after which a place is given up: where a worker
/// was ready before, and where none ever was. In the latter the command is mostly at fault.
const LOSSES: u32 = 10;
const LOSSES_AT_FIRST: u32 = 3;

/// Most jobs that a worker may ask for at a time.
const MOST_JOBS: usize = 4096;

/// What is told of a farm, from any thread.
pub(super) type Hear = dyn Fn(News) + Send + Sync;

/// A place where a worker is.
pub(super) struct Place {
    pub(super) launch: Launch,
    /// The line that sets a worker up.
    pub(super) setup: Arc<str>,
    /// What a worker has to answer to that.
    pub(super) probe: Answer,
    /// How long a worker may be silent; for ever if there is none.
    pub(super) timeout: Option<Duration>,
    pub(super) queue: Arc<Queue>,
    pub(super) events: Receiver<Event>,
    /// Where `events` come from.
    pub(super) sender: Sender<Event>,
    pub(super) hear: Arc<Hear>,
}

/// How a worker's time ended.
enum End {
    /// There is no more work.
    Over,
    /// Another may do better.
    Lost(String),
    /// Another would do no better.
    Useless(String),
}

/// What is known of a worker.
struct Worker {
    /// The number of its process here.
    number: u64,
    state: State,
    /// What it is at.
    held: BTreeSet<u64>,
    /// When it was heard of.
    heard: Instant,
    /// Whether it gave a verdict.
    was_of_use: bool,
}

enum State {
    /// It has not said who it is.
    Strange,
    /// It loads its scenes.
    SetUp { threads: usize },
    /// It may be given so many jobs at a time.
    Ready { threads: usize },
}

impl Place {
    /// Keeps a worker there until the queue ends, or it is no use.
    pub(super) fn keep(self) {
        let (mut losses, mut was_ready) = (0, false);
        for number in 0.. {
            let heard = Instant::now();
            let (state, held) = (State::Strange, BTreeSet::new());
            let mut worker = Worker { number, state, held, heard, was_of_use: false };
            let end = self.employ(&mut worker);
            was_ready |= matches!(worker.state, State::Ready { .. });
            losses = if worker.was_of_use { 1 } else { losses + 1 };
            let limit = if was_ready { LOSSES } else { LOSSES_AT_FIRST };
            let place = self.launch.name.clone();
            match end {
                End::Over => return,
                // What ends while everything does is no news.
                _ if self.queue.has_ended() => return,
                End::Useless(reason) => return self.give_up(reason),
                End::Lost(reason) if losses >= limit => {
                    return self.give_up(format!("{reason} ({losses} times in a row)"));
                }
                End::Lost(reason) => {
                    let pause = LONGEST_PAUSE.min(FIRST_PAUSE * (1 << (losses - 1)));
                    (self.hear)(News::Lost { place, reason, pause });
                    if !self.rest(pause) {
                        return;
                    }
                }
            }
        }
    }

    fn give_up(&self, reason: String) {
        let place = self.launch.name.clone();
        (self.hear)(News::GivenUp { place, reason: reason.clone() });
        self.queue.close(format!("{} {reason}", self.launch.name));
    }

    /// Lets time pass; false if the queue ends before.
    fn rest(&self, pause: Duration) -> bool {
        let start = Instant::now();
        while let Some(left) = pause.checked_sub(start.elapsed()) {
            if self.queue.has_ended() {
                return false;
            }
            // Whatever it is, it is only to be looked at once.
            let _ = self.events.recv_timeout(left);
        }
        true
    }

    /// Starts a worker and gives it work until it is lost.
    fn employ(&self, worker: &mut Worker) -> End {
        let mut link = match Link::start(&self.launch, worker.number, &self.sender) {
            Ok(link) => link,
            Err(error) => {
                let reason = format!("cannot be started ({error})");
                let is_final =
                    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::PermissionDenied);
                return if is_final { End::Useless(reason) } else { End::Lost(reason) };
            }
        };
        worker.heard = Instant::now();
        let end = self.attend(worker, &mut link);
        self.queue.give_back(std::mem::take(&mut worker.held));
        link.end();
        end
    }

    fn attend(&self, worker: &mut Worker, link: &mut Link) -> End {
        loop {
            if self.queue.has_ended() {
                return End::Over;
            }
            if let State::Ready { threads } = worker.state {
                while worker.held.len() < threads
                    && let Some((number, line)) = self.queue.take()
                {
                    worker.held.insert(number);
                    link.send(line);
                }
            }
            let event = match self.timeout {
                None => self.events.recv().map_err(|_| RecvTimeoutError::Disconnected),
                Some(limit) => {
                    self.events.recv_timeout(limit.saturating_sub(worker.heard.elapsed()))
                }
            };
            match event {
                Ok(Event::Line(number, line)) if number == worker.number => {
                    worker.heard = Instant::now();
                    if let Some(end) = self.hear_out(worker, link, &line) {
                        return end;
                    }
                }
                Ok(Event::Closed(number)) if number == worker.number => {
                    return End::Lost(link.ending());
                }
                // Of a process that is gone, or merely to look for work.
                Ok(Event::Line(..) | Event::Closed(_) | Event::Wake) => {}
                Err(RecvTimeoutError::Timeout) => {
                    let seconds = self.timeout.unwrap_or_default().as_secs();
                    return End::Lost(format!("gave no sign of life for {seconds} s"));
                }
                // Nobody is left who could end the queue.
                Err(RecvTimeoutError::Disconnected) => return End::Over,
            }
        }
    }

    /// Takes in what a worker says. Returns how its time ended if it does.
    fn hear_out(&self, worker: &mut Worker, link: &Link, line: &str) -> Option<End> {
        let message = match parse(line) {
            Ok(message) => message,
            Err(problem) => return Some(End::Lost(problem)),
        };
        match (message, &worker.state) {
            (FromWorker::Hello(hello), State::Strange) => {
                let Hello { program, protocol, threads } = hello;
                if (&*program, protocol) != (PROGRAM, PROTOCOL) {
                    return Some(End::Useless(format!(
                        "is {program} with protocol {protocol}, and the search runs in {PROGRAM} \
                         with protocol {PROTOCOL}; install the same version there"
                    )));
                }
                let threads = threads.clamp(1, MOST_JOBS);
                worker.state = State::SetUp { threads };
                link.send(Arc::clone(&self.setup));
                None
            }
            (FromWorker::Ready { probe }, &State::SetUp { threads }) => {
                if probe != self.probe {
                    return Some(End::Useless(
                        "computes other results from the same filter and scenes; install the same \
                         build there"
                            .to_owned(),
                    ));
                }
                worker.state = State::Ready { threads };
                self.queue.ready();
                (self.hear)(News::Ready { place: self.launch.name.clone(), threads });
                None
            }
            (FromWorker::Refused { reason }, State::SetUp { .. }) => {
                Some(End::Useless(format!("refuses: {reason}")))
            }
            (FromWorker::Verdict { job, verdict }, State::Ready { .. })
                if worker.held.contains(&job) =>
            {
                match verdict.verdict() {
                    Ok(verdict) => {
                        worker.held.remove(&job);
                        worker.was_of_use = true;
                        self.queue.settle(job, verdict);
                        None
                    }
                    Err(error) => {
                        Some(End::Lost(format!("gave a verdict on no program ({error})")))
                    }
                }
            }
            (FromWorker::Failed { job, reason }, State::Ready { .. })
                if worker.held.contains(&job) =>
            {
                Some(End::Lost(format!("could not judge: {reason}")))
            }
            (FromWorker::Alive {}, State::SetUp { .. } | State::Ready { .. }) => None,
            (
                FromWorker::Hello(_)
                | FromWorker::Ready { .. }
                | FromWorker::Refused { .. }
                | FromWorker::Verdict { .. }
                | FromWorker::Failed { .. }
                | FromWorker::Alive {},
                _,
            ) => Some(End::Lost("said what was not asked, or not yet".to_owned())),
        }
    }
}
