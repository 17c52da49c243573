//! Which of a file's channels feed which feature.
//!
//! Decided once per file, from names alone, in this order:
//!
//! 1. **Prefixes.** Files put `ViewLayer.`, `beauty.` … before their layers. A
//!    prefix is whatever stands before a layer that some convention knows, with
//!    all its channels present; no prefix is always among them.
//! 2. **Convention and prefix** that together explain the most features win; of
//!    equals the earlier row of [`CONVENTIONS`], then no prefix, then the
//!    file's order. So of several view layers one is used as a whole.
//! 3. **The winner's names** are taken, best first.
//! 4. **What is still missing** may come from other conventions' names, in their
//!    order, under the winning prefix or none; but a channel that the winner
//!    knows the meaning of keeps it. (pbrt's `Variance.R` is not ours.)
//! 5. **A colour without a known name** is taken from the only RGB triple of the
//!    file, if there is but one.

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap, HashSet};

use super::SceneError;
use super::naming::{CONVENTIONS, Candidate, Convention, Spread};
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::image::exr::Header;

/// Where a feature's value or variance comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Full channel names: one per component, or one for a variance.
    pub channels: Vec<String>,
    /// Whose names they are.
    pub convention: &'static str,
    /// What the samples are divided by: the samples per pixel for variances of
    /// single samples, else 1.
    pub divisor: f32,
}

/// The sources of everything that a file provides.
#[derive(Clone, Debug)]
pub struct Mapping {
    convention: &'static str,
    sources: BTreeMap<(Feature, Quantity), Source>,
    unusable: Vec<Unusable>,
}

/// A variance that the file holds but that cannot be used.
#[derive(Clone, Debug, PartialEq)]
pub struct Unusable {
    /// Whose variance.
    pub feature: Feature,
    /// The channels that hold it.
    pub channels: Vec<String>,
    /// Why not.
    pub reason: &'static str,
}

impl Mapping {
    /// Decides what the channels of a file are.
    pub fn of(header: &Header) -> Self {
        let index = Index::of(header);
        let (convention, prefix) = index.best();
        let mut mapping =
            Self { convention: convention.name, sources: BTreeMap::new(), unusable: Vec::new() };
        let mut claimed = HashSet::new();
        let prefixes = if prefix.is_empty() { vec![""] } else { vec![prefix, ""] };
        mapping.take(convention, &[prefix], &index, header, &mut claimed);
        for other in &CONVENTIONS {
            mapping.take(other, &prefixes, &index, header, &mut claimed);
        }
        let Self { sources, unusable, .. } = &mut mapping;
        unusable.retain(|v| !sources.contains_key(&(v.feature, Quantity::Variance)));
        if let Some(channels) = index.only_triple()
            && mapping.value(Feature::Color).is_none()
            && channels.iter().all(|channel| !claimed.contains(channel))
        {
            let source = Source { channels, convention: "the only RGB layer", divisor: 1.0 };
            mapping.sources.insert((Feature::Color, Quantity::Value), source);
        }
        mapping
    }

    /// Fills gaps from one convention's names.
    fn take(
        &mut self,
        convention: &'static Convention,
        prefixes: &[&str],
        index: &Index,
        header: &Header,
        claimed: &mut HashSet<String>,
    ) {
        let free = |candidate: &Candidate, claimed: &HashSet<String>| {
            let mut found = prefixes.iter().filter_map(|prefix| index.find(prefix, candidate));
            found.find(|channels| channels.iter().all(|channel| !claimed.contains(channel)))
        };
        for feature in Feature::ALL {
            if self.value(feature).is_some() {
                continue;
            }
            let ways = convention.value(feature);
            if let Some(channels) = ways.iter().find_map(|way| free(way, claimed)) {
                claimed.extend(channels.iter().cloned());
                let source = Source { channels, convention: convention.name, divisor: 1.0 };
                self.sources.insert((feature, Quantity::Value), source);
            }
        }
        for feature in Feature::ALL {
            for (way, spread) in convention.variance(feature) {
                let Some(channels) = free(&way, claimed) else { continue };
                claimed.extend(channels.iter().cloned());
                self.take_variance(convention, feature, channels, spread, header);
            }
        }
    }

    fn take_variance(
        &mut self,
        convention: &'static Convention,
        feature: Feature,
        channels: Vec<String>,
        spread: Spread,
        header: &Header,
    ) {
        let divisor = match (spread, header.samples_per_pixel()) {
            (Spread::OfMean, _) => Ok(1.0),
            (Spread::PerSample, Some(spp)) => Ok(spp as f32),
            (Spread::PerSample, None) => {
                Err("it is the variance of one sample, and the file does \
                 not say how many samples a pixel has")
            }
            (Spread::Unclear, _) => Err("the renderer does not say what it is the variance of"),
        };
        match divisor {
            Ok(divisor) => {
                let source = Source { channels, convention: convention.name, divisor };
                self.sources.entry((feature, Quantity::Variance)).or_insert(source);
            }
            Err(reason) => self.unusable.push(Unusable { feature, channels, reason }),
        }
    }

    /// The convention that explains the file best.
    pub fn convention(&self) -> &'static str {
        self.convention
    }

    /// Where a feature's value comes from, if the file holds it.
    pub fn value(&self, feature: Feature) -> Option<&Source> {
        self.sources.get(&(feature, Quantity::Value))
    }

    /// Where a feature's variance comes from, if the file holds one.
    pub fn variance(&self, feature: Feature) -> Option<&Source> {
        self.sources.get(&(feature, Quantity::Variance))
    }

    /// Whether a scene that is loaded from the file has this plane. Gradients are made of
    /// values, and so are variances that the file does not hold.
    pub fn provides(&self, PlaneId { feature, quantity, .. }: PlaneId) -> bool {
        match quantity {
            Quantity::Value | Quantity::Gradient => {
                !feature.is_stored() || self.value(feature).is_some()
            }
            Quantity::Variance => self.value(feature).is_some() || self.variance(feature).is_some(),
        }
    }

    /// Every source.
    pub fn sources(&self) -> impl Iterator<Item = (Feature, Quantity, &Source)> {
        self.sources.iter().map(|(&(feature, quantity), source)| (feature, quantity, source))
    }

    /// Variances that the file holds but that cannot be used, with the reason.
    pub fn unusable(&self) -> &[Unusable] {
        &self.unusable
    }

    /// The colour's source.
    ///
    /// # Errors
    /// If the file has none.
    pub fn color(&self, header: &Header) -> Result<&Source, SceneError> {
        self.value(Feature::Color).ok_or_else(|| SceneError::MissingColor {
            path: header.path().to_owned(),
            looked_for: looked_for(Feature::Color),
            present: header.listing(),
        })
    }
}

/// Every name that a feature would have been taken from, as text.
pub(super) fn looked_for(feature: Feature) -> String {
    let rows = CONVENTIONS.iter().filter_map(|convention| {
        let layers = convention.layers(feature);
        (!layers.is_empty()).then(|| format!("{} ({})", layers.join(", "), convention.name))
    });
    rows.collect::<Vec<_>>().join("; ")
}

/// A file's names, ready to be looked up without regard to case.
struct Index<'a> {
    /// Lower case to the file's spelling; of duplicates the first.
    names: HashMap<String, &'a str>,
    /// In lower case, the empty one first, then in the file's order.
    prefixes: Vec<String>,
}

impl<'a> Index<'a> {
    fn of(header: &'a Header) -> Self {
        let mut names = HashMap::new();
        let mut order = Vec::new();
        for name in header.names() {
            let lower = name.to_lowercase();
            order.push(lower.clone());
            names.entry(lower).or_insert(name);
        }
        let mut index = Self { names, prefixes: vec![String::new()] };
        let ways: Vec<Candidate> = CONVENTIONS
            .iter()
            .flat_map(|row| Feature::ALL.into_iter().flat_map(|feature| row.value(feature)))
            // A bare name stands after any dot: it says nothing about prefixes.
            .filter(|way| way[0].contains('.'))
            .collect();
        for name in &order {
            for way in &ways {
                if let Some(prefix) = name.strip_suffix(way[0].as_str())
                    && prefix.ends_with('.')
                    && index.find(prefix, way).is_some()
                    && !index.prefixes.iter().any(|known| known == prefix)
                {
                    index.prefixes.push(prefix.to_owned());
                }
            }
        }
        index
    }

    /// The file's spelling of a candidate's channels, if it has all of them.
    fn find(&self, prefix: &str, candidate: &Candidate) -> Option<Vec<String>> {
        let spelled = |name: &String| self.names.get(&format!("{prefix}{name}"));
        candidate.iter().map(|name| spelled(name).map(|&name| name.to_owned())).collect()
    }

    /// The convention and prefix that explain the most features.
    fn best(&self) -> (&'static Convention, &str) {
        let mut best = (&CONVENTIONS[0], "");
        let mut most = 0;
        for convention in &CONVENTIONS {
            for prefix in &self.prefixes {
                let known = |feature: &Feature| {
                    convention.value(*feature).iter().any(|way| self.find(prefix, way).is_some())
                };
                let count = Feature::ALL.iter().filter(|feature| known(feature)).count();
                if count > most {
                    (best, most) = ((convention, prefix.as_str()), count);
                }
            }
        }
        best
    }

    /// The file's only channels called R, G and B, under whatever prefix.
    fn only_triple(&self) -> Option<Vec<String>> {
        let triples: Vec<Vec<String>> = self
            .names
            .keys()
            .filter_map(|name| name.strip_suffix('r'))
            .filter(|prefix| prefix.is_empty() || prefix.ends_with('.'))
            .filter_map(|prefix| self.find(prefix, &["r", "g", "b"].map(str::to_owned).to_vec()))
            .collect();
        match <[Vec<String>; 1]>::try_from(triples) {
            Ok([triple]) => Some(triple),
            Err(_) => None,
        }
    }
}
