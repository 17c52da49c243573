//! Remarks on stderr. They are for people who look: that nobody does, or that
//! stderr is closed, is no error.

use std::env;
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

    /// Writes a line about something that may be wrong, even if asked to be quiet.
    pub(super) fn warn(self, warning: impl Display) {
        let _ = writeln!(io::stderr(), "{warning}");
    }

    /// A line that redraws itself, for so much work, where one makes sense.
    pub(super) fn bar(self, length: u64) -> Option<ProgressBar> {
        let template = match colors() {
            true => "{wide_bar:.cyan/238} {msg}",
            false => "{wide_bar} {msg}",
        };
        self.line(ProgressBar::new(length), template)
    }

    /// The same for work of which nobody knows how much there is.
    pub(super) fn spinner(self) -> Option<ProgressBar> {
        let template = match colors() {
            true => "{spinner:.cyan} {msg}  {elapsed}",
            false => "{spinner} {msg}  {elapsed}",
        };
        self.line(ProgressBar::new_spinner(), template)
    }

    fn line(self, bar: ProgressBar, template: &str) -> Option<ProgressBar> {
        (!self.quiet && io::stderr().is_terminal()).then(|| {
            let style = match bar.length() {
                Some(_) => ProgressStyle::default_bar().progress_chars("━╸─"),
                None => ProgressStyle::default_spinner(),
            };
            bar.set_style(style.template(template).expect("the template is well-formed"));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        })
    }

    /// Writes an error with its causes, as far as it does not name them itself.
    pub(super) fn error(self, error: &Error) {
        let _ = writeln!(io::stderr(), "tamis: error: {}", error.with_causes());
    }
}

/// Whether lines may be coloured (<https://no-color.org>).
fn colors() -> bool {
    env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}
