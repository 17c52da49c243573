//! The best so far as a filter file, for whoever's search is killed.

use std::path::PathBuf;

use crate::cli::evolve::record::{self, Origin};
use crate::evolve::Event;
use crate::filter::Filter;
use crate::image::{ImageError, write_atomically};
use crate::tune::Causes;

/// Writes the best so far with every checkpoint.
pub(super) struct Provisional<'a> {
    origin: &'a Origin<'a>,
    path: PathBuf,
    causes: Causes,
}

impl<'a> Provisional<'a> {
    pub(super) fn new(origin: &'a Origin<'a>, path: PathBuf) -> Self {
        Self { origin, path, causes: Causes::default() }
    }

    /// Takes news in. Returns why the file cannot be written, the first time for each cause.
    pub(super) fn hear(&mut self, event: Event<'_>) -> Option<ImageError> {
        let Event::Checkpoint { complete, best: Some(best), evaluations, .. } = event else {
            return None;
        };
        let filter = Filter::single("best", best.tree.clone(), self.origin.settings.radius);
        let training = record::under_way(self.origin, best, complete, evaluations);
        let written = write_atomically(&self.path, filter.to_toml(training).as_bytes());
        written.err().filter(|error| self.causes.is_new(error))
    }
}
