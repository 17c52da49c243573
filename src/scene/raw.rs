//! A scene's features as the renderer wrote them: before repair, normalisation
//! and padding.
//!
//! Most callers want [`Scene::load`](super::Scene::load), which goes through here.
//! The raw form is for those who make or change scenes: tests, and checks of
//! how a filter takes another exposure, another origin or a flipped image.

use std::collections::BTreeMap;
use std::path::Path;

use super::mapping::{Mapping, Source, looked_for};
use super::needs::Needs;
use super::note::Note;
use super::{LoadOptions, SceneError};
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::image::exr::{Attributes, Header, read_channels};

/// Features in the renderer's units, row by row without padding.
#[derive(Clone, Debug)]
pub struct RawScene {
    /// What reports call the scene.
    pub name: String,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values (one image per component) and variances of the pixel's mean (one
    /// image, or one per component to be averaged). Must hold the colour.
    pub features: BTreeMap<(Feature, Quantity), Vec<Vec<f32>>>,
    /// Samples per pixel, where the file says so.
    pub samples: Option<u32>,
    pub(super) notes: Vec<Note>,
    pub(super) origin: Origin,
}

/// The file that a scene comes from, if any.
#[derive(Clone, Debug, Default)]
pub(super) struct Origin {
    pub(super) file: Option<(Header, Mapping)>,
    pub(super) attributes: Option<Attributes>,
}

impl RawScene {
    /// A scene made in memory.
    pub fn new(name: &str, width: usize, height: usize, color: [Vec<f32>; 3]) -> Self {
        Self {
            name: name.to_owned(),
            width,
            height,
            features: BTreeMap::from([((Feature::Color, Quantity::Value), color.into())]),
            samples: None,
            notes: Vec::new(),
            origin: Origin::default(),
        }
    }

    /// The same scene with one more value or variance.
    #[must_use]
    pub fn with(mut self, feature: Feature, quantity: Quantity, components: Vec<Vec<f32>>) -> Self {
        self.features.insert((feature, quantity), components);
        self
    }

    /// Decodes what `needs` come from, and nothing else, of the file at `path`.
    ///
    /// # Errors
    /// If the file cannot be read or has no colour. That a needed feature is
    /// missing is no error yet: see [`Scene::require`](super::Scene::require).
    pub fn read(path: &Path, needs: &Needs, options: &LoadOptions) -> Result<Self, SceneError> {
        let Request { header, mapping, sources } = Request::of(path, needs, options)?;
        let wanted: Vec<&str> = Request::channels(&sources).collect();
        let mut pixels = read_channels(path, &wanted)?;
        let mut features = BTreeMap::new();
        for (key, source) in &sources {
            let components = source.channels.iter().map(|name| {
                let mut samples =
                    pixels.channels.remove(name).expect("a channel feeds one feature only");
                source.divide(&mut samples);
                samples
            });
            features.insert(*key, components.collect::<Vec<_>>());
        }
        Ok(Self {
            name: super::folder::scene_name(path),
            width: pixels.width,
            height: pixels.height,
            features,
            samples: header.samples_per_pixel(),
            notes: notes(&mapping, needs),
            origin: Origin { attributes: Some(pixels.attributes), file: Some((header, mapping)) },
        })
    }
}

/// What is to be read of a file.
pub(super) struct Request {
    pub(super) header: Header,
    pub(super) mapping: Mapping,
    /// The quantities, and the channels that each comes from.
    pub(super) sources: Vec<((Feature, Quantity), Source)>,
}

impl Request {
    /// What `needs` come from.
    pub(super) fn of(
        path: &Path,
        needs: &Needs,
        options: &LoadOptions,
    ) -> Result<Self, SceneError> {
        let header = Header::read(path)?;
        let mapping = Mapping::of(&header);
        mapping.color(&header)?;
        let stored = needs.stored(&mapping, options.color_scale);
        let sources = mapping.sources().filter(|&(f, q, _)| stored.contains(&(f, q)));
        let sources = sources.map(|(f, q, source)| ((f, q), source.clone())).collect();
        Ok(Self { header, mapping, sources })
    }

    /// The channels' full names.
    pub(super) fn channels(
        sources: &[((Feature, Quantity), Source)],
    ) -> impl Iterator<Item = &str> {
        sources.iter().flat_map(|(_, source)| &source.channels).map(String::as_str)
    }
}

impl Source {
    /// Brings samples of the file into the unit of the feature.
    pub(super) fn divide(&self, samples: &mut [f32]) {
        if self.divisor != 1.0 {
            samples.iter_mut().for_each(|sample| *sample /= self.divisor);
        }
    }
}

/// What the mapping has to say about what is needed.
pub(super) fn notes(mapping: &Mapping, needs: &Needs) -> Vec<Note> {
    let borrowed = mapping.sources().filter(|&(feature, quantity, source)| {
        source.convention != mapping.convention() && needs.wants(feature, quantity)
    });
    let borrowed = borrowed.map(|(feature, _, source)| Note::Borrowed {
        feature,
        channels: source.channels.clone(),
        convention: source.convention,
    });
    let unusable = mapping.unusable().iter();
    let unusable = unusable.filter(|unusable| needs.wants(unusable.feature, Quantity::Variance));
    let unusable = unusable.map(|unusable| Note::UnusableVariance {
        feature: unusable.feature,
        channels: unusable.channels.clone(),
        reason: unusable.reason,
    });
    borrowed.chain(unusable).collect()
}

impl Origin {
    /// The full name of the channel that a component came from, or the name it
    /// would have in a file of ours.
    pub(super) fn channel(&self, feature: Feature, quantity: Quantity, component: usize) -> String {
        let source = self.file.as_ref().and_then(|(_, mapping)| match quantity {
            Quantity::Value => mapping.value(feature),
            Quantity::Variance => mapping.variance(feature),
            Quantity::Gradient => None,
        });
        let own = match quantity {
            Quantity::Variance => feature.row().variance_channels,
            Quantity::Value | Quantity::Gradient => feature.row().channels,
        };
        match source {
            Some(source) => source.channels.get(component).cloned(),
            None => own.get(component).map(|&name| name.to_owned()),
        }
        .unwrap_or_else(|| format!("{}[{component}]", feature.row().name))
    }

    /// The error for the first plane that is needed and not provided.
    pub(super) fn require(
        &self,
        scene: &str,
        needs: &Needs,
        provides: impl Fn(PlaneId) -> bool,
    ) -> Result<(), SceneError> {
        let missing = needs.named().into_iter().flatten().find(|&&id| !provides(id));
        missing.map_or(Ok(()), |&id| Err(self.missing(scene, id)))
    }

    /// The error for a scene that has no colour.
    pub(super) fn without_color(&self, scene: &str) -> SceneError {
        let (feature, quantity) = (Feature::Color, Quantity::Value);
        self.missing(scene, PlaneId { feature, quantity, component: 0 })
    }

    /// The error for a plane that a filter reads and the file does not provide.
    pub(super) fn missing(&self, scene: &str, id: PlaneId) -> SceneError {
        let term = id.feature.spelling(id.quantity).unwrap_or(id.feature.row().name).to_owned();
        let (path, present) = match &self.file {
            Some((header, _)) => (header.path().to_owned(), header.listing()),
            None => (scene.into(), "no such feature".to_owned()),
        };
        SceneError::MissingFeature { path, term, looked_for: looked_for(id.feature), present }
    }
}
