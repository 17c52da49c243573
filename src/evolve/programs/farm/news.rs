//! What a farm has to tell.

use std::fmt;
use std::time::Duration;

/// News of workers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum News {
    /// A worker has the scenes, judges as the coordinator does, and begins.
    Ready {
        /// What its place is called.
        place: String,
        /// How many children it judges at a time.
        threads: usize,
    },
    /// A worker is lost. What it was at is asked again elsewhere.
    Lost {
        /// What its place is called.
        place: String,
        /// What became of it.
        reason: String,
        /// When another is started there.
        pause: Duration,
    },
    /// No worker is started at a place any more.
    GivenUp {
        /// What it is called.
        place: String,
        /// Why.
        reason: String,
    },
    /// Children that workers were lost with several times are judged by the coordinator.
    Spoilt {
        /// How many.
        children: usize,
    },
    /// No place is left: the coordinator judges from now on.
    Deserted,
}

impl News {
    /// Whether something is wrong.
    pub fn is_warning(&self) -> bool {
        !matches!(self, Self::Ready { .. })
    }
}

impl fmt::Display for News {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ready { place, threads: 1 } => write!(f, "{place} is ready, with 1 thread"),
            Self::Ready { place, threads } => write!(f, "{place} is ready, with {threads} threads"),
            Self::Lost { place, reason, pause } => write!(
                f,
                "warning: {place} {reason}; what it was at is asked again elsewhere, and it is \
                 started anew in {pause:?}"
            ),
            Self::GivenUp { place, reason } => {
                write!(f, "warning: {place} {reason}; it is not started again")
            }
            Self::Spoilt { children } => write!(
                f,
                "warning: workers were lost three times with the same work, {children} of the \
                 children; it is done here, in the process of the search"
            ),
            Self::Deserted => f.write_str(
                "warning: no worker is left; the search goes on in its own process, more slowly \
                 (Ctrl-C ends it, and --resume starts workers anew)",
            ),
        }
    }
}
