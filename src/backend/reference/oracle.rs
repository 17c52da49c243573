//! A filter's exact meaning, in f64: what every back end is held to.
//!
//! No plan, no pass and no tape is involved: the trees are evaluated by the
//! meanings of the operator table, so that an error in any of those shows.

use rayon::prelude::*;

use crate::backend::{Rect, SMALLEST_SUM, TRUSTED_SHARE, TRUSTED_SUM, color_at};
use crate::expr::feature::{Feature, PlaneId};
use crate::expr::tape::Side;
use crate::filter::{Gather, Window};
use crate::scene::Scene;

/// The exact colour of one pixel, with what is needed to judge a rounded one.
#[derive(Clone, Copy, Debug)]
pub struct ExactGather {
    /// Σ c·w / Σ w per channel.
    pub color: [f64; 3],
    /// The greatest |c| in the window, per channel.
    pub brightest: [f64; 3],
    /// Σ w.
    pub total: f64,
    /// Σ |w|.
    pub magnitude: f64,
}

/// What the guard of a weighted mean decides by.
#[derive(Clone, Copy, Debug)]
pub struct Sums {
    /// Σ w.
    pub total: f64,
    /// Σ |w|.
    pub magnitude: f64,
    /// The greatest magnitude of the sums.
    pub greatest: f64,
    /// What none of their parts can exceed.
    pub bound: f64,
}

impl Sums {
    /// Whether the mean is used, as far as weights tell.
    pub fn is_trusted(&self) -> bool {
        let total = self.total.abs();
        total >= f64::from(TRUSTED_SUM) && total >= f64::from(TRUSTED_SHARE) * self.magnitude
    }

    /// Whether back ends promise anything of this mean, unless it [may
    /// overflow](Self::may_overflow): its weights do not all but vanish, nor cancel so far
    /// that rounding decides whether the guard acts.
    pub fn is_promised(&self) -> bool {
        let total = self.total.abs();
        let share = 2.0 * f64::from(TRUSTED_SHARE);
        total >= f64::from(SMALLEST_SUM) && total >= share * self.magnitude
    }

    /// Whether a sum may be too large for `f32`, so that the guard may act.
    pub fn may_overflow(&self) -> bool {
        self.bound > f64::from(f32::MAX)
    }

    /// Whether a sum is too large for `f32`.
    pub fn overflows(&self) -> bool {
        self.greatest > f64::from(f32::MAX)
    }
}

/// The exact colour of one pixel, and by what a computed one is judged.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// Linear R, G, B in the units of the file.
    pub color: [f64; 3],
    /// How many times as large errors may be.
    pub condition: f64,
    /// Darker channels are measured by this.
    pub least: [f64; 3],
    /// Whether back ends promise anything of it.
    pub promised: bool,
}

impl Pixel {
    /// How far a computed colour is from this one: the greatest relative difference of a
    /// channel, divided by the condition; NaN is infinitely far off. This is what
    /// [`ACCURACY`](crate::backend::ACCURACY) bounds.
    pub fn difference(&self, computed: [f32; 3]) -> f64 {
        let channels = computed.iter().zip(self.color).zip(self.least);
        let differences = channels.map(|((&computed, color), least)| {
            let scale = color.abs().max(least);
            let difference = (f64::from(computed) - color).abs() / (self.condition * scale);
            if difference.is_nan() { f64::INFINITY } else { difference }
        });
        differences.fold(0.0, f64::max)
    }
}

/// Darker colours are measured by this: the products that make them are subnormal.
pub const DARKEST: f64 = 1e-30;

impl ExactGather {
    /// What the guard decides by.
    pub fn sums(&self) -> Sums {
        let Self { total, magnitude, .. } = *self;
        let greatest =
            self.color.map(|c| (c * total).abs()).into_iter().fold(total.abs(), f64::max);
        let brightest = self.brightest.into_iter().fold(1.0, f64::max);
        Sums { total, magnitude, greatest, bound: magnitude * brightest }
    }

    /// Whether back ends promise anything of this pixel: see [`Sums::is_promised`].
    pub fn is_promised(&self) -> bool {
        self.sums().is_promised()
    }

    /// The colour with what a computed one is judged by: the condition is the sums'. A
    /// colour that cancelled away is measured by what was cancelled.
    pub fn pixel(&self) -> Pixel {
        let condition = self.magnitude / self.total.abs();
        let sums = self.sums();
        Pixel {
            color: self.color,
            condition,
            least: self.brightest.map(|c| (c * (condition - 1.0)).max(DARKEST)),
            promised: sums.is_promised() && !sums.may_overflow(),
        }
    }

    /// How far a computed colour is from this one: see [`Pixel::difference`].
    pub fn difference(&self, computed: [f32; 3]) -> f64 {
        self.pixel().difference(computed)
    }
}

/// How far the filtered pixels of a rectangle, row by row, are from exact: the greatest
/// [difference](ExactGather::difference) of those of which back ends promise anything.
///
/// # Panics
/// If the scene was loaded without a plane that the stage reads.
pub fn difference(scene: &Scene, stage: &Gather, rect: Rect, computed: &[[f32; 3]]) -> f64 {
    let rows = computed.par_chunks(rect.width).enumerate().map(|(y, row)| {
        let exact = filter(scene, stage, Rect { y: rect.y + y, height: 1, ..rect });
        let promised = row.iter().zip(&exact).filter(|(_, exact)| exact.is_promised());
        promised.map(|(&computed, exact)| exact.difference(computed)).fold(0.0, f64::max)
    });
    rows.reduce(|| 0.0, f64::max)
}

/// Filters the pixels of a rectangle exactly.
///
/// # Panics
/// If the scene was loaded without a plane that the stage reads.
pub fn filter(scene: &Scene, stage: &Gather, rect: Rect) -> Vec<ExactGather> {
    let rows = rect.y..rect.y + rect.height;
    rows.flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| pixel(scene, stage, x, y)))
        .collect()
}

fn pixel(scene: &Scene, stage: &Gather, x: usize, y: usize) -> ExactGather {
    let mut sums = [0.0; 3];
    let mut brightest = [0.0f64; 3];
    let (mut total, mut magnitude) = (0.0, 0.0);
    let size = [scene.layout().width(), scene.layout().height()];
    for [u, v] in neighbours(size, stage.window, [x, y]) {
        let weight = weight(scene, stage, (x, y), (u, v));
        for (c, &noisy) in color_at(scene, u, v).iter().enumerate() {
            sums[c] += f64::from(noisy) * weight;
            brightest[c] = brightest[c].max(f64::from(noisy).abs());
        }
        total += weight;
        magnitude += weight.abs();
    }
    ExactGather { color: sums.map(|sum| sum / total), brightest, total, magnitude }
}

/// The exact weight of pixel j for pixel i.
pub fn weight(scene: &Scene, stage: &Gather, i: (usize, usize), j: (usize, usize)) -> f64 {
    stage.weight.meaning(|plane, side| {
        let (x, y) = match side {
            Side::I => i,
            Side::J => j,
        };
        feature(scene, plane, x, y)
    })
}

fn feature(scene: &Scene, plane: PlaneId, x: usize, y: usize) -> f64 {
    match (plane.feature, plane.component) {
        (Feature::Pixel, 0) => x as f64,
        (Feature::Pixel, _) => (scene.top() + y) as f64,
        _ => f64::from(scene.plane(plane).expect("the plane is loaded").at(x, y)),
    }
}

pub(super) fn neighbours(
    [width, height]: [usize; 2],
    window: Window,
    [x, y]: [usize; 2],
) -> impl Iterator<Item = [usize; 2]> {
    let along = move |at: usize, end: usize| {
        let taps = 0..window.diameter();
        taps.filter_map(move |k| {
            let shifted = (at + k * window.dilation as usize).checked_sub(window.reach() as usize);
            shifted.filter(|&p| p < end)
        })
    };
    along(y, height).flat_map(move |v| along(x, width).map(move |u| [u, v]))
}
