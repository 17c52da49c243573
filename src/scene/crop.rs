//! Parts of scenes, turned: what constants are tuned on.

use std::collections::BTreeMap;

use super::Scene;
use super::derive::grain;
use super::facts::{Fact, Facts};
use super::plane::{Edge, Layout, Plane, Samples};
use super::prepare::{MOST_SAMPLES, estimated_variance};
use crate::expr::feature::{Feature, PlaneId, Quantity};

/// A part of an image, and how it is turned.
///
/// What a filter reads has no handedness: gradients are magnitudes, and normals and positions
/// are those of the world, wherever the image's axes point. So every turn of an image is an
/// image that a renderer could have made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// The part's leftmost column and topmost row.
    pub corner: [usize; 2],
    /// Its columns and rows, before it is turned.
    pub size: [usize; 2],
    /// Whether left and right, and top and bottom, change places.
    pub flipped: [bool; 2],
    /// Whether columns and rows change places, after that.
    pub transposed: bool,
}

impl Crop {
    /// Columns and rows of the result.
    pub fn turned(&self) -> [usize; 2] {
        let [width, height] = self.size;
        if self.transposed { [height, width] } else { [width, height] }
    }

    /// The pixels of an image of so many columns that the result consists of, row by row.
    pub fn pixels(&self, columns: usize) -> impl Iterator<Item = usize> {
        let Self { corner, size, flipped, transposed } = *self;
        let [width, height] = self.turned();
        (0..height).flat_map(move |v| (0..width).map(move |u| [u, v])).map(move |[u, v]| {
            let at = if transposed { [v, u] } else { [u, v] };
            let along = |axis: usize| match flipped[axis] {
                true => size[axis] - 1 - at[axis],
                false => at[axis],
            };
            (corner[1] + along(1)) * columns + corner[0] + along(0)
        })
    }
}

impl Scene {
    /// A part of the scene as a scene of its own, with what is known of the whole, and with
    /// its scales. `gain` multiplies light: the colour and the direct light as weights see
    /// them, and their variances by its square.
    ///
    /// # Panics
    /// If the part does not lie in the image.
    pub fn crop(&self, crop: &Crop, gain: f32) -> Self {
        let [right, bottom] = [0, 1].map(|axis| crop.corner[axis] + crop.size[axis]);
        let whole = self.layout;
        assert!(right <= whole.width() && bottom <= whole.height(), "a part of the image");
        let [width, height] = crop.turned();
        let layout = Layout::new(width, height, whole.pad());
        let turned = |samples: &Samples, gain: f32| -> Vec<f32> {
            let pixel = |k: usize| samples.at(k % whole.width(), k / whole.width()) * gain;
            crop.pixels(whole.width()).map(pixel).collect()
        };
        let planes = self.planes.iter().map(|(&id, plane)| {
            let light = matches!(id.feature, Feature::Color | Feature::DirIllumination);
            let gain = match (light, id.quantity) {
                (false, _) => 1.0,
                (true, Quantity::Variance) => gain * gain,
                (true, _) => gain,
            };
            let plane = match plane {
                Plane::Constant(value) => Plane::Constant(value * gain),
                // Also where this part holds one number: the whole image does not.
                Plane::Samples(_) if id.feature == Feature::Pixel => {
                    let at = |k: usize| [k % width, k / width][usize::from(id.component)] as f32;
                    let pixels: Vec<f32> = (0..layout.pixels()).map(at).collect();
                    Plane::Samples(Samples::new(layout, &pixels, Edge::Replicate))
                }
                Plane::Samples(samples) => {
                    Plane::Samples(Samples::new(layout, &turned(samples, gain), Edge::Replicate))
                }
            };
            (id, plane)
        });
        let planes: BTreeMap<_, _> = planes.collect();
        let color = self.color.each_ref();
        let facts = match gain == 1.0 {
            true => self.facts.clone(),
            false => Facts::from_planes(planes.iter().map(|(&id, plane)| (id, Fact::of(plane)))),
        };
        Self {
            name: self.name.clone(),
            layout,
            top: 0,
            color: color.map(|c| Samples::new(layout, &turned(c, gain), Edge::Zero)),
            // Parts of scenes are learned from, and not composited.
            alpha: None,
            layers: Vec::new(),
            ones: Samples::new(layout, &vec![1.0; layout.pixels()], Edge::Zero),
            planes,
            facts,
            normalization: self.normalization,
            notes: Vec::new(),
            origin: self.origin.of_part(),
        }
    }
}

impl Scene {
    /// The same scene as if it had been rendered with more samples: what its colour differs by
    /// from a reference (linear R, G, B as the renderer wrote them, pixel by pixel) becomes
    /// this share of itself, its variance the square of that. Features and gradients stay.
    ///
    /// # Panics
    /// If the reference is of another size.
    #[must_use]
    pub fn quieter(&self, reference: &[[f32; 3]], share: f32) -> Self {
        assert_eq!(reference.len(), self.layout.pixels(), "one colour per pixel");
        let (layout, width) = (self.layout, self.layout.width());
        let nearer = |samples: &Samples, component: usize, unit: f32| -> Vec<f32> {
            let pixel = |(k, pixel): (usize, &[f32; 3])| {
                let truth = pixel[component] / unit;
                truth + share * (samples.at(k % width, k / width) - truth)
            };
            reference.iter().enumerate().map(pixel).collect()
        };
        let exposure = self.normalization.exposure;
        let plane = |(&id, plane): (&PlaneId, &Plane)| {
            let changed = match (id.feature, id.quantity, plane) {
                (Feature::Color, Quantity::Value, Plane::Samples(samples)) => {
                    let pixels = nearer(samples, id.component.into(), exposure);
                    Plane::Samples(Samples::new(layout, &pixels, Edge::Replicate))
                }
                (Feature::Color, Quantity::Variance, Plane::Samples(samples)) => {
                    let rows = (0..layout.height()).flat_map(|y| samples.pixels(y));
                    let pixels: Vec<f32> = rows.map(|x| share * share * x).collect();
                    Plane::Samples(Samples::new(layout, &pixels, Edge::Replicate))
                }
                _ => plane.clone(),
            };
            (id, changed)
        };
        let planes: BTreeMap<_, _> = self.planes.iter().map(plane).collect();
        let facts = Facts::from_planes(planes.iter().map(|(&id, plane)| (id, Fact::of(plane))));
        let [r, g, b] =
            [0, 1, 2].map(|k| Samples::new(layout, &nearer(&self.color[k], k, 1.0), Edge::Zero));
        Self { color: [r, g, b], planes, facts, ..self.clone() }
    }
}

impl Scene {
    /// The same scene as if its file held no variances: those that it has planes of are
    /// estimated from the image, as far as it has the values.
    #[must_use]
    pub fn without_variances(&self) -> Self {
        let width = self.layout.width();
        let values = |feature| -> Option<Vec<Vec<f32>>> {
            let component = |id| match self.planes.get(&id)? {
                Plane::Constant(value) => Some(vec![*value; self.layout.pixels()]),
                Plane::Samples(samples) => {
                    let rows = 0..self.layout.height();
                    Some(rows.flat_map(|y| samples.pixels(y)).copied().collect())
                }
            };
            PlaneId::of(feature, Quantity::Value).map(component).collect()
        };
        let grain = values(Feature::Color).map(|color| grain(&color, width)).unwrap_or_default();
        let plane = |(&id, plane): (&PlaneId, &Plane)| {
            let changed = match (id.feature, id.quantity) {
                (Feature::Measured, _) => Plane::Constant(0.0),
                (Feature::Grain, _) => Plane::Constant(grain[usize::from(id.component)]),
                (feature, Quantity::Variance) => match values(feature) {
                    Some(values) => Plane::new(self.layout, &estimated_variance(&values, width)),
                    None => plane.clone(),
                },
                _ => plane.clone(),
            };
            (id, changed)
        };
        let planes: BTreeMap<_, _> = self.planes.iter().map(plane).collect();
        let facts = Facts::from_planes(planes.iter().map(|(&id, plane)| (id, Fact::of(plane))));
        Self { planes, facts, ..self.clone() }
    }

    /// The same scene as if it were known how many samples each pixel is the mean of.
    #[must_use]
    pub fn with_samples(mut self, samples: u32) -> Self {
        for id in PlaneId::of(Feature::Samples, Quantity::Value) {
            if let Some(plane) = self.planes.get_mut(&id) {
                *plane = Plane::Constant(samples.min(MOST_SAMPLES) as f32);
            }
        }
        let planes = self.planes.iter();
        self.facts = Facts::from_planes(planes.map(|(&id, plane)| (id, Fact::of(plane))));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_those_that_they_say() {
        // 0 1 2 3
        // 4 5 6 7
        let crop = Crop { corner: [1, 0], size: [3, 2], flipped: [false; 2], transposed: false };
        let pixels = |crop: Crop| crop.pixels(4).collect::<Vec<_>>();
        assert_eq!(pixels(crop), [1, 2, 3, 5, 6, 7]);
        assert_eq!(pixels(Crop { flipped: [true, false], ..crop }), [3, 2, 1, 7, 6, 5]);
        assert_eq!(pixels(Crop { flipped: [false, true], ..crop }), [5, 6, 7, 1, 2, 3]);
        assert_eq!(pixels(Crop { transposed: true, ..crop }), [1, 5, 2, 6, 3, 7]);
        let turned = Crop { transposed: true, flipped: [true, false], ..crop };
        assert_eq!(pixels(turned), [3, 7, 2, 6, 1, 5]);
        assert_eq!(turned.turned(), [2, 3]);
    }

    #[test]
    fn without_variances_a_scene_is_that_of_a_file_without_them() {
        use crate::scene::{LoadOptions, Needs, RawScene};
        let (width, height) = (7, 5);
        let image = |seed: usize| -> Vec<f32> {
            (0..width * height).map(|k| ((k * 13 + seed * 7) % 17) as f32 / 8.0).collect()
        };
        let mut raw = RawScene::new("made", width, height, [1, 2, 3].map(image))
            .with(Feature::Normal, Quantity::Value, vec![image(4), image(5), vec![0.25; 35]])
            .with(Feature::Normal, Quantity::Variance, vec![image(6)])
            .with(Feature::Color, Quantity::Variance, vec![image(7)]);
        let prepared = |raw: &RawScene, samples| {
            let options = LoadOptions { samples, ..LoadOptions::default() };
            raw.clone().prepare(&Needs::everything(), 2, &options).expect("a sound scene")
        };
        let (measured, told) = (prepared(&raw, None), prepared(&raw, Some(9)));
        raw.features.retain(|&(_, quantity), _| quantity != Quantity::Variance);
        let estimated = prepared(&raw, None);
        let planes = |scene: &Scene| -> Vec<(PlaneId, Plane)> {
            scene.planes().map(|(id, plane)| (id, plane.clone())).collect()
        };
        assert_ne!(planes(&measured), planes(&estimated));
        assert_eq!(planes(&measured.without_variances()), planes(&estimated));
        assert_eq!(measured.without_variances().facts, estimated.facts);
        assert_eq!(planes(&measured.clone().with_samples(9)), planes(&told));
        let fact = |scene: &Scene, feature| {
            scene.fact(PlaneId { feature, quantity: Quantity::Value, component: 0 })
        };
        assert_eq!(fact(&measured, Feature::Measured), Fact::Constant(1.0));
        assert_eq!(fact(&estimated, Feature::Measured), Fact::Constant(0.0));
        assert_eq!(fact(&measured, Feature::Samples), Fact::Constant(0.0));
        assert_eq!(fact(&told, Feature::Samples), Fact::Constant(9.0));
    }
}
