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
    /// Gathers them. Codebook entries that read what is forbidden, or are of operators
    /// that are not in the primitive set, are left out; an initial expression that
    /// does or is, or is too large, is an error.
    pub fn new(settings: &Settings) -> Result<Self, Error> {
        let mut forbidden = Vec::new();
        for name in &settings.forbidden {
            forbidden.push(Feature::parse(name).ok_or_else(|| Error::Setting {
                name: "forbidden",
                value: format!("`{name}`"),
                wanted: "it must name features, gradients or variances",
            })?);
        }
        let vocabulary = Vocabulary::of(settings.primitives, |feature, quantity| {
            !forbidden.contains(&(feature, quantity))
        });

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
            return Err(refused(
                "it must be of the operators of `primitives`, and not read what `forbidden` names",
            ));
        }
        if !settings.admit(&initial) {
            return Err(refused(
                "it must fit into `max_nodes` and `max_depth`, and look at `pixel` through distances alone",
            ));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evolve::mutation::mutate;
    use crate::evolve::settings::Preset;
    use crate::tune::stream;

    #[test]
    fn what_is_forbidden_never_appears() {
        let settings = Settings {
            forbidden: ["secTexture", "cVariance", "tGradient"].map(str::to_owned).into(),
            ..Preset::Weights.settings()
        };
        let materials = Materials::new(&settings).unwrap();
        let mut rng = stream(1, 0, 0, 0);
        let mut tree = materials.initial().clone();
        for _ in 0..2000 {
            tree = mutate(&tree, &materials, &settings, &mut rng);
            let text = tree.to_string();
            assert!(!settings.forbidden.iter().any(|name| text.contains(name)), "{text}");
        }
    }

    #[test]
    fn an_initial_expression_that_cannot_be_is_refused() {
        let refused = |change: fn(&mut Settings)| {
            let mut settings = Preset::Weights.settings();
            change(&mut settings);
            Materials::new(&settings).unwrap_err().to_string()
        };
        assert!(refused(|s| s.initial = "bilatral".to_owned()).contains("neither a filter's name"));
        assert!(refused(|s| s.initial = "normal".to_owned()).contains("nor an expression"));
        assert!(refused(|s| s.forbidden = vec!["color".to_owned()]).contains("what `forbidden`"));
        assert!(refused(|s| s.forbidden = vec!["colour".to_owned()]).contains("`colour`"));
        assert!(refused(|s| s.max_nodes = 3).contains("fit into `max_nodes`"));
    }
}
