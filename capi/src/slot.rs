//! What images of a filter can be: the result, the alpha, and what the library's feature table
//! has.

use std::fmt;

use tamis::expr::{Feature, Quantity};

use crate::error::Failure;

/// What an image is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Slot {
    /// The result.
    Output,
    /// How much of each pixel is covered.
    Alpha,
    /// A feature, or the variance of its mean.
    Feature(Feature, Quantity),
}

impl Slot {
    pub(crate) const COLOR: Self = Self::Feature(Feature::Color, Quantity::Value);
    pub(crate) const COLOR_VARIANCE: Self = Self::Feature(Feature::Color, Quantity::Variance);

    /// Every one there is.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        let stored = Feature::ALL.into_iter().filter(|feature| feature.is_stored());
        let quantities = |feature: Feature| {
            let variance = feature.row().variance.map(|_| Quantity::Variance);
            let quantities = [Some(Quantity::Value), variance].into_iter().flatten();
            quantities.map(move |quantity| Self::Feature(feature, quantity))
        };
        [Self::Output, Self::Alpha].into_iter().chain(stored.flat_map(quantities))
    }

    /// The one of a name.
    pub(crate) fn named(name: &str) -> Result<Self, Failure> {
        Self::all().find(|slot| slot.to_string() == name).ok_or_else(|| {
            let names: Vec<String> = Self::all().map(|slot| slot.to_string()).collect();
            let names = names.join(", ");
            Failure::argument(format!("there is no image `{name}`; images: {names}"))
        })
    }

    /// How many components of its pixels are read, or written.
    pub(crate) fn components(self) -> usize {
        match self {
            Self::Output => 3,
            Self::Alpha => 1,
            Self::Feature(feature, quantity) => feature.stored_width(quantity),
        }
    }
}

/// What C calls it.
impl fmt::Display for Slot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Output => f.write_str("output"),
            Self::Alpha => f.write_str("alpha"),
            Self::Feature(feature, Quantity::Variance) => write!(f, "{}Variance", feature.term()),
            Self::Feature(feature, Quantity::Value | Quantity::Gradient) => {
                f.write_str(feature.term())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_are_those_of_the_header() {
        for slot in Slot::all() {
            assert_eq!(Slot::named(&slot.to_string()).expect("its own name"), slot);
        }
        for (name, components) in [
            ("color", 3),
            ("colorVariance", 3),
            ("albedo", 3),
            ("albedoVariance", 1),
            ("normal", 3),
            ("depth", 1),
            ("position", 3),
            ("direct", 3),
            ("secondaryAlbedo", 3),
            ("alpha", 1),
            ("output", 3),
        ] {
            assert_eq!(Slot::named(name).expect(name).components(), components, "{name}");
        }
        let failure = Slot::named("colour").unwrap_err();
        assert!(failure.message.contains("color, colorVariance"), "{failure:?}");
    }

    /// Nobody looks up a name that the header does not have.
    #[test]
    fn the_header_names_every_image() {
        let header = include_str!("../include/tamis.h");
        for slot in Slot::all() {
            assert!(header.contains(&format!("`{slot}`")), "{slot}");
        }
    }
}
