//! What becomes of features that are wrong before anything is made of them: far depths,
//! bad pixels, what is out of bounds.

use std::path::PathBuf;

use rayon::prelude::*;

use super::SceneError;
use super::defect::{self, Extremes, Tally};
use super::note::Note;
use super::raw::Origin;
use super::repair::{self, Repair};
use super::target::LayerChannels;
use crate::expr::feature::{Feature, Quantity};

/// Normals that are looked at together.
const BLOCK: usize = 1024;

/// Mends the features of a scene.
pub(super) struct Mender<'a> {
    /// What reports call the scene.
    pub(super) name: &'a str,
    pub(super) origin: &'a Origin,
    /// Pixels per row.
    pub(super) width: usize,
    pub(super) repair: Repair,
}

/// What was found in a quantity, by kind, in the order in which it is told.
#[derive(Default)]
pub(super) struct Findings {
    kinds: [Vec<Note>; 4],
}

impl Findings {
    const FAR: usize = 0;
    const FOUND: usize = 1;
    const REPAIRED: usize = 2;
    const BOUNDED: usize = 3;

    /// Those of all quantities, kind by kind.
    pub(super) fn all(each: Vec<Self>) -> Vec<Note> {
        let mut kinds: [Vec<Note>; 4] = Default::default();
        for findings in each {
            for (all, notes) in kinds.iter_mut().zip(findings.kinds) {
                all.extend(notes);
            }
        }
        kinds.into_iter().flatten().collect()
    }
}

impl Mender<'_> {
    /// Mends the components of a quantity.
    ///
    /// # Errors
    /// If there are bad pixels and they are to be refused.
    pub(super) fn mend(
        &self,
        feature: Feature,
        quantity: Quantity,
        components: &mut [Vec<f32>],
    ) -> Result<Findings, SceneError> {
        let mut findings = Findings::default();
        if (feature, quantity) == (Feature::Depth, Quantity::Value) {
            let found = components.iter_mut().filter_map(|samples| defect::drop_far(samples));
            let notes = found.map(|found| Note::FarDepth { count: found.count });
            findings.kinds[Findings::FAR].extend(notes);
        }
        // Mostly this one look tells that nothing is wrong, and no other is needed.
        let extremes: Vec<_> = components.iter().map(|samples| Extremes::of(samples)).collect();
        let lie_in = |bounds| extremes.iter().all(|x| x.is_some_and(|x| x.lie_in(bounds)));
        findings.kinds[Findings::FOUND] = self.kept(feature, quantity, components, &extremes);
        if extremes.contains(&None) {
            findings.kinds[Findings::REPAIRED] = self.repaired(feature, quantity, components)?;
        }
        let is_normal = (feature, quantity) == (Feature::Normal, Quantity::Value);
        if is_normal {
            findings.kinds[Findings::BOUNDED].extend(unit_normals(components));
        }
        if is_normal || !feature.row().bounds.is_some_and(lie_in) {
            findings.kinds[Findings::BOUNDED].extend(bounded(feature, quantity, components));
        }
        Ok(findings)
    }

    /// Notes what is found but kept.
    fn kept(
        &self,
        feature: Feature,
        quantity: Quantity,
        components: &[Vec<f32>],
        extremes: &[Option<Extremes>],
    ) -> Vec<Note> {
        let mut notes = Vec::new();
        let not_negative = |x: &Option<Extremes>| x.is_some_and(|x| x.bounds[0] >= 0.0);
        for (k, samples) in components.iter().enumerate() {
            if not_negative(&extremes[k]) {
                continue;
            }
            let channel = || self.origin.channel(feature, quantity, k);
            let note =
                |found: Tally| Note::Negative { channel: channel(), quantity, count: found.count };
            notes.extend(defect::negative(samples, feature, quantity).map(note));
        }
        if quantity == Quantity::Value {
            let note = |found: Tally| Note::Fireflies { feature, count: found.count };
            let found = defect::fireflies_among(components, self.width, feature, extremes);
            notes.extend(found.map(note));
        }
        notes
    }

    fn repaired(
        &self,
        feature: Feature,
        quantity: Quantity,
        components: &mut [Vec<f32>],
    ) -> Result<Vec<Note>, SceneError> {
        self.repaired_as(components, |k| self.origin.channel(feature, quantity, k))
    }

    /// Repairs the channels of a layer that is filtered by the colour's weights.
    ///
    /// # Errors
    /// If there are bad pixels and they are to be refused.
    pub(super) fn mend_layer(
        &self,
        layer: &LayerChannels,
        components: &mut [Vec<f32>],
    ) -> Result<Vec<Note>, SceneError> {
        self.repaired_as(components, |k| layer.channels[k].clone())
    }

    fn repaired_as(
        &self,
        components: &mut [Vec<f32>],
        name: impl Fn(usize) -> String,
    ) -> Result<Vec<Note>, SceneError> {
        let found: Vec<_> = components.par_iter().map(|samples| repair::find(samples)).collect();
        let mut notes = Vec::new();
        for (k, (samples, bad)) in components.iter_mut().zip(found).enumerate() {
            let Some(bad) = bad else { continue };
            let channel = name(k);
            let count = bad.count;
            match self.repair {
                Repair::Median => {
                    repair::by_median(samples, self.width);
                    notes.push(Note::Repaired { channel, count });
                }
                Repair::None => notes.push(Note::LeftBad { channel, count }),
                Repair::Error => {
                    let first = (bad.first[0] % self.width, bad.first[0] / self.width);
                    let path = self.path();
                    return Err(SceneError::BadPixels { path, channel, count, first });
                }
            }
        }
        Ok(notes)
    }

    fn path(&self) -> PathBuf {
        match &self.origin.target {
            Some(target) => target.path().to_owned(),
            None => self.name.into(),
        }
    }
}

/// Normals as directions: those that were stored as colours are brought back from [0, 1], and
/// what is longer than 1 is shortened. (Shorter ones are means of several: antialiased, or out
/// of focus.)
fn unit_normals(components: &mut [Vec<f32>]) -> Vec<Note> {
    let mut notes = Vec::new();
    let [x, y, z] = components else { return notes };
    if defect::are_encoded(x, y, z) {
        for samples in [&mut *x, &mut *y, &mut *z] {
            samples.iter_mut().for_each(|sample| *sample = 2.0 * *sample - 1.0);
        }
        notes.push(Note::EncodedNormals);
    }
    let length = |x: f32, y: f32, z: f32| (x * x + y * y + z * z).sqrt();
    let is_long = |length: f32| length.is_finite() && length > defect::LONG_NORMAL;
    let mut count = 0;
    let blocks = x.chunks_mut(BLOCK).zip(y.chunks_mut(BLOCK)).zip(z.chunks_mut(BLOCK));
    for ((x, y), z) in blocks {
        // Counting takes no branch, so that it is vector code; mostly there is nothing.
        let all = x.iter().zip(&*y).zip(&*z);
        let long = all.map(|((&x, &y), &z)| usize::from(is_long(length(x, y, z)))).sum::<usize>();
        if long == 0 {
            continue;
        }
        count += long;
        for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
            let length = length(*x, *y, *z);
            if is_long(length) {
                for component in [x, y, z] {
                    *component /= length;
                }
            }
        }
    }
    if count > 0 {
        notes.push(Note::LongNormals { count });
    }
    notes
}

/// Brings a feature that has bounds into them: what is derived from it follows.
fn bounded(feature: Feature, quantity: Quantity, components: &mut [Vec<f32>]) -> Option<Note> {
    let bounds = feature.row().bounds.filter(|_| quantity == Quantity::Value)?;
    let mut marked = vec![false; components.first().map_or(0, Vec::len)];
    for samples in components {
        defect::bound(samples, bounds, &mut marked);
    }
    let count = marked.into_iter().filter(|&marked| marked).count();
    (count > 0).then_some(Note::Bounded { feature, bounds, count })
}
