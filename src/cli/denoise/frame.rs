//! One frame: loaded, filtered, written, and what there is to say of it.

use std::time::{Duration, Instant};

use super::files::Frame;
use super::form::Form;
use super::timings::Timings;
use crate::cli::apply::reach;
use crate::cli::error::Error;
use crate::denoise::{self, Applied, Denoised, Denoiser};
use crate::report::number;

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
    pub(super) remarks: Vec<String>,
    pub(super) timings: Timings,
}

impl Job<'_> {
    pub(super) fn load(&self, frame: &Frame) -> Result<Loaded, Error> {
        let start = Instant::now();
        let frame = self.denoiser.load(&frame.input)?;
        Ok(Loaded { frame, loading: start.elapsed() })
    }

    pub(super) fn filter(&self, loaded: Loaded) -> Result<Filtered, Error> {
        let denoised = self.denoiser.filter(loaded.frame)?;
        Ok(Filtered { denoised, loading: loaded.loading })
    }

    pub(super) fn write(&self, frame: &Frame, filtered: Filtered) -> Result<Written, Error> {
        let start = Instant::now();
        let Denoised { image, chosen, applied, .. } = &filtered.denoised;
        self.form.save(image, &frame.output)?;
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
        Ok(Written { remarks: self.remarks(frame, &filtered.denoised), timings })
    }

    fn remarks(&self, frame: &Frame, denoised: &Denoised) -> Vec<String> {
        let Denoised { image, applied: Applied { kept, filtering, .. }, chosen, notes } = denoised;
        let (input, output) = (frame.input.display(), frame.output.display());
        let (width, height) = image.size();
        let why = chosen.why.iter().map(|why| format!("{input}: {why}"));
        let notes = notes.iter().map(|note| format!("{input}: {note}"));
        let mut remarks: Vec<String> = why.chain(notes).collect();
        for (stage, &kept) in chosen.filter.stages.iter().zip(kept).filter(|(_, kept)| **kept > 0) {
            let (of, what) = match chosen.filter.paper() {
                Some(_) => (String::new(), "the noisy colour"),
                None => (format!("stage `{}`: ", stage.name), "what was to be averaged"),
            };
            let pixels = stage.grid.along(width) * stage.grid.along(height);
            remarks.push(format!(
                "{output}: {of}{} ({}) kept {what}: their weights sum to nothing that can be \
                 trusted",
                number::plural(kept, "pixel"),
                number::percent(kept, pixels),
            ));
        }
        remarks.push(format!(
            "{output}: {width}x{height} pixels, filter `{}`, radius {}, {}, {}",
            chosen.filter.name,
            reach(&chosen.filter),
            self.denoiser.backend().name(),
            number::duration(*filtering),
        ));
        remarks
    }
}
