//! One frame: loaded, filtered, written, and what there is to say of it.

use std::path::Path;
use std::time::{Duration, Instant};

use super::files::Frame;
use super::form::Form;
use super::timings::Timings;
use crate::cli::apply::reach;
use crate::cli::error::Error;
use crate::denoise::{self, Applied, Denoised, Denoiser};
use crate::report::number;
use crate::scene::Note;

/// What is done to every frame.
pub(super) struct Job<'a> {
    pub(super) denoiser: Denoiser<'a>,
    pub(super) form: Form,
}

/// A frame that was read.
pub(super) struct Loaded {
    frame: denoise::Frame,
    loading: Duration,
}

/// A frame that was filtered. Of the scene, which is many times larger than the
/// result, it keeps what is to be said.
pub(super) struct Filtered {
    denoised: Denoised,
    loading: Duration,
}

/// A frame whose result is in its place.
pub(super) struct Written {
    /// What people should know, a line each.
    pub(super) remarks: Vec<Remark>,
    /// What the frame was filtered with.
    pub(super) filter: String,
    pub(super) timings: Timings,
}

/// A line about a frame.
pub(super) enum Remark {
    /// Something is wrong with the input; said even if asked to be quiet.
    Warning(String),
    /// Something that only some want to know.
    Detail(String),
}

impl Job<'_> {
    /// Loads a frame from a file.
    pub(super) fn load(&self, source: &Path) -> Result<Loaded, Error> {
        let start = Instant::now();
        let frame = self.denoiser.load(source)?;
        Ok(Loaded { frame, loading: start.elapsed() })
    }

    pub(super) fn filter(&self, loaded: Loaded) -> Result<Filtered, Error> {
        let denoised = self.denoiser.filter(loaded.frame)?;
        Ok(Filtered { denoised, loading: loaded.loading })
    }

    /// Writes a frame into a file.
    pub(super) fn write(
        &self,
        frame: &Frame,
        target: &Path,
        filtered: Filtered,
    ) -> Result<Written, Error> {
        let start = Instant::now();
        let Denoised { image, chosen, applied, .. } = &filtered.denoised;
        self.form.save(image, target)?;
        let write = start.elapsed();
        let &Applied { planning, compilation, filtering, .. } = applied;
        let (width, height) = image.size();
        let taps: usize = chosen.filter.gathers().map(|gather| gather.window.taps()).sum();
        let timings = Timings {
            load: filtered.loading,
            plan: planning,
            compile: compilation,
            filter: filtering,
            write,
            pairs: width * height * taps,
        };
        let filter = chosen.filter.name.clone();
        Ok(Written { remarks: self.remarks(frame, &filtered.denoised), filter, timings })
    }

    fn remarks(&self, frame: &Frame, denoised: &Denoised) -> Vec<Remark> {
        let Denoised { image, applied: Applied { kept, filtering, .. }, chosen, notes } = denoised;
        let (input, output) = (frame.input_name(), frame.output_name());
        let (width, height) = image.size();
        let why = chosen.why.iter().map(|why| Remark::Detail(format!("{input}: {why}")));
        let notes = notes.iter().map(|note| match note {
            Note::Repaired { .. } | Note::LeftBad { .. } => {
                Remark::Warning(format!("{input}: {note}"))
            }
            Note::Negative { .. }
            | Note::Bounded { .. }
            | Note::Fireflies { .. }
            | Note::EstimatedVariance(_)
            | Note::UnusableVariance { .. }
            | Note::FarDepth { .. }
            | Note::Borrowed { .. } => Remark::Detail(format!("{input}: {note}")),
        });
        let mut remarks: Vec<Remark> = why.chain(notes).collect();
        for (stage, &kept) in chosen.filter.stages.iter().zip(kept).filter(|(_, kept)| **kept > 0) {
            let (of, what) = match chosen.filter.paper() {
                Some(_) => (String::new(), "the noisy colour"),
                None => (format!("stage `{}`: ", stage.name), "what was to be averaged"),
            };
            let pixels = stage.grid.along(width) * stage.grid.along(height);
            remarks.push(Remark::Detail(format!(
                "{output}: {of}{} ({}) kept {what}: their weights sum to nothing that can be \
                 trusted",
                number::plural(kept, "pixel"),
                number::percent(kept, pixels),
            )));
        }
        remarks.push(Remark::Detail(format!(
            "{output}: {width}x{height} pixels, filter `{}`, radius {}, {}, {}",
            chosen.filter.name,
            reach(&chosen.filter),
            self.denoiser.backend().name(),
            number::duration(*filtering),
        )));
        remarks
    }
}
