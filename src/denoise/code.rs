//! Filters as code, and scenes in memory.

use std::time::{Duration, Instant};

use super::DenoiseError;
use crate::backend::{Backend, Executable, Filtered, Rect, Watch};
use crate::filter::{Carrying, Filter};
use crate::image::Image;
use crate::plan::{Passes, Plan, PlanError};
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

impl Applied {
    /// The same stages, before anything took time.
    pub(super) fn nothing(other: &Self) -> Self {
        let zero = Duration::ZERO;
        let kept = other.kept.clone();
        Self { kept, planning: zero, compilation: zero, filtering: zero }
    }
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
        let plan = || Plan::of(&checked, facts, passes);
        Self::planned(filter, scene, backend, How { passes, strength, watch }, plan)
    }

    /// The same of a filter of several pictures.
    ///
    /// # Errors
    /// If it cannot be planned, or the back end fails.
    pub fn of_pictures(
        carrying: &'a Carrying,
        (scene, facts): (&str, &Facts),
        backend: &dyn Backend,
        how: How<'a>,
    ) -> Result<Self, DenoiseError> {
        let plan = || Plan::of_pictures(carrying, facts, how.passes);
        Self::planned(&carrying.filter, scene, backend, how, plan)
    }

    fn planned(
        filter: &'a Filter,
        scene: &str,
        backend: &dyn Backend,
        How { strength, watch, .. }: How<'a>,
        plan: impl FnOnce() -> Result<Plan, PlanError>,
    ) -> Result<Self, DenoiseError> {
        let start = Instant::now();
        let plan = plan().map_err(|source| DenoiseError::Plan {
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
        let filtered = self.run_pictures(scene, &[], rect)?;
        Ok(filtered.into_iter().next().expect("there is a result"))
    }

    /// Filters a rectangle of a scene and of the pictures that the scene was given, which are as
    /// the file has them. The colour comes first.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn run_pictures(
        &self,
        scene: &Scene,
        pictures: &[[Vec<f32>; 3]],
        rect: Rect,
    ) -> Result<Vec<Filtered>, DenoiseError> {
        let filtered = self.code.run_watched(scene, &[rect], self.watch);
        let filtered = filtered.map_err(|source| DenoiseError::Run {
            scene: scene.name().to_owned(),
            filter: self.filter.name.clone(),
            source,
        })?;
        let width = scene.layout().width();
        let noisy = |picture: usize, x: usize, y: usize| match picture.checked_sub(1) {
            None => scene.color().each_ref().map(|channel| channel.at(x, y)),
            Some(other) => pictures[other].each_ref().map(|channel| channel[y * width + x]),
        };
        let finish = |(k, mut filtered): (usize, Filtered)| {
            for (n, pixel) in filtered.pixels.iter_mut().enumerate() {
                let (x, y) = (rect.x + n % rect.width, rect.y + n / rect.width);
                if let Some(alpha) = scene.alpha() {
                    keep_uncovered(pixel, alpha[y * width + x], noisy(k, x, y));
                }
                if self.strength < 1.0 {
                    for (channel, noisy) in pixel.iter_mut().zip(noisy(k, x, y)) {
                        *channel = noisy + self.strength * (*channel - noisy);
                    }
                }
            }
            filtered
        };
        // Whole images need no other look at all of their pixels.
        if scene.alpha().is_none() && self.strength >= 1.0 {
            return Ok(filtered);
        }
        Ok(filtered.into_iter().enumerate().map(finish).collect())
    }
}

/// Gives a pixel back its colour that nothing covers: where alpha and colour are zero,
/// whatever comes from pixels around would shine through when the image is composited.
fn keep_uncovered(pixel: &mut [f32; 3], alpha: f32, noisy: [f32; 3]) {
    if alpha == 0.0 && noisy == [0.0; 3] {
        *pixel = [0.0; 3];
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
    let filtered = code.run(scene, Rect::whole(scene))?;
    let filtering = start.elapsed();
    let kept = filtered.kept.clone();
    let image = image(scene, filtered)
        .with_attributes(scene.attributes())
        .with_alpha(scene.alpha().map(<[f32]>::to_vec));
    let Code { planning, compilation, .. } = code;
    Ok((image, Applied { kept, planning, compilation, filtering }))
}

/// Filters a scene and other pictures, as the file has them, by the weights of its colour. What
/// is said of stages is of those of the filter of the colour.
///
/// # Errors
/// If the scene lacks something, the filter cannot be planned, or the back end fails.
///
/// # Panics
/// If there are not as many pictures as the filter carries, or the scene was given others.
pub(super) fn apply_pictures(
    carrying: &Carrying,
    scene: &Scene,
    pictures: &[[Vec<f32>; 3]],
    backend: &dyn Backend,
    how: How<'_>,
) -> Result<(Vec<Image>, Applied), DenoiseError> {
    assert_eq!(pictures.len(), carrying.pictures.len(), "a picture for each that is carried");
    let checked = carrying.filter.check().expect("it was checked when it was made");
    scene.require(&checked.required())?;
    let code = Code::of_pictures(carrying, (scene.name(), &Facts::of(scene)), backend, how)?;
    let start = Instant::now();
    let filtered = code.run_pictures(scene, pictures, Rect::whole(scene))?;
    let filtering = start.elapsed();
    let kept = carrying.own.iter().map(|&k| filtered[0].kept[usize::from(k)]).collect();
    let images = filtered.into_iter().map(|filtered| {
        image(scene, filtered)
            .with_attributes(scene.attributes())
            .with_alpha(scene.alpha().map(<[f32]>::to_vec))
    });
    let images = images.collect();
    let Code { planning, compilation, .. } = code;
    Ok((images, Applied { kept, planning, compilation, filtering }))
}

fn image(scene: &Scene, Filtered { pixels, .. }: Filtered) -> Image {
    let rgb = [0, 1, 2].map(|channel| pixels.iter().map(|c| c[channel]).collect());
    let (width, height) = (scene.layout().width(), scene.layout().height());
    Image::new(scene.name(), width, height, rgb).expect("one colour per pixel of the scene")
}
