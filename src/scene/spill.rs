//! Scenes that do not fit in memory.
//!
//! A [`SpilledScene`] is made as a [`Scene`] is, but one feature at a time, and what is
//! done stands in a scratch file. Parts of it are scenes like others: some rows, with
//! what is known of the whole image. So whoever filters an image part by part gets the
//! bits of the whole.
//!
//! While it is made, it takes memory for a dozen planes at most ([`SpilledScene::least`]).

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::facts::{Fact, Facts};
use super::gap::Gaps;
use super::mend::{Findings, Mender};
use super::normalize::Normalization;
use super::note::Note;
use super::plane::{Edge, Layout, Plane, Samples};
use super::prepare::{Maker, MendedFeatures, Scales};
use super::raw::{Origin, notes, sources};
use super::scratch::Scratch;
use super::target::{Target, channels};
use super::{LoadOptions, Needs, Scene, SceneError};
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::image::exr::{Sink, Window};
use crate::image::{Attributes, ImageError};

/// A scene in a scratch file.
pub struct SpilledScene {
    name: String,
    layout: Layout,
    scratch: Scratch,
    /// Where the alpha stands in the file.
    alpha: Option<usize>,
    /// Where planes stand in the file that are not one number everywhere.
    places: BTreeMap<PlaneId, usize>,
    facts: Facts,
    normalization: Normalization,
    notes: Vec<Note>,
    origin: Origin,
}

/// The most planes that stand in memory while one feature's are made: its three components
/// as they were and normalised, a copy of each to find quantiles in, and three planes' worth
/// of what is derived from them.
const PLANES: u64 = 12;

/// Memory that a scene takes, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weight {
    /// To load it whole and to filter it.
    pub in_memory: u64,
    /// To spill it.
    pub least: u64,
}

impl Weight {
    /// Of the scene of a target, loaded with what `needs` names.
    ///
    /// # Errors
    /// If it has no colour.
    pub fn of(target: &Target, needs: &Needs, options: &LoadOptions) -> Result<Self, SceneError> {
        let sources = sources(target, needs, options)?;
        let pixels = target.window()?.pixels();
        let stored = channels(&sources).count();
        let planes = needs.named().map_or(Feature::terms().count() * 3, BTreeSet::len);
        let all = (stored + planes + RESULT) as u64 * pixels as u64 * size_of::<f32>() as u64;
        Ok(Self { in_memory: all, least: SpilledScene::least(pixels) })
    }
}

/// Planes beside those that a filter reads: the colour as it is averaged, ones, the result as
/// pixels and as channels.
const RESULT: usize = 10;

/// The places of the colour as it is averaged.
const COLOR: [usize; 3] = [0, 1, 2];

impl SpilledScene {
    /// Loads the scene of a target, as [`Scene::of`] does.
    ///
    /// # Errors
    /// Those of [`Scene::load`], and if the scratch file cannot be written.
    pub fn load(
        target: &Target,
        needs: &Needs,
        pad: usize,
        options: &LoadOptions,
    ) -> Result<Self, SceneError> {
        let name = super::folder::scene_name(target.path());
        let sources = sources(target, needs, options)?;
        let mut spill = Spill { scratch: None };
        let read = target.decode(&sources, &[], options.unfinished, &mut spill)?;
        let (width, height) = read.window.size;
        let mut gaps = Gaps::new(read.window.size);
        let mut next = 0;
        let quantities = sources.iter().map(|(key, source)| {
            let begin = next;
            next += source.channels.len();
            (*key, (begin..next).collect())
        });
        let mut raw = Raw {
            scratch: spill.scratch.expect("decoding begins with its size"),
            pixels: width * height,
            places: quantities.collect(),
        };
        let mut notes = notes(target, &sources, needs, &read);
        let samples = options.samples.or(target.listing().header().samples_per_pixel());
        let missing = read.missing.clone();
        let origin = Origin::of(target, read, vec![missing[0].clone()]);

        let mender = Mender { name: &name, origin: &origin, width, repair: options.repair };
        let mut findings = Vec::with_capacity(sources.len());
        for (key, source) in &sources {
            let mut components = raw.read(*key)?;
            for (samples, &place) in components.iter_mut().zip(&raw.places[key]) {
                gaps.fill(samples, &missing[place]);
            }
            let value = (key.0, Quantity::Value);
            let value = match source.is_moment {
                true => Some(raw.read(value)?),
                false => None,
            };
            source.convert(target, *key, &mut components, value.as_deref());
            findings.push((*key, mender.mend(key.0, key.1, &mut components)?));
            raw.write(*key, &components)?;
        }
        findings.sort_by_key(|&(key, _)| key);
        notes.extend(Findings::all(findings.into_iter().map(|(_, found)| found).collect()));

        let scales = Scales::of(&raw, options.color_scale)?;
        let layout = Layout::new(width, height, pad);
        let scratch = Scratch::new(width * height)?;
        let color = raw.read((Feature::Color, Quantity::Value))?;
        let [_, _, _] = color.as_slice() else { return Err(origin.without_color(&name)) };
        for (place, samples) in COLOR.into_iter().zip(&color) {
            scratch.write(place, 0, samples)?;
        }
        drop(color);
        let alpha = target.alpha().map(|_| COLOR.len());
        if let Some(place) = alpha {
            let mut samples = vec![0.0; width * height];
            raw.scratch.read(next, 0, &mut samples)?;
            scratch.write(place, 0, &samples)?;
        }
        let first = COLOR.len() + usize::from(alpha.is_some());
        let maker = Maker { features: &raw, scales: &scales, layout, samples };
        let (mut places, mut facts) = (BTreeMap::new(), Vec::new());
        for feature in Feature::ALL {
            let estimated = maker.planes(feature, needs, &mut |id, samples| {
                let fact = Fact::of_pixels(samples, width);
                facts.push((id, fact));
                if let Fact::Range(_) = fact {
                    let place = first + places.len();
                    scratch.write(place, 0, samples)?;
                    places.insert(id, place);
                }
                Ok(())
            })?;
            notes.extend(estimated.map(Note::EstimatedVariance));
        }
        let (facts, normalization) = (Facts::from_planes(facts), scales.normalization);
        Ok(Self { name, layout, scratch, alpha, places, facts, normalization, notes, origin })
    }

    /// Memory that making one of so many pixels takes, in bytes.
    pub fn least(pixels: usize) -> u64 {
        PLANES * pixels as u64 * size_of::<f32>() as u64
    }

    /// Memory that a row of a part takes, in bytes.
    pub fn row_bytes(&self) -> u64 {
        let planes = COLOR.len() + 1 + self.places.len();
        (planes * self.layout.stride() * size_of::<f32>()) as u64
    }

    /// Some of its rows as a scene, with what is known of the whole image.
    ///
    /// # Errors
    /// If the scratch file cannot be read.
    ///
    /// # Panics
    /// If the rows do not lie in the image.
    pub fn rows(&self, rows: Range<usize>) -> Result<Scene, SceneError> {
        assert!(rows.start <= rows.end && rows.end <= self.layout.height(), "rows of the image");
        let layout = self.layout.with_height(rows.len());
        let read = |place: usize| -> Result<Vec<f32>, ImageError> {
            let mut samples = vec![0.0; layout.pixels()];
            self.scratch.read(place, rows.start * layout.width(), &mut samples)?;
            Ok(samples)
        };
        let mut color = Vec::with_capacity(COLOR.len());
        for place in COLOR {
            color.push(Samples::new(layout, &read(place)?, Edge::Zero));
        }
        let mut planes = BTreeMap::new();
        for (id, fact) in self.facts.iter() {
            let plane = match (fact, self.places.get(&id)) {
                (Fact::Constant(value), _) => Plane::Constant(value),
                // Also where these rows hold one number: the whole image does not.
                (_, Some(&place)) => {
                    Plane::Samples(Samples::new(layout, &read(place)?, Edge::Replicate))
                }
                (_, None) => unreachable!("what is no constant stands in the file"),
            };
            planes.insert(id, plane);
        }
        Ok(Scene {
            name: self.name.clone(),
            layout,
            top: rows.start,
            color: color.try_into().expect("three channels"),
            alpha: self.alpha.map(read).transpose()?,
            layers: Vec::new(),
            ones: Samples::new(layout, &vec![1.0; layout.pixels()], Edge::Zero),
            planes,
            facts: self.facts.clone(),
            normalization: self.normalization,
            notes: Vec::new(),
            origin: self.origin.of_part(),
        })
    }

    /// What reports call it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// How the samples of a scene of all its rows would stand.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// What is known of its planes.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Where the file lacks the colour, as [`Scene::missing`] does.
    pub fn missing(&self) -> &[Window] {
        &self.origin.missing[0]
    }

    /// What was done on the way in.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }

    /// What the file says beside its pixels, to be written with the result.
    pub fn attributes(&self) -> Option<&Attributes> {
        self.origin.attributes.as_ref()
    }

    /// Checks that it provides what a filter reads, as [`Scene::require`] does.
    ///
    /// # Errors
    /// For the first plane that is missing.
    pub fn require(&self, needs: &Needs) -> Result<(), SceneError> {
        self.origin.require(&self.name, needs, |id| self.facts.get(id) != Fact::Absent)
    }
}

/// Decoded channels on their way into a scratch file.
struct Spill {
    scratch: Option<Scratch>,
}

impl Sink for Spill {
    fn begin(&mut self, channels: usize, size: (usize, usize)) -> Result<(), ImageError> {
        // Not every file gives every sample.
        self.scratch = Some(Scratch::zeros(channels, size.0 * size.1)?);
        Ok(())
    }

    fn line(&mut self, channel: usize, start: usize, samples: &[f32]) -> Result<(), ImageError> {
        let scratch = self.scratch.as_ref().expect("it began");
        scratch.write(channel, start, samples)
    }
}

/// The features of a file in a scratch file.
struct Raw {
    scratch: Scratch,
    pixels: usize,
    places: BTreeMap<(Feature, Quantity), Vec<usize>>,
}

impl Raw {
    fn read(&self, key: (Feature, Quantity)) -> Result<Vec<Vec<f32>>, SceneError> {
        let places = self.places.get(&key).into_iter().flatten();
        let component = |&place| {
            let mut samples = vec![0.0; self.pixels];
            self.scratch.read(place, 0, &mut samples)?;
            Ok(samples)
        };
        places.map(component).collect()
    }

    fn write(
        &mut self,
        key: (Feature, Quantity),
        components: &[Vec<f32>],
    ) -> Result<(), SceneError> {
        // A grey colour is stored once and read thrice.
        let places = self.places.get_mut(&key).expect("a key of the sources");
        places.resize(components.len(), places[0]);
        for (&place, samples) in self.places[&key].iter().zip(components) {
            self.scratch.write(place, 0, samples)?;
        }
        Ok(())
    }
}

impl MendedFeatures for Raw {
    fn get(
        &self,
        feature: Feature,
        quantity: Quantity,
    ) -> Result<Option<Cow<'_, [Vec<f32>]>>, SceneError> {
        match self.places.contains_key(&(feature, quantity)) {
            true => Ok(Some(Cow::Owned(self.read((feature, quantity))?))),
            false => Ok(None),
        }
    }
}
