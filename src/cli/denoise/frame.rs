//! One frame: loaded, filtered, written, and what there is to say of it.

use std::path::Path;
use std::time::{Duration, Instant};

use super::files::Frame;
use super::timings::Timings;
use crate::cli::apply::reach;
use crate::cli::error::Error;
use crate::denoise::{self, Applied, Denoised, Denoiser, Feeds, Picture};
use crate::filter::Filter;
use crate::image::{Image, listing};
use crate::report::{Form, number};
use crate::scene::Note;
use crate::scene::listing::Aux;

/// What is done to every frame.
pub(super) struct Job {
    pub(super) denoiser: Denoiser,
    pub(super) form: Form,
    /// Whether somebody named the filter.
    pub(super) is_named: bool,
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
    /// What of the input the result's format has no place for, if anything.
    pub(super) left_out: Option<String>,
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

impl Job {
    /// Loads a frame from a file, and others with features of their own.
    pub(super) fn load(&self, source: &Path, aux: &[Aux]) -> Result<Loaded, Error> {
        let start = Instant::now();
        let frame = self.denoiser.load(source, aux)?;
        Ok(Loaded { frame, loading: start.elapsed() })
    }

    /// Filters a frame; `progress` is told how many rows are done, and of how many.
    pub(super) fn filter(
        &self,
        loaded: Loaded,
        progress: &denoise::Progress<'_>,
    ) -> Result<Filtered, Error> {
        let denoised = self.denoiser.filter_watched(loaded.frame, progress)?;
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
        let lost = self.form.save(&filtered.denoised, target, self.exposure)?;
        let write = start.elapsed();
        let mut timings = Timings { load: filtered.loading, write, ..Timings::default() };
        let Denoised { pictures, filter, .. } = &filtered.denoised;
        let taps: usize = filter.gathers().map(|gather| gather.window.taps()).sum();
        for Picture { image, applied, .. } in pictures {
            let (width, height) = image.size();
            timings.plan += applied.planning;
            timings.compile += applied.compilation;
            timings.filter += applied.filtering;
            timings.pairs += width * height * taps;
        }
        let output = frame.output_name();
        let recompressed = lost.recompressed.iter().map(|compression| {
            Remark::Detail(format!(
                "{output}: {compression} loses precision, also of channels beside the colour"
            ))
        });
        let mut remarks: Vec<Remark> = recompressed.collect();
        for picture in pictures {
            remarks.extend(self.remarks(frame, filter, picture));
        }
        let feeds = pictures.iter().map(|picture| Feeds(&picture.target).to_string()).collect();
        let filter = filter.name.clone();
        let left_out = match self.form {
            Form::Exr => Vec::new(),
            Form::Png | Form::Pfm => filtered.denoised.beside_the_picture(),
        };
        let left_out = (!left_out.is_empty()).then(|| {
            let names = listing(left_out.iter().map(String::as_str));
            format!("a {} file holds one picture; not in it: {names}", self.form.name())
        });
        Ok(Written { feeds, left_out, remarks, filter, timings })
    }

    /// What there is to say of a picture.
    fn remarks(&self, frame: &Frame, filter: &Filter, picture: &Picture) -> Vec<Remark> {
        let Picture { target, image, layers, notes, applied } = picture;
        let Applied { kept, filtering, .. } = applied;
        let which = target.mapping().which().to_string();
        let which = if which.is_empty() { which } else { format!(" {which}:") };
        let input = format!("{}:{which}", frame.input_name());
        let output = format!("{}:{which}", frame.output_name());
        let (width, height) = image.size();
        // The filter that nobody named is made for estimates, too.
        let is_told = |note: &&Note| self.is_named || !matches!(note, Note::EstimatedVariance(_));
        let notes = notes.iter().filter(is_told).map(|note| match note.is_warning() {
            true => Remark::Warning(format!("{input} {note}")),
            false => Remark::Detail(format!("{input} {note}")),
        });
        let mut remarks: Vec<Remark> = notes.collect();
        for (stage, &kept) in filter.stages.iter().zip(kept).filter(|(_, kept)| **kept > 0) {
            let (of, what) = match filter.paper() {
                Some(_) => (String::new(), "the noisy colour"),
                None => (format!("stage `{}`: ", stage.name), "what was to be averaged"),
            };
            let pixels = stage.grid.along(width) * stage.grid.along(height);
            remarks.push(Remark::Detail(format!(
                "{output} {of}{} ({}) kept {what}: their weights sum to nothing that can be \
                 trusted",
                number::plural(kept, "pixel"),
                number::percent(kept, pixels),
            )));
        }
        if !layers.is_empty() {
            let names: Vec<&str> = layers.iter().map(layer_name).collect();
            remarks.push(Remark::Detail(format!(
                "{output} by the same weights: {}",
                names.join(", ")
            )));
        }
        remarks.push(Remark::Detail(format!(
            "{output} {width}x{height} pixels, filter `{}`, radius {}, {}, {}",
            filter.name,
            reach(filter),
            self.denoiser.backend().name(),
            number::duration(*filtering),
        )));
        remarks
    }
}

/// What a layer's channels have in common.
fn layer_name(layer: &Image) -> &str {
    let [first, second, _] = layer.channels();
    match first.rsplit_once('.') {
        Some((name, _)) if first != second => name,
        _ => first,
    }
}
