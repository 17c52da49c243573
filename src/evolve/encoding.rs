//! How trees and fitness values are written, so that reading gives them back
//! exactly: what is resumed must be what was interrupted.

/// Trees as the text of the expression language.
pub(super) mod expression {
    use serde::{Deserialize, Deserializer, Serializer, de};

    use crate::expr::{Tree, text};

    pub(in crate::evolve) fn serialize<S: Serializer>(
        tree: &Tree,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_str(tree)
    }

    pub(in crate::evolve) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Tree, D::Error> {
        let written = String::deserialize(deserializer)?;
        text::parse_scalar(&written).map_err(de::Error::custom)
    }
}

/// Floating-point numbers as their shortest exact decimals, in quotes: JSON has
/// no infinity, and its readers may be an ulp off.
pub(super) mod exact {
    use serde::{Deserialize, Deserializer, Serializer, de};

    pub(in crate::evolve) fn serialize<S: Serializer>(
        value: &f64,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_str(value)
    }

    pub(in crate::evolve) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<f64, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}
