//! One frame: loaded, filtered, written, and what there is to say of it.

use std::path::Path;
use std::time::{Duration, Instant};

use super::files::Frame;
use super::form::Form;
use super::timings::Timings;
use crate::cli::apply::reach;
use crate::cli::error::Error;
use crate::denoise::{self, Applied, Denoised, Denoiser, Feeds, Picture};
use crate::report::number;
use crate::scene::Note;
use crate::scene::listing::Aux;

/// What is done to every frame.
pub(super) struct Job<'a> {
    pub(super) denoiser: Denoiser<'a>,
    pub(super) form: Form,
    /// Whether somebody named the filter.
    pub(super) is_named: bool,
    /// Files beside each frame's own.
    pub(super) aux: Vec<Aux>,
    /// Stops by which pictures for people are made brighter.
    pub(super) exposure: f32,
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
    /// What feeds the filter, a line for each picture.
    pub(super) feeds: Vec<String>,
    /// What people may want to know, a line each.
    pub(super) remarks: Vec<String>,
    /// What they should know, whatever they want.
    pub(super) warnings: Vec<String>,
    pub(super) timings: Timings,
}

impl Job<'_> {
    pub(super) fn load(&self, frame: &Frame) -> Result<Loaded, Error> {
        let start = Instant::now();
        let frame = self.denoiser.load(&frame.input, &self.aux)?;
        Ok(Loaded { frame, loading: start.elapsed() })
    }

    pub(super) fn filter(&self, loaded: Loaded) -> Result<Filtered, Error> {
        let denoised = self.denoiser.filter(loaded.frame)?;
        Ok(Filtered { denoised, loading: loaded.loading })
    }

    pub(super) fn write(&self, frame: &Frame, filtered: Filtered) -> Result<Written, Error> {
        let start = Instant::now();
        let lost = self.form.save(&filtered.denoised, &frame.output, self.exposure)?;
        let write = start.elapsed();
        let mut timings = Timings { load: filtered.loading, write, ..Timings::default() };
        for Picture { image, chosen, applied, .. } in &filtered.denoised.pictures {
            let (width, height) = image.size();
            let taps: usize = chosen.filter.gathers().map(|gather| gather.window.taps()).sum();
            timings.plan += applied.planning;
            timings.compile += applied.compilation;
            timings.filter += applied.filtering;
            timings.pairs += width * height * taps;
        }
        let mut written =
            Written { feeds: Vec::new(), remarks: Vec::new(), warnings: Vec::new(), timings };
        let output = frame.output.display();
        for compression in lost.recompressed {
            written.warnings.push(format!(
                "{output}: {compression} loses precision: so did channels beside the colour"
            ));
        }
        for picture in &filtered.denoised.pictures {
            self.tell(frame, picture, &mut written);
        }
        Ok(written)
    }

    /// Tells of a picture.
    fn tell(&self, frame: &Frame, picture: &Picture, written: &mut Written) {
        let Picture { target, image, applied: Applied { kept, filtering, .. }, chosen, notes } =
            picture;
        let which = target.mapping().which().to_string();
        let of = |file: &Path| match which.is_empty() {
            true => format!("{}:", file.display()),
            false => format!("{}: {which}:", file.display()),
        };
        let (input, output) = (of(&frame.input), of(&frame.output));
        let (width, height) = image.size();
        written.feeds.push(Feeds(target).to_string());
        // A filter that is chosen for a file is made for estimates, too.
        let is_told = |note: &&Note| self.is_named || !matches!(note, Note::EstimatedVariance(_));
        let notes = notes.iter().filter(is_told);
        for note in notes {
            let list = if note.is_warning() { &mut written.warnings } else { &mut written.remarks };
            list.push(format!("{input} {note}"));
        }
        written.remarks.extend(chosen.why.iter().map(|why| format!("{input} {why}")));
        for (stage, &kept) in chosen.filter.stages.iter().zip(kept).filter(|(_, kept)| **kept > 0) {
            let (of, what) = match chosen.filter.paper() {
                Some(_) => (String::new(), "the noisy colour"),
                None => (format!("stage `{}`: ", stage.name), "what was to be averaged"),
            };
            let pixels = stage.grid.along(width) * stage.grid.along(height);
            written.remarks.push(format!(
                "{output} {of}{} ({}) kept {what}: their weights sum to nothing that can be \
                 trusted",
                number::plural(kept, "pixel"),
                number::percent(kept, pixels),
            ));
        }
        written.remarks.push(format!(
            "{output} {width}x{height} pixels, filter `{}`, radius {}, {}, {}",
            chosen.filter.name,
            reach(&chosen.filter),
            self.denoiser.backend().name(),
            number::duration(*filtering),
        ));
    }
}
