//! One picture of a frame, and what feeds its features.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use glob::Pattern;

use super::SceneError;
use super::listing::{Aux, Listing};
use super::mapping::{Fed, Mapping, Selection};
use super::naming::is_data;
use crate::expr::feature::{Feature, Quantity};
use crate::image::exr::{Attributes, Sink, Unfinished, Window};
use crate::image::{ImageError, files};

/// One picture of a frame (its only one, a view, a view layer) with where its features are.
#[derive(Clone, Debug)]
pub struct Target {
    listing: Arc<Listing>,
    mapping: Mapping,
}

/// The channels of a layer that is filtered by the colour's weights.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LayerChannels {
    /// What people call it.
    pub name: String,
    /// The full names of its three channels; one name thrice if it has but one.
    pub channels: [String; 3],
}

/// What was decoded of a target.
pub(super) struct Read {
    pub(super) window: Window,
    pub(super) attributes: Option<Attributes>,
    /// Of each channel what its file lacks, counted from the window's corner.
    pub(super) missing: Vec<Vec<Window>>,
}

impl Target {
    /// Every picture of the frame at `path`, with features in other files if there are any;
    /// the best one first. There is at least one.
    ///
    /// # Errors
    /// If a file cannot be read, or what is selected is not there.
    pub fn all(path: &Path, aux: &[Aux], selection: &Selection) -> Result<Vec<Self>, SceneError> {
        let listing = Arc::new(Listing::read(path, aux)?);
        let mappings = Mapping::all(&listing, selection)?;
        for file in 1..listing.files() {
            let feeds = |mapping: &Mapping| {
                let mut channels = mapping.sources().flat_map(|(_, _, source)| &source.channels);
                channels.any(|name| listing.place(name).is_some_and(|(home, _)| home == file))
            };
            if !mappings.iter().any(feeds) {
                return Err(SceneError::FeedsNothing { path: listing.file(file).to_owned() });
            }
        }
        let target = |mapping| Self { listing: Arc::clone(&listing), mapping };
        let targets: Vec<Self> = mappings.into_iter().map(target).collect();
        targets.iter().try_for_each(Self::check_sizes)?;
        Ok(targets)
    }

    /// Refuses features in files of their own that are of another picture. A part of this one
    /// is welcome, which a display window shows that is the same.
    fn check_sizes(&self) -> Result<(), SceneError> {
        let Ok(own) = self.window() else { return Ok(()) };
        for (feature, _, source) in self.mapping.sources() {
            let Some(channel) = source.channels.first() else { continue };
            let (Some((file, _)), Some(window)) =
                (self.listing.place(channel), self.listing.window(channel))
            else {
                continue;
            };
            let frame = self.listing.display(file);
            let is_part = frame == self.listing.display(0) && window.overlap(&own).is_some();
            // A picture of a format without windows lies where the colour does.
            let fits = match self.listing.is_placed(channel) {
                true => window == own || is_part,
                false => window.size == own.size,
            };
            if file > 0 && !fits {
                return Err(SceneError::OtherSize {
                    path: self.listing.file(file).to_owned(),
                    feature: feature.row().title,
                    window,
                    color: self.path().to_owned(),
                    color_window: own,
                });
            }
        }
        Ok(())
    }

    /// The best picture of a file.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        Self::known(path, None)
    }

    /// The same, of which somebody may know the samples per pixel.
    pub(super) fn known(path: &Path, samples: Option<u32>) -> Result<Self, SceneError> {
        let selection = Selection { samples, ..Selection::default() };
        let mut all = Self::all(path, &[], &selection)?;
        Ok(all.swap_remove(0))
    }

    /// The file of the colour.
    pub fn path(&self) -> &Path {
        self.listing.path()
    }

    /// The file that holds a channel of the frame's, and what that file calls it; nothing if
    /// there is no such channel.
    pub fn place(&self, full: &str) -> Option<(&Path, &str)> {
        let (file, name) = self.listing.place(full)?;
        Some((self.listing.file(file), name))
    }

    /// The channels of the frame's files.
    pub fn listing(&self) -> &Listing {
        &self.listing
    }

    /// What feeds which feature.
    pub fn mapping(&self) -> &Mapping {
        &self.mapping
    }

    /// Where its pixels are: the data window of its colour.
    ///
    /// # Errors
    /// If it has no colour.
    pub fn window(&self) -> Result<Window, SceneError> {
        let color = self.mapping.color(&self.listing)?;
        let window = self.listing.window(&color.channels[0]);
        Ok(window.expect("the mapping names channels of the files"))
    }

    /// The full names of the colour's channels; one of them thrice if the image is grey.
    ///
    /// # Errors
    /// If it has no colour.
    pub fn color_channels(&self) -> Result<[String; 3], SceneError> {
        let channels = &self.mapping.color(&self.listing)?.channels;
        Ok(std::array::from_fn(|k| channels[k.min(channels.len() - 1)].clone()))
    }

    /// The full name of the colour's alpha, if it has one.
    pub fn alpha(&self) -> Option<String> {
        let color = self.mapping.value(Feature::Color)?;
        let first = &color.channels[0];
        let end = first.rfind(['.', ':']).map_or(0, |dot| dot + 1);
        ["A", "a", "alpha", "Alpha"]
            .into_iter()
            .map(|name| format!("{}{name}", &first[..end]))
            .find(|name| self.listing.window(name) == self.listing.window(first))
    }

    /// The layers beside the colour whose names are of a pattern, in the file's order: with
    /// their view and this picture's layer before them, or without. What is no light is none
    /// of them: other features, and Cryptomatte's hashes.
    ///
    /// # Errors
    /// If there is none for a pattern.
    pub fn layers(&self, patterns: &[Pattern]) -> Result<Vec<LayerChannels>, SceneError> {
        let which = self.mapping.which();
        let views = self.listing.views();
        let view = which.view.as_ref().and_then(|view| views.iter().position(|v| v == view));
        let prefix = which.layer.as_ref().map(|layer| format!("{}.", layer.to_lowercase()));
        let others = self.mapping.sources().filter(|&(feature, quantity, _)| {
            (feature, quantity) != (Feature::DirIllumination, Quantity::Value)
        });
        let fed: HashSet<&String> = others.flat_map(|(_, _, source)| &source.channels).collect();
        let window = self.window()?;
        let mut all: Vec<LayerChannels> = Vec::new();
        for entry in self.listing.entries() {
            let is_ours = entry.view == view.unwrap_or(0)
                && prefix.as_ref().is_none_or(|prefix| entry.layer.starts_with(prefix))
                && !fed.contains(&entry.full)
                && self.listing.window(&entry.full) == Some(window);
            let Some((layer, component)) = entry.full.rsplit_once('.').filter(|_| is_ours) else {
                continue;
            };
            let place = match component {
                "R" | "r" | "red" => 0,
                "G" | "g" | "green" => 1,
                "B" | "b" | "blue" => 2,
                _ => continue,
            };
            if is_data(layer) {
                continue;
            }
            if all.last().is_none_or(|last| last.name != layer) {
                let channels = [const { String::new() }; 3];
                all.push(LayerChannels { name: layer.to_owned(), channels });
            }
            all.last_mut().expect("just pushed").channels[place] = entry.full.clone();
        }
        all.retain(|layer| layer.channels.iter().all(|channel| !channel.is_empty()));
        // `ViewLayer.` before `ViewLayer.Combined.R`.
        let [first, ..] = self.color_channels()?;
        let own = first.rsplit_once('.').and_then(|(layer, _)| layer.rsplit_once('.'));
        let own = own.map(|(before, _)| format!("{before}."));
        let relative = |layer: &LayerChannels| {
            let own = own.as_deref().unwrap_or_default();
            layer.name.strip_prefix(own).unwrap_or(&layer.name).to_owned()
        };
        for pattern in patterns {
            let is_of =
                |l: &LayerChannels| pattern.matches(&l.name) || pattern.matches(&relative(l));
            if !all.iter().any(is_of) {
                return Err(SceneError::NotInFile {
                    path: self.path().to_owned(),
                    what: "layer beside the colour",
                    name: pattern.as_str().to_owned(),
                    present: match all.is_empty() {
                        true => "none".to_owned(),
                        false => crate::image::listing(all.iter().map(|l| l.name.as_str())),
                    },
                });
            }
        }
        all.retain(|l| patterns.iter().any(|p| p.matches(&l.name) || p.matches(&relative(l))));
        Ok(all)
    }

    /// Decodes the channels of sources into a sink, in their order, then the alpha if
    /// there is one, and then other channels.
    pub(super) fn decode(
        &self,
        sources: &[Fed],
        others: &[String],
        unfinished: Unfinished,
        sink: &mut dyn Sink,
    ) -> Result<Read, SceneError> {
        let window = self.window()?;
        let alpha = self.alpha();
        let others = others.iter().map(String::as_str);
        let wanted: Vec<&str> = channels(sources).chain(alpha.as_deref()).chain(others).collect();
        sink.begin(wanted.len(), window.size)?;
        let missing = vec![Vec::new(); wanted.len()];
        let mut read = Read { window, attributes: None, missing };
        for file in 0..self.listing.files() {
            let mut slots = Vec::new();
            let mut names = Vec::new();
            for (slot, full) in wanted.iter().enumerate() {
                let (home, name) = self.listing.place(full).expect("a channel of the files");
                if home == file {
                    slots.push(slot);
                    names.push(name);
                }
            }
            if names.is_empty() {
                continue;
            }
            let mut sink = Slots { sink: &mut *sink, slots: &slots };
            let path = self.listing.file(file);
            let decoded =
                files::decode_channels(path, &names, Some(window), unfinished, &mut sink)?;
            for (&slot, missing) in slots.iter().zip(decoded.missing) {
                read.missing[slot] = missing;
            }
            if file == 0 {
                read.attributes = decoded.attributes;
            }
        }
        Ok(read)
    }
}

/// The full names of the sources' channels.
pub(super) fn channels(sources: &[Fed]) -> impl Iterator<Item = &str> {
    sources.iter().flat_map(|(_, source)| &source.channels).map(String::as_str)
}

/// The channels of one file among those of all.
struct Slots<'a> {
    sink: &'a mut dyn Sink,
    slots: &'a [usize],
}

impl Sink for Slots<'_> {
    fn begin(&mut self, _channels: usize, _size: (usize, usize)) -> Result<(), ImageError> {
        Ok(())
    }

    fn line(&mut self, channel: usize, start: usize, samples: &[f32]) -> Result<(), ImageError> {
        self.sink.line(self.slots[channel], start, samples)
    }
}
