//! Remarks on stderr. They are for people who look: that nobody does, or that
//! stderr is closed, is no error.

use std::error::Error as _;
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};

use super::error::Error;

/// Where remarks go, if anywhere.
#[derive(Clone, Copy, Debug)]
pub(super) struct Log {
    quiet: bool,
}

impl Log {
    pub(super) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// Writes a line, unless asked to be quiet.
    pub(super) fn say(self, remark: impl Display) {
        if !self.quiet {
            // A closed stderr leaves nobody to tell.
            let _ = writeln!(io::stderr(), "{remark}");
        }
    }

    /// Whether a line that redraws itself makes sense.
    pub(super) fn live(self) -> bool {
        !self.quiet && io::stderr().is_terminal()
    }

    /// Writes an error with its causes, as far as it does not name them itself.
    pub(super) fn error(self, error: &Error) {
        let mut text = error.to_string();
        let mut cause = error.source();
        while let Some(error) = cause {
            let detail = error.to_string();
            if !text.contains(&detail) {
                text = format!("{text}: {detail}");
            }
            cause = error.source();
        }
        let _ = writeln!(io::stderr(), "tamis: error: {text}");
    }
}
