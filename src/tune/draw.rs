//! Which parts of which images a step looks at.

use rand::RngExt;

use super::rng::Stream;
use super::scenes::TuningScene;
use super::settings::Settings;
use crate::expr::Feature;
use crate::scene::Crop;

/// Features that many files lack, all at once.
#[derive(Debug)]
pub struct Lack {
    /// What reports call what is left.
    pub name: &'static str,
    /// What is not there.
    pub features: &'static [Feature],
    /// Whether there are variances.
    pub variances: bool,
}

/// What a picture with normals, albedo and depth lacks.
const GUIDES: &[Feature] = &[Feature::WorldPosition, Feature::SecTexture, Feature::DirIllumination];

/// What a picture with normals and albedo lacks.
const NORMAL_AND_ALBEDO: &[Feature] =
    &[Feature::WorldPosition, Feature::SecTexture, Feature::DirIllumination, Feature::Depth];

/// What a picture with normals and depth lacks: a renderer's plain passes, albedo not ticked.
const NORMAL_AND_DEPTH: &[Feature] =
    &[Feature::WorldPosition, Feature::SecTexture, Feature::DirIllumination, Feature::Texture];

/// What a picture alone lacks.
const COLOR: &[Feature] = &[
    Feature::WorldPosition,
    Feature::SecTexture,
    Feature::DirIllumination,
    Feature::Depth,
    Feature::Normal,
    Feature::Texture,
];

/// What files lack: at first nothing. What denoisers are usually given follows, with and
/// without depth, what has no albedo, and a picture alone; and the same once more as most
/// renderers write them, without variances.
pub const LACKS: [Lack; 9] = [
    Lack { name: "all features", features: &[], variances: true },
    Lack { name: "colour, albedo, normal and depth", features: GUIDES, variances: true },
    Lack { name: "colour, albedo and normal", features: NORMAL_AND_ALBEDO, variances: true },
    Lack { name: "colour, normal and depth", features: NORMAL_AND_DEPTH, variances: true },
    Lack { name: "colour alone", features: COLOR, variances: true },
    Lack {
        name: "colour, albedo, normal and depth without variances",
        features: GUIDES,
        variances: false,
    },
    Lack {
        name: "colour, albedo and normal without variances",
        features: NORMAL_AND_ALBEDO,
        variances: false,
    },
    Lack {
        name: "colour, normal and depth without variances",
        features: NORMAL_AND_DEPTH,
        variances: false,
    },
    Lack { name: "colour alone without variances", features: COLOR, variances: false },
];

/// A part of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draw {
    /// Which scene.
    pub scene: usize,
    /// At which of its sample counts.
    pub level: usize,
    /// Which of so many sets of features it is filtered with; 0 for all.
    pub lack: usize,
    /// Which part, and how it is turned.
    pub crop: Crop,
    /// By what light is multiplied.
    pub gain: f32,
    /// Which share of its noise is left.
    pub noise: f32,
    /// Whether the filter is told how many samples there are.
    pub told: bool,
}

impl Draw {
    /// Draws a part. Scenes count alike, and so do the sample counts of each.
    pub fn new(
        settings: &Settings,
        scenes: &[TuningScene],
        lacks: usize,
        stream: &mut Stream,
    ) -> Self {
        let scene = stream.random_range(0..scenes.len());
        let level = stream.random_range(0..scenes[scene].levels.len());
        let layout = scenes[scene].levels[level].scene.layout();
        let whole = [layout.width(), layout.height()];
        // Half resolution pairs columns and rows from even ones on.
        let size = whole.map(|length| length.min(settings.crop).max(2) / 2 * 2);
        let size = [0, 1].map(|axis| size[axis].min(whole[axis]));
        let corner = [0, 1].map(|axis| stream.random_range(0..=(whole[axis] - size[axis]) / 2) * 2);
        let flipped = [stream.random_bool(0.5), stream.random_bool(0.5)];
        let transposed = stream.random_bool(0.5);
        let dropped = stream.random_bool(settings.drop) && lacks > 1;
        let lack = if dropped { stream.random_range(1..lacks) } else { 0 };
        let stops = stream.random_range(-1.0f32..=1.0) * settings.stops;
        let (quiet, halvings) =
            (stream.random_bool(settings.clean), stream.random_range(0.0f32..3.0));
        let noise = if quiet { (-halvings).exp2() } else { 1.0 };
        let told = stream.random_bool(0.5);
        let crop = Crop { corner, size, flipped, transposed };
        Self { scene, level, lack, crop, gain: stops.exp2(), noise, told }
    }
}
