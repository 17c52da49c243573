//! What may end long work early, and what lets it go on another day.

use std::collections::BTreeSet;
use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How a run is to be watched over. None of it changes what one that gets to its end
/// finds.
#[derive(Clone, Debug, Default)]
pub struct Control {
    /// Set this (on Ctrl-C, say) and the run ends after the batch or step under way; at once,
    /// if what takes the time looks at it too (`backend::Stoppable`).
    pub stop: Arc<AtomicBool>,
    /// Ends the run after the batch in which the time is up. The one thing
    /// here that a clock decides, and only where the user asks for it.
    pub time_limit: Option<Duration>,
    /// Where and how often to write checkpoints.
    pub checkpoints: Option<Checkpoints>,
}

/// Where and how often checkpoints are written. One more is written when the
/// run ends, early or not.
#[derive(Clone, Debug)]
pub struct Checkpoints {
    /// The file.
    pub path: PathBuf,
    /// Generations, or steps, from one to the next; 0 for the one at the end only.
    pub interval: u32,
}

/// What has failed already on the way: a long run whose disk is full should say so once, and
/// not every minute.
#[derive(Clone, Debug, Default)]
pub struct Causes(BTreeSet<String>);

impl Causes {
    /// Whether an error is the first of its cause. Errors of the system are of one cause if
    /// they are of one kind, whatever file they name; others if they say the same.
    pub fn is_new(&mut self, error: &(dyn Error + 'static)) -> bool {
        let mut cause = Some(error);
        while let Some(error) = cause {
            if let Some(error) = error.downcast_ref::<io::Error>() {
                return self.0.insert(error.kind().to_string());
            }
            cause = error.source();
        }
        self.0.insert(error.to_string())
    }
}

/// Writes a run's checkpoints. One that cannot be written is no reason to end the run.
#[derive(Debug)]
pub struct Keeper<'a> {
    checkpoints: Option<&'a Checkpoints>,
    causes: Causes,
    latest: bool,
}

impl<'a> Keeper<'a> {
    /// Of the checkpoints that are asked for, if any are.
    pub fn new(control: &'a Control) -> Self {
        let checkpoints = control.checkpoints.as_ref();
        Self { checkpoints, causes: Causes::default(), latest: false }
    }

    /// Whether one is due in the middle of a run, after so many generations or steps.
    pub fn is_due(&self, done: u32) -> bool {
        let interval = self.checkpoints.map_or(0, |checkpoints| checkpoints.interval);
        interval > 0 && done.is_multiple_of(interval)
    }

    /// Has a checkpoint written to where it is asked for. Returns the error if it cannot be,
    /// and no earlier one failed for the same cause: that is to be told, and the run goes on.
    pub fn keep<E: Error + 'static>(
        &mut self,
        write: impl FnOnce(&Path) -> Result<(), E>,
    ) -> Option<E> {
        let written = write(&self.checkpoints?.path);
        self.latest = written.is_ok();
        written.err().filter(|error| self.causes.is_new(error))
    }

    /// The checkpoint, if the latest could be written.
    pub fn latest(&self) -> Option<&'a Path> {
        self.checkpoints.filter(|_| self.latest).map(|checkpoints| &*checkpoints.path)
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// With nothing left to do.
    Finished,
    /// Because it was asked to stop.
    Stopped,
    /// Because its time was up.
    TimeLimit,
}

/// A control in force, since a moment.
pub(crate) struct Watch<'a> {
    control: &'a Control,
    started: Instant,
}

impl<'a> Watch<'a> {
    pub(crate) fn start(control: &'a Control) -> Self {
        Self { control, started: Instant::now() }
    }

    /// Why to end now, if there is a reason.
    pub(crate) fn ending(&self) -> Option<Ending> {
        if self.control.stop.load(Ordering::Relaxed) {
            Some(Ending::Stopped)
        } else if self.control.time_limit.is_some_and(|limit| self.started.elapsed() >= limit) {
            Some(Ending::TimeLimit)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("{path}: cannot write: {source}")]
    struct Unwritten {
        path: String,
        source: io::Error,
    }

    /// The names of temporary files differ every time.
    fn unwritten(path: &str, kind: io::ErrorKind) -> Unwritten {
        Unwritten { path: path.to_owned(), source: io::Error::new(kind, path.to_owned()) }
    }

    #[test]
    fn a_checkpoint_that_cannot_be_written_is_told_once_per_cause() {
        let checkpoints = Some(Checkpoints { path: "run.json".into(), interval: 3 });
        let control = Control { checkpoints, ..Control::default() };
        let mut keeper = Keeper::new(&control);
        assert_eq!(keeper.latest(), None);
        let full = |path| Err(unwritten(path, io::ErrorKind::StorageFull));
        assert!(keeper.keep(|_| full("a")).is_some());
        assert!(keeper.keep(|_| full("b")).is_none());
        assert_eq!(keeper.latest(), None);
        assert!(keeper.keep(|_| Ok::<(), Unwritten>(())).is_none());
        assert_eq!(keeper.latest(), Some(Path::new("run.json")));
        let refused = |_: &Path| Err(unwritten("c", io::ErrorKind::PermissionDenied));
        assert!(keeper.keep(refused).is_some());
        assert!(keeper.keep(|_| full("d")).is_none());
        assert!(keeper.is_due(6) && !keeper.is_due(7));

        let control = Control::default();
        let mut keeper = Keeper::new(&control);
        assert!(keeper.keep(refused).is_none(), "no checkpoint was asked for");
        assert!(!keeper.is_due(0));
    }
}
