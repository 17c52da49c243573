//! Floor 7: what the parts of a filter are for, on a scene whose truth is known.
//!
//! [`explain`] runs the filter without each of its parts in turn: without a feature that the
//! file has, without a pass, a term of a weight's exponent, a factor of it, or with one number
//! in the place of a value that a map makes for every pixel. What the error becomes says what
//! the part is for; what is predicted to be saved says what it takes. Constants stay as they
//! are: they were tuned for the whole, and tuned anew the rest may do better.
//!
//! [`footprints`] says which pixels a result is made of: the weights of every pass around a
//! pixel, exactly.

mod parts;

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::backend::reference::meaning::Images;
use crate::backend::{Backend, Rect};
use crate::denoise::{Code, DenoiseError, Run};
use crate::expr::feature::{Feature, PlaneId};
use crate::filter::{Filter, Grid, Stage, StageKind};
use crate::image::{Image, ImageError, Metrics};
use crate::plan::{Passes, Program};
use crate::scene::{Crop, Fact, Facts, Note, Scene};
use parts::{Without, parts};

pub use parts::{Kind, Part};

/// Columns and rows, at most, of the part of a scene that means are taken over.
const SAMPLE: usize = 96;

/// Why a filter cannot be explained.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// It cannot run on the scene.
    #[error(transparent)]
    Denoise(#[from] DenoiseError),
    /// Its result cannot be compared with the reference.
    #[error(transparent)]
    Image(#[from] ImageError),
}

/// What a filter does on a scene, and what its parts do for that.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The errors of the image as it was rendered.
    pub noisy: Metrics,
    /// Of the result, with everything.
    pub whole: Effect,
    /// The result.
    pub image: Image,
    /// The parts, in the order of the stages.
    pub parts: Vec<(Part, Found)>,
}

/// What a filter comes to.
#[derive(Clone, Copy, Debug)]
pub struct Effect {
    /// The errors of its result.
    pub metrics: Metrics,
    /// Nanoseconds per pixel that it is predicted to take on one core.
    pub cost: f64,
}

/// What was found about a part.
#[derive(Clone, Copy, Debug)]
pub enum Found {
    /// What the filter comes to without it.
    Without(Effect),
    /// The filter cannot run without it.
    Needed,
    /// The scene does not have it.
    Absent,
}

/// Explains a filter on a scene that was loaded with what it needs. `hear` is told how many of
/// how many parts are done.
///
/// # Errors
/// If the filter cannot run on the scene, or the reference is of another size.
///
/// # Panics
/// If the filter makes no sense.
pub fn explain(
    filter: &Filter,
    scene: &Scene,
    reference: &Image,
    backend: &dyn Backend,
    hear: &(dyn Fn(usize, usize) + Sync),
) -> Result<Explanation, Error> {
    let noisy = Metrics::of(&scene.noisy(), reference)?;
    let facts = Facts::of(scene);
    let (image, whole) = run(filter, scene, &facts, reference, backend)?;
    let checked = filter.check().expect("only filters that make sense get here");
    let sample = scene.crop(&middle(scene), 1.0);
    // Weights alone make no values, and their scenes may lack the colour as a feature.
    let stages = if filter.paper().is_some() { 0 } else { filter.stages.len() };
    let parts = parts(&checked, &Images::of(&sample, &checked, stages).0);
    let done = AtomicUsize::new(0);
    let count = parts.len();
    let found: Result<Vec<Found>, Error> = parts
        .par_iter()
        .map(|part| {
            let effect = |filter: &Filter, scene: &Scene, facts: &Facts| {
                run(filter, scene, facts, reference, backend).map(|(_, e)| Found::Without(e))
            };
            let found = match &part.without {
                Without::Nothing => Found::Needed,
                Without::Feature(feature) if lacks(&facts, *feature) => Found::Absent,
                Without::Feature(feature) => effect(filter, scene, &without(&facts, *feature))?,
                Without::Variances if is_estimated(scene) => Found::Absent,
                Without::Variances => {
                    let scene = scene.without_variances();
                    effect(filter, &scene, &Facts::of(&scene))?
                }
                Without::Filter(other) => effect(other, scene, &facts)?,
            };
            hear(1 + done.fetch_add(1, Ordering::Relaxed), count);
            Ok(found)
        })
        .collect();
    Ok(Explanation { noisy, whole, image, parts: parts.into_iter().zip(found?).collect() })
}

fn run(
    filter: &Filter,
    scene: &Scene,
    facts: &Facts,
    reference: &Image,
    backend: &dyn Backend,
) -> Result<(Image, Effect), Error> {
    let code = Code::new(filter, (scene.name(), facts), backend, Passes::ALL)?;
    let whole = Rect::whole(scene);
    let filtered = code.run(scene, whole, Run::default())?.pixels;
    let rgb = [0, 1, 2].map(|channel| filtered.iter().map(|pixel| pixel[channel]).collect());
    let image =
        Image::new(scene.name(), whole.width, whole.height, rgb).expect("a colour per pixel");
    let metrics = Metrics::of(&image, reference)?;
    let checked = filter.check().expect("only filters that make sense get here");
    let program = Program::new(&checked, facts, Passes::ALL);
    let cost = program.map_or(f64::NAN, |program| program.cost());
    Ok((image, Effect { metrics, cost }))
}

fn lacks(facts: &Facts, feature: Feature) -> bool {
    facts.iter().all(|(plane, _)| plane.feature != feature)
}

fn without(facts: &Facts, feature: Feature) -> Facts {
    let known = facts.iter().filter(|(plane, _)| plane.feature != feature);
    Facts::from_planes(known.collect::<Vec<(PlaneId, Fact)>>())
}

fn is_estimated(scene: &Scene) -> bool {
    scene.notes().contains(&Note::EstimatedVariance(Feature::Color))
}

/// The middle of a scene.
fn middle(scene: &Scene) -> Crop {
    let whole = [scene.layout().width(), scene.layout().height()];
    let size = whole.map(|length| length.min(SAMPLE));
    part(whole, [0, 1].map(|axis| [(whole[axis] - size[axis]) / 2, size[axis]]))
}

/// A part of a scene by where it begins and how long it is along each axis. It begins at even
/// pixels, as half resolution does.
fn part(whole: [usize; 2], [x, y]: [[usize; 2]; 2]) -> Crop {
    let even = |[start, length]: [usize; 2], end: usize| {
        let start = start / 2 * 2;
        [start, length.min(end - start)]
    };
    let ([x, width], [y, height]) = (even(x, whole[0]), even(y, whole[1]));
    Crop { corner: [x, y], size: [width, height], flipped: [false; 2], transposed: false }
}

/// The weights of a pass around a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint {
    /// The pass: which stage, counted from 0.
    pub stage: usize,
    /// By tap, row by row: the share of the sum of all weights; nothing beside the image.
    /// Where all weights are 0, so is every share.
    pub shares: Vec<Option<f64>>,
}

/// Which pixels each pass of a filter averages for a pixel of a scene, and how much each counts.
/// On half the resolution, the pixel is the one that stands for it there.
///
/// # Panics
/// If the filter makes no sense, the scene lacks what it needs, or the pixel is not in it.
pub fn footprints(filter: &Filter, scene: &Scene, [x, y]: [usize; 2]) -> Vec<Footprint> {
    let checked = filter.check().expect("only filters that make sense get here");
    let whole = [scene.layout().width(), scene.layout().height()];
    assert!(x < whole[0] && y < whole[1], "a pixel of the scene");
    let field = checked.receptive_field() + checked.reach();
    let around = |at: usize, end: usize| {
        // Rounding the start down to an even pixel takes one more at the end.
        let start = at.saturating_sub(field) / 2 * 2;
        [start, (at + field + 2).min(end) - start]
    };
    let crop = part(whole, [around(x, whole[0]), around(y, whole[1])]);
    let near = scene.crop(&crop, 1.0);
    let at = [x - crop.corner[0], y - crop.corner[1]];
    let stages = &filter.stages;
    let last = stages.iter().rposition(|stage| matches!(stage.kind, StageKind::Gather(_)));
    let Some(last) = last else { return Vec::new() };
    let (images, _) = Images::of(&near, &checked, last);
    let footprint = |(k, stage): (usize, &Stage)| {
        let StageKind::Gather(gather) = &stage.kind else { return None };
        let at = match stage.grid {
            Grid::Full => at,
            Grid::Half => at.map(|n| n / 2),
        };
        let weights = images.weights(gather, stage.grid, at);
        let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
        let diameter = gather.window.diameter();
        let mut shares = vec![None; diameter * diameter];
        for ([u, v], weight) in weights {
            let tap = |j: usize, i: usize| {
                (j + gather.window.reach() as usize - i) / gather.window.dilation as usize
            };
            let share = if sum == 0.0 { 0.0 } else { weight / sum };
            shares[tap(v, at[1]) * diameter + tap(u, at[0])] = Some(share);
        }
        Some(Footprint { stage: k, shares })
    };
    stages.iter().enumerate().filter_map(footprint).collect()
}

#[cfg(test)]
mod tests;
