//! Floor 2: rendered scenes.
//!
//! A [`Scene`] is what a filter works on: the noisy colour as it is, and for the
//! weights one [`Plane`] per component of each feature's value, gradient and
//! variance, in the form described in [`plane`], in the units described in
//! [`normalize`]. [`Scene::load`] makes it from an OpenEXR file of any renderer
//! in [`naming`]; [`RawScene`] from memory.
//!
//! What it promises:
//! - Only the channels that the [`Needs`] come from are decoded, and what a plane
//!   holds does not depend on what else is needed.
//! - Unless bad pixels are left in ([`Repair::None`]), every sample is finite and
//!   within ±1e18.
//! - Scaling the exposure, or the world, by a power of two changes no bit of any
//!   plane; other scales, and moving the world, change them within rounding.
//! - Whatever was repaired, estimated or guessed is in [`Scene::notes`].
//!
//! What it does not know: whether the channels hold what their names say.

mod crop;
pub mod defect;
pub mod derive;
mod error;
pub mod facts;
mod fingerprint;
mod folder;
mod gap;
pub mod inspect;
pub mod listing;
pub mod mapping;
mod mend;
pub mod naming;
mod needs;
pub mod normalize;
mod note;
mod picture;
pub mod plane;
mod prepare;
mod raw;
pub mod repair;
mod scratch;
mod spill;
mod target;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::Path;

pub use crop::Crop;
pub use error::SceneError;
pub use facts::{Fact, Facts};
pub use fingerprint::Fingerprint;
pub use folder::{NOISY, REFERENCE, SceneFiles, discover, sample_counts, samples_of, scene_name};
pub use needs::Needs;
pub use normalize::{ColorScale, Normalization};
pub use note::Note;
pub use picture::{load_image, load_reference};
pub use plane::{Layout, Plane, Samples};
pub use prepare::MOST_SAMPLES;
pub use raw::RawScene;
pub use repair::Repair;
pub use spill::{SpilledScene, Weight};
pub use target::{LayerChannels, Target};

use crate::expr::builder::LIMIT;
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::image::exr::{Unfinished, Window};
use crate::image::{Attributes, Image};
use raw::Origin;

/// How scenes are loaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// What becomes of pixels that are no numbers.
    pub repair: Repair,
    /// How colours are laid out for weights.
    pub color_scale: ColorScale,
    /// How many samples each pixel is the mean of, for filters that ask; if nothing is said,
    /// what the file says.
    pub samples: Option<u32>,
    /// What becomes of renders that were not finished.
    pub unfinished: Unfinished,
}

/// A noisy image with its features, ready to be filtered.
#[derive(Clone, Debug)]
pub struct Scene {
    name: String,
    layout: Layout,
    top: usize,
    color: [Samples; 3],
    /// Without padding.
    alpha: Option<Vec<f32>>,
    /// Pictures to be filtered by the colour's weights, without padding.
    layers: Vec<(LayerChannels, [Vec<f32>; 3])>,
    ones: Samples,
    planes: BTreeMap<PlaneId, Plane>,
    /// What is known of each of `planes`: found once, as every run of a plan asks.
    facts: Facts,
    normalization: Normalization,
    notes: Vec<Note>,
    origin: Origin,
}

impl Scene {
    /// Loads the scene in the file at `path`, for windows up to radius `pad`.
    ///
    /// A needed plane that the file cannot provide is left out; ask
    /// [`Scene::require`] for an error.
    ///
    /// # Errors
    /// If the file cannot be read, has no colour, or has bad pixels that the
    /// options refuse.
    pub fn load(
        path: &Path,
        needs: &Needs,
        pad: usize,
        options: &LoadOptions,
    ) -> Result<Self, SceneError> {
        Self::of(&Target::known(path, options.samples)?, &[], needs, pad, options)
    }

    /// Loads the scene of a target, with layers beside the colour.
    ///
    /// # Errors
    /// Those of [`Scene::load`].
    pub fn of(
        target: &Target,
        layers: &[LayerChannels],
        needs: &Needs,
        pad: usize,
        options: &LoadOptions,
    ) -> Result<Self, SceneError> {
        RawScene::of(target, layers, needs, options)?.prepare(needs, pad, options)
    }

    /// What reports call it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where the samples of every plane of this scene stand.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Where its first row stands in the image: 0, unless it is a part of one.
    pub fn top(&self) -> usize {
        self.top
    }

    /// The noisy colour as the renderer wrote it (but for repaired pixels): what
    /// is averaged. Zero in the padding.
    pub fn color(&self) -> &[Samples; 3] {
        &self.color
    }

    /// How much of each pixel is covered, row by row without padding, where the file says so.
    pub fn alpha(&self) -> Option<&[f32]> {
        self.alpha.as_deref()
    }

    /// 1 inside the image, 0 in the padding: summed with the weights of taps
    /// outside, it adds nothing.
    pub fn ones(&self) -> &Samples {
        &self.ones
    }

    /// A plane for weights to look at; `None` if the scene does not provide it or
    /// it was not needed.
    pub fn plane(&self, id: PlaneId) -> Option<&Plane> {
        self.planes.get(&id)
    }

    /// What is known of a plane.
    pub fn fact(&self, id: PlaneId) -> Fact {
        self.facts.get(id)
    }

    /// The same scene as if the file said nothing of what is covered.
    #[must_use]
    pub fn without_alpha(self) -> Self {
        Self { alpha: None, ..self }
    }

    /// The layers that it was loaded with.
    pub fn layers(&self) -> impl Iterator<Item = &LayerChannels> {
        self.layers.iter().map(|(channels, _)| channels)
    }

    /// The pixels of a layer that it was loaded with, as the file has them.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn layer(&self, layer: usize) -> &[Vec<f32>; 3] {
        &self.layers[layer].1
    }

    /// The same scene with these pictures, pixel by pixel in the file's units, as `otherLayer`:
    /// what is filtered by the weights of the colour.
    ///
    /// # Panics
    /// If they are more than [`Feature::PICTURES`] or of another size.
    #[must_use]
    pub fn with_pictures(mut self, pictures: &[[Vec<f32>; 3]]) -> Self {
        assert!(pictures.len() <= Feature::PICTURES, "so many are read at a time");
        let Normalization { exposure, color_scale, .. } = self.normalization;
        let channels = pictures.iter().flatten();
        for (id, channel) in PlaneId::of(Feature::Layer, Quantity::Value).zip(channels) {
            if let Some(plane) = self.planes.get_mut(&id) {
                let scaled = channel.iter().map(|&x| color_scale.apply(x / exposure));
                let scaled: Vec<f32> = scaled.map(|x| x.clamp(-LIMIT, LIMIT)).collect();
                *plane = Plane::new(self.layout, &scaled);
            }
        }
        let planes = self.planes.iter();
        self.facts = Facts::from_planes(planes.map(|(&id, plane)| (id, Fact::of(plane))));
        self
    }

    /// Every plane for weights.
    pub fn planes(&self) -> impl Iterator<Item = (PlaneId, &Plane)> {
        self.planes.iter().map(|(&id, plane)| (id, plane))
    }

    /// The scales that the planes were divided by.
    pub fn normalization(&self) -> &Normalization {
        &self.normalization
    }

    /// Where the file lacks the colour, as a render that was not finished does: rectangles
    /// of pixels, counted from the image's corner. There the colour, and every feature that
    /// is not there, is that of pixels near by, so that weights around see no edge.
    pub fn missing(&self) -> &[Window] {
        self.origin.missing.first().map_or(&[], Vec::as_slice)
    }

    /// Where the file lacks a layer that the scene was loaded with, as
    /// [`missing`](Self::missing) has it of the colour.
    pub fn missing_of_layer(&self, layer: usize) -> &[Window] {
        self.origin.missing.get(1 + layer).map_or(&[], Vec::as_slice)
    }

    /// What was done on the way in.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }

    /// What the file says beside its pixels, to be written with the result.
    pub fn attributes(&self) -> Option<&Attributes> {
        self.origin.attributes.as_ref()
    }

    /// The noisy colour as an unpadded image.
    pub fn noisy(&self) -> Image {
        let rgb = self.color.each_ref().map(|channel| {
            (0..self.layout.height()).flat_map(|y| channel.pixels(y)).copied().collect()
        });
        Image::new(&self.name, self.layout.width(), self.layout.height(), rgb)
            .expect("one sample per pixel, as the layout has it")
            .with_attributes(self.attributes())
    }

    /// Checks that the scene provides what a filter reads. The scene must have
    /// been loaded with at least these needs.
    ///
    /// # Errors
    /// For the first plane that is missing: its spelling in expressions, the
    /// channels it would have been taken from, and those that the file has.
    pub fn require(&self, needs: &Needs) -> Result<(), SceneError> {
        self.origin.require(&self.name, needs, |id| self.planes.contains_key(&id))
    }
}
