//! The best so far as a filter file, for whoever's search is killed, and as a page for whoever
//! watches.

use std::path::Path;

use super::browser;
use crate::cli::evolve::record::{self, Origin};
use crate::cli::evolve::{BEST, PAGE};
use crate::evolve::Event;
use crate::filter::Filter;
use crate::image::{ImageError, write_atomically};
use crate::tune::Causes;

/// Writes the best so far, and the page, with every checkpoint.
pub(super) struct Provisional<'a> {
    origin: &'a Origin<'a>,
    out: &'a Path,
    causes: Causes,
}

impl<'a> Provisional<'a> {
    pub(super) fn new(origin: &'a Origin<'a>, out: &'a Path) -> Self {
        Self { origin, out, causes: Causes::default() }
    }

    /// Takes news in. Returns why a file cannot be written, the first time for each cause.
    pub(super) fn hear(&mut self, event: Event<'_>) -> Option<ImageError> {
        let Event::Checkpoint { complete, best: Some(best), evaluations, rows, .. } = event else {
            return None;
        };
        let filter = Filter::single("best", best.tree.clone(), self.origin.settings.radius);
        let training = record::under_way(self.origin, best, complete, evaluations);
        let text = filter.to_toml(training);
        let mut written = write_atomically(&self.out.join(BEST), text.as_bytes());
        if written.is_ok() && !rows.is_empty() {
            let page = browser::under_way(self.origin, rows, best);
            written = write_atomically(&self.out.join(PAGE), page.as_bytes());
        }
        written.err().filter(|error| self.causes.is_new(error))
    }
}
