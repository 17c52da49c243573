//! A scene's features as the renderer wrote them: before repair, normalisation
//! and padding.
//!
//! Most callers want [`Scene::load`](super::Scene::load), which goes through here.
//! The raw form is for those who make or change scenes: tests, and checks of
//! how a filter takes another exposure, another origin or a flipped image.

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use super::gap::Gaps;
use super::mapping::{Fed, Mapping, Source, looked_for};
use super::needs::Needs;
use super::note::Note;
use super::target::{LayerChannels, Read, Target, channels};
use super::{LoadOptions, SceneError};
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::image::Attributes;
use crate::image::exr::{Memory, Window};
use crate::image::metric::linear;

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
    /// How much of each pixel is covered, where the file says so.
    pub alpha: Option<Vec<f32>>,
    /// Pictures to be filtered by the colour's weights.
    pub(super) layers: Vec<(LayerChannels, [Vec<f32>; 3])>,
    pub(super) notes: Vec<Note>,
    pub(super) origin: Origin,
}

/// The file that a scene comes from, if any.
#[derive(Clone, Debug, Default)]
pub(super) struct Origin {
    pub(super) target: Option<Target>,
    pub(super) attributes: Option<Attributes>,
    /// Where the file lacks the colour, and then each layer that is filtered by its weights,
    /// counted from the image's corner.
    pub(super) missing: Vec<Vec<Window>>,
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
            alpha: None,
            layers: Vec::new(),
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
        Self::of(&Target::known(path, options.samples)?, &[], needs, options)
    }

    /// The same of a target, with layers beside the colour.
    ///
    /// # Errors
    /// Those of [`RawScene::read`].
    pub fn of(
        target: &Target,
        layers: &[LayerChannels],
        needs: &Needs,
        options: &LoadOptions,
    ) -> Result<Self, SceneError> {
        let sources = sources(target, needs, options)?;
        let mut others: Vec<String> = Vec::new();
        for channel in layers.iter().flat_map(|layer| &layer.channels) {
            // The alpha is decoded in any case.
            if !others.contains(channel) && target.alpha().as_ref() != Some(channel) {
                others.push(channel.clone());
            }
        }
        let mut memory = Memory::of(target.path());
        let read = target.decode(&sources, &others, options.unfinished, &mut memory)?;
        let mut planes = memory.into_planes();
        let mut gaps = Gaps::new(read.window.size);
        // The alpha says what is covered, and nothing is where there is no pixel.
        let alpha_at = target.alpha().map(|_| channels(&sources).count());
        for (k, (plane, missing)) in planes.iter_mut().zip(&read.missing).enumerate() {
            if Some(k) != alpha_at {
                gaps.fill(plane, missing);
            }
        }
        let alpha_gap = alpha_at.map(|k| &read.missing[k]);
        let mut planes = planes.into_iter();
        let mut features: BTreeMap<(Feature, Quantity), Vec<Vec<f32>>> = BTreeMap::new();
        for (key, source) in &sources {
            let components = planes.by_ref().take(source.channels.len());
            features.insert(*key, components.collect());
        }
        let alpha = target.alpha().and_then(|_| planes.next());
        let first_other = read.missing.len() - others.len();
        let mut missing = vec![read.missing[0].clone()];
        missing.extend(layers.iter().map(|layer| {
            let at = others.iter().position(|channel| *channel == layer.channels[0]);
            let gap = at.map(|k| &read.missing[first_other + k]).or(alpha_gap);
            gap.expect("it was read").clone()
        }));
        let others: BTreeMap<&String, Vec<f32>> = others.iter().zip(planes).collect();
        let mut plane = |channel: &String| match others.get(channel) {
            Some(plane) => plane.clone(),
            None => {
                let mut plane = alpha.clone().expect("what is no layer's own is the alpha");
                gaps.fill(&mut plane, alpha_gap.expect("it was read"));
                plane
            }
        };
        let layers = layers.iter();
        let layers: Vec<_> = layers
            .map(|layer| (layer.clone(), layer.channels.each_ref().map(&mut plane)))
            .collect();
        for (key, source) in &sources {
            let mut components = features.remove(key).expect("it was just put there");
            let value = features.get(&(key.0, Quantity::Value)).map(Vec::as_slice);
            source.convert(target, *key, &mut components, value);
            features.insert(*key, components);
        }
        Ok(Self {
            name: super::folder::scene_name(target.path()),
            width: read.window.size.0,
            height: read.window.size.1,
            features,
            alpha,
            layers,
            samples: target.listing().header().samples_per_pixel(),
            notes: notes(target, &sources, needs, &read),
            origin: Origin::of(target, read, missing),
        })
    }
}

/// What `needs` come from: the quantities, and the channels of each; the colour first, and
/// values before variances.
pub(super) fn sources(
    target: &Target,
    needs: &Needs,
    options: &LoadOptions,
) -> Result<Vec<Fed>, SceneError> {
    let mapping = target.mapping();
    mapping.color(target.listing())?;
    let stored = needs.stored(mapping, options.color_scale);
    let sources = mapping.sources().filter(|&(f, q, _)| stored.contains(&(f, q)));
    let mut sources: Vec<_> = sources.map(|(f, q, source)| ((f, q), source.clone())).collect();
    sources.sort_by_key(|&((feature, quantity), _)| {
        (quantity == Quantity::Variance, feature != Feature::Color)
    });
    Ok(sources)
}

impl Source {
    /// Brings samples of the file into the unit of the feature, with its value at hand.
    pub(super) fn convert(
        &self,
        target: &Target,
        (feature, quantity): (Feature, Quantity),
        components: &mut Vec<Vec<f32>>,
        value: Option<&[Vec<f32>]>,
    ) {
        let is_light =
            !matches!(feature, Feature::Normal | Feature::Depth | Feature::WorldPosition);
        let is_encoded =
            self.channels.first().is_some_and(|channel| target.listing().is_encoded(channel));
        if quantity == Quantity::Value && is_light && is_encoded {
            for samples in components.iter_mut() {
                samples.iter_mut().for_each(|x| *x = linear(f64::from(*x)) as f32);
            }
        }
        if self.is_moment {
            for (samples, value) in components.iter_mut().zip(value.unwrap_or_default()) {
                for (x, &mean) in samples.iter_mut().zip(value) {
                    // Rounding makes it a little less than nothing.
                    *x = (*x - mean * mean).max(0.0);
                }
            }
        }
        if self.divisor != 1.0 {
            components.iter_mut().flatten().for_each(|sample| *sample /= self.divisor);
        }
        // A grey image is one whose channels are equal.
        if (feature, quantity) == (Feature::Color, Quantity::Value) && components.len() == 1 {
            components.resize(feature.width(), components[0].clone());
        }
    }
}

/// What there is to say of where things come from.
pub(super) fn notes(target: &Target, sources: &[Fed], needs: &Needs, read: &Read) -> Vec<Note> {
    let mapping = target.mapping();
    let unusable = mapping.unusable().iter();
    let unusable = unusable.filter(|unusable| needs.wants(unusable.feature, Quantity::Variance));
    let unusable = unusable.map(|unusable| Note::UnusableVariance {
        feature: unusable.feature,
        channels: unusable.channels.clone(),
        reason: unusable.reason,
    });
    let mut notes: Vec<Note> = unusable.collect();
    for ((feature, _), source) in sources {
        let window = source.channels.first().and_then(|name| target.listing().window(name));
        let Some(window) = window.filter(|window| *window != read.window) else { continue };
        if target.listing().is_placed(&source.channels[0]) {
            let covered = window.overlap(&read.window).map_or(0, |both| both.pixels());
            let count = read.window.pixels() - covered;
            if count > 0 {
                notes.push(Note::Uncovered { feature: *feature, window, count });
            }
        }
    }
    for ((feature, quantity), source) in sources {
        let one = source.channels.first().filter(|_| feature.width() == 1);
        let Some(channel) = one.filter(|_| *quantity == Quantity::Value) else { continue };
        let others = target.listing().unused_beside(channel);
        if !others.is_empty() {
            let others = others.into_iter().map(str::to_owned).collect();
            let (feature, channel) = (*feature, channel.clone());
            notes.push(Note::OneOfSeveral { feature, channel, others });
        }
    }
    let rows = |missing: &mut dyn Iterator<Item = &Window>| {
        let rows = missing.flat_map(|gap| gap.origin.1..gap.origin.1 + gap.size.1 as i32);
        rows.collect::<HashSet<i32>>().len()
    };
    let missing = rows(&mut read.missing.iter().flatten());
    if missing > 0 {
        let black = rows(&mut read.missing[0].iter());
        notes.push(Note::Unfinished { rows: missing, of: read.window.size.1, black });
    }
    notes
}

impl Origin {
    /// That of a target, with what was read of it.
    pub(super) fn of(target: &Target, read: Read, missing: Vec<Vec<Window>>) -> Self {
        Self { target: Some(target.clone()), attributes: read.attributes, missing }
    }

    /// That of a part of the scene, of which nothing is missing.
    pub(super) fn of_part(&self) -> Self {
        Self { missing: Vec::new(), ..self.clone() }
    }

    /// The full name of the channel that a component came from, or the name it
    /// would have in a file of ours.
    pub(super) fn channel(&self, feature: Feature, quantity: Quantity, component: usize) -> String {
        let mapping = self.target.as_ref().map(Target::mapping);
        let source = mapping.and_then(|mapping: &Mapping| match quantity {
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
        let term = match id.quantity {
            Quantity::Value => id.feature.term(),
            other => id.feature.spelling(other).unwrap_or(id.feature.term()),
        };
        let Some(target) = &self.target else {
            return SceneError::NotGiven { scene: scene.to_owned(), term: term.to_owned() };
        };
        let (path, present) = (target.path().to_owned(), target.listing().listing());
        let mapping = target.mapping();
        let known = mapping.renderer().map(|renderer| (renderer, mapping.switches()));
        let setting = match known {
            Some((renderer, switches)) => format!("Switch it on in {renderer}: {switches}"),
            None => "Render that feature too".to_owned(),
        };
        let looked_for = looked_for(id.feature);
        SceneError::MissingFeature { path, term: term.to_owned(), looked_for, present, setting }
    }
}
