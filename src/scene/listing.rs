//! The channels of a frame's files, and what each is called.
//!
//! A frame is one file, and maybe others with features in files of their own. A channel has
//! two names:
//!
//! - its *full name*, by which people and errors call it: in the first file that of
//!   [`Header`], in others `FILE:CHANNEL`;
//! - its *layer's name*, which conventions are matched with: without the view it belongs to
//!   (`right.Albedo.R` and `Albedo.right.R` are `Albedo.R` of the view `right`), and with the
//!   file's name before bare channels of other files (`R` of `shot_albedo.0012.exr` is
//!   `albedo.R`).

use std::path::{Path, PathBuf};

use super::naming::layer_in;
use crate::expr::feature::Feature;
use crate::image::exr::{Header, Window};
use crate::image::files::{self, Format};
use crate::image::{ImageError, listing};

/// The channels of all files of a frame.
#[derive(Clone, Debug)]
pub struct Listing {
    headers: Vec<Header>,
    entries: Vec<Entry>,
}

/// A channel.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) full: String,
    /// In lower case.
    pub(super) layer: String,
    /// The view it belongs to, by its place in [`Listing::views`].
    pub(super) view: usize,
    /// What somebody says that its file holds.
    pub(super) said: Option<Feature>,
    file: usize,
    /// What its file calls it.
    name: String,
}

/// A file beside a frame's first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Aux {
    /// The file.
    pub path: PathBuf,
    /// What it holds; if nothing is said, its name or its channels' tell.
    pub feature: Option<Feature>,
}

impl Listing {
    /// Lists a frame's files.
    ///
    /// # Errors
    /// If one cannot be read.
    pub fn read(path: &Path, aux: &[Aux]) -> Result<Self, ImageError> {
        let mut listing = Self::of(files::read_header(path)?);
        for aux in aux {
            listing.add(files::read_header(&aux.path)?, aux.feature);
        }
        Ok(listing)
    }

    /// The channels of one file.
    pub(super) fn of(header: Header) -> Self {
        let mut entries = Vec::new();
        for part in header.parts() {
            for channel in &part.channels {
                let (view, layer) = viewless(header.views(), part.view.as_deref(), &channel.name);
                entries.push(Entry {
                    full: channel.name.clone(),
                    layer: layer.to_lowercase(),
                    view,
                    said: None,
                    file: 0,
                    name: channel.name.clone(),
                });
            }
        }
        Self { headers: vec![header], entries }
    }

    fn add(&mut self, header: Header, said: Option<Feature>) {
        let stem = header.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let stem = stem.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.').to_owned();
        let layer = layer_in(&stem).map_or(stem, str::to_owned);
        let file = self.headers.len();
        for name in header.names() {
            let is_bare = !name.contains('.') && name.len() <= 5;
            let full = format!("{}:{name}", header.path().display());
            let layer = if is_bare { format!("{layer}.{name}") } else { name.to_owned() };
            let (layer, name) = (layer.to_lowercase(), name.to_owned());
            self.entries.push(Entry { full, layer, view: 0, said, file, name });
        }
        self.headers.push(header);
    }

    /// The first file, which the colour is in.
    pub fn path(&self) -> &Path {
        self.headers[0].path()
    }

    /// What is known of the first file.
    pub fn header(&self) -> &Header {
        &self.headers[0]
    }

    /// The views of the first file, its main one first; an empty name if it has but one.
    pub fn views(&self) -> Vec<&str> {
        match self.header().views() {
            [] => vec![""],
            views => views.iter().map(String::as_str).collect(),
        }
    }

    pub(super) fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// All channels as one text, for error messages.
    pub fn listing(&self) -> String {
        listing(self.entries.iter().map(|entry| entry.full.as_str()))
    }

    /// Number of files.
    pub(super) fn files(&self) -> usize {
        self.headers.len()
    }

    /// The file of that number.
    pub(super) fn file(&self, number: usize) -> &Path {
        self.headers[number].path()
    }

    /// What is beside the only channel that a feature of one number per pixel is taken from,
    /// if that is one of a coloured image: its layer's other channels, the alpha left out.
    pub(super) fn unused_beside(&self, full: &str) -> Vec<&str> {
        let Some(entry) = self.entries.iter().find(|entry| entry.full == full) else {
            return Vec::new();
        };
        fn parts(layer: &str) -> (&str, &str) {
            layer.rsplit_once('.').unwrap_or(("", layer))
        }
        let (layer, component) = parts(&entry.layer);
        // A layer's Z or V is what it is, whatever else is there.
        let is_grey = matches!(component, "z" | "v" | "y" | "t");
        let is_coloured = matches!(component, "r" | "red") || entry.said.is_some();
        if is_grey || !is_coloured {
            return Vec::new();
        }
        let others = self.entries.iter().filter(|other| {
            let (others, name) = parts(&other.layer);
            (other.file, other.view, others) == (entry.file, entry.view, layer)
                && name != component
                && !matches!(name, "a" | "alpha")
        });
        others.map(|other| other.name.as_str()).collect()
    }

    /// The display window of the file of that number.
    pub(super) fn display(&self, number: usize) -> Window {
        self.headers[number].display()
    }

    /// Which file holds a channel, and what that calls it.
    pub(super) fn place(&self, full: &str) -> Option<(usize, &str)> {
        let entry = self.entries.iter().find(|entry| entry.full == full)?;
        Some((entry.file, &entry.name))
    }

    /// Whether the samples of a channel are those of a display: sRGB, from 0 to 1.
    pub(super) fn is_encoded(&self, full: &str) -> bool {
        self.place(full).is_some_and(|(file, _)| self.headers[file].is_encoded())
    }

    /// Whether a channel's file says where its pixels are.
    pub(super) fn is_placed(&self, full: &str) -> bool {
        let format = |file: usize| self.headers[file].format();
        self.place(full).is_some_and(|(file, _)| format(file) == Format::Exr)
    }

    /// The data window of a channel.
    pub fn window(&self, full: &str) -> Option<Window> {
        let (file, name) = self.place(full)?;
        let header = &self.headers[file];
        Some(header.parts()[header.find(name)?.0].window)
    }
}

/// The view that a channel belongs to, and its name without it.
fn viewless(views: &[String], of_part: Option<&str>, name: &str) -> (usize, String) {
    let components: Vec<&str> = name.split('.').collect();
    let is_view = |component: &str, view: &str| component == view;
    let found = match of_part {
        Some(view) => views.iter().position(|known| known == view),
        // The last component is the channel itself.
        None => {
            let inner = &components[..components.len() - 1];
            (0..views.len()).find(|&k| inner.iter().any(|component| is_view(component, &views[k])))
        }
    };
    let Some(view) = found else { return (0, name.to_owned()) };
    let last = components.len() - 1;
    let kept = components.iter().enumerate();
    let kept = kept.filter(|&(k, component)| k == last || !is_view(component, &views[view]));
    // Blender's parts are called `ViewLayer.Combined-left`.
    let bare = |(_, &component): (usize, &&'_ str)| {
        let bare = component.strip_suffix(views[view].as_str());
        let bare = bare.and_then(|rest| rest.strip_suffix(['-', '_']));
        bare.unwrap_or(component).to_owned()
    };
    (view, kept.map(bare).collect::<Vec<_>>().join("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_stand_before_layers_or_between_layer_and_channel() {
        let views = ["left".to_owned(), "right".to_owned()];
        let of = |name: &str| viewless(&views, None, name);
        assert_eq!(of("R"), (0, "R".to_owned()));
        assert_eq!(of("right.R"), (1, "R".to_owned()));
        assert_eq!(of("right.Albedo.R"), (1, "Albedo.R".to_owned()));
        assert_eq!(of("Albedo.right.R"), (1, "Albedo.R".to_owned()));
        assert_eq!(of("Albedo.R"), (0, "Albedo.R".to_owned()));
        assert_eq!(viewless(&views, Some("left"), "left.N.X"), (0, "N.X".to_owned()));
        let blender = viewless(&views, Some("right"), "ViewLayer.Combined-right.R");
        assert_eq!(blender, (1, "ViewLayer.Combined.R".to_owned()));
        assert_eq!(viewless(&[], None, "right.R"), (0, "right.R".to_owned()));
    }
}
