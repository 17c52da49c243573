//! Which of a frame's channels feed which feature.
//!
//! Decided once per frame and *target* (a view, or a layer that is a picture of its own, such
//! as Blender's view layers), from names alone, in this order:
//!
//! 1. **What somebody says**: `--map`, and files that were named for a feature.
//! 2. **Prefixes.** Files put `ViewLayer.`, `beauty.` … before their layers. A
//!    prefix is whatever stands before a layer that some convention knows, with
//!    all its channels present; no prefix is always among them.
//! 3. **Convention and prefix** that together explain the most features win; of
//!    equals the earlier row of [`CONVENTIONS`], then no prefix, then the
//!    file's order. Every other prefix under which the winner names a colour is a target
//!    of its own; but where there are bare R, G and B, they are the colour.
//! 4. **The winner's names** are taken, best first. A name that means different things to
//!    different renderers counts only if the file has another that the winner alone uses.
//! 5. **What is still missing** may come from other conventions' names, in their
//!    order, under the winning prefix or none; but a channel that the winner
//!    knows the meaning of keeps it. (pbrt's `Variance.R` is not ours.)
//! 6. **A colour without a known name** is taken from the only RGB triple of the
//!    file, if there is but one.

mod index;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashSet};
use std::fmt;

use super::SceneError;
use super::listing::{Entry, Listing};
use super::naming::{CONVENTIONS, Convention, MOMENT, Spread, Way};
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::image::listing;
use index::Index;

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
    /// Whether the samples are second moments, which the square of the value is to be taken
    /// from first.
    pub is_moment: bool,
}

/// A quantity, and the channels that feed it.
pub(super) type Fed = ((Feature, Quantity), Source);

/// What somebody says that a layer is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Said {
    /// The feature, and its value or variance.
    pub term: (Feature, Quantity),
    /// The layer, or the channel of a feature one component wide.
    pub layer: String,
}

impl Said {
    /// Reads what somebody says of a layer, as `--map` takes it: `albedo=DiffuseFilter`.
    ///
    /// # Errors
    /// If it is no such text, or names no feature.
    pub fn read(text: &str) -> Result<Self, String> {
        let (term, layer) = text.split_once('=').ok_or("it must be FEATURE=LAYER")?;
        let (term, quantity) = match (term, term.strip_suffix(".variance")) {
            ("variance", _) => ("color", Quantity::Variance),
            (_, Some(term)) => (term, Quantity::Variance),
            ("colour", None) => ("color", Quantity::Value),
            (term, None) => (term, Quantity::Value),
        };
        let feature = Feature::parse(term)
            .filter(|&(feature, read)| feature.is_stored() && read == Quantity::Value);
        let Some((feature, _)) = feature else {
            return Err(format!(
                "`{term}` is no feature; there are color, albedo, normal, depth, position, direct and \
                 secondaryAlbedo, and `variance`"
            ));
        };
        if layer.is_empty() {
            return Err(format!("no layer is named for `{term}`"));
        }
        Ok(Self { term: (feature, quantity), layer: layer.to_owned() })
    }
}

/// What is mapped, of all that a frame holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// This view alone.
    pub view: Option<String>,
    /// This layer (Blender's view layer, say) alone.
    pub layer: Option<String>,
    /// What layers are.
    pub said: Vec<Said>,
    /// Samples per pixel, if somebody says so.
    pub samples: Option<u32>,
}

/// Which picture of a frame is meant; nothing if there is but one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Which {
    /// The view.
    pub view: Option<String>,
    /// The layer.
    pub layer: Option<String>,
}

impl fmt::Display for Which {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.view, &self.layer) {
            (Some(view), Some(layer)) => write!(f, "view `{view}`, layer `{layer}`"),
            (Some(view), None) => write!(f, "view `{view}`"),
            (None, Some(layer)) => write!(f, "layer `{layer}`"),
            (None, None) => Ok(()),
        }
    }
}

/// The sources of everything that a file provides.
#[derive(Clone, Debug)]
pub struct Mapping {
    which: Which,
    convention: &'static Convention,
    /// Whether a name in the file is the renderer's alone.
    is_certain: bool,
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
    /// Decides what the channels of a frame are, for every target that it holds: the best
    /// one first. There is at least one.
    ///
    /// # Errors
    /// If a view, a layer or a channel that was asked for is not there.
    pub fn all(listing: &Listing, selection: &Selection) -> Result<Vec<Self>, SceneError> {
        let views = listing.views();
        if let Some(view) = &selection.view
            && !views.contains(&view.as_str())
        {
            return Err(nothing(listing, "view", view, views.iter().map(|v| (*v).to_owned())));
        }
        let mut all = Vec::new();
        for (number, &view) in views.iter().enumerate() {
            if selection.view.as_ref().is_some_and(|wanted| wanted != view) {
                continue;
            }
            let index = Index::of(listing, number);
            let (convention, best) = index.best();
            let mut prefixes = vec![best];
            // Bare channels are what every program shows: where there are some, they are the
            // picture, and the only one.
            let others = !index.has(&CONVENTIONS[0], Feature::Color, "");
            prefixes.extend(index.prefixes.iter().map(String::as_str).filter(|&prefix| {
                others && prefix != best && index.has(convention, Feature::Color, prefix)
            }));
            for prefix in prefixes {
                let mut mapping = Self::under(convention, prefix, &index, listing, selection)?;
                let several = index.prefixes.len() > 1;
                mapping.which = Which {
                    view: (!view.is_empty()).then(|| view.to_owned()),
                    layer: index.spelling(prefix).filter(|_| several),
                };
                all.push(mapping);
            }
        }
        if let Some(layer) = &selection.layer {
            let names: Vec<String> =
                all.iter().filter_map(|mapping| mapping.which.layer.clone()).collect();
            let is_it = |mapping: &Self| {
                mapping.which.layer.as_ref().is_some_and(|name| name.eq_ignore_ascii_case(layer))
            };
            all.retain(is_it);
            if all.is_empty() {
                return Err(nothing(listing, "layer", layer, names.into_iter()));
            }
        }
        // A layer that is nothing but features is no target beside others that are pictures.
        if all.iter().any(|mapping| mapping.value(Feature::Color).is_some()) {
            all.retain(|mapping| mapping.value(Feature::Color).is_some());
        }
        // The only layer of a view needs no name.
        let views: Vec<Option<String>> = all.iter().map(|each| each.which.view.clone()).collect();
        for mapping in &mut all {
            let of_view = views.iter().filter(|view| **view == mapping.which.view).count();
            if of_view == 1 && selection.layer.is_none() {
                mapping.which.layer = None;
            }
        }
        Ok(all)
    }

    /// The best target of a file, nothing being said.
    #[cfg(test)]
    pub(crate) fn of(listing: &Listing) -> Self {
        let mut all = Self::all(listing, &Selection::default()).expect("nothing is asked for");
        all.swap_remove(0)
    }

    fn under(
        convention: &'static Convention,
        prefix: &str,
        index: &Index,
        listing: &Listing,
        selection: &Selection,
    ) -> Result<Self, SceneError> {
        let mut mapping = Self {
            which: Which::default(),
            convention,
            is_certain: index.has_own_name(convention, prefix),
            sources: BTreeMap::new(),
            unusable: Vec::new(),
        };
        let samples = selection.samples.or(listing.header().samples_per_pixel());
        let mut taking = Taking { index, samples, claimed: HashSet::new() };
        for said in &selection.said {
            let channels = index.said(prefix, said.term, &said.layer).ok_or_else(|| {
                if index.luminance(&said.layer.to_lowercase()) {
                    return SceneError::LuminanceChroma { path: listing.path().to_owned() };
                }
                let present = listing.entries().iter().map(|entry| entry.full.clone());
                nothing(listing, "layer", &said.layer, present)
            })?;
            taking.claimed.extend(channels.iter().cloned());
            mapping.sources.insert(said.term, Source::of(channels, "as you say"));
        }
        mapping.take_files(listing, &mut taking)?;
        let bare = ["r", "g", "b"].map(str::to_owned).to_vec();
        if !prefix.is_empty()
            && mapping.value(Feature::Color).is_none()
            && let Some(channels) = index.find("", &bare)
        {
            taking.claimed.extend(channels.iter().cloned());
            let source = Source::of(channels, convention.name);
            mapping.sources.insert((Feature::Color, Quantity::Value), source);
        }
        let prefixes = if prefix.is_empty() { vec![""] } else { vec![prefix, ""] };
        mapping.take(convention, &[prefix], &mut taking);
        for other in &CONVENTIONS {
            mapping.take(other, &prefixes, &mut taking);
        }
        mapping.take_moments(listing, &mut taking);
        let Self { sources, unusable, .. } = &mut mapping;
        unusable.retain(|v| !sources.contains_key(&(v.feature, Quantity::Variance)));
        if let Some(channels) = index.only_triple()
            && mapping.value(Feature::Color).is_none()
            && channels.iter().all(|channel| !taking.claimed.contains(channel))
        {
            let source = Source::of(channels, "the only RGB layer");
            mapping.sources.insert((Feature::Color, Quantity::Value), source);
        }
        Ok(mapping)
    }

    /// Takes features from files that were named for them.
    fn take_files(&mut self, listing: &Listing, taking: &mut Taking) -> Result<(), SceneError> {
        for feature in Feature::ALL {
            let said: Vec<&Entry> =
                listing.entries().iter().filter(|entry| entry.said == Some(feature)).collect();
            if said.is_empty() {
                continue;
            }
            let file = listing.place(&said[0].full).map_or(0, |(file, _)| file);
            let is_chroma = |entry: &&Entry| luminance_of(&entry.layer).is_some();
            if feature.width() > 1 && said.iter().any(is_chroma) {
                return Err(SceneError::LuminanceChroma { path: listing.file(file).to_owned() });
            }
            let channel = |suffixes: &[&str]| {
                suffixes
                    .iter()
                    .map(|suffix| {
                        let end = format!(".{suffix}");
                        said.iter()
                            .find(|entry| entry.layer.ends_with(&end) || entry.layer == *suffix)
                    })
                    .collect::<Option<Vec<_>>>()
            };
            let wide: &[&[&str]] = &[&["r", "g", "b"], &["x", "y", "z"], &["red", "green", "blue"]];
            let single: &[&[&str]] = &[&["z"], &["v"], &["y"], &["t"], &["r"], &["red"]];
            let ways = if feature.width() == 3 { wide } else { single };
            let found = ways.iter().find_map(|way| channel(way));
            // Whatever a file for one number per pixel has, its first channel is that number.
            let found = found.or_else(|| (feature.width() == 1).then(|| vec![&said[0]]));
            let channels: Vec<String> = match found {
                Some(entries) => entries.iter().map(|entry| entry.full.clone()).collect(),
                None if said.len() == feature.width() => {
                    said.iter().map(|entry| entry.full.clone()).collect()
                }
                None => {
                    return Err(SceneError::NotInFile {
                        path: listing.file(file).to_owned(),
                        what: "layer of three channels for",
                        name: feature.row().title.to_owned(),
                        present: said.iter().map(|e| e.full.clone()).collect::<Vec<_>>().join(", "),
                    });
                }
            };
            taking.claimed.extend(channels.iter().cloned());
            let source = Source::of(channels, "a file of its own");
            self.sources.insert((feature, Quantity::Value), source);
        }
        Ok(())
    }

    /// Fills gaps from one convention's names.
    fn take(&mut self, convention: &'static Convention, prefixes: &[&str], taking: &mut Taking) {
        let is_certain = std::ptr::eq(convention, self.convention)
            && prefixes.iter().any(|prefix| taking.index.has_own_name(convention, prefix));
        let free = |way: &Way, taking: &Taking| {
            if way.is_ambiguous && !is_certain {
                return None;
            }
            let mut found =
                prefixes.iter().filter_map(|prefix| taking.index.find(prefix, &way.channels));
            found.find(|channels| channels.iter().all(|name| !taking.claimed.contains(name)))
        };
        for feature in Feature::ALL {
            if self.value(feature).is_some() {
                continue;
            }
            let ways = convention.value(feature);
            if let Some(channels) = ways.iter().find_map(|way| free(way, taking)) {
                taking.claimed.extend(channels.iter().cloned());
                let source = Source::of(channels, convention.name);
                self.sources.insert((feature, Quantity::Value), source);
            }
        }
        for feature in Feature::ALL {
            for way in convention.variance(feature) {
                let Some(channels) = free(&way, taking) else { continue };
                taking.claimed.extend(channels.iter().cloned());
                self.take_variance(convention, feature, channels, way.spread, taking.samples);
            }
        }
    }

    /// Takes variances from second moments of what was found.
    fn take_moments(&mut self, listing: &Listing, taking: &mut Taking) {
        for feature in Feature::ALL {
            let Some(value) = self.value(feature) else { continue };
            let moments = value.channels.iter().map(|name| {
                let entry = listing.entries().iter().find(|entry| entry.full == *name)?;
                let moment = format!("{MOMENT}{}", entry.layer);
                taking.index.names.get(moment.as_str()).map(|&name| name.to_owned())
            });
            let Some(channels) = moments.collect::<Option<Vec<String>>>() else { continue };
            taking.claimed.extend(channels.iter().cloned());
            let reason = match taking.samples {
                Some(samples) if samples > 1 => {
                    let divisor = (samples - 1) as f32;
                    let source = Source::of(channels, "second moments");
                    let source = Source { divisor, is_moment: true, ..source };
                    self.sources.entry((feature, Quantity::Variance)).or_insert(source);
                    continue;
                }
                Some(_) => "one sample has no variance",
                None => {
                    "they are means of squares, and the file does not say how many samples a \
                     pixel has: `--samples` does"
                }
            };
            self.unusable.push(Unusable { feature, channels, reason });
        }
    }

    fn take_variance(
        &mut self,
        convention: &'static Convention,
        feature: Feature,
        channels: Vec<String>,
        spread: Spread,
        samples: Option<u32>,
    ) {
        let divisor = match (spread, samples) {
            (Spread::OfMean, _) => Ok(1.0),
            (Spread::PerSample, Some(samples)) => Ok(samples as f32),
            (Spread::PerSample, None) => {
                Err("it is that of one sample, and the file does not say how many samples a \
                     pixel has: `--samples` does")
            }
            (Spread::Unclear, _) => Err("the renderer does not say what it is the variance of"),
        };
        match divisor {
            Ok(divisor) => {
                let source = Source { divisor, ..Source::of(channels, convention.name) };
                self.sources.entry((feature, Quantity::Variance)).or_insert(source);
            }
            Err(reason) => self.unusable.push(Unusable { feature, channels, reason }),
        }
    }

    /// Which picture of the frame it is of.
    pub fn which(&self) -> &Which {
        &self.which
    }

    /// The renderer, if names tell that it is no other.
    pub fn renderer(&self) -> Option<&'static str> {
        (self.is_certain && !self.convention.switches.is_empty()).then_some(self.convention.name)
    }

    /// What a user switches on in the renderer for more features; nothing if nobody knows.
    pub fn switches(&self) -> &'static str {
        if self.is_certain { self.convention.switches } else { "" }
    }

    /// What the renderer calls a feature's layers, if names tell the renderer; of other
    /// files nobody knows.
    pub fn names(&self, feature: Feature) -> Vec<String> {
        let layers = self.convention.layers(feature).into_iter();
        layers.filter(|_| self.renderer().is_some()).map(str::to_owned).collect()
    }

    /// The convention that explains the file best.
    pub fn convention(&self) -> &'static str {
        self.convention.name
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
    pub fn color(&self, files: &Listing) -> Result<&Source, SceneError> {
        self.value(Feature::Color).ok_or_else(|| {
            let path = files.path().to_owned();
            let names = || files.entries().iter().map(|entry| entry.layer.as_str());
            let has_chroma = names().filter_map(luminance_of).any(|y| names().any(|n| n == y));
            match has_chroma {
                true => SceneError::LuminanceChroma { path },
                false => SceneError::MissingColor { path, present: layers_of(files) },
            }
        })
    }
}

impl Source {
    fn of(channels: Vec<String>, convention: &'static str) -> Self {
        Self { channels, convention, divisor: 1.0, is_moment: false }
    }
}

/// The layers of three channels, or if there is none, the channels.
fn layers_of(files: &Listing) -> String {
    let ends = [".R", ".r", ".red", ".X"];
    let entries = || files.entries().iter().map(|entry| entry.full.as_str());
    let layers: Vec<&str> =
        entries().filter_map(|name| ends.iter().find_map(|end| name.strip_suffix(end))).collect();
    match layers.is_empty() {
        true => files.listing(),
        false => format!("the layers {}", listing(layers.into_iter())),
    }
}

/// The luminance that a channel would be the chroma of; names are in lower case.
fn luminance_of(layer: &str) -> Option<String> {
    let prefix = layer.strip_suffix("ry").or_else(|| layer.strip_suffix("by"))?;
    (prefix.is_empty() || prefix.ends_with('.')).then(|| format!("{prefix}y"))
}

/// The error for what was asked for and is not there.
fn nothing(
    files: &Listing,
    what: &'static str,
    name: &str,
    present: impl Iterator<Item = String>,
) -> SceneError {
    let mut present: Vec<String> = present.filter(|name| !name.is_empty()).collect();
    present.dedup();
    SceneError::NotInFile {
        path: files.path().to_owned(),
        what,
        name: name.to_owned(),
        present: match present.is_empty() {
            true => "none by name".to_owned(),
            false => listing(present.iter().map(String::as_str)),
        },
    }
}

/// What is known while channels are taken.
struct Taking<'a> {
    index: &'a Index<'a>,
    samples: Option<u32>,
    claimed: HashSet<String>,
}

/// Every name that a feature would have been taken from, as text.
pub(super) fn looked_for(feature: Feature) -> String {
    let rows = CONVENTIONS.iter().filter_map(|convention| {
        let layers = convention.layers(feature);
        (!layers.is_empty()).then(|| format!("{} ({})", layers.join(", "), convention.name))
    });
    rows.collect::<Vec<_>>().join("; ")
}
