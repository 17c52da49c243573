//! One frame: loaded, filtered, written, and what there is to say of it.

use std::time::{Duration, Instant};

use super::files::Frame;
use super::form::Form;
use super::timings::Timings;
use crate::backend::Backend;
use crate::cli::apply::{Applied, apply, needs, reach};
use crate::cli::error::Error;
use crate::cli::resolve::resized;
use crate::expr::Feature;
use crate::filter::Filter;
use crate::filter::shipped::{self, Choice};
use crate::plan::Passes;
use crate::report::number;
use crate::scene::exr::Header;
use crate::scene::mapping::Mapping;
use crate::scene::{ColorScale, LoadOptions, Note, Scene};

/// What is done to every frame.
pub(super) struct Job<'a> {
    /// What was asked for; if nothing was, each frame gets what its file can feed.
    pub(super) filter: Option<&'a Filter>,
    pub(super) radius: Option<u32>,
    pub(super) backend: &'a dyn Backend,
    pub(super) passes: Passes,
    pub(super) options: LoadOptions,
    pub(super) form: Form,
}

/// A frame that was read.
pub(super) struct Loaded {
    scene: Scene,
    chosen: Chosen,
    loading: Duration,
}

/// The filter of a frame.
struct Chosen {
    filter: Filter,
    /// Why it is not the best there is, if it is not.
    why: Option<String>,
}

/// A frame that was filtered. Of the scene, which is many times larger than the
/// result, it keeps what is to be said.
pub(super) struct Filtered {
    applied: Applied,
    chosen: Chosen,
    notes: Vec<Note>,
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
        let chosen = self.choose(frame)?;
        let (needs, reach) = (needs(&chosen.filter), reach(&chosen.filter));
        let scene = Scene::load(&frame.input, &needs, reach, &self.options)?;
        Ok(Loaded { scene, chosen, loading: start.elapsed() })
    }

    fn choose(&self, frame: &Frame) -> Result<Chosen, Error> {
        if let Some(filter) = self.filter {
            return Ok(Chosen { filter: filter.clone(), why: None });
        }
        let mapping = Mapping::of(&Header::read(&frame.input)?);
        // The windows of a program have radii of their own, and its colours are linear.
        let programs = self.backend.runs_programs()
            && self.radius.is_none()
            && self.options.color_scale == ColorScale::Linear;
        let Choice { filter, best, lacking } =
            shipped::choose(programs, |plane| mapping.provides(plane));
        let filter = resized(filter, self.radius)?;
        let without = filter.does_without(|plane| mapping.provides(plane));
        let titles = |features: &[Feature]| {
            let titles: Vec<&str> = features.iter().map(|feature| feature.row().title).collect();
            titles.join(", no ")
        };
        let (name, lacking, without) = (&filter.name, titles(&lacking), titles(&without));
        let why = match (lacking.is_empty(), without.is_empty()) {
            (true, true) => None,
            (true, false) => Some(format!("no {without} in the file: `{name}` does without")),
            (false, _) => {
                Some(format!("no {lacking} in the file: using `{name}` instead of `{best}`"))
            }
        };
        Ok(Chosen { filter, why })
    }

    pub(super) fn filter(&self, loaded: Loaded) -> Result<Filtered, Error> {
        let Loaded { scene, chosen, loading } = loaded;
        let applied = apply(&chosen.filter, &scene, self.backend, self.passes)?;
        Ok(Filtered { applied, chosen, notes: scene.notes().to_vec(), loading })
    }

    pub(super) fn write(&self, frame: &Frame, filtered: Filtered) -> Result<Written, Error> {
        let start = Instant::now();
        self.form.save(&filtered.applied.image, &frame.output)?;
        let write = start.elapsed();
        let Applied { planning, compilation, filtering, .. } = filtered.applied;
        let (width, height) = filtered.applied.image.size();
        let taps: usize = filtered.chosen.filter.gathers().map(|gather| gather.window.taps()).sum();
        let timings = Timings {
            load: filtered.loading,
            plan: planning,
            compile: compilation,
            filter: filtering,
            write,
            pairs: width * height * taps,
        };
        Ok(Written { remarks: self.remarks(frame, &filtered), timings })
    }

    fn remarks(&self, frame: &Frame, filtered: &Filtered) -> Vec<String> {
        let Filtered { applied: Applied { image, kept, filtering, .. }, chosen, notes, .. } =
            filtered;
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
            self.backend.name(),
            number::duration(*filtering),
        ));
        remarks
    }
}
