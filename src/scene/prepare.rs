//! From raw features to the planes of a [`Scene`]: repair, bounds, scales, normalised
//! values, what is derived from them, padding. In that order.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::defect::{self, Tally};
use super::facts::{Fact, Facts};
use super::normalize::{ColorScale, Normalization, depth_extent, exposure, geometry, hits};
use super::note::Note;
use super::plane::{Edge, Layout, Plane, Samples};
use super::raw::RawScene;
use super::repair::{self, Repair};
use super::{LoadOptions, Needs, Scene, SceneError, derive};
use crate::expr::builder::LIMIT;
use crate::expr::feature::{Feature, PlaneId, Quantity, Unit};

impl RawScene {
    /// Makes the planes that `needs` names, as far as this scene can provide
    /// them, for windows up to radius `pad`. The scene must hold what
    /// [`RawScene::read`] reads for the same needs.
    ///
    /// # Errors
    /// If there are bad pixels and the options refuse them, or no colour.
    ///
    /// # Panics
    /// If a feature's components are not images of this scene's size.
    pub fn prepare(
        mut self,
        needs: &Needs,
        pad: usize,
        options: &LoadOptions,
    ) -> Result<Scene, SceneError> {
        for components in self.features.values().flatten() {
            assert_eq!(components.len(), self.width * self.height, "one sample per pixel");
        }
        self.drop_far_depths();
        self.note_defects();
        self.repair(options.repair)?;
        self.bound();
        let layout = Layout::new(self.width, self.height, pad);
        let Some([r, g, b]) = self.components(Feature::Color, Quantity::Value) else {
            return Err(self.origin.missing(
                &self.name,
                PlaneId { feature: Feature::Color, quantity: Quantity::Value, component: 0 },
            ));
        };
        let summed = || {
            let color = [r, g, b].map(|channel| Samples::new(layout, channel, Edge::Zero));
            (color, Samples::new(layout, &vec![1.0; layout.pixels()], Edge::Zero))
        };
        let ((color, ones), (scales, hit)) =
            rayon::join(summed, || self.scales(options.color_scale));

        let made: Vec<Made> = Feature::ALL
            .into_par_iter()
            .map(|feature| {
                let maker = Maker { raw: &self, scales: &scales, hit: &hit, layout };
                maker.planes(feature, needs)
            })
            .collect();
        let mut planes = BTreeMap::new();
        let mut facts = Vec::new();
        let mut notes = self.notes;
        for mut made in made {
            planes.append(&mut made.planes);
            facts.append(&mut made.facts);
            notes.extend(made.estimated.map(Note::EstimatedVariance));
        }
        Ok(Scene {
            name: self.name,
            layout,
            color,
            ones,
            planes,
            facts: Facts::from_planes(facts),
            normalization: scales,
            notes,
            origin: self.origin,
        })
    }

    fn components(&self, feature: Feature, quantity: Quantity) -> Option<&[Vec<f32>]> {
        self.features.get(&(feature, quantity)).map(Vec::as_slice)
    }

    /// Notes what is found but kept, before anything is changed.
    fn note_defects(&mut self) {
        let found: Vec<Vec<Note>> = self
            .features
            .par_iter()
            .map(|(&(feature, quantity), components)| {
                let mut notes = Vec::new();
                for (k, samples) in components.iter().enumerate() {
                    let channel = || self.origin.channel(feature, quantity, k);
                    let note = |found: Tally| Note::Negative {
                        channel: channel(),
                        quantity,
                        count: found.count,
                    };
                    notes.extend(defect::negative(samples, feature, quantity).map(note));
                }
                if quantity == Quantity::Value {
                    let note = |found: Tally| Note::Fireflies { feature, count: found.count };
                    notes.extend(defect::fireflies(components, self.width, feature).map(note));
                }
                notes
            })
            .collect();
        self.notes.extend(found.into_iter().flatten());
    }

    fn drop_far_depths(&mut self) {
        let depth = self.features.get_mut(&(Feature::Depth, Quantity::Value));
        let found = depth.into_iter().flatten().filter_map(|samples| defect::drop_far(samples));
        let notes: Vec<Note> = found.map(|found| Note::FarDepth { count: found.count }).collect();
        self.notes.extend(notes);
    }

    fn repair(&mut self, repair: Repair) -> Result<(), SceneError> {
        let search = |components: &Vec<Vec<f32>>| -> Vec<_> {
            components.par_iter().map(|samples| repair::find(samples)).collect()
        };
        let found: Vec<Vec<_>> = self.features.par_iter().map(|(_, all)| search(all)).collect();
        for ((&(feature, quantity), components), found) in self.features.iter_mut().zip(found) {
            for (k, (samples, bad)) in components.iter_mut().zip(found).enumerate() {
                let Some(bad) = bad else { continue };
                let channel = self.origin.channel(feature, quantity, k);
                let count = bad.count;
                match repair {
                    Repair::Median => {
                        repair::by_median(samples, self.width);
                        self.notes.push(Note::Repaired { channel, count });
                    }
                    Repair::None => self.notes.push(Note::LeftBad { channel, count }),
                    Repair::Error => {
                        let path = match &self.origin.file {
                            Some((header, _)) => header.path().to_owned(),
                            None => self.name.clone().into(),
                        };
                        let first = (bad.first[0] % self.width, bad.first[0] / self.width);
                        return Err(SceneError::BadPixels { path, channel, count, first });
                    }
                }
            }
        }
        Ok(())
    }

    /// Brings features that have bounds into them: what is derived from them follows.
    fn bound(&mut self) {
        let pixels = self.width * self.height;
        let found: Vec<Option<Note>> = self
            .features
            .par_iter_mut()
            .map(|(&(feature, quantity), components)| {
                let bounds = feature.row().bounds.filter(|_| quantity == Quantity::Value)?;
                let mut marked = vec![false; pixels];
                for samples in components {
                    defect::bound(samples, bounds, &mut marked);
                }
                let count = marked.into_iter().filter(|&marked| marked).count();
                (count > 0).then_some(Note::Bounded { feature, bounds, count })
            })
            .collect();
        self.notes.extend(found.into_iter().flatten());
    }

    /// The scales, and which pixels hit something (empty without positions).
    fn scales(&self, color_scale: ColorScale) -> (Normalization, Vec<bool>) {
        let color = self.components(Feature::Color, Quantity::Value).unwrap_or_default();
        let exposure = || match color {
            [r, g, b] => exposure([r, g, b]),
            _ => 1.0,
        };
        let (exposure, (center, extent, hit)) = rayon::join(exposure, || self.geometry());
        (Normalization { exposure, color_scale, center, extent }, hit)
    }

    /// Centre and extent, and which pixels hit something.
    fn geometry(&self) -> (Option<[f32; 3]>, Option<f32>, Vec<bool>) {
        let depth = self.components(Feature::Depth, Quantity::Value);
        let (mut center, mut extent, mut hit) = (None, None, Vec::new());
        if let Some(position) = self.components(Feature::WorldPosition, Quantity::Value) {
            // Evidence that is zero everywhere is none.
            let evidence = depth
                .or(self.components(Feature::Normal, Quantity::Value))
                .filter(|planes| planes.iter().flatten().any(|&x| x != 0.0));
            hit = hits(evidence.unwrap_or(position));
            let (c, e) = geometry(position, &hit);
            (center, extent) = (Some(c), Some(e));
        } else if let Some([depth]) = depth {
            extent = Some(depth_extent(depth));
        }
        (center, extent, hit)
    }
}

/// The planes of one feature.
#[derive(Default)]
struct Made {
    planes: BTreeMap<PlaneId, Plane>,
    facts: Vec<(PlaneId, Fact)>,
    estimated: Option<Feature>,
}

struct Maker<'a> {
    raw: &'a RawScene,
    scales: &'a Normalization,
    hit: &'a [bool],
    layout: Layout,
}

impl Maker<'_> {
    fn planes(&self, feature: Feature, needs: &Needs) -> Made {
        let [value, gradient, variance] = [Quantity::Value, Quantity::Gradient, Quantity::Variance]
            .map(|quantity| needs.wants(feature, quantity));
        let mut made = Made::default();
        if !(value || gradient || variance) {
            return made;
        }
        let normalized = self.normalized(feature);
        let mut add = |quantity, component: usize, samples: &[f32]| {
            let id = PlaneId { feature, quantity, component: component as u8 };
            if needs.includes(id) {
                let plane = Plane::new(self.layout, samples);
                made.facts.push((id, Fact::of(&plane)));
                made.planes.insert(id, plane);
            }
        };
        for (k, samples) in normalized.iter().flatten().enumerate() {
            if value {
                add(Quantity::Value, k, samples);
            }
            if gradient {
                let mut gradient = derive::gradient(samples, self.layout.width());
                limit(&mut gradient);
                add(Quantity::Gradient, k, &gradient);
            }
        }
        if variance {
            let stored = self.raw.components(feature, Quantity::Variance);
            let samples = match (stored, &normalized) {
                (Some(stored), _) => Some(self.stored_variance(feature, stored)),
                (None, Some(normalized)) => {
                    let mut estimate = derive::estimate_variance(normalized, self.layout.width());
                    limit(&mut estimate);
                    Some(estimate)
                }
                (None, None) => None,
            };
            if let Some(samples) = &samples {
                add(Quantity::Variance, 0, samples);
            }
            made.estimated = (stored.is_none() && samples.is_some()).then_some(feature);
        }
        made
    }

    /// The feature's components in the scene's own scales.
    fn normalized(&self, feature: Feature) -> Option<Vec<Vec<f32>>> {
        if feature == Feature::Pixel {
            let (width, height) = (self.layout.width(), self.layout.height());
            return Some((0..2).map(|axis| derive::coordinates(width, height, axis)).collect());
        }
        let raw = self.raw.components(feature, Quantity::Value)?;
        let divisor = self.divisor(feature);
        let scale = |f: &dyn Fn(f32) -> f32, samples: &[f32]| -> Vec<f32> {
            samples.iter().map(|&x| f(x).clamp(-LIMIT, LIMIT)).collect()
        };
        let components = raw.iter().enumerate().map(|(k, samples)| match feature.row().unit {
            Unit::Place => {
                let center = self.scales.center.unwrap_or_default()[k.min(2)];
                let place = |(&x, &hit): (&f32, &bool)| {
                    if hit { ((x - center) / divisor).clamp(-LIMIT, LIMIT) } else { 0.0 }
                };
                samples.iter().zip(self.hit).map(place).collect()
            }
            Unit::Light => scale(&|x| self.scales.color_scale.apply(x / divisor), samples),
            Unit::Length => scale(&|x| x / divisor, samples),
            Unit::Own => scale(&|x| x, samples),
        });
        Some(components.collect())
    }

    /// What a feature's values are divided by.
    fn divisor(&self, feature: Feature) -> f32 {
        match feature.row().unit {
            Unit::Place | Unit::Length => self.scales.extent.unwrap_or(1.0),
            Unit::Light => self.scales.exposure,
            Unit::Own => 1.0,
        }
    }

    /// The file's variance, averaged over the components, in the scales of the
    /// normalised feature. A negative one (rounding in the renderer) is none.
    fn stored_variance(&self, feature: Feature, stored: &[Vec<f32>]) -> Vec<f32> {
        let divisor = self.divisor(feature);
        let mut variance = derive::average(stored);
        for v in &mut variance {
            // Divided twice: the divisor's square may leave the range of f32.
            *v = (*v / divisor / divisor).max(0.0);
        }
        if feature.row().unit == Unit::Light
            && self.scales.color_scale == ColorScale::Compressed
            && let Some(components) = self.raw.components(feature, Quantity::Value)
        {
            let color = derive::average(components);
            for (v, c) in variance.iter_mut().zip(color) {
                *v *= self.scales.color_scale.slope_squared(c / divisor);
            }
        }
        limit(&mut variance);
        variance
    }
}

/// Brings samples into the range that expressions compute in.
fn limit(samples: &mut [f32]) {
    samples.iter_mut().for_each(|x| *x = x.clamp(-LIMIT, LIMIT));
}
