//! A filter's exact meaning, in f64: what every back end is held to.
//!
//! No plan, no pass and no tape is involved: the trees are evaluated by the
//! meanings of the operator table, so that an error in any of those shows.

use super::{Rect, color_at};
use crate::expr::feature::{Feature, PlaneId};
use crate::expr::tape::Side;
use crate::plan::{Stage, Window};
use crate::scene::Scene;

/// The exact colour of one pixel, with what is needed to judge a rounded one.
#[derive(Clone, Copy, Debug)]
pub struct Exact {
    /// Σ c·w / Σ w per channel.
    pub color: [f64; 3],
    /// The greatest |c| in the window, per channel.
    pub brightest: [f64; 3],
    /// Σ w.
    pub total: f64,
    /// Σ |w|.
    pub magnitude: f64,
}

/// Filters the pixels of a rectangle exactly.
///
/// # Panics
/// If the scene was loaded without a plane that the stage reads.
pub fn filter(scene: &Scene, stage: &Stage, rect: Rect) -> Vec<Exact> {
    let rows = rect.y..rect.y + rect.height;
    rows.flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| pixel(scene, stage, x, y)))
        .collect()
}

fn pixel(scene: &Scene, stage: &Stage, x: usize, y: usize) -> Exact {
    let mut sums = [0.0; 3];
    let mut brightest = [0.0f64; 3];
    let (mut total, mut magnitude) = (0.0, 0.0);
    for (u, v) in neighbours(scene, stage.window, x, y) {
        let weight = weight(scene, stage, (x, y), (u, v));
        for (c, &noisy) in color_at(scene, u, v).iter().enumerate() {
            sums[c] += f64::from(noisy) * weight;
            brightest[c] = brightest[c].max(f64::from(noisy).abs());
        }
        total += weight;
        magnitude += weight.abs();
    }
    Exact { color: sums.map(|sum| sum / total), brightest, total, magnitude }
}

/// The exact weight of pixel j for pixel i.
pub fn weight(scene: &Scene, stage: &Stage, i: (usize, usize), j: (usize, usize)) -> f64 {
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
        (Feature::Pixel, _) => y as f64,
        _ => f64::from(scene.plane(plane).expect("the plane is loaded").at(x, y)),
    }
}

fn neighbours(
    scene: &Scene,
    window: Window,
    x: usize,
    y: usize,
) -> impl Iterator<Item = (usize, usize)> {
    let along = move |at: usize, end: usize| {
        let taps = 0..window.diameter();
        taps.filter_map(move |k| {
            let shifted = (at + k * window.dilation as usize).checked_sub(window.reach() as usize);
            shifted.filter(|&p| p < end)
        })
    };
    let (width, height) = (scene.layout().width(), scene.layout().height());
    along(y, height).flat_map(move |v| along(x, width).map(move |u| (u, v)))
}
