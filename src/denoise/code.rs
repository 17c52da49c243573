//! Filters as code, and scenes in memory.

use std::time::{Duration, Instant};

use super::DenoiseError;
use crate::backend::{Backend, Executable, Filtered, Rect, UNWATCHED, Watch};
use crate::filter::{Carrying, Filter};
use crate::image::Image;
use crate::plan::{Passes, Plan, PlanError};
use crate::scene::{Facts, Scene};

/// A filter, planned and compiled for scenes of which some facts hold.
pub struct Code {
    /// What the filter is called.
    filter: String,
    plan: Plan,
    code: Box<dyn Executable>,
    /// How long planning took.
    pub planning: Duration,
    /// How long compilation took.
    pub compilation: Duration,
}

/// How code is run.
#[derive(Clone, Copy)]
pub struct Run<'w> {
    /// How much of the result is taken, between 0 and 1; the rest is the noisy colour.
    pub strength: f32,
    /// Who is told how many more rows are done.
    pub watch: &'w Watch<'w>,
}

/// All of the result, and nobody looks.
impl Default for Run<'_> {
    fn default() -> Self {
        Self { strength: 1.0, watch: UNWATCHED }
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

impl Code {
    /// Plans and compiles a filter. `scene` is what errors call what it is made for.
    ///
    /// # Errors
    /// If it cannot be planned, or the back end fails.
    pub fn new(
        filter: &Filter,
        (scene, facts): (&str, &Facts),
        backend: &dyn Backend,
        passes: Passes,
    ) -> Result<Self, DenoiseError> {
        let checked = filter.check().expect("only filters that make sense get here");
        Self::planned(&filter.name, scene, backend, || Plan::of(&checked, facts, passes))
    }

    /// The same of a filter of several pictures.
    ///
    /// # Errors
    /// If it cannot be planned, or the back end fails.
    pub fn of_pictures(
        carrying: &Carrying,
        (scene, facts): (&str, &Facts),
        backend: &dyn Backend,
        passes: Passes,
    ) -> Result<Self, DenoiseError> {
        let plan = || Plan::of_pictures(carrying, facts, passes);
        Self::planned(&carrying.filter.name, scene, backend, plan)
    }

    fn planned(
        filter: &str,
        scene: &str,
        backend: &dyn Backend,
        plan: impl FnOnce() -> Result<Plan, PlanError>,
    ) -> Result<Self, DenoiseError> {
        let (scene, filter) = (scene.to_owned(), filter.to_owned());
        let start = Instant::now();
        let plan = match plan() {
            Ok(plan) => plan,
            Err(source) => return Err(DenoiseError::Plan { scene, filter, source }),
        };
        let planning = start.elapsed();
        let start = Instant::now();
        match backend.compile(&plan) {
            Ok(code) => Ok(Self { filter, plan, code, planning, compilation: start.elapsed() }),
            Err(source) => Err(DenoiseError::Run { scene, filter, source }),
        }
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Filters a rectangle of a scene.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn run(&self, scene: &Scene, rect: Rect, run: Run<'_>) -> Result<Filtered, DenoiseError> {
        let filtered = self.run_pictures(scene, &[], rect, run)?;
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
        Run { strength, watch }: Run<'_>,
    ) -> Result<Vec<Filtered>, DenoiseError> {
        let filtered = self.code.run_watched(scene, &[rect], watch);
        let filtered = filtered.map_err(|source| DenoiseError::Run {
            scene: scene.name().to_owned(),
            filter: self.filter.clone(),
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
                if strength < 1.0 {
                    for (channel, noisy) in pixel.iter_mut().zip(noisy(k, x, y)) {
                        *channel = noisy + strength * (*channel - noisy);
                    }
                }
            }
            filtered
        };
        // Whole images need no other look at all of their pixels.
        if scene.alpha().is_none() && strength >= 1.0 {
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
    passes: Passes,
    run: Run<'_>,
) -> Result<(Image, Applied), DenoiseError> {
    let checked = filter.check().expect("only filters that make sense get here");
    scene.require(&checked.required())?;
    let code = Code::new(filter, (scene.name(), &Facts::of(scene)), backend, passes)?;
    let start = Instant::now();
    let filtered = code.run(scene, Rect::whole(scene), run)?;
    let applied = Applied {
        kept: filtered.kept.clone(),
        planning: code.planning,
        compilation: code.compilation,
        filtering: start.elapsed(),
    };
    Ok((image(scene, filtered), applied))
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
    passes: Passes,
    run: Run<'_>,
) -> Result<(Vec<Image>, Applied), DenoiseError> {
    assert_eq!(pictures.len(), carrying.pictures.len(), "a picture for each that is carried");
    let checked = carrying.filter.check().expect("it was checked when it was made");
    scene.require(&checked.required())?;
    let code = Code::of_pictures(carrying, (scene.name(), &Facts::of(scene)), backend, passes)?;
    let start = Instant::now();
    let filtered = code.run_pictures(scene, pictures, Rect::whole(scene), run)?;
    let applied = Applied {
        kept: carrying.own.iter().map(|&k| filtered[0].kept[usize::from(k)]).collect(),
        planning: code.planning,
        compilation: code.compilation,
        filtering: start.elapsed(),
    };
    Ok((filtered.into_iter().map(|filtered| image(scene, filtered)).collect(), applied))
}

/// Filtered pixels with what the file says beside them.
pub(super) fn image(scene: &Scene, Filtered { pixels, .. }: Filtered) -> Image {
    let rgb = [0, 1, 2].map(|channel| pixels.iter().map(|c| c[channel]).collect());
    let (width, height) = (scene.layout().width(), scene.layout().height());
    Image::new(scene.name(), width, height, rgb)
        .expect("one colour per pixel of the scene")
        .with_attributes(scene.attributes())
        .with_alpha(scene.alpha().map(<[f32]>::to_vec))
}
