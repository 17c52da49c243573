//! From raw features to the planes of a [`Scene`]: repair, bounds, scales, normalised
//! values, what is derived from them, padding. In that order.
//!
//! Features are taken from wherever they are ([`MendedFeatures`]) and planes given to whoever
//! keeps them, so that scenes in memory and [spilled](super::SpilledScene) ones are made by
//! the same steps.

use std::borrow::Cow;
use std::collections::BTreeMap;

use rayon::prelude::*;

use super::facts::{Fact, Facts};
use super::mend::{Findings, Mender};
use super::normalize::{ColorScale, Normalization, depth_extent, exposure, geometry, hits};
use super::note::Note;
use super::plane::{Edge, Layout, Plane, Samples};
use super::raw::RawScene;
use super::{LoadOptions, Needs, Scene, SceneError, derive};
use crate::expr::builder::LIMIT;
use crate::expr::feature::{Feature, PlaneId, Quantity, Unit};
use crate::image::is_good;

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
        let mender = Mender {
            name: &self.name,
            origin: &self.origin,
            width: self.width,
            repair: options.repair,
        };
        let mend = |(&(feature, quantity), components): (&_, &mut Vec<Vec<f32>>)| {
            mender.mend(feature, quantity, components)
        };
        // The first error in the features' order, whichever was found first.
        let findings: Vec<Result<Findings, SceneError>> =
            self.features.par_iter_mut().map(mend).collect();
        let findings = findings.into_iter().collect::<Result<_, _>>()?;
        let mut notes = std::mem::take(&mut self.notes);
        notes.extend(Findings::all(findings));
        for (layer, channels) in &mut self.layers {
            notes.extend(mender.mend_layer(layer, channels)?);
        }
        let layout = Layout::new(self.width, self.height, pad);
        let color = self.features.get(&(Feature::Color, Quantity::Value)).map(Vec::as_slice);
        let Some([r, g, b]) = color else {
            return Err(self.origin.without_color(&self.name));
        };
        let summed = || {
            let color = [r, g, b].map(|channel| Samples::new(layout, channel, Edge::Zero));
            (color, Samples::new(layout, &vec![1.0; layout.pixels()], Edge::Zero))
        };
        let ((color, ones), scales) =
            rayon::join(summed, || Scales::of(&self, options.color_scale));
        let scales = scales?;
        let samples = options.samples.or(self.samples);
        let maker = Maker { features: &self, scales: &scales, layout, samples };
        let made = Feature::ALL
            .into_par_iter()
            .map(|feature| {
                let mut planes = Vec::new();
                let estimated = maker.planes(feature, needs, &mut |id, samples| {
                    let plane = Plane::new(layout, samples);
                    planes.push((id, Fact::of(&plane), plane));
                    Ok(())
                })?;
                Ok((planes, estimated))
            })
            .collect::<Result<Vec<_>, SceneError>>()?;
        let mut planes = BTreeMap::new();
        let mut facts = Vec::new();
        for (made, estimated) in made {
            for (id, fact, plane) in made {
                facts.push((id, fact));
                planes.insert(id, plane);
            }
            notes.extend(estimated.map(Note::EstimatedVariance));
        }
        Ok(Scene {
            name: self.name,
            layout,
            top: 0,
            color,
            alpha: self.alpha,
            layers: self.layers,
            ones,
            planes,
            facts: Facts::from_planes(facts),
            normalization: scales.normalization,
            notes,
            origin: self.origin,
        })
    }
}

/// Where features are that were mended.
pub(super) trait MendedFeatures: Sync {
    /// The components of a quantity, row by row without padding; `None` if there is none.
    ///
    /// # Errors
    /// If they cannot be read.
    fn get(
        &self,
        feature: Feature,
        quantity: Quantity,
    ) -> Result<Option<Cow<'_, [Vec<f32>]>>, SceneError>;
}

impl MendedFeatures for RawScene {
    fn get(
        &self,
        feature: Feature,
        quantity: Quantity,
    ) -> Result<Option<Cow<'_, [Vec<f32>]>>, SceneError> {
        Ok(self.features.get(&(feature, quantity)).map(|all| Cow::Borrowed(all.as_slice())))
    }
}

/// What planes are measured in.
pub(super) struct Scales {
    pub(super) normalization: Normalization,
    /// Which pixels hit something; empty without positions.
    hit: Vec<bool>,
}

impl Scales {
    pub(super) fn of(
        features: &dyn MendedFeatures,
        color_scale: ColorScale,
    ) -> Result<Self, SceneError> {
        let exposure = match features.get(Feature::Color, Quantity::Value)?.as_deref() {
            Some([r, g, b]) => exposure([r, g, b]),
            _ => 1.0,
        };
        let (center, extent, hit) = visible(features)?;
        Ok(Self { normalization: Normalization { exposure, color_scale, center, extent }, hit })
    }
}

/// Centre and extent, and which pixels hit something.
type Visible = (Option<[f32; 3]>, Option<f32>, Vec<bool>);

fn visible(features: &dyn MendedFeatures) -> Result<Visible, SceneError> {
    let value = |feature| features.get(feature, Quantity::Value);
    let depth = value(Feature::Depth)?;
    if let Some(position) = value(Feature::WorldPosition)? {
        let evidence = match depth {
            Some(depth) => Some(depth),
            None => value(Feature::Normal)?,
        };
        // Evidence that is zero everywhere is none.
        let evidence = evidence.filter(|planes| planes.iter().flatten().any(|&x| x != 0.0));
        let hit = hits(evidence.as_deref().unwrap_or(&position));
        drop(evidence);
        let (center, extent) = geometry(&position, &hit);
        return Ok((Some(center), Some(extent), hit));
    }
    let extent = match depth.as_deref() {
        Some([depth]) => Some(depth_extent(depth)),
        _ => None,
    };
    Ok((None, extent, Vec::new()))
}

/// More samples per pixel than these count as so many.
pub const MOST_SAMPLES: u32 = 65536;

/// What stands in for a variance that a file does not hold, from the values.
pub(super) fn estimated_variance(values: &[Vec<f32>], width: usize) -> Vec<f32> {
    let mut estimate = derive::estimate_variance(values, width);
    limit(&mut estimate);
    estimate
}

/// Makes planes.
pub(super) struct Maker<'a> {
    pub(super) features: &'a dyn MendedFeatures,
    pub(super) scales: &'a Scales,
    pub(super) layout: Layout,
    /// Samples per pixel, where they are known.
    pub(super) samples: Option<u32>,
}

/// Takes a plane's samples, row by row without padding.
type Keep<'a> = dyn FnMut(PlaneId, &[f32]) -> Result<(), SceneError> + 'a;

impl Maker<'_> {
    /// Makes the planes of one feature. Returns it if its variance was estimated.
    pub(super) fn planes(
        &self,
        feature: Feature,
        needs: &Needs,
        keep: &mut Keep<'_>,
    ) -> Result<Option<Feature>, SceneError> {
        let [value, gradient, variance] = [Quantity::Value, Quantity::Gradient, Quantity::Variance]
            .map(|quantity| needs.wants(feature, quantity));
        if !(value || gradient || variance) {
            return Ok(None);
        }
        let normalized = self.normalized(feature)?;
        let mut add = |quantity, component: usize, samples: &[f32]| {
            let id = PlaneId { feature, quantity, component: component as u8 };
            if needs.includes(id) { keep(id, samples) } else { Ok(()) }
        };
        for (k, samples) in normalized.as_deref().unwrap_or_default().iter().enumerate() {
            if value {
                add(Quantity::Value, k, samples)?;
            }
            if gradient {
                let mut gradient = derive::gradient(samples, self.layout.width());
                limit(&mut gradient);
                add(Quantity::Gradient, k, &gradient)?;
            }
        }
        if !variance {
            return Ok(None);
        }
        let stored = self.features.get(feature, Quantity::Variance)?;
        let samples = match (stored.as_deref(), &normalized) {
            (Some(stored), _) => Some(self.stored_variance(feature, stored)?),
            (None, Some(normalized)) => Some(estimated_variance(normalized, self.layout.width())),
            (None, None) => None,
        };
        if let Some(samples) = &samples {
            add(Quantity::Variance, 0, samples)?;
        }
        Ok((stored.is_none() && samples.is_some()).then_some(feature))
    }

    /// The feature's components in the scene's own scales.
    fn normalized(&self, feature: Feature) -> Result<Option<Cow<'_, [Vec<f32>]>>, SceneError> {
        let everywhere = |x: f32| Ok(Some(vec![vec![x; self.layout.pixels()]].into()));
        match feature {
            Feature::Pixel => {
                let (width, height) = (self.layout.width(), self.layout.height());
                let axis = |axis| derive::coordinates(width, height, axis);
                return Ok(Some((0..2).map(axis).collect::<Vec<_>>().into()));
            }
            Feature::Measured => {
                let stored = self.features.get(Feature::Color, Quantity::Variance)?;
                return everywhere(if stored.is_some() { 1.0 } else { 0.0 });
            }
            Feature::Grain => {
                let stored = self.features.get(Feature::Color, Quantity::Variance)?.is_some();
                let color = if stored { None } else { self.normalized(Feature::Color)? };
                let grain = color.map(|color| derive::grain(&color, self.layout.width()));
                let planes = grain.unwrap_or_default().map(|x| vec![x; self.layout.pixels()]);
                return Ok(Some(Vec::from(planes).into()));
            }
            // Whoever filters layers puts them here (`Scene::with_pictures`).
            Feature::Layer => {
                let nothing = vec![0.0; self.layout.pixels()];
                return Ok(Some(vec![nothing; Feature::Layer.width()].into()));
            }
            Feature::Samples => {
                return everywhere(self.samples.unwrap_or(0).min(MOST_SAMPLES) as f32);
            }
            _ => {}
        }
        let Some(raw) = self.features.get(feature, Quantity::Value)? else { return Ok(None) };
        if feature.row().unit == Unit::Own && raw.iter().all(|samples| all_good(samples)) {
            return Ok(Some(raw));
        }
        let divisor = self.divisor(feature);
        let scale = |f: &dyn Fn(f32) -> f32, samples: &[f32]| -> Vec<f32> {
            samples.iter().map(|&x| f(x).clamp(-LIMIT, LIMIT)).collect()
        };
        let Normalization { center, color_scale, .. } = self.scales.normalization;
        let components = raw.iter().enumerate().map(|(k, samples)| match feature.row().unit {
            Unit::Place => {
                let center = center.unwrap_or_default()[k.min(2)];
                let place = |(&x, &hit): (&f32, &bool)| {
                    if hit { ((x - center) / divisor).clamp(-LIMIT, LIMIT) } else { 0.0 }
                };
                samples.iter().zip(&self.scales.hit).map(place).collect()
            }
            Unit::Light => scale(&|x| color_scale.apply(x / divisor), samples),
            Unit::Length => scale(&|x| x / divisor, samples),
            Unit::Own => scale(&|x| x, samples),
        });
        Ok(Some(components.collect::<Vec<_>>().into()))
    }

    /// What a feature's values are divided by.
    fn divisor(&self, feature: Feature) -> f32 {
        match feature.row().unit {
            Unit::Place | Unit::Length => self.scales.normalization.extent.unwrap_or(1.0),
            Unit::Light => self.scales.normalization.exposure,
            Unit::Own => 1.0,
        }
    }

    /// The file's variance, averaged over the components, in the scales of the
    /// normalised feature. A negative one (rounding in the renderer) is none.
    fn stored_variance(
        &self,
        feature: Feature,
        stored: &[Vec<f32>],
    ) -> Result<Vec<f32>, SceneError> {
        let divisor = self.divisor(feature);
        let mut variance = derive::average(stored);
        for v in &mut variance {
            // Divided twice: the divisor's square may leave the range of f32.
            *v = (*v / divisor / divisor).max(0.0);
        }
        if feature.row().unit == Unit::Light
            && self.scales.normalization.color_scale == ColorScale::Compressed
            && let Some(components) = self.features.get(feature, Quantity::Value)?
        {
            let color = derive::average(&components);
            for (v, c) in variance.iter_mut().zip(color) {
                *v *= self.scales.normalization.color_scale.slope_squared(c / divisor);
            }
        }
        limit(&mut variance);
        Ok(variance)
    }
}

/// Whether all samples can be computed with.
fn all_good(samples: &[f32]) -> bool {
    // Counting takes no branch, so that it is vector code.
    samples.iter().map(|&x| usize::from(is_good(x))).sum::<usize>() == samples.len()
}

/// Brings samples into the range that expressions compute in.
fn limit(samples: &mut [f32]) {
    samples.iter_mut().for_each(|x| *x = x.clamp(-LIMIT, LIMIT));
}
