//! Long work: other Python threads run meanwhile, somebody may watch, and Ctrl-C ends it.

use std::ops::ControlFlow;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors::{Kind, raise};

/// From one look at signals to the next.
const PAUSE: Duration = Duration::from_millis(50);

/// What the work tells, from any of its threads, and is told.
#[derive(Default)]
pub(crate) struct Told {
    done: AtomicUsize,
    of: AtomicUsize,
    stop: Arc<AtomicBool>,
}

impl Told {
    /// Says how much is done, and of how much; breaks off if nobody waits any longer.
    pub(crate) fn tell(&self, done: usize, of: usize) -> ControlFlow<()> {
        // Threads do not tell in order.
        self.done.fetch_max(done, Relaxed);
        self.of.store(of, Relaxed);
        match self.stop.load(Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// The flag that is raised when nobody waits any longer.
    pub(crate) fn stop(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    fn now(&self) -> (usize, usize) {
        (self.done.load(Relaxed), self.of.load(Relaxed))
    }
}

/// Does some work on a thread of its own, and returns its result. `progress` is called on the
/// caller's thread with how much is done and of how much, while the work goes on and at its end.
///
/// # Errors
/// Whatever `progress` raises, or a signal's handler, such as `KeyboardInterrupt`; the work has
/// ended by then. If there can be no further thread.
pub(crate) fn work<R: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Told) -> R + Send,
) -> PyResult<R> {
    let told = Told::default();
    let mut last = (0, 0);
    let mut report = || {
        let now = told.now();
        let Some(progress) = progress.filter(|_| now != last && now.1 > 0) else { return Ok(()) };
        last = now;
        progress.call1(now).map(|_| ())
    };
    thread::scope(|scope| {
        let (send, mut receive) = channel();
        let at_work = &told;
        // The channel closes when the work has ended, however it does.
        let worker = move || {
            // Nobody listens only if the caller has panicked.
            let _ = send.send(work(at_work));
        };
        let builder = thread::Builder::new().name("tamis".to_owned());
        let worker = builder.spawn_scoped(scope, worker);
        let worker = worker.map_err(|error| {
            let text = format!(
                "cannot start a thread: {error}; end other programs, or raise the limit (ulimit -u)"
            );
            raise(py, Kind::Other, text)
        })?;
        let mut failure = None;
        let result = loop {
            let heard;
            (heard, receive) = py.detach(move || (receive.recv_timeout(PAUSE), receive));
            match heard {
                Ok(result) => break result,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => match worker.join() {
                    Ok(()) => unreachable!("work that ends sends its result"),
                    Err(panic) => resume_unwind(panic),
                },
            }
            if failure.is_none()
                && let Err(error) = py.check_signals().and_then(|()| report())
            {
                told.stop.store(true, Relaxed);
                failure = Some(error);
            }
        };
        match failure {
            Some(error) => Err(error),
            None => report().map(|()| result),
        }
    })
}
