//! What expressions are made of: vocabulary, codebook, initial expression.

use super::error::Error;
use super::settings::Settings;
use crate::expr::codebook::{codebook, named};
use crate::expr::grammar::Vocabulary;
use crate::expr::{Feature, Tree, text};

/// What a search's settings say that expressions are made of.
#[derive(Clone, Debug)]
pub struct Materials {
    vocabulary: Vocabulary,
    codebook: Vec<Tree>,
    initial: Tree,
}

impl Materials {
    /// Gathers them. Codebook entries that read what is forbidden are left out;
    /// an initial expression that does, or is too large, is an error.
    pub fn new(settings: &Settings) -> Result<Self, Error> {
        let mut forbidden = Vec::new();
        for name in &settings.forbidden {
            forbidden.push(Feature::parse(name).ok_or_else(|| Error::Setting {
                name: "forbidden",
                value: format!("`{name}`"),
                wanted: "it must name features, gradients or variances",
            })?);
        }
        let vocabulary =
            Vocabulary::of(|feature, quantity| !forbidden.contains(&(feature, quantity)));

        let initial = match named(&settings.initial) {
            Some(tree) => tree.clone(),
            None => text::parse_scalar(&settings.initial).map_err(Error::Initial)?,
        };
        let refused = |wanted| Error::Setting {
            name: "initial",
            value: format!("`{}`", settings.initial),
            wanted,
        };
        if !vocabulary.covers(&initial) {
            return Err(refused("it must not read what `forbidden` names"));
        }
        if !settings.admit(&initial) {
            return Err(refused("it must fit into `max_nodes` and `max_depth`"));
        }

        let codebook =
            codebook().iter().filter(|entry| vocabulary.covers(entry)).cloned().collect();
        Ok(Self { vocabulary, codebook, initial })
    }

    /// The symbols of the grammar (Figure 2).
    pub fn vocabulary(&self) -> &Vocabulary {
        &self.vocabulary
    }

    /// The codebook's expressions (Section 4.2), all of them scalar.
    pub fn codebook(&self) -> &[Tree] {
        &self.codebook
    }

    /// What the initial population is made from.
    pub fn initial(&self) -> &Tree {
        &self.initial
    }
}
