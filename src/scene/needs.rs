//! Which planes are wanted, and which raw features they come from.

use std::collections::BTreeSet;

use super::mapping::Mapping;
use super::normalize::ColorScale;
use crate::expr::feature::{Feature, PlaneId, Quantity};

/// The planes that a filter reads. What nobody needs is not decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Needs {
    /// `None`: whatever there is.
    planes: Option<BTreeSet<PlaneId>>,
}

impl Needs {
    /// Every plane that a file can provide.
    pub fn everything() -> Self {
        Self { planes: None }
    }

    /// The colour to be averaged, and no plane for weights.
    pub fn nothing() -> Self {
        Self { planes: Some(BTreeSet::new()) }
    }

    /// Exactly these planes.
    pub fn planes(planes: impl IntoIterator<Item = PlaneId>) -> Self {
        Self { planes: Some(planes.into_iter().collect()) }
    }

    /// All components of these quantities.
    pub fn terms(terms: impl IntoIterator<Item = (Feature, Quantity)>) -> Self {
        Self::planes(terms.into_iter().flat_map(|(f, q)| PlaneId::of(f, q)))
    }

    /// Whether a plane is wanted.
    pub fn includes(&self, id: PlaneId) -> bool {
        self.planes.as_ref().is_none_or(|planes| planes.contains(&id))
    }

    /// Whether any component of a quantity is wanted.
    pub fn wants(&self, feature: Feature, quantity: Quantity) -> bool {
        PlaneId::of(feature, quantity).any(|id| self.includes(id))
            && feature.spelling(quantity).is_some()
    }

    /// The planes named; `None` where everything is wanted.
    pub fn named(&self) -> Option<&BTreeSet<PlaneId>> {
        self.planes.as_ref()
    }

    /// What either needs.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        let planes = match (self.planes, other.planes) {
            (Some(a), Some(b)) => Some(a.into_iter().chain(b).collect()),
            (None, _) | (_, None) => None,
        };
        Self { planes }
    }

    /// The stored quantities (values and variances) that these planes are made
    /// from, of those that the file has. Beside the obvious ones:
    ///
    /// - the colour, always: it is what a filter averages, and the exposure;
    /// - a feature's value for its variance, where that must be estimated or
    ///   follows a compression;
    /// - the colour's variance for whether it was measured, and for grain;
    /// - positions for anything about depth, and for their own variance: they
    ///   tell the extent;
    /// - for positions, what tells where nothing was hit: depth if the file has
    ///   it, else normals.
    ///
    /// So what a plane holds never depends on which other planes are wanted.
    pub(super) fn stored(
        &self,
        mapping: &Mapping,
        color_scale: ColorScale,
    ) -> BTreeSet<(Feature, Quantity)> {
        let has = |feature, quantity| match quantity {
            Quantity::Value => mapping.value(feature).is_some(),
            Quantity::Variance => mapping.variance(feature).is_some(),
            Quantity::Gradient => false,
        };
        let is_moment = |feature| mapping.variance(feature).is_some_and(|source| source.is_moment);
        self.stored_of(&has, &is_moment, color_scale)
    }

    /// The values and variances that [`RawScene::prepare`](super::RawScene::prepare) makes these
    /// planes of, where `has` says what there is.
    pub fn raw(
        &self,
        has: &dyn Fn(Feature, Quantity) -> bool,
        color_scale: ColorScale,
    ) -> BTreeSet<(Feature, Quantity)> {
        self.stored_of(has, &|_| false, color_scale)
    }

    /// The same where `is_moment` says whose variances are second moments.
    fn stored_of(
        &self,
        has: &dyn Fn(Feature, Quantity) -> bool,
        is_moment: &dyn Fn(Feature) -> bool,
        color_scale: ColorScale,
    ) -> BTreeSet<(Feature, Quantity)> {
        let mut stored = BTreeSet::from([(Feature::Color, Quantity::Value)]);
        for feature in Feature::ALL {
            if self.wants(feature, Quantity::Value) || self.wants(feature, Quantity::Gradient) {
                stored.insert((feature, Quantity::Value));
            }
            if self.wants(feature, Quantity::Variance) {
                let follows =
                    feature == Feature::DirIllumination && color_scale == ColorScale::Compressed;
                if !has(feature, Quantity::Variance) || follows || is_moment(feature) {
                    stored.insert((feature, Quantity::Value));
                }
                stored.insert((feature, Quantity::Variance));
            }
        }
        let tells = [Feature::Measured, Feature::Grain];
        if tells.into_iter().any(|feature| self.wants(feature, Quantity::Value)) {
            stored.insert((Feature::Color, Quantity::Variance));
        }
        let reads = |stored: &BTreeSet<(Feature, Quantity)>, feature| {
            stored.iter().any(|&(stored, _)| stored == feature)
        };
        if reads(&stored, Feature::WorldPosition) || reads(&stored, Feature::Depth) {
            stored.insert((Feature::WorldPosition, Quantity::Value));
            let evidence = [Feature::Depth, Feature::Normal];
            let evidence = evidence.into_iter().find(|&feature| has(feature, Quantity::Value));
            stored.extend(evidence.map(|feature| (feature, Quantity::Value)));
        }
        stored.retain(|&(feature, quantity)| has(feature, quantity));
        stored
    }
}
