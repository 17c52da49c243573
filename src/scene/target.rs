//! One picture of a frame, and what feeds its features.

use std::path::Path;
use std::sync::Arc;

use super::SceneError;
use super::listing::{Aux, Listing};
use super::mapping::{Mapping, Selection};
use super::raw::Fed;
use crate::expr::feature::Feature;
use crate::image::exr::{Attributes, Sink, Unfinished, Window};
use crate::image::{ImageError, files};

/// One picture of a frame (its only one, a view, a view layer) with where its features are.
#[derive(Clone, Debug)]
pub struct Target {
    listing: Arc<Listing>,
    mapping: Mapping,
}

/// What was decoded of a target.
pub(super) struct Read {
    pub(super) window: Window,
    pub(super) attributes: Option<Attributes>,
    pub(super) missing_rows: usize,
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
        let target = |mapping| Self { listing: Arc::clone(&listing), mapping };
        Ok(mappings.into_iter().map(target).collect())
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

    /// Decodes the channels of sources into a sink, in their order, and then the alpha if
    /// there is one.
    pub(super) fn decode(
        &self,
        sources: &[Fed],
        unfinished: Unfinished,
        sink: &mut dyn Sink,
    ) -> Result<Read, SceneError> {
        let window = self.window()?;
        let alpha = self.alpha();
        let wanted: Vec<&str> = channels(sources).chain(alpha.as_deref()).collect();
        sink.begin(wanted.len(), window.size)?;
        let mut read = Read { window, attributes: None, missing_rows: 0 };
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
            let mut sink = Slots { sink: &mut *sink, slots };
            let path = self.listing.file(file);
            let decoded =
                files::decode_channels(path, &names, Some(window), unfinished, &mut sink)?;
            read.missing_rows += decoded.missing_rows;
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
    slots: Vec<usize>,
}

impl Sink for Slots<'_> {
    fn begin(&mut self, _channels: usize, _size: (usize, usize)) -> Result<(), ImageError> {
        Ok(())
    }

    fn line(&mut self, channel: usize, start: usize, samples: &[f32]) -> Result<(), ImageError> {
        self.sink.line(self.slots[channel], start, samples)
    }
}
