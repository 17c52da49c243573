//! What must not matter: exposure, the world's unit and place, the image's orientation.

use rayon::prelude::*;
use serde::Serialize;

use super::peak::change;
use super::sensitivity::stored;
use super::trial::Trial;
use super::{Peak, StressError};
use crate::backend::reference::oracle::Pixel;
use crate::backend::{ACCURACY, Backend};
use crate::expr::builder::LIMIT;
use crate::expr::feature::Unit;
use crate::expr::{Feature, PlaneId, Quantity};
use crate::filter::Grid;
use crate::scene::RawScene;
use crate::scene::normalize::{geometry, hits};

/// How close two results must be that mean the same.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tolerance {
    /// Equal in all bits.
    Bits,
    /// As with noise in the last place of positions and depths: those of another
    /// world are rounded anew.
    Rounding,
    /// Within twice what back ends promise, where weights cancel by the sums' condition
    /// more, as the sums run in another order.
    Order,
}

impl Tolerance {
    /// The greatest difference that this allows; none where that is the matter of
    /// sensitivity to noise.
    pub fn bound(self) -> Option<f64> {
        match self {
            Self::Bits => Some(0.0),
            Self::Rounding => None,
            Self::Order => Some(2.0 * ACCURACY),
        }
    }
}

/// What a change did that should do nothing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Invariance {
    /// The scene's name.
    pub scene: String,
    /// What was changed.
    pub change: &'static str,
    /// How close the results must be.
    pub tolerance: Tolerance,
    /// The greatest relative difference of a pixel, of those of which back ends promise
    /// anything.
    pub greatest: Peak,
}

/// A change of a scene.
struct Row {
    name: &'static str,
    /// Whether only filters notice that look at positions or depths.
    world: bool,
    tolerance: Tolerance,
    apply: fn(&RawScene) -> RawScene,
    /// What it multiplies colours by.
    factor: f32,
    /// Where a pixel goes, given the size before.
    moved: fn([usize; 2], [usize; 2]) -> [usize; 2],
}

/// A change of samples alone.
const fn samples(
    name: &'static str,
    world: bool,
    tolerance: Tolerance,
    apply: fn(&RawScene) -> RawScene,
    factor: f32,
) -> Row {
    Row { name, world, tolerance, apply, factor, moved: |at, _| at }
}

/// A change of the order of pixels.
const fn order(
    name: &'static str,
    apply: fn(&RawScene) -> RawScene,
    moved: fn([usize; 2], [usize; 2]) -> [usize; 2],
) -> Row {
    Row { name, world: false, tolerance: Tolerance::Order, apply, factor: 1.0, moved }
}

const STOPS: f32 = (1 << 20) as f32;

const TABLE: [Row; 9] = [
    samples("exposure times 2^20", false, Tolerance::Bits, |raw| exposed(raw, STOPS), STOPS),
    samples(
        "exposure times 2^-20",
        false,
        Tolerance::Bits,
        |raw| exposed(raw, STOPS.recip()),
        1.0 / STOPS,
    ),
    samples("world times 2^10", true, Tolerance::Bits, |raw| scaled(raw, 1024.0), 1.0),
    samples("world times 2^-10", true, Tolerance::Bits, |raw| scaled(raw, 1.0 / 1024.0), 1.0),
    // Feet instead of metres.
    samples("world times 3.28", true, Tolerance::Rounding, |raw| scaled(raw, 3.280_84), 1.0),
    samples("world moved by its extent", true, Tolerance::Rounding, moved, 1.0),
    order("flipped left to right", |raw| reordered(raw, FLIP_X), FLIP_X),
    order("flipped top to bottom", |raw| reordered(raw, FLIP_Y), FLIP_Y),
    order("transposed", |raw| reordered(raw, TRANSPOSE), TRANSPOSE),
];

const FLIP_X: fn([usize; 2], [usize; 2]) -> [usize; 2] = |[x, y], [width, _]| [width - 1 - x, y];
const FLIP_Y: fn([usize; 2], [usize; 2]) -> [usize; 2] = |[x, y], [_, height]| [x, height - 1 - y];
const TRANSPOSE: fn([usize; 2], [usize; 2]) -> [usize; 2] = |[x, y], _| [y, x];

/// Makes each change in turn.
pub(super) fn measure(
    trial: &Trial<'_>,
    backend: &dyn Backend,
) -> Result<Vec<Invariance>, StressError> {
    let needs = trial.checked().needs();
    let world = |p: &PlaneId| matches!(p.feature.row().unit, Unit::Place | Unit::Length);
    let world = needs.named().into_iter().flatten().any(world);
    let size = [trial.scene.layout().width(), trial.scene.layout().height()];
    // Pixels of half the resolution are pairs, of which an odd number begins at one end of a
    // row: which pixels are a pair hangs on where the row begins.
    let pairs = trial.filter.stages.iter().any(|stage| stage.grid == Grid::Half);
    let paired = |row: &Row| {
        let [x, y] = (row.moved)([0, 0], size);
        !pairs || x % 2 == usize::from(x > 0) && y % 2 == usize::from(y > 0)
    };
    let rows = TABLE.iter().filter(|row| (world || !row.world) && paired(row));
    let rows: Vec<&Row> = rows.collect();
    let stored = stored(&trial.checked(), &trial.ground.raw);
    let measure = |row: &&Row| {
        let changed = (row.apply)(&trial.ground.raw);
        // What leaves the range that filters compute in is no number to them, and says nothing.
        let leaves = |key: &(Feature, Quantity)| {
            changed.features[key].iter().flatten().any(|x| x.abs() > LIMIT)
        };
        if stored.iter().any(leaves) {
            return Ok(None);
        }
        let width = changed.width;
        let filtered = trial.with(changed, backend)?;
        let difference = |k: usize| {
            let [x, y] = (row.moved)([k % size[0], k / size[0]], size);
            let after = filtered[y * width + x];
            let before = trial.filtered[k].map(|c| c * row.factor);
            match row.tolerance {
                Tolerance::Bits | Tolerance::Rounding => {
                    change(before, after, trial.meaning.darkest)
                }
                Tolerance::Order => {
                    let color = before.map(f64::from);
                    Pixel { color, ..trial.meaning.pixels[k] }.difference(after)
                }
            }
        };
        Ok(Some(Invariance {
            scene: trial.scene.name().to_owned(),
            change: row.name,
            tolerance: row.tolerance,
            greatest: Peak::of(trial.promised().map(|k| (k, difference(k))), size[0]),
        }))
    };
    rows.par_iter().filter_map(|row| measure(row).transpose()).collect()
}

/// The scene with quantities of some units multiplied, variances by the square.
fn multiplied(raw: &RawScene, factor: f32, applies: fn(Unit) -> bool) -> RawScene {
    let mut raw = raw.clone();
    for ((feature, quantity), components) in &mut raw.features {
        if !applies(feature.row().unit) {
            continue;
        }
        for x in components.iter_mut().flatten() {
            *x *= factor;
            if *quantity == Quantity::Variance {
                *x *= factor;
            }
        }
    }
    raw
}

fn exposed(raw: &RawScene, factor: f32) -> RawScene {
    multiplied(raw, factor, |unit| unit == Unit::Light)
}

fn scaled(raw: &RawScene, factor: f32) -> RawScene {
    multiplied(raw, factor, |unit| matches!(unit, Unit::Place | Unit::Length))
}

/// The scene moved by its own extent. Pixels that hit nothing have no position that
/// could move.
fn moved(raw: &RawScene) -> RawScene {
    let mut moved = raw.clone();
    let value = |feature| raw.features.get(&(feature, Quantity::Value));
    let Some(position) = value(Feature::WorldPosition) else { return moved };
    let seen = |planes: &&Vec<Vec<f32>>| planes.iter().flatten().any(|&x| x != 0.0);
    let evidence = value(Feature::Depth).or(value(Feature::Normal)).filter(seen);
    let hit = hits(evidence.unwrap_or(position));
    let (_, extent) = geometry(position, &hit);
    let components = moved.features.get_mut(&(Feature::WorldPosition, Quantity::Value));
    for (component, step) in components.into_iter().flatten().zip([1.0, -1.0, 1.0]) {
        for (x, _) in component.iter_mut().zip(&hit).filter(|(_, hit)| **hit) {
            *x += step * extent;
        }
    }
    moved
}

/// The scene with its pixels in other places.
fn reordered(raw: &RawScene, moved: fn([usize; 2], [usize; 2]) -> [usize; 2]) -> RawScene {
    let mut other = raw.clone();
    let size = [raw.width, raw.height];
    let [x, y] = moved([raw.width - 1, 0], size);
    let [u, v] = moved([0, raw.height - 1], size);
    (other.width, other.height) = (x.max(u) + 1, y.max(v) + 1);
    let width = other.width;
    for (component, original) in
        other.features.values_mut().flatten().zip(raw.features.values().flatten())
    {
        for (k, &sample) in original.iter().enumerate() {
            let [x, y] = moved([k % raw.width, k / raw.width], size);
            component[y * width + x] = sample;
        }
    }
    other
}
