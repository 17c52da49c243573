//! How far results are from a filter's exact meaning, on a sample of rows.

use rayon::prelude::*;

use crate::backend::Rect;
use crate::backend::reference::oracle;
use crate::filter::Gather;
use crate::image::Image;
use crate::scene::Scene;

/// Rows that are computed exactly: that takes a hundred times as long as filtering
/// them.
const ROWS: usize = 8;

/// The exact colours of some rows.
pub(super) struct ExactImages(Vec<(usize, Vec<oracle::ExactGather>)>);

impl ExactImages {
    /// Rows from all over the image.
    pub(super) fn of(scene: &Scene, stage: &Gather) -> Self {
        let (width, height) = (scene.layout().width(), scene.layout().height());
        let count = ROWS.min(height);
        let rows = (0..count).into_par_iter().map(|k| {
            let y = (2 * k + 1) * height / (2 * count);
            (y, oracle::filter(scene, stage, Rect { x: 0, y, width, height: 1 }))
        });
        Self(rows.collect())
    }

    /// The greatest difference of a colour among the pixels of which back ends promise
    /// anything.
    pub(super) fn difference(&self, image: &Image) -> f64 {
        let rgb = image.rgb();
        let width = image.size().0;
        let rows = self.0.iter();
        let pixels = rows.flat_map(|(y, row)| row.iter().enumerate().map(move |(x, e)| (x, y, e)));
        pixels
            .filter(|(.., exact)| exact.is_promised())
            .map(|(x, y, exact)| exact.difference(rgb.map(|channel| channel[y * width + x])))
            .fold(0.0, f64::max)
    }
}
