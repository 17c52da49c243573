//! A filter on one scene: what it should give, and what it does give.

use super::{Ground, StressError};
use crate::backend::reference::meaning::{self, Meaning};
use crate::backend::{Backend, Rect};
use crate::filter::{Checked, Filter};
use crate::plan::{Passes, Plan, Precision};
use crate::scene::{Facts, LoadOptions, RawScene, Scene};

/// The filter on one scene, with what every measurement starts from.
pub(super) struct Trial<'a> {
    pub(super) ground: &'a Ground,
    /// The filter, if it is one of the paper's with the window for this scene.
    pub(super) filter: Filter,
    pub(super) scene: Scene,
    pub(super) meaning: Meaning,
    /// The computed colours, row by row.
    pub(super) filtered: Vec<[f32; 3]>,
}

impl<'a> Trial<'a> {
    pub(super) fn new(
        ground: &'a Ground,
        checked: &Checked<'_>,
        backend: &dyn Backend,
    ) -> Result<Self, StressError> {
        let mut whole = checked.filter().clone();
        // The windows of a program hang together.
        if whole.paper().is_some() {
            whole.gathers_mut().for_each(|gather| {
                gather.window.radius = ground.radius.min(gather.window.radius);
            });
        }
        let checked = self::checked(&whole);
        let scene = prepare(ground.raw.clone(), &checked)?;
        let meaning = meaning::of(&scene, &checked);
        let filtered = filter(&scene, &checked, backend)?;
        Ok(Self { ground, filter: whole, scene, meaning, filtered })
    }

    pub(super) fn checked(&self) -> Checked<'_> {
        checked(&self.filter)
    }

    /// The pixels of which back ends promise anything, as places row by row.
    pub(super) fn promised(&self) -> impl Iterator<Item = usize> {
        let pixels = self.meaning.pixels.iter().enumerate();
        pixels.filter(|(_, pixel)| pixel.promised).map(|(k, _)| k)
    }

    /// The filtered colours of the same scene with other features.
    pub(super) fn with(
        &self,
        raw: RawScene,
        backend: &dyn Backend,
    ) -> Result<Vec<[f32; 3]>, StressError> {
        let checked = self.checked();
        filter(&prepare(raw, &checked)?, &checked, backend)
    }
}

/// A smaller window makes no less sense.
fn checked(filter: &Filter) -> Checked<'_> {
    filter.check().expect("it was checked with a window as large or larger")
}

/// The scene that a filter works on, with all that it cannot do without.
pub(super) fn prepare(raw: RawScene, checked: &Checked<'_>) -> Result<Scene, StressError> {
    let scene = raw.prepare(&checked.needs(), checked.reach(), &LoadOptions::default())?;
    scene.require(&checked.required())?;
    Ok(scene)
}

/// The computed colours of a whole scene, row by row, at standard precision.
pub(super) fn filter(
    scene: &Scene,
    checked: &Checked<'_>,
    backend: &dyn Backend,
) -> Result<Vec<[f32; 3]>, StressError> {
    filter_at(Precision::Standard, scene, checked, backend)
}

/// The computed colours of a whole scene, row by row.
pub(super) fn filter_at(
    precision: Precision,
    scene: &Scene,
    checked: &Checked<'_>,
    backend: &dyn Backend,
) -> Result<Vec<[f32; 3]>, StressError> {
    let name = || scene.name().to_owned();
    let passes = Passes { precision, ..Passes::ALL };
    let schedule = Plan::of(checked, &Facts::of(scene), passes)
        .map_err(|source| StressError::Plan { scene: name(), source })?;
    let filtered = backend.compile(&schedule);
    let filtered = filtered.and_then(|code| code.run(scene, &[Rect::whole(scene)]));
    let filtered = filtered.map_err(|source| StressError::Run { scene: name(), source })?;
    Ok(filtered.into_iter().next().expect("one result for one filter").pixels)
}
