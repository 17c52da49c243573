//! Remarks on stderr. They are for people who look: that nobody does, or that
//! stderr is closed, is no error.

use std::error::Error as _;
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

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

    /// Writes a line that even those should see who asked for quiet.
    pub(super) fn warn(self, warning: impl Display) {
        let _ = writeln!(io::stderr(), "tamis: warning: {warning}");
    }

    /// A line that redraws itself, for so much work, where one makes sense.
    pub(super) fn bar(self, length: u64) -> Option<ProgressBar> {
        (!self.quiet && io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::new(length);
            let style = ProgressStyle::with_template("{wide_bar:.cyan/238} {msg}")
                .expect("the template is well-formed");
            bar.set_style(style.progress_chars("━╸─"));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        })
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
