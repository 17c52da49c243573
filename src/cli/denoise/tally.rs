//! What became of the frames: a line of JSON each, if that is asked for, and a summary.

use std::io::{self, Write};

use serde::Serialize;

use super::files::Frame;
use super::timings::Timings;
use crate::cli::error::Error;

/// What became of one frame, as `--json` tells it.
#[derive(Debug, Serialize)]
struct Line<'a> {
    frame: Option<u64>,
    input: String,
    output: String,
    status: &'static str,
    /// Of a frame that was filtered: what its steps took together.
    seconds: Option<f64>,
    filter: Option<&'a str>,
    error: Option<&'a str>,
}

/// The frames so far.
#[derive(Debug)]
pub(super) struct Tally {
    json: bool,
    pub(super) done: Vec<Timings>,
    pub(super) skipped: usize,
    /// Inputs with what is wrong, each one line.
    failures: Vec<String>,
}

impl Tally {
    pub(super) fn new(json: bool) -> Self {
        Self { json, done: Vec::new(), skipped: 0, failures: Vec::new() }
    }

    /// A frame was filtered with the filter of that name.
    pub(super) fn done(&mut self, frame: &Frame, filter: &str, took: Timings) -> Result<(), Error> {
        self.done.push(took);
        let seconds = Some(took.sum().as_secs_f64());
        self.tell(Line { seconds, filter: Some(filter), ..Line::of(frame, "done") })
    }

    /// A frame's result was there.
    pub(super) fn skipped(&mut self, frame: &Frame) -> Result<(), Error> {
        self.skipped += 1;
        self.tell(Line::of(frame, "skipped"))
    }

    pub(super) fn failed(&mut self, frame: &Frame, error: &Error) -> Result<(), Error> {
        let text = error.with_causes();
        let reason: Vec<&str> = text.lines().map(str::trim).collect();
        let (reason, input) = (reason.join(" "), frame.input_name());
        self.failures.push(match reason.starts_with(&input) {
            true => reason.clone(),
            false => format!("{input}: {reason}"),
        });
        self.tell(Line { error: Some(&reason), ..Line::of(frame, "failed") })
    }

    /// The run's error, if frames failed.
    pub(super) fn verdict(&self, of: usize) -> Result<(), Error> {
        if self.failures.is_empty() {
            return Ok(());
        }
        let listing = self.failures.iter().map(|failure| format!("\n  {failure}")).collect();
        Err(Error::Frames { failed: self.failures.len(), of, listing })
    }

    /// Writes a line, which is then seen at once: whoever reads may be another program.
    fn tell(&self, line: Line<'_>) -> Result<(), Error> {
        if !self.json {
            return Ok(());
        }
        let mut text = serde_json::to_string(&line).expect("text and numbers are JSON");
        text.push('\n');
        let mut stdout = io::stdout().lock();
        match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
            // Nobody listens any more; the frames are still wanted.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            result => result.map_err(Error::Stdout),
        }
    }
}

impl Line<'_> {
    fn of(frame: &Frame, status: &'static str) -> Self {
        Self {
            frame: frame.number,
            input: frame.input.display().to_string(),
            output: frame.output.display().to_string(),
            status,
            seconds: None,
            filter: None,
            error: None,
        }
    }
}
