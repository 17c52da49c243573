//! Filters as code, and scenes in memory.

use std::time::{Duration, Instant};

use super::DenoiseError;
use crate::backend::{Backend, Executable, Filtered, Rect, Watch};
use crate::filter::Filter;
use crate::image::Image;
use crate::plan::{Passes, Plan};
use crate::scene::{Facts, Scene};

/// A filter, planned and compiled for scenes of which some facts hold.
pub struct Code<'a> {
    filter: &'a Filter,
    plan: Plan,
    code: Box<dyn Executable>,
    strength: f32,
    watch: &'a Watch<'a>,
    /// How long planning took.
    pub planning: Duration,
    /// How long compilation took.
    pub compilation: Duration,
}

/// How a filter is applied.
#[derive(Clone, Copy)]
pub struct How<'w> {
    /// How its plan is made.
    pub passes: Passes,
    /// How much of the result is taken, between 0 and 1; the rest is the noisy colour.
    pub strength: f32,
    /// Who is told how many more rows are done.
    pub watch: &'w Watch<'w>,
}

impl How<'_> {
    /// All of the result, and nobody looks.
    pub fn new(passes: Passes) -> Self {
        Self { passes, strength: 1.0, watch: &|_| {} }
    }
}

/// What there is to say of a filtered image.
#[derive(Clone, Debug)]
pub struct Applied {
    /// By stage: pixels that kept what was to be averaged.
    pub kept: Vec<usize>,
    /// How long planning took.
    pub planning: Duration,
    /// How long compilation took.
    pub compilation: Duration,
    /// How long filtering took.
    pub filtering: Duration,
}

impl<'a> Code<'a> {
    /// Plans and compiles a filter. `scene` is what errors call what it is made for.
    ///
    /// # Errors
    /// If it cannot be planned, or the back end fails.
    pub fn new(
        filter: &'a Filter,
        (scene, facts): (&str, &Facts),
        backend: &dyn Backend,
        How { passes, strength, watch }: How<'a>,
    ) -> Result<Self, DenoiseError> {
        let checked = filter.check().expect("only filters that make sense get here");
        let start = Instant::now();
        let plan = Plan::of(&checked, facts, passes).map_err(|source| DenoiseError::Plan {
            scene: scene.to_owned(),
            filter: filter.name.clone(),
            source,
        })?;
        let planning = start.elapsed();
        let start = Instant::now();
        let code = backend.compile(&plan).map_err(|source| DenoiseError::Run {
            scene: scene.to_owned(),
            filter: filter.name.clone(),
            source,
        })?;
        Ok(Self { filter, plan, code, strength, watch, planning, compilation: start.elapsed() })
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Filters a rectangle of a scene.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn run(&self, scene: &Scene, rect: Rect) -> Result<Filtered, DenoiseError> {
        let filtered = self.code.run_watched(scene, &[rect], self.watch);
        let filtered = filtered.map_err(|source| DenoiseError::Run {
            scene: scene.name().to_owned(),
            filter: self.filter.name.clone(),
            source,
        })?;
        let mut filtered = filtered.into_iter().next().expect("one result for one filter");
        if let Some(alpha) = scene.alpha() {
            keep_uncovered(&mut filtered, scene, alpha, rect);
        }
        if self.strength < 1.0 {
            for (k, pixel) in filtered.pixels.iter_mut().enumerate() {
                let (x, y) = (rect.x + k % rect.width, rect.y + k / rect.width);
                for (channel, noisy) in pixel.iter_mut().zip(scene.color()) {
                    let noisy = noisy.at(x, y);
                    *channel = noisy + self.strength * (*channel - noisy);
                }
            }
        }
        Ok(filtered)
    }
}

/// Gives pixels back their colour that nothing covers: where alpha and colour are zero,
/// whatever comes from pixels around would shine through when the image is composited.
fn keep_uncovered(filtered: &mut Filtered, scene: &Scene, alpha: &[f32], rect: Rect) {
    let width = scene.layout().width();
    for (k, pixel) in filtered.pixels.iter_mut().enumerate() {
        let (x, y) = (rect.x + k % rect.width, rect.y + k / rect.width);
        let is_black = || scene.color().iter().all(|channel| channel.at(x, y) == 0.0);
        if alpha[y * width + x] == 0.0 && is_black() {
            *pixel = [0.0; 3];
        }
    }
}

/// Filters a scene that was loaded with what the filter needs.
///
/// # Errors
/// If the scene lacks something, the filter cannot be planned, or the back end fails.
pub fn apply(
    filter: &Filter,
    scene: &Scene,
    backend: &dyn Backend,
    how: How<'_>,
) -> Result<(Image, Applied), DenoiseError> {
    let checked = filter.check().expect("only filters that make sense get here");
    scene.require(&checked.required())?;
    let code = Code::new(filter, (scene.name(), &Facts::of(scene)), backend, how)?;
    let start = Instant::now();
    let whole = Rect::whole(scene);
    let Filtered { pixels, kept } = code.run(scene, whole)?;
    let filtering = start.elapsed();
    let rgb = [0, 1, 2].map(|channel| pixels.iter().map(|c| c[channel]).collect());
    let image = Image::new(scene.name(), whole.width, whole.height, rgb)
        .expect("one colour per pixel of the rectangle")
        .with_attributes(scene.attributes())
        .with_alpha(scene.alpha().map(<[f32]>::to_vec));
    let Code { planning, compilation, .. } = code;
    Ok((image, Applied { kept, planning, compilation, filtering }))
}
