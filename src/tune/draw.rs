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
}

/// What files lack: at first nothing. What denoisers are usually given follows, with and
/// without depth, and at last a picture alone.
pub const LACKS: [Lack; 4] = [
    Lack { name: "all features", features: &[] },
    Lack {
        name: "colour, albedo, normal and depth",
        features: &[Feature::WorldPosition, Feature::SecTexture, Feature::DirIllumination],
    },
    Lack {
        name: "colour, albedo and normal",
        features: &[
            Feature::WorldPosition,
            Feature::SecTexture,
            Feature::DirIllumination,
            Feature::Depth,
        ],
    },
    Lack {
        name: "colour alone",
        features: &[
            Feature::WorldPosition,
            Feature::SecTexture,
            Feature::DirIllumination,
            Feature::Depth,
            Feature::Normal,
            Feature::Texture,
        ],
    },
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
        let crop = Crop { corner, size, flipped, transposed };
        Self { scene, level, lack, crop, gain: stops.exp2(), noise }
    }
}
