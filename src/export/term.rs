//! What a weight looks at of a pixel, as exports name it.

use std::collections::BTreeSet;

use crate::expr::feature::{Feature, FeatureRow, PlaneId, Quantity};
use crate::plan::WindowPlan;

/// One quantity of one feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Term {
    pub(super) feature: Feature,
    pub(super) quantity: Quantity,
}

impl Term {
    /// The terms that a plan reads, in the table's order.
    pub(super) fn of(plan: &WindowPlan) -> Vec<Self> {
        Self::of_planes(&plan.planes())
    }

    /// The terms of planes, in the table's order.
    pub(super) fn of_planes(planes: &BTreeSet<PlaneId>) -> Vec<Self> {
        let read = |&(feature, quantity): &(Feature, Quantity)| {
            planes.iter().any(|plane| (plane.feature, plane.quantity) == (feature, quantity))
        };
        let terms = Feature::terms().filter(read);
        terms.map(|(feature, quantity)| Self { feature, quantity }).collect()
    }

    /// The term of a plane.
    pub(super) fn of_plane(plane: PlaneId) -> Self {
        Self { feature: plane.feature, quantity: plane.quantity }
    }

    /// How programs spell it.
    pub(super) fn in_programs(self) -> &'static str {
        let term = self.row().term.filter(|_| self.quantity == Quantity::Value);
        term.unwrap_or_else(|| self.spelling())
    }

    /// How expressions spell it.
    pub(super) fn spelling(self) -> &'static str {
        self.feature.spelling(self.quantity).expect("trees read only what has a spelling")
    }

    /// What code calls it.
    pub(super) fn field(self) -> String {
        self.feature.identifier(self.quantity)
    }

    /// How many numbers it is.
    pub(super) fn components(self) -> usize {
        PlaneId::components(self.feature, self.quantity)
    }

    /// The feature's row.
    pub(super) fn row(self) -> &'static FeatureRow {
        self.feature.row()
    }

    /// Whether it is an image that the renderer supplies; else a kernel knows it
    /// from the pixel's place.
    pub(super) fn is_image(self) -> bool {
        self.feature != Feature::Pixel
    }
}
