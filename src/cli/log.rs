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
        self.line(ProgressBar::new(length))
    }

    /// The same for work of which nobody knows how much there is.
    pub(super) fn spinner(self) -> Option<ProgressBar> {
        self.line(ProgressBar::new_spinner())
    }

    fn line(self, bar: ProgressBar) -> Option<ProgressBar> {
        (!self.quiet && io::stderr().is_terminal()).then(|| {
            bar.set_style(style(bar.length().is_some()));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        })
    }

    /// Writes an error with its causes, as far as it does not name them itself.
    pub(super) fn error(self, error: &Error) {
        let _ = writeln!(io::stderr(), "tamis: error: {}", error.with_causes());
    }
}

/// What a line looks like: a bar where it is known how much work there is, or a spinner.
pub(super) fn style(is_bar: bool) -> ProgressStyle {
    let (style, template) = match (is_bar, colors()) {
        (true, true) => (ProgressStyle::default_bar(), "{wide_bar:.cyan/238} {msg}"),
        (true, false) => (ProgressStyle::default_bar(), "{wide_bar} {msg}"),
        (false, true) => (ProgressStyle::default_spinner(), "{spinner:.cyan} {msg}  {elapsed}"),
        (false, false) => (ProgressStyle::default_spinner(), "{spinner} {msg}  {elapsed}"),
    };
    let style = if is_bar { style.progress_chars("━╸─") } else { style };
    style.template(template).expect("the template is well-formed")
}

/// Whether lines may be coloured (<https://no-color.org>).
fn colors() -> bool {
    env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}
