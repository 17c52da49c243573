//! One frame: loaded, filtered, written, and what there is to say of it.

use std::time::{Duration, Instant};

use super::files::Frame;
use super::form::Form;
use super::timings::Timings;
use crate::backend::Backend;
use crate::cli::apply::{Applied, apply, needs, reach};
use crate::cli::error::Error;
use crate::plan::{Filter, Passes};
use crate::report::number;
use crate::scene::{LoadOptions, Note, Scene};

/// What is done to every frame.
pub(super) struct Job<'a> {
    pub(super) filter: &'a Filter,
    pub(super) backend: &'a dyn Backend,
    pub(super) passes: Passes,
    pub(super) options: LoadOptions,
    pub(super) form: Form,
}

/// A frame that was read.
pub(super) struct Loaded {
    scene: Scene,
    loading: Duration,
}

/// A frame that was filtered. Of the scene, which is many times larger than the
/// result, it keeps what is to be said.
pub(super) struct Filtered {
    applied: Applied,
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
        let (needs, reach) = (needs(self.filter), reach(self.filter));
        let scene = Scene::load(&frame.input, &needs, reach, &self.options)?;
        Ok(Loaded { scene, loading: start.elapsed() })
    }

    pub(super) fn filter(&self, Loaded { scene, loading }: Loaded) -> Result<Filtered, Error> {
        let applied = apply(self.filter, &scene, self.backend, self.passes)?;
        Ok(Filtered { applied, notes: scene.notes().to_vec(), loading })
    }

    pub(super) fn write(&self, frame: &Frame, filtered: Filtered) -> Result<Written, Error> {
        let start = Instant::now();
        self.form.save(&filtered.applied.image, &frame.output)?;
        let write = start.elapsed();
        let Applied { planning, compilation, filtering, .. } = filtered.applied;
        let (width, height) = filtered.applied.image.size();
        let taps: usize = self.filter.stages.iter().map(|stage| stage.window.taps()).sum();
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
        let Filtered { applied: Applied { image, kept, filtering, .. }, notes, .. } = filtered;
        let (input, output) = (frame.input.display(), frame.output.display());
        let (width, height) = image.size();
        let mut remarks: Vec<String> =
            notes.iter().map(|note| format!("{input}: {note}")).collect();
        if *kept > 0 {
            remarks.push(format!(
                "{output}: {} ({}) kept the noisy colour: their weights sum to nothing that can \
                 be trusted",
                number::plural(*kept, "pixel"),
                number::percent(*kept, width * height),
            ));
        }
        remarks.push(format!(
            "{output}: {width}x{height} pixels, filter `{}`, radius {}, {}, {}",
            self.filter.name,
            reach(self.filter),
            self.backend.name(),
            number::duration(*filtering),
        ));
        remarks
    }
}
