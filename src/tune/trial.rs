//! How filters do on whole scenes that they are not tuned on.

use super::draw::Lack;
use super::error::Error;
use super::loss::{Loss, parts};
use super::scenes::{Level, TuningScene};
use super::settings::Settings;
use crate::backend::{Backend, Executable, Rect};
use crate::expr::Feature;
use crate::filter::Filter;
use crate::image::{Image, Metrics};
use crate::plan::{Passes, Plan, PlanError};
use crate::scene::{Fact, Facts, Note, Scene};

/// How a filter does on whole validation scenes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// The mean score of the loss, over images with all features and without some of them,
    /// the latter counting as often as they are tuned on.
    pub score: f64,
    /// The geometric mean of RelMSE, with all features.
    pub rel_mse: f64,
    /// The same without the worst 0.1% of the pixels of each image.
    pub trimmed_rel_mse: f64,
}

/// How a filter does on one scene: means over its sample counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// The score of the loss: lower is better.
    pub score: f64,
    /// The logarithm of RelMSE.
    pub log_rel_mse: f64,
    /// The same without the worst 0.1% of the pixels.
    pub log_trimmed: f64,
}

/// How a filter does on each of some scenes, with all their features.
///
/// # Errors
/// If it cannot run on one of them.
pub fn scores<B: Backend + ?Sized>(
    filter: &Filter,
    scenes: &[TuningScene],
    loss: Loss,
    backend: &B,
) -> Result<Vec<Score>, Error> {
    let levels = scenes.iter().flat_map(|scene| &scene.levels);
    let facts = Facts::of_all(levels.map(|level| &level.scene));
    let code = compiled(filter, &facts, scenes, backend)?;
    let of_scene = |scene: &TuningScene| {
        let mut sum = Score::default();
        for level in &scene.levels {
            let score = judged(&*code, scene, &level.scene, loss)?;
            sum.score += score.score;
            sum.log_rel_mse += score.log_rel_mse;
            sum.log_trimmed += score.log_trimmed;
        }
        let count = scene.levels.len() as f64;
        Ok(Score {
            score: sum.score / count,
            log_rel_mse: sum.log_rel_mse / count,
            log_trimmed: sum.log_trimmed / count,
        })
    };
    scenes.iter().map(of_scene).collect()
}

/// How a filter does on whole scenes, at all of their sample counts: with all features, and
/// with what the other sets leave, each image with one of them in turn.
///
/// # Errors
/// If it cannot run on one of them.
pub(super) fn trial<B: Backend>(
    filter: &Filter,
    scenes: &[TuningScene],
    lacks: &[&Lack],
    settings: &Settings,
    backend: &B,
) -> Result<Trial, Error> {
    let images: Vec<(&TuningScene, &Level)> =
        scenes.iter().flat_map(|scene| scene.levels.iter().map(move |l| (scene, l))).collect();
    let mut sum = Score::default();
    let mut lacking = 0.0;
    for (k, lack) in lacks.iter().enumerate() {
        let others = lacks.len() - 1;
        let met = images.iter().enumerate().filter(|&(n, _)| k == 0 || n % others == k - 1);
        let met: Vec<(&TuningScene, Scene)> =
            met.map(|(_, &(scene, level))| (scene, without(&level.scene, lack))).collect();
        if met.is_empty() {
            continue;
        }
        let facts = Facts::of_all(met.iter().map(|(_, noisy)| noisy));
        let facts = facts.iter().filter(|(plane, _)| !lack.features.contains(&plane.feature));
        let code = compiled(filter, &Facts::from_planes(facts), scenes, backend)?;
        for (scene, noisy) in &met {
            let score = judged(&*code, scene, noisy, settings.loss)?;
            if k > 0 {
                lacking += score.score;
                continue;
            }
            sum.score += score.score;
            sum.log_rel_mse += score.log_rel_mse;
            sum.log_trimmed += score.log_trimmed;
        }
    }
    let count = images.len() as f64;
    let dropped = if lacks.len() > 1 { settings.drop } else { 0.0 };
    Ok(Trial {
        score: (1.0 - dropped) * (sum.score / count) + dropped * lacking / count,
        rel_mse: (sum.log_rel_mse / count).exp(),
        trimmed_rel_mse: (sum.log_trimmed / count).exp(),
    })
}

fn compiled<B: Backend + ?Sized>(
    filter: &Filter,
    facts: &Facts,
    scenes: &[TuningScene],
    backend: &B,
) -> Result<Box<dyn Executable>, Error> {
    let checked = filter.check().expect("values within bounds make sense");
    let plan = Plan::of(&checked, facts, Passes::ALL).map_err(|source| refused(scenes, source))?;
    Ok(backend.compile(&plan)?)
}

/// How code does on one image of a scene.
fn judged(
    code: &dyn Executable,
    scene: &TuningScene,
    noisy: &Scene,
    loss: Loss,
) -> Result<Score, Error> {
    let filtered = code.run(noisy, &[Rect::whole(noisy)])?.swap_remove(0);
    let mut owed = vec![[0.0; 3]; filtered.pixels.len()];
    let (width, height) = scene.image.size();
    let parts = parts(&filtered.pixels, width, 1.0, &scene.reference, loss.shares(), &mut owed);
    let rgb = [0, 1, 2].map(|k| filtered.pixels.iter().map(|pixel| pixel[k]).collect());
    let image = Image::new(&scene.name, width, height, rgb).expect("a colour per pixel");
    let metrics = Metrics::of(&image, &scene.image)?;
    let [log_rel_mse, log_trimmed] =
        [metrics.rel_mse, metrics.trimmed_rel_mse].map(|x| x.max(1e-12).ln());
    Ok(Score { score: loss.score(parts), log_rel_mse, log_trimmed })
}

/// An image as if its file had no variances, if that is what is lacking.
fn without(scene: &Scene, lack: &Lack) -> Scene {
    if lack.variances { scene.clone() } else { scene.without_variances() }
}

/// Whether the variance of the colour is an estimate, as far as somebody asked for it.
pub(super) fn is_estimated(scene: &Scene) -> bool {
    scene.notes().contains(&Note::EstimatedVariance(Feature::Color))
}

/// Why no plan could be made, naming a scene that lacks what is missing.
pub(super) fn refused(scenes: &[TuningScene], source: PlanError) -> Error {
    let missing = |scene: &&TuningScene| match &source {
        PlanError::Missing { plane, .. } => {
            scene.levels.iter().any(|level| level.scene.fact(*plane) == Fact::Absent)
        }
        _ => false,
    };
    let scene = scenes.iter().find(missing).or(scenes.first());
    Error::Plan { scene: scene.map_or(String::new(), |scene| scene.name.clone()), source }
}
