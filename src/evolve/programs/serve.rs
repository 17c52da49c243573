//! A worker's side: judges what a coordinator sends.

use std::error::Error as StdError;
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use super::judge::{Judge, Verdict};
use super::protocol::{
    Answer, FromWorker, Hello, PROGRAM, PROTOCOL, Setup, Task, ToWorker, line, parse,
};
use super::settings::Settings;
use crate::backend::{Backend, Differentiator};
use crate::evolve::with_causes;
use crate::filter::Filter;
use crate::scene::Fingerprint;
use crate::tune::TuningScene;

/// Why a worker cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The other side is no coordinator.
    #[error(
        "whoever writes to standard input {0}; it is `tamis evolve --worker-command` that starts \
         workers and talks to them"
    )]
    Message(String),
    /// Nobody hears it.
    #[error("cannot write to the coordinator: {0}")]
    Output(#[from] io::Error),
}

/// Judges for a coordinator, on the threads of rayon's pool, until `lines`, which it writes,
/// end. `load` loads the training scenes, given what the coordinator calls them, its settings and
/// the filter that it begins with. Returns whether the worker was of use: what it refuses, such
/// as scenes that are other ones here, it tells the coordinator.
///
/// # Errors
/// If the other side says what no coordinator does, or does not listen.
pub fn serve<B: Backend + Differentiator, E: StdError>(
    lines: impl Iterator<Item = String>,
    output: impl Write + Send,
    backend: &B,
    load: impl FnOnce(&[String], &Settings, &Filter) -> Result<Vec<TuningScene>, E>,
) -> Result<bool, ServeError> {
    let output = Output(Mutex::new(output));
    let threads = rayon::current_num_threads();
    let hello = Hello { program: PROGRAM.to_owned(), protocol: PROTOCOL, threads };
    output.say(&FromWorker::Hello(hello))?;
    let mut lines = lines;
    let Some(first) = lines.next() else { return Ok(true) };
    let setup = match parse(&first).map_err(ServeError::Message)? {
        ToWorker::Setup(setup) => *setup,
        ToWorker::Judge(_) => {
            return Err(ServeError::Message("asks for a verdict before any setup".to_owned()));
        }
    };
    let heartbeat = Duration::from_millis(setup.heartbeat.max(1));
    thread::scope(|scope| {
        let (_alive, ended) = mpsc::channel::<()>();
        let output = &output;
        scope.spawn(move || {
            while ended.recv_timeout(heartbeat) == Err(RecvTimeoutError::Timeout)
                && output.say(&FromWorker::Alive {}).is_ok()
            {}
        });
        let scenes = match scenes(&setup, load) {
            Ok(scenes) => scenes,
            Err(reason) => return output.refuse(reason),
        };
        let mut judge = match Judge::new(setup.briefing.settings.clone(), &scenes, &[], backend) {
            Ok(judge) => judge,
            Err(error) => return output.refuse(error.to_string()),
        };
        match probe(&setup, &mut judge) {
            Ok(probe) => output.say(&FromWorker::Ready { probe: Answer::of(&probe) })?,
            Err(reason) => return output.refuse(reason),
        }
        judge_all(lines, output, &judge).map(|()| true)
    })
}

/// The scenes, if they are the coordinator's.
fn scenes<E: StdError>(
    Setup { briefing, scenes, .. }: &Setup,
    load: impl FnOnce(&[String], &Settings, &Filter) -> Result<Vec<TuningScene>, E>,
) -> Result<Vec<TuningScene>, String> {
    briefing.settings.validate().map_err(|error| with_causes(&error))?;
    let initial = briefing.initial().map_err(|error| with_causes(&error))?;
    let loaded = load(scenes, &briefing.settings, initial.filter());
    let loaded = loaded.map_err(|error| {
        format!(
            "{}; start it where these scenes are, or name them with `tamis worker --scenes`",
            with_causes(&error)
        )
    })?;
    let pictures = crate::tune::pictures(&loaded, &[]);
    if let Some(picture) = Fingerprint::first_changed(&briefing.pictures, &pictures) {
        return Err(format!(
            "{picture} is not the same there as where the search runs, or is only in one of the \
             two places; copy the scenes there, or name others with `tamis worker --scenes`"
        ));
    }
    // Which part of which scene is looked at hangs on their order.
    if pictures != briefing.pictures {
        return Err("its scenes are the same as where the search runs, but in another order; \
                    name the same folders in the same order with `tamis worker --scenes`"
            .to_owned());
    }
    Ok(loaded)
}

/// Makes the judge what the coordinator's is, and has it show that.
fn probe<B: Backend + Differentiator>(
    setup: &Setup,
    judge: &mut Judge<'_, B>,
) -> Result<Verdict, String> {
    let initial = setup.briefing.initial().map_err(|error| with_causes(&error))?;
    judge.allow(initial.filter()).map_err(|error| with_causes(&error))?;
    judge.probe(&initial).map_err(|error| with_causes(&error))
}

/// Judges what comes, until nothing does any more.
fn judge_all<B: Backend + Differentiator>(
    lines: impl Iterator<Item = String>,
    output: &Output<impl Write + Send>,
    judge: &Judge<'_, B>,
) -> Result<(), ServeError> {
    let stop = Arc::new(AtomicBool::new(false));
    rayon::in_place_scope(|scope| {
        let come = || -> Result<(), ServeError> {
            for line in lines {
                let task = match parse(&line).map_err(ServeError::Message)? {
                    ToWorker::Judge(task) => task,
                    ToWorker::Setup(_) => {
                        return Err(ServeError::Message("sends a second setup".to_owned()));
                    }
                };
                let stop = &stop;
                // Of an output that fails the input tells, too: it ends.
                scope.spawn(move |_| {
                    let _ = output.say(&judged(&task, judge, stop));
                });
            }
            Ok(())
        };
        let ended = come();
        stop.store(true, Ordering::Relaxed);
        ended
    })
}

fn judged<B: Backend + Differentiator>(
    task: &Task,
    judge: &Judge<'_, B>,
    stop: &Arc<AtomicBool>,
) -> FromWorker {
    let judged = || -> Result<Verdict, String> {
        let genome = task.genome().map_err(|error| with_causes(&error))?;
        let bar = task.bar();
        let job = task.as_job(&genome, bar.as_deref());
        judge.judge(&job, stop).map_err(|error| with_causes(&error))
    };
    // A fault of this program must not leave the coordinator waiting: nobody else would tell it.
    let judged = catch_unwind(AssertUnwindSafe(judged));
    match judged.unwrap_or_else(|_| Err("it panicked".to_owned())) {
        Ok(verdict) => FromWorker::Verdict { job: task.job, verdict: Answer::of(&verdict) },
        Err(reason) => FromWorker::Failed { job: task.job, reason },
    }
}

/// The way to the coordinator, which all threads share.
struct Output<W>(Mutex<W>);

impl<W: Write> Output<W> {
    /// Says something, in one piece.
    fn say(&self, message: &FromWorker) -> io::Result<()> {
        let line = line(message);
        let mut output = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        output.write_all(line.as_bytes())?;
        output.flush()
    }

    /// Tells the coordinator why this worker is of no use.
    fn refuse(&self, reason: String) -> Result<bool, ServeError> {
        self.say(&FromWorker::Refused { reason })?;
        Ok(false)
    }
}
