//! How far an expression's filtered training scenes are from its exact meaning.
//!
//! What is ill-conditioned (a division by something that comes near zero, say) shows
//! in a few pixels of a few scenes, and in windows of any size: taps far away weigh
//! little, and many of them average errors away. So all pixels are looked at, in
//! small windows.

use super::{ImageFitness, JudgeError};
use crate::backend::reference::oracle;
use crate::backend::{ACCURACY, Rect};
use crate::expr::Tree;
use crate::filter::{Gather, Window};
use crate::plan::Plan;

/// Half of what back ends promise: of all scenes, training scenes hold few pixels.
/// Bred expressions have 1e-6 where nothing is amiss.
pub(super) const TOLERANCE: f64 = ACCURACY / 2.0;

/// The window's radius: 25 taps, exactly computed for 0.4 million pixels, take seconds.
const RADIUS: u32 = 2;

/// Pixels of a band, about: computed exactly in less than a second.
const BAND: usize = 1 << 14;

/// A rectangle in bands of rows. Between two of them the back end may say that somebody asked
/// to stop.
fn bands(whole: Rect) -> impl Iterator<Item = Rect> {
    let height = (BAND / whole.width.max(1)).max(1);
    (0..whole.height).step_by(height).map(move |y| Rect {
        y: whole.y + y,
        height: height.min(whole.height - y),
        ..whole
    })
}

impl ImageFitness<'_> {
    /// The greatest difference from exact of a pixel of which back ends promise
    /// anything, of all scenes.
    pub(super) fn greatest_difference(&self, tree: &Tree) -> Result<f64, JudgeError> {
        let batching = &self.batching;
        let window = Window { radius: batching.window.radius.min(RADIUS), ..batching.window };
        let trees = std::slice::from_ref(tree);
        let plan = Plan::new(trees, window, &batching.facts, batching.passes)?;
        let failed = |source| self.failed(source);
        let code = batching.backend.compile(&plan).map_err(failed)?;
        let stage = Gather::of_color(tree.clone(), window);
        let mut greatest = 0.0f64;
        for training in &self.scenes {
            let scene = &training.scene;
            for band in bands(Rect::whole(scene)) {
                let filtered = code.run(scene, &[band]).map_err(failed)?.swap_remove(0);
                greatest = greatest.max(oracle::difference(scene, &stage, band, &filtered.pixels));
            }
        }
        Ok(greatest)
    }
}
