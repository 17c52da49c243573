//! Scenes made to be difficult, each with every feature there is.
//!
//! What a scene is made of is a row of a table: a function from a sample's place to
//! its value. Colours are never negative, as what back ends promise is relative to
//! the colour: averaged with others of the other sign, one may cancel, whatever the
//! weights.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Ground, Kind};
use crate::expr::feature::Unit;
use crate::expr::{Feature, Quantity};
use crate::filter::Window;
use crate::scene::RawScene;

const WIDTH: usize = 40;
const HEIGHT: usize = 24;

/// The radius of most windows: all of the scenes' structure fits into it.
const RADIUS: u32 = 4;

/// Names a stream of random numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stream {
    pub(super) seed: u64,
    pub(super) scene: u64,
}

impl Stream {
    /// The stream's numbers for one of many uses.
    pub(super) fn numbers(self, of: u64) -> ChaCha8Rng {
        let mut key = [0; 32];
        for (bytes, word) in key.chunks_exact_mut(8).zip([self.seed, self.scene, of]) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        ChaCha8Rng::from_seed(key)
    }
}

/// A sample of a plane.
#[derive(Clone, Copy)]
struct Place {
    feature: Feature,
    quantity: Quantity,
    component: usize,
    x: usize,
    y: usize,
}

struct Row {
    name: &'static str,
    kind: Kind,
    sample: fn(Place, &mut ChaCha8Rng) -> f32,
}

const TABLE: [Row; 11] = [
    Row { name: "noise", kind: Kind::Made, sample: noise },
    Row { name: "constant", kind: Kind::Made, sample: |at, _| level(at, 0.3) },
    Row { name: "equal features", kind: Kind::Made, sample: equal },
    Row { name: "last bits", kind: Kind::Made, sample: last_bits },
    Row { name: "leaves", kind: Kind::Made, sample: leaves },
    Row { name: "checkerboard", kind: Kind::Made, sample: checkerboard },
    Row { name: "gradients", kind: Kind::Made, sample: gradients },
    Row { name: "twelve decades", kind: Kind::Made, sample: decades },
    Row { name: "huge", kind: Kind::Extreme, sample: huge },
    Row { name: "tiny", kind: Kind::Extreme, sample: tiny },
    STEPS,
];

/// The scene that stands for all others where one must do.
const STEPS: Row = Row { name: "steps", kind: Kind::Made, sample: steps };

/// All scenes, and one of them again with a window as large as the filter's, if it has
/// one that is otherwise cut down.
pub(super) fn grounds(seed: u64, window: Option<Window>) -> Vec<Ground> {
    let ground = |(k, row): (usize, &Row)| row.ground(Stream { seed, scene: k as u64 });
    let mut grounds: Vec<Ground> = TABLE.iter().enumerate().map(ground).collect();
    if let Some(window) = window.filter(|window| window.radius > RADIUS) {
        let mut wide = steps_alone(seed);
        wide.raw.name = format!("{}, whole window", STEPS.name);
        wide.radius = window.radius;
        grounds.push(wide);
    }
    grounds
}

/// The scene that stands for all others where one must do.
pub(super) fn steps_alone(seed: u64) -> Ground {
    STEPS.ground(Stream { seed, scene: TABLE.len() as u64 })
}

impl Row {
    fn ground(&self, stream: Stream) -> Ground {
        let mut rng = stream.numbers(0);
        let mut image = |feature, quantity, component| -> Vec<f32> {
            let places = (0..WIDTH * HEIGHT).map(|k| (k % WIDTH, k / WIDTH));
            let places = places.map(|(x, y)| Place { feature, quantity, component, x, y });
            places.map(|place| (self.sample)(place, &mut rng)).collect()
        };
        let color = [0, 1, 2].map(|c| {
            let channel = image(Feature::Color, Quantity::Value, c);
            channel.into_iter().map(f32::abs).collect()
        });
        let mut raw = RawScene::new(self.name, WIDTH, HEIGHT, color);
        for feature in Feature::ALL.into_iter().filter(|feature| feature.is_stored()) {
            if feature != Feature::Color {
                let values = (0..feature.width()).map(|c| image(feature, Quantity::Value, c));
                raw = raw.with(feature, Quantity::Value, values.collect());
            }
            let variance = image(feature, Quantity::Variance, 0);
            let variance = variance.into_iter().map(f32::abs).collect();
            raw = raw.with(feature, Quantity::Variance, vec![variance]);
        }
        Ground { raw, kind: self.kind, radius: RADIUS }
    }
}

/// A value that a renderer might write, for `t` in [0, 1].
fn level(Place { feature, quantity, component, .. }: Place, t: f32) -> f32 {
    // So that no two components are alike.
    let t = (t + 0.07 * component as f32).min(1.0);
    if quantity == Quantity::Variance {
        return 0.02 * t;
    }
    let row = feature.row();
    match (row.unit, row.bounds) {
        (Unit::Place, _) => 10.0 * t - 3.0,
        (Unit::Length, _) => 2.0 + 10.0 * t,
        (Unit::Light, _) => 2.0 * t,
        (Unit::Own, Some([lo, hi])) => lo + (hi - lo) * t,
        (Unit::Own, None) => t,
    }
}

const PLACE: (Feature, Quantity) = (Feature::WorldPosition, Quantity::Value);

fn is_color(at: Place) -> bool {
    (at.feature, at.quantity) == (Feature::Color, Quantity::Value)
}

/// Every sample for itself.
fn noise(at: Place, rng: &mut ChaCha8Rng) -> f32 {
    level(at, rng.random())
}

/// Noise over a wall that knows no differences. Some of it is elsewhere: positions are
/// measured by the extent of what is visible, and that of a single point would be its
/// rounding errors.
fn equal(at: Place, rng: &mut ChaCha8Rng) -> f32 {
    let t: f32 = rng.random();
    let elsewhere = at.x < 4 && (at.feature, at.quantity) == PLACE;
    level(
        at,
        if is_color(at) {
            t
        } else if elsewhere {
            0.8
        } else {
            0.3
        },
    )
}

/// The same wall, rounded one way here and another there.
fn last_bits(at: Place, rng: &mut ChaCha8Rng) -> f32 {
    let value = equal(at, rng);
    match rng.random_range(0..3) {
        0 => value.next_down(),
        1 => value.next_up(),
        _ => value,
    }
}

fn checkerboard(at: Place, rng: &mut ChaCha8Rng) -> f32 {
    let t = if (at.x + at.y).is_multiple_of(2) { 0.2 } else { 0.7 };
    level(at, if is_color(at) { t + 0.2 * rng.random::<f32>() } else { t })
}

/// Ramps, each component in a direction of its own, under noisy light.
fn gradients(at: Place, rng: &mut ChaCha8Rng) -> f32 {
    let (x, y) = (at.x as f32 / WIDTH as f32, at.y as f32 / HEIGHT as f32);
    let t = [x, y, 0.5 * (x + y)][at.component % 3];
    level(at, if is_color(at) { t * rng.random::<f32>() } else { t })
}

/// Light from 1e-6 to 1e6.
fn decades(at: Place, rng: &mut ChaCha8Rng) -> f32 {
    let t: f32 = rng.random();
    match at.feature.row().unit {
        Unit::Light => 10f32.powf(12.0 * t - 6.0),
        Unit::Own | Unit::Place | Unit::Length => level(at, t),
    }
}

/// Surfaces with outlines, some noise on everything, fireflies, and a corner in which
/// nothing is hit.
fn steps(at: Place, rng: &mut ChaCha8Rng) -> f32 {
    let noise: f32 = rng.random();
    let firefly = rng.random_range(0..100) == 0;
    if at.x < 8 && at.y < 6 && !is_color(at) {
        return 0.0;
    }
    let t = SURFACES[surface(at)];
    if is_color(at) {
        return level(at, t * (0.3 + 1.4 * noise)) * if firefly { 500.0 } else { 1.0 };
    }
    level(at, t + 0.02 * noise)
}

/// Leaves: each of one colour throughout, near and dark, far and dark, near and bright,
/// far and bright; and each pixel with a normal and a light of its own.
fn leaves(at: Place, rng: &mut ChaCha8Rng) -> f32 {
    let which = surface(at);
    let is_bright = which / 2 == 1;
    let is_far = which % 2 == 1;
    let t = match at.feature.row().unit {
        Unit::Place | Unit::Length => is_far,
        Unit::Light if at.feature == Feature::Color => is_bright,
        Unit::Own if !at.feature.row().signed => is_bright,
        Unit::Own | Unit::Light => return level(at, rng.random()),
    };
    let t = if t { 0.8 } else { 0.1 };
    level(at, if is_color(at) { t * (0.3 + 1.4 * rng.random::<f32>()) } else { t })
}

const SURFACES: [f32; 4] = [0.1, 0.35, 0.6, 0.8];

/// Which of four surfaces is seen.
fn surface(Place { x, y, .. }: Place) -> usize {
    (x / 9 + y / 7) % SURFACES.len()
}

/// Anything from 1 to the limit of what expressions compute with.
fn huge(_: Place, rng: &mut ChaCha8Rng) -> f32 {
    const VALUES: [f32; 8] = [1e18, -1e18, 3e17, 1e9, -1e9, 1.0, 0.0, -0.0];
    VALUES[rng.random_range(0..VALUES.len())]
}

/// Subnormal numbers, zeros of both signs, and little else.
fn tiny(_: Place, rng: &mut ChaCha8Rng) -> f32 {
    const VALUES: [f32; 8] = [1e-45, -1e-45, 5e-39, 1e-30, -1e-18, 1e-6, 0.0, -0.0];
    VALUES[rng.random_range(0..VALUES.len())]
}
