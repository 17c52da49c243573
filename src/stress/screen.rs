//! A quick look at what makes most bred filters unstable: the last bits of features, and
//! roundings on the way to a weight.
//!
//! Certificates take a minute, which a search cannot give to each of thousands. This
//! takes a tenth of a second: all features are given noise in the last place at once,
//! in the scenes that certificates are made from, and the results compared, with each
//! other and in some rows with the exact filter's. What passes may still be refused a
//! certificate.

use super::adversary::{Stream, grounds};
use super::peak::change;
use super::sensitivity::{Noise, noisy};
use super::trial::filter;
use super::verdict::{INACCURACY, ULP};
use super::{Ground, Kind, StressError};
use crate::backend::reference::oracle::{self, DARKEST};
use crate::backend::{ACCURACY, Backend, Rect};
use crate::expr::Tree;
use crate::filter::{Filter, Gather, Window};
use crate::scene::{LoadOptions, Needs, RawScene, Scene, SceneError};

/// Rows of a rendered scene that are computed exactly. What magnifies roundings (an arc
/// sine near 1, say) does so in many pixels.
const ROWS: usize = 2;

/// Scenes with and without noise in the last place of all features.
pub struct Screen<'a> {
    backend: &'a dyn Backend,
    window: Window,
    pairs: Vec<Pair>,
}

struct Pair {
    before: Scene,
    after: Scene,
    radius: u32,
    kind: Kind,
}

/// Pixels that changed of which it is asked whether anything is promised of them: one
/// that is decides, and where none of so many is, the others are hardly either.
const ASKED: usize = 64;

/// The stream of the noise, which certificates do not use.
const NOISE: u64 = u64::MAX;

impl<'a> Screen<'a> {
    /// Made scenes and `real` ones, which are to be read with all that they have, for
    /// filters with this window.
    ///
    /// # Errors
    /// If a scene cannot be prepared.
    pub fn new(
        real: &[Ground],
        window: Window,
        backend: &'a dyn Backend,
        seed: u64,
    ) -> Result<Self, SceneError> {
        let made = grounds(seed, Some(window));
        let ordinary = made.iter().chain(real).filter(|ground| ground.kind != Kind::Extreme);
        let pair = |(k, ground): (usize, &Ground)| {
            let radius = ground.radius.min(window.radius);
            let reach = Window { radius, ..window }.reach() as usize;
            let prepare = |raw: &RawScene| {
                raw.clone().prepare(&Needs::everything(), reach, &LoadOptions::default())
            };
            let before = prepare(&ground.raw)?;
            let mut rng = Stream { seed, scene: k as u64 }.numbers(NOISE);
            let mut raw = ground.raw.clone();
            for &key in ground.raw.features.keys() {
                raw = noisy(&raw, &before, key, Noise::Ulp, &mut rng);
            }
            Ok(Pair { after: prepare(&raw)?, before, radius, kind: ground.kind })
        };
        let pairs = ordinary.enumerate().map(pair).collect::<Result<_, SceneError>>()?;
        Ok(Self { backend, window, pairs })
    }

    /// Whether the last bits of its features change a filter's results by more than
    /// [`ULP`] allows, its results are further from exact than [`INACCURACY`] allows in
    /// rendered scenes, or it cannot be planned.
    ///
    /// # Errors
    /// If the back end fails, which says nothing of the filter.
    pub fn refuses(&self, tree: &Tree) -> Result<bool, StressError> {
        for pair in &self.pairs {
            match pair.tells(self, tree) {
                Ok(false) => {}
                Ok(true) | Err(StressError::Plan { .. }) => return Ok(true),
                Err(error @ (StressError::Scene(_) | StressError::Run { .. })) => {
                    return Err(error);
                }
            }
        }
        Ok(false)
    }
}

impl Pair {
    fn tells(&self, screen: &Screen<'_>, tree: &Tree) -> Result<bool, StressError> {
        let window = Window { radius: self.radius, ..screen.window };
        let stage = Gather::of_color(tree.clone(), window);
        let whole = Filter::of_gather("bred", stage.clone());
        // What is no number is no weight.
        let Ok(checked) = whole.check() else { return Ok(true) };
        let before = filter(&self.before, &checked, screen.backend)?;
        let after = filter(&self.after, &checked, screen.backend)?;
        let changes = before.iter().zip(&after).enumerate();
        let changed = changes
            .filter(|&(_, (&before, &after))| change(before, after, DARKEST) > ULP.sensitive);
        let width = self.before.layout().width();
        Ok(self.is_inexact(&stage, &before)
            || changed.take(ASKED).any(|(k, _)| {
                let pixel = Rect { x: k % width, y: k / width, width: 1, height: 1 };
                oracle::filter(&self.before, &stage, pixel)[0].pixel().promised
            }))
    }

    /// Whether some rows are too far from exact.
    fn is_inexact(&self, stage: &Gather, computed: &[[f32; 3]]) -> bool {
        if self.kind != Kind::Real {
            return false;
        }
        let (width, height) = (self.before.layout().width(), self.before.layout().height());
        (0..ROWS).any(|k| {
            let y = (2 * k + 1) * height / (2 * ROWS);
            let row = Rect { x: 0, y, width, height: 1 };
            let exact = oracle::filter(&self.before, stage, row);
            exact.iter().zip(&computed[y * width..]).any(|(exact, &computed)| {
                let exact = exact.pixel();
                exact.promised && exact.difference(computed) > INACCURACY.sensitive * ACCURACY
            })
        })
    }
}
