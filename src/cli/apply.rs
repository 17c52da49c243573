//! Applying a filter to a scene, from the filter to an image.

use std::time::{Duration, Instant};

use super::error::Error;
use crate::backend::{Backend, Rect};
use crate::filter::{Checked, Filter};
use crate::plan::{Passes, Schedule};
use crate::scene::{Facts, Image, Needs, Scene};

/// A filtered image, and what it took.
pub(super) struct Applied {
    pub(super) image: Image,
    /// By stage: pixels that kept what was to be averaged.
    pub(super) kept: Vec<usize>,
    pub(super) planning: Duration,
    pub(super) compilation: Duration,
    pub(super) filtering: Duration,
}

/// The planes that a filter reads of a scene.
pub(super) fn needs(filter: &Filter) -> Needs {
    checked(filter).needs()
}

/// How far a filter looks, in pixels: the padding that its scene needs.
pub(super) fn reach(filter: &Filter) -> usize {
    checked(filter).reach()
}

/// A filter that was checked when it was read or made.
pub(super) fn checked(filter: &Filter) -> Checked<'_> {
    filter.check().expect("only filters that make sense get here")
}

/// Filters a scene that was loaded with the filter's [`needs`] and [`reach`].
pub(super) fn apply(
    filter: &Filter,
    scene: &Scene,
    backend: &dyn Backend,
    passes: Passes,
) -> Result<Applied, Error> {
    let checked = checked(filter);
    scene.require(&checked.required())?;
    let (scene_name, filter_name) = (scene.name(), &filter.name);
    let failed =
        |source| Error::Run { scene: scene_name.to_owned(), filter: filter_name.clone(), source };

    let start = Instant::now();
    let plan = Schedule::new(&checked, &Facts::of(scene), passes).map_err(|source| {
        Error::Plan { scene: scene_name.to_owned(), filter: filter_name.clone(), source }
    })?;
    let planning = start.elapsed();

    let start = Instant::now();
    let executable = backend.schedule(&plan).map_err(failed)?;
    let compilation = start.elapsed();

    let start = Instant::now();
    let whole = Rect::whole(scene);
    let filtered = executable.run(scene, &[whole]).map_err(failed)?;
    let filtered = filtered.into_iter().next().expect("one result for one weight");
    let filtering = start.elapsed();

    let rgb = [0, 1, 2].map(|channel| filtered.pixels.iter().map(|c| c[channel]).collect());
    let image = Image::new(scene_name, whole.width, whole.height, rgb)
        .expect("one colour per pixel of the rectangle")
        .with_attributes(scene.attributes());
    Ok(Applied { image, kept: filtered.kept, planning, compilation, filtering })
}
