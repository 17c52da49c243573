//! How far results are from a filter's exact meaning, on a sample of rows.

use rayon::prelude::*;

use crate::backend::{Rect, SMALLEST_SUM, TRUSTED_SHARE, oracle};
use crate::plan::Stage;
use crate::scene::{Image, Scene};

/// Rows that are computed exactly: that takes a hundred times as long as filtering
/// them.
const ROWS: usize = 8;

/// The exact colours of some rows.
pub(super) struct Exact(Vec<(usize, Vec<oracle::Exact>)>);

impl Exact {
    /// Rows from all over the image.
    pub(super) fn of(scene: &Scene, stage: &Stage) -> Self {
        let (width, height) = (scene.layout().width(), scene.layout().height());
        let count = ROWS.min(height);
        let rows = (0..count).into_par_iter().map(|k| {
            let y = (2 * k + 1) * height / (2 * count);
            (y, oracle::filter(scene, stage, Rect { x: 0, y, width, height: 1 }))
        });
        Self(rows.collect())
    }

    /// The greatest relative difference of a colour, divided by its sums' condition
    /// where weights cancel. Pixels of which no back end promises anything are left
    /// out.
    pub(super) fn difference(&self, image: &Image) -> f64 {
        let rgb = image.rgb();
        let width = image.size().0;
        let mut worst = 0.0f64;
        for (y, row) in &self.0 {
            for (x, exact) in row.iter().enumerate() {
                let total = exact.total.abs();
                let share = total / exact.magnitude;
                if total < f64::from(SMALLEST_SUM) || share < f64::from(TRUSTED_SHARE) {
                    continue;
                }
                for (channel, color) in rgb.iter().zip(exact.color) {
                    let difference = (f64::from(channel[y * width + x]) - color).abs();
                    if difference.is_nan() {
                        return f64::INFINITY;
                    }
                    if color != 0.0 {
                        worst = worst.max(share * difference / color.abs());
                    }
                }
            }
        }
        worst
    }
}
