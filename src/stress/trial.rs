//! A filter on one scene: what it should give, and what it does give.

use rayon::prelude::*;

use super::{Ground, StressError, needs};
use crate::backend::reference::oracle::{self, Exact};
use crate::backend::{Backend, Rect};
use crate::filter::{Gather, Window};
use crate::plan::{Passes, Plan, Precision};
use crate::scene::{Facts, LoadOptions, RawScene, Scene};

/// The filter on one scene, with what every measurement starts from.
pub(super) struct Trial<'a> {
    pub(super) ground: &'a Ground,
    /// The filter with the window for this scene.
    pub(super) stage: Gather,
    pub(super) scene: Scene,
    /// The exact colours, row by row.
    pub(super) exact: Vec<Exact>,
    /// The computed ones.
    pub(super) filtered: Vec<[f32; 3]>,
}

impl<'a> Trial<'a> {
    pub(super) fn new(
        ground: &'a Ground,
        stage: &Gather,
        backend: &dyn Backend,
    ) -> Result<Self, StressError> {
        let window = Window { radius: ground.radius.min(stage.window.radius), ..stage.window };
        let stage = Gather { window, ..stage.clone() };
        let scene = prepare(ground.raw.clone(), &stage)?;
        let exact = exact(&scene, &stage);
        let filtered = filter(&scene, &stage, backend)?;
        Ok(Self { ground, stage, scene, exact, filtered })
    }

    /// The pixels of which back ends promise anything, as places row by row.
    pub(super) fn promised(&self) -> impl Iterator<Item = usize> {
        let pixels = self.exact.iter().enumerate();
        pixels.filter(|(_, exact)| exact.is_promised() && !overflows(exact)).map(|(k, _)| k)
    }

    /// The filtered colours of the same scene with other features.
    pub(super) fn with(
        &self,
        raw: RawScene,
        backend: &dyn Backend,
    ) -> Result<Vec<[f32; 3]>, StressError> {
        filter(&prepare(raw, &self.stage)?, &self.stage, backend)
    }
}

/// Whether a sum may be too large for `f32`, so that the guard may act.
pub(super) fn overflows(exact: &Exact) -> bool {
    let greatest = exact.brightest.into_iter().fold(1.0, f64::max);
    exact.magnitude * greatest > f64::from(f32::MAX)
}

/// The scene that a stage works on, with all that it reads.
pub(super) fn prepare(raw: RawScene, stage: &Gather) -> Result<Scene, StressError> {
    let needs = needs(stage);
    let scene = raw.prepare(&needs, stage.window.reach() as usize, &LoadOptions::default())?;
    scene.require(&needs)?;
    Ok(scene)
}

/// The exact colours of a whole scene, row by row.
pub(super) fn exact(scene: &Scene, stage: &Gather) -> Vec<Exact> {
    let (width, height) = (scene.layout().width(), scene.layout().height());
    let row = |y| oracle::filter(scene, stage, Rect { x: 0, y, width, height: 1 });
    (0..height).into_par_iter().flat_map_iter(row).collect()
}

/// The computed colours of a whole scene, row by row, at standard precision.
pub(super) fn filter(
    scene: &Scene,
    stage: &Gather,
    backend: &dyn Backend,
) -> Result<Vec<[f32; 3]>, StressError> {
    filter_at(Precision::Standard, scene, stage, backend)
}

/// The computed colours of a whole scene, row by row.
pub(super) fn filter_at(
    precision: Precision,
    scene: &Scene,
    stage: &Gather,
    backend: &dyn Backend,
) -> Result<Vec<[f32; 3]>, StressError> {
    let name = || scene.name().to_owned();
    let weights = std::slice::from_ref(&stage.weight);
    let plan =
        Plan::new(weights, stage.window, &Facts::of(scene), Passes { precision, ..Passes::ALL })
            .map_err(|source| StressError::Plan { scene: name(), source })?;
    let filtered = backend.compile(&plan).and_then(|code| code.run(scene, &[Rect::whole(scene)]));
    let filtered = filtered.map_err(|source| StressError::Run { scene: name(), source })?;
    Ok(filtered.into_iter().next().expect("one result for one weight").pixels)
}
