//! The fitness of the paper: the error that an expression leaves in scenes
//! (Section 4.3).

use rand::RngExt;
use rayon::prelude::*;

use super::fitness::Fitness;
use super::rng;
use super::settings::Settings;
use crate::backend::{Backend, BackendError, Rect};
use crate::expr::Tree;
use crate::plan::{Passes, Plan, PlanError, Window};
use crate::scene::facts::Facts;
use crate::scene::{Image, Scene, SceneError, metric};

/// A scene to train on: noisy input, features, and the clean reference.
#[derive(Debug)]
pub struct TrainingScene {
    scene: Scene,
    reference: Image,
}

impl TrainingScene {
    /// Pairs a scene with its reference.
    ///
    /// # Errors
    /// If the two differ in size.
    pub fn new(scene: Scene, reference: Image) -> Result<Self, SceneError> {
        // Comparing the noisy image with the reference is the check, and says
        // which is which if it fails.
        metric::Metrics::of(&scene.noisy(), &reference)?;
        Ok(Self { scene, reference })
    }

    /// The noisy side.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The clean side.
    pub fn reference(&self) -> &Image {
        &self.reference
    }
}

/// Which pixels of the training scenes breeding looks at.
///
/// The image is divided into equal cells, and each cell gives one tile at a
/// place within it that is drawn once for the whole run: stratified sampling,
/// the same for every expression, so that expressions are compared on the same
/// pixels and a fitness can be remembered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coverage {
    /// All of them.
    Full,
    /// About this share of them, in tiles whose places `seed` names.
    Share {
        /// Between 0 and 1.
        share: f64,
        /// Names the places.
        seed: u64,
    },
}

impl Coverage {
    /// The coverage that settings ask for.
    pub fn of(settings: &Settings) -> Self {
        if settings.share < 1.0 {
            Self::Share { share: settings.share, seed: settings.seed }
        } else {
            Self::Full
        }
    }
}

/// Tiles are wide and low: vector code works along rows.
const TILE: (usize, usize) = (64, 2);

/// Judges expressions by the sum over scenes of the relative mean square error.
pub struct ImageFitness<'a> {
    scenes: Vec<TrainingScene>,
    tiles: Vec<Vec<Rect>>,
    coverage: Coverage,
    facts: Facts,
    window: Window,
    passes: Passes,
    backend: &'a dyn Backend,
}

/// Why an expression could not be judged in a report.
#[derive(Debug, thiserror::Error)]
pub enum JudgeError {
    /// There is no plan for it.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// It could not be run.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

/// The errors that a filter leaves in one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneErrors {
    /// Which scene.
    pub scene: String,
    /// Against the reference.
    pub metrics: metric::Metrics,
}

impl<'a> ImageFitness<'a> {
    /// A fitness over scenes, all loaded with padding for the window.
    pub fn new(
        scenes: Vec<TrainingScene>,
        window: Window,
        coverage: Coverage,
        backend: &'a dyn Backend,
    ) -> Self {
        let tiles = scenes
            .iter()
            .enumerate()
            .map(|(k, training)| match coverage {
                Coverage::Full => vec![Rect::whole(&training.scene)],
                Coverage::Share { share, seed } => {
                    tiles(Rect::whole(&training.scene), share, seed, k)
                }
            })
            .collect();
        let facts = Facts::of_all(scenes.iter().map(|training| &training.scene));
        Self { scenes, tiles, coverage, facts, window, passes: Passes::ALL, backend }
    }

    /// What holds of all scenes: what is absent here no expression may read.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// The scenes.
    pub fn scenes(&self) -> &[TrainingScene] {
        &self.scenes
    }

    /// Pixel pairs that judging one expression for breeding takes.
    pub fn pairs(&self) -> usize {
        let pixels: usize = self.tiles.iter().flatten().map(Rect::pixels).sum();
        pixels * self.window.taps()
    }

    /// The errors that a filter leaves in each scene, all pixels counted.
    ///
    /// # Errors
    /// If the expression cannot be planned for these scenes or compiled.
    pub fn report(&self, tree: &Tree) -> Result<Vec<SceneErrors>, JudgeError> {
        let plan = self.plan(tree)?;
        let code = self.backend.compile(&plan)?;
        let judge = |training: &TrainingScene| {
            let scene = &training.scene;
            let filtered = code.run(scene, &[Rect::whole(scene)])?.swap_remove(0);
            let channel = |c: usize| filtered.pixels.iter().map(|p| p[c]).collect::<Vec<f32>>();
            let (width, height) = (scene.layout().width(), scene.layout().height());
            let image = Image::new(scene.name(), width, height, [0, 1, 2].map(channel))
                .expect("one colour per pixel");
            let metrics = metric::Metrics::of(&image, &training.reference)
                .expect("TrainingScene::new compared the sizes");
            Ok(SceneErrors { scene: scene.name().to_owned(), metrics })
        };
        self.scenes.iter().map(judge).collect()
    }

    fn plan(&self, tree: &Tree) -> Result<Plan, PlanError> {
        Plan::new(std::slice::from_ref(tree), self.window, &self.facts, self.passes)
    }

    /// The sum over the scenes of the mean error over the given tiles.
    fn error(&self, tree: &Tree, tiles: impl Fn(usize) -> Vec<Rect>) -> f64 {
        // Whatever cannot be planned or compiled is good for nothing, and costs
        // the run no more than that.
        let Ok(plan) = self.plan(tree) else { return f64::INFINITY };
        let Ok(code) = self.backend.compile(&plan) else { return f64::INFINITY };
        let mut sum = 0.0;
        for (k, training) in self.scenes.iter().enumerate() {
            let region = tiles(k);
            let Ok(filtered) = code.run(&training.scene, &region) else { return f64::INFINITY };
            sum += mean_error(&filtered[0].pixels, &training.reference, &region);
        }
        if sum.is_nan() { f64::INFINITY } else { sum }
    }
}

impl Fitness for ImageFitness<'_> {
    type Error = std::convert::Infallible;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Self::Error> {
        Ok(trees.par_iter().map(|tree| self.error(tree, |k| self.tiles[k].clone())).collect())
    }

    fn evaluate_full(&self, trees: &[Tree]) -> Result<Vec<f64>, Self::Error> {
        let whole = |k: usize| vec![Rect::whole(&self.scenes[k].scene)];
        Ok(trees.par_iter().map(|tree| self.error(tree, whole)).collect())
    }

    fn identity(&self) -> String {
        let names: Vec<&str> = self.scenes.iter().map(|t| t.scene.name()).collect();
        format!("relmse of {} over {:?}, {:?}", names.join(" "), self.window, self.coverage)
    }
}

/// Mean over pixels and channels of (img - ref)² / (ref² + 0.01), summed in the
/// order of the pixels.
fn mean_error(pixels: &[[f32; 3]], reference: &Image, region: &[Rect]) -> f64 {
    let (width, _) = reference.size();
    let mut truth: [Vec<f32>; 3] = Default::default();
    for rect in region {
        for y in rect.y..rect.y + rect.height {
            let row = y * width + rect.x..y * width + rect.x + rect.width;
            for (truth, channel) in truth.iter_mut().zip(reference.rgb()) {
                truth.extend_from_slice(&channel[row.clone()]);
            }
        }
    }
    let image = [0, 1, 2].map(|c| pixels.iter().map(|p| p[c]).collect::<Vec<f32>>());
    metric::rel_mse(image.each_ref().map(Vec::as_slice), truth.each_ref().map(Vec::as_slice))
}

/// One tile in each cell of a regular grid over the image.
fn tiles(whole: Rect, share: f64, seed: u64, scene: usize) -> Vec<Rect> {
    let (tile_width, tile_height) = TILE;
    // Tiles span their cell's columns; which of its rows, is drawn.
    let columns = whole.width.div_ceil(tile_width).max(1);
    let bands = (whole.height as f64 * share / tile_height as f64).round() as usize;
    let bands = bands.clamp(1, whole.height.div_ceil(tile_height).max(1));
    let mut tiles = Vec::with_capacity(columns * bands);
    for band in 0..bands {
        let rows = band * whole.height / bands..(band + 1) * whole.height / bands;
        for column in 0..columns {
            let x = column * whole.width / columns..(column + 1) * whole.width / columns;
            let height = tile_height.min(rows.len());
            // A stream that no individual has: islands are numbered from zero.
            let mut stream = rng::stream(seed, usize::MAX, scene as u32, tiles.len());
            let y = rows.start + stream.random_range(0..=rows.len() - height);
            tiles.push(Rect { x: x.start, y, width: x.len(), height });
        }
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_share_asked_for_and_stay_in_their_cells() {
        for (width, height, share) in [(256, 256, 0.1), (337, 191, 0.05), (5, 3, 0.5), (64, 1, 1.0)]
        {
            let whole = Rect { x: 0, y: 0, width, height };
            let tiles = tiles(whole, share, 7, 0);
            let mut seen = vec![false; whole.pixels()];
            for tile in &tiles {
                for y in tile.y..tile.y + tile.height {
                    for x in tile.x..tile.x + tile.width {
                        assert!(!std::mem::replace(&mut seen[y * width + x], true), "overlap");
                    }
                }
            }
            let covered = seen.iter().filter(|&&s| s).count() as f64 / whole.pixels() as f64;
            let one_band = 2.0 / height as f64;
            assert!((covered - share).abs() <= one_band, "{covered} of {share}");
        }
    }

    #[test]
    fn every_row_can_be_drawn_and_the_draw_is_named_by_the_seed() {
        let whole = Rect { x: 0, y: 0, width: 640, height: 100 };
        assert_eq!(tiles(whole, 0.1, 7, 0), tiles(whole, 0.1, 7, 0));
        assert_ne!(tiles(whole, 0.1, 7, 0), tiles(whole, 0.1, 8, 0));
        assert_ne!(tiles(whole, 0.1, 7, 0), tiles(whole, 0.1, 7, 1));
    }
}
