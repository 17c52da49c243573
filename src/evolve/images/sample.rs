//! Some pixels of a training scene, and how far filtered ones are from the truth.

use super::TrainingScene;
use crate::backend::Rect;
use crate::image::metric::Measure;

/// Rectangles of a scene with their true colours, in the order that back ends
/// give pixels in.
pub(super) struct Sample {
    region: Vec<Rect>,
    truth: [Vec<f32>; 3],
}

impl Sample {
    pub(super) fn new(training: &TrainingScene, region: Vec<Rect>) -> Self {
        let (width, _) = training.reference().size();
        let mut truth: [Vec<f32>; 3] = Default::default();
        for rect in &region {
            for y in rect.y..rect.y + rect.height {
                let row = y * width + rect.x..y * width + rect.x + rect.width;
                for (truth, channel) in truth.iter_mut().zip(training.reference().rgb()) {
                    truth.extend_from_slice(&channel[row.clone()]);
                }
            }
        }
        Self { region, truth }
    }

    /// All pixels of a scene.
    pub(super) fn whole(training: &TrainingScene) -> Self {
        Self::new(training, vec![Rect::whole(training.scene())])
    }

    pub(super) fn region(&self) -> &[Rect] {
        &self.region
    }

    pub(super) fn pixels(&self) -> usize {
        self.truth[0].len()
    }

    /// Per pixel, how far it is from the truth.
    pub(super) fn errors(&self, pixels: &[[f32; 3]], measure: Measure) -> Vec<f64> {
        let image = [0, 1, 2].map(|c| pixels.iter().map(|p| p[c]).collect::<Vec<f32>>());
        let [image, truth] = [&image, &self.truth].map(|rgb| rgb.each_ref().map(Vec::as_slice));
        measure.of_pixels(image, truth)
    }

    /// The mean of each rectangle's errors.
    pub(super) fn means(&self, errors: &[f64]) -> Vec<f64> {
        let mut rest = errors;
        let mean = |rect: &Rect| {
            let (own, others) = rest.split_at(rect.pixels());
            rest = others;
            mean(own)
        };
        self.region.iter().map(mean).collect()
    }

    /// The errors of a part of one of the rectangles, in its own order.
    ///
    /// # Panics
    /// If it is part of none.
    pub(super) fn within(&self, part: Rect, errors: &[f64]) -> Vec<f64> {
        let mut rest = errors;
        for rect in &self.region {
            let (own, others) = rest.split_at(rect.pixels());
            rest = others;
            let (x, y) = (part.x.wrapping_sub(rect.x), part.y.wrapping_sub(rect.y));
            if x < rect.width && y < rect.height {
                let row = |y| &own[y * rect.width + x..][..part.width];
                return (y..y + part.height).flat_map(row).copied().collect();
            }
        }
        panic!("{part:?} is part of no rectangle of the sample")
    }
}

/// The mean, summed in the order of the values.
pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
