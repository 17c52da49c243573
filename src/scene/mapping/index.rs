//! The names of a view's layers, and what is found by them.

use std::collections::HashMap;

use super::super::listing::Listing;
use super::super::naming::{CONVENTIONS, Candidate, Convention, MOMENT, expand, is_data};
use crate::expr::feature::{Feature, Quantity};

/// The layers' names of a view, ready to be looked up without regard to case.
pub(super) struct Index<'a> {
    /// Layer's name to full name; of duplicates the first.
    pub(super) names: HashMap<&'a str, &'a str>,
    /// In lower case, the empty one first, then in the file's order.
    pub(super) prefixes: Vec<String>,
}

impl<'a> Index<'a> {
    pub(super) fn of(listing: &'a Listing, view: usize) -> Self {
        let entries = || listing.entries().iter().filter(|entry| entry.view == view);
        let mut names = HashMap::new();
        for entry in entries().filter(|entry| entry.said.is_none()) {
            names.entry(entry.layer.as_str()).or_insert(entry.full.as_str());
        }
        let mut index = Self { names, prefixes: vec![String::new()] };
        let ways: Vec<Candidate> = CONVENTIONS
            .iter()
            .flat_map(|row| Feature::ALL.into_iter().flat_map(|feature| row.value(feature)))
            .map(|way| way.channels)
            // A bare name stands after any dot: it says nothing about prefixes.
            .filter(|way| way[0].contains('.'))
            .collect();
        for entry in entries() {
            for way in &ways {
                if let Some(prefix) = entry.layer.strip_suffix(way[0].as_str())
                    && prefix.ends_with('.')
                    && !prefix.starts_with(MOMENT)
                    && index.find(prefix, way).is_some()
                    && !index.prefixes.iter().any(|known| known == prefix)
                {
                    index.prefixes.push(prefix.to_owned());
                }
            }
        }
        index
    }

    /// The full names of a candidate's channels, if all of them are there.
    pub(super) fn find(&self, prefix: &str, candidate: &Candidate) -> Option<Vec<String>> {
        // A Z beside X and Y is no depth, a Y beside X no luminance, and a luminance beside its
        // chroma no grey image.
        if let [name] = candidate.as_slice()
            && let full = format!("{prefix}{name}")
            && let Some(layer) = full.strip_suffix(['y', 'z'])
            && (layer.is_empty() || layer.ends_with('.'))
            && (self.names.contains_key(format!("{layer}x").as_str()) || self.luminance(&full))
        {
            return None;
        }
        let spelled = |name: &String| self.names.get(format!("{prefix}{name}").as_str());
        candidate.iter().map(|name| spelled(name).map(|&name| name.to_owned())).collect()
    }

    /// Whether a channel, or a layer's, is a luminance that has its chroma beside it: the two
    /// make a coloured image, and neither is one.
    pub(super) fn luminance(&self, name: &str) -> bool {
        let layer = match name.strip_suffix('y') {
            Some(layer) if layer.is_empty() || layer.ends_with('.') => layer.to_owned(),
            _ => format!("{name}."),
        };
        let has = |component: &str| self.names.contains_key(format!("{layer}{component}").as_str());
        has("y") && (has("ry") || has("by"))
    }

    pub(super) fn has(&self, convention: &Convention, feature: Feature, prefix: &str) -> bool {
        let certain = convention.value(feature).into_iter().filter(|way| !way.is_ambiguous);
        certain.into_iter().any(|way| self.find(prefix, &way.channels).is_some())
    }

    /// Whether the file has a name under this prefix that no other convention has.
    pub(super) fn has_own_name(&self, convention: &Convention, prefix: &str) -> bool {
        Feature::ALL.into_iter().any(|feature| {
            let ways = convention.value(feature).into_iter();
            let mut found = ways.filter(|way| self.find(prefix, &way.channels).is_some());
            found.any(|way| convention.has_alone(&way, feature))
        })
    }

    /// The convention and prefix that explain the most features.
    pub(super) fn best(&self) -> (&'static Convention, &str) {
        let mut best = (&CONVENTIONS[0], "");
        let mut most = 0;
        for convention in &CONVENTIONS {
            for prefix in &self.prefixes {
                let known = |feature: &Feature| self.has(convention, *feature, prefix);
                let count = Feature::ALL.iter().filter(|feature| known(feature)).count();
                if count > most {
                    (best, most) = ((convention, prefix.as_str()), count);
                }
            }
        }
        best
    }

    /// The channels of what somebody says, under a prefix or none.
    pub(super) fn said(
        &self,
        prefix: &str,
        (feature, quantity): (Feature, Quantity),
        layer: &str,
    ) -> Option<Vec<String>> {
        let layer = layer.to_lowercase();
        let mut ways = expand(&layer, feature.width());
        if quantity == Quantity::Variance || feature == Feature::Color {
            ways.extend(expand(&layer, 1));
        }
        ways.iter().find_map(|way| self.find(prefix, way).or_else(|| self.find("", way)))
    }

    /// A prefix as the file spells it, without its last dot; nothing if it is empty.
    pub(super) fn spelling(&self, prefix: &str) -> Option<String> {
        let length = prefix.strip_suffix('.')?.len();
        let (layer, full) = self.names.iter().find(|(layer, _)| layer.starts_with(prefix))?;
        // A full name that lost its view on the way is told in lower case.
        let is_same = full.len() == layer.len() && full.is_char_boundary(length);
        Some(if is_same { full[..length].to_owned() } else { layer[..length].to_owned() })
    }

    /// The file's only channels called R, G and B, under whatever prefix.
    pub(super) fn only_triple(&self) -> Option<Vec<String>> {
        let triples: Vec<Vec<String>> = self
            .names
            .keys()
            .filter_map(|name| name.strip_suffix('r'))
            .filter(|prefix| prefix.is_empty() || prefix.ends_with('.'))
            .filter(|prefix| !is_data(prefix.trim_end_matches('.')))
            .filter_map(|prefix| self.find(prefix, &["r", "g", "b"].map(str::to_owned).to_vec()))
            .collect();
        match <[Vec<String>; 1]>::try_from(triples) {
            Ok([triple]) => Some(triple),
            Err(_) => None,
        }
    }
}
