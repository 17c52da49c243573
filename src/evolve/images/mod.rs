//! The fitness of the paper: the error that an expression leaves in scenes
//! (Section 4.3).

mod batch;
mod coverage;
mod exact;
mod kin;
mod race;
mod rungs;
mod sample;

use std::sync::Mutex;

use rayon::prelude::*;

use super::fitness::Fitness;
use super::race::{Entrant, Ruling};
use super::settings::{Racing, TOGETHER};
use crate::backend::{Backend, BackendError, Rect};
use crate::expr::Tree;
use crate::filter::Window;
use crate::image::metric::{self, Measure};
use crate::image::{Image, ImageError};
use crate::plan::{Passes, PlanError, Precision};
use crate::scene::facts::Facts;
use crate::scene::{Fingerprint, Scene};
use batch::Batching;
pub use coverage::Coverage;
use race::Course;
use rungs::Ladder;
use sample::{Sample, mean};

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
    /// If the two differ in size, or the reference holds what is no number.
    pub fn new(scene: Scene, reference: Image) -> Result<Self, ImageError> {
        reference.check_reference()?;
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

/// Judges expressions by the sum over scenes of the mean error, RelMSE unless told
/// otherwise.
pub struct ImageFitness<'a> {
    scenes: Vec<TrainingScene>,
    /// What breeding looks at, scene by scene.
    samples: Vec<Sample>,
    coverage: Coverage,
    batching: Batching<'a>,
    /// How accurately expressions are computed for breeding; for all else at standard
    /// precision.
    breeding: Precision,
    measure: Measure,
    /// Where races are run; without one every entrant is judged in full.
    course: Option<Course>,
    /// Who has to stay out.
    restriction: Option<Restriction<'a>>,
}

/// What is asked of expressions beside a small error.
pub struct Restriction<'a> {
    /// Names it in checkpoints: a search under another would breed others.
    pub name: &'static str,
    /// Whether an expression is good for nothing. Asked of all that are to be judged
    /// in full, so it should take less time than that. The answer is remembered; where
    /// there is none because something failed, the search stops.
    pub refuses: Box<Question<'a, bool>>,
    /// Says why an expression must not win, if it must not. Asked of finalists, the
    /// best first, until there is one to whom there is no objection.
    pub objection: Box<Question<'a, Option<String>>>,
}

/// Something to be asked of expressions.
pub type Question<'a, A> = dyn Fn(&Tree) -> Result<A, Failure> + Sync + 'a;

/// Why there is no answer.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Why an expression could not be judged.
#[derive(Debug, thiserror::Error)]
pub enum JudgeError {
    /// There is no plan for it.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The back end failed.
    #[error("the back end `{backend}` failed: {source}")]
    Backend {
        /// What `--backend` calls it.
        backend: &'static str,
        /// At what.
        source: BackendError,
    },
    /// A [`Restriction`] got no answer.
    #[error(transparent)]
    Restriction(Failure),
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
        let samples = scenes.iter().enumerate().map(|(k, training)| {
            Sample::new(training, coverage.region(Rect::whole(&training.scene), k))
        });
        let samples = samples.collect();
        let facts = Facts::of_all(scenes.iter().map(|training| &training.scene));
        // A pixel's bits must not depend on whether its window is uniform in one
        // plan and filtered in another, and little in training scenes is.
        let passes = Passes { uniform: false, ..Passes::ALL };
        let batching = Batching { backend, facts, window, passes, together: TOGETHER };
        Self {
            scenes,
            samples,
            coverage,
            batching,
            breeding: Precision::Standard,
            measure: Measure::RelMse,
            course: None,
            restriction: None,
        }
    }

    /// The same, judging so many expressions in one plan; the values are the same.
    #[must_use]
    pub fn together(mut self, expressions: usize) -> Self {
        self.batching.together = expressions.max(1);
        self
    }

    /// The same, minimising another error.
    #[must_use]
    pub fn minimizing(mut self, measure: Measure) -> Self {
        self.measure = measure;
        self
    }

    /// The same, computing expressions with another accuracy while they are bred.
    /// [`evaluate_full`](Fitness::evaluate_full) and [`report`](Self::report) stay at
    /// standard precision.
    #[must_use]
    pub fn breeding_at(mut self, precision: Precision) -> Self {
        self.breeding = precision;
        self
    }

    /// The same, racing as settings ask for on pixels that `seed` names.
    #[must_use]
    pub fn racing(mut self, racing: &Racing, seed: u64) -> Self {
        self.course = racing.on.then(|| Course {
            ladder: Ladder::new(&self.scenes, &self.samples, &racing.rungs, seed),
            deviations: racing.deviations,
            known: Mutex::default(),
        });
        self
    }

    /// The same, asking more of expressions than a small error.
    #[must_use]
    pub fn restricted(mut self, restriction: Restriction<'a>) -> Self {
        self.restriction = Some(restriction);
        self
    }

    /// The same, planning with other passes; how accurately is not one of them
    /// ([`breeding_at`](Self::breeding_at)).
    #[must_use]
    pub fn with_passes(mut self, passes: Passes) -> Self {
        self.batching.passes = Passes { precision: Precision::Standard, ..passes };
        self
    }

    /// What holds of all scenes: what is absent here no expression may read.
    pub fn facts(&self) -> &Facts {
        &self.batching.facts
    }

    /// The scenes.
    pub fn scenes(&self) -> &[TrainingScene] {
        &self.scenes
    }

    /// Pixel pairs that judging one expression for breeding looks at, those included
    /// that passes save.
    pub fn pairs(&self) -> usize {
        let pixels: usize = self.samples.iter().map(Sample::pixels).sum();
        pixels * self.batching.window.taps()
    }

    /// The errors that a filter leaves in each scene, all pixels counted.
    ///
    /// # Errors
    /// If the expression cannot be planned for these scenes, or the back end fails.
    pub fn report(&self, tree: &Tree) -> Result<Vec<SceneErrors>, JudgeError> {
        let plan = self.batching.plan(std::slice::from_ref(tree))?;
        let failed = |source| self.failed(source);
        let code = self.batching.backend.compile(&plan).map_err(failed)?;
        let judge = |training: &TrainingScene| {
            let scene = &training.scene;
            let filtered = code.run(scene, &[Rect::whole(scene)]).map_err(failed)?.swap_remove(0);
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

    /// Per tree, the sum over the scenes of the mean error over their samples.
    /// Whatever cannot be planned is good for nothing. A back end that fails says nothing
    /// of the expression, so that is an error.
    fn errors(
        &self,
        trees: &[Tree],
        samples: &[Sample],
        precision: Precision,
    ) -> Result<Vec<f64>, JudgeError> {
        let error = |k: usize, pixels: &[[f32; 3]]| mean(&samples[k].errors(pixels, self.measure));
        let measured = self.batching.run(trees, &self.pairs_of(samples), precision, error);
        let measured = measured.map_err(|source| self.failed(source))?;
        Ok(measured.into_iter().map(|errors| errors.map_or(f64::INFINITY, total)).collect())
    }

    fn failed(&self, source: BackendError) -> JudgeError {
        JudgeError::Backend { backend: self.batching.backend.name(), source }
    }

    /// Judges those that the restriction, if there is one, does not refuse.
    fn unless_refused(
        &self,
        trees: &[Tree],
        judge: impl Fn(&[Tree]) -> Result<Vec<f64>, JudgeError>,
    ) -> Result<Vec<f64>, JudgeError> {
        let Some(restriction) = &self.restriction else { return judge(trees) };
        let refused = trees.par_iter().map(|tree| (restriction.refuses)(tree));
        let refused = refused.collect::<Result<Vec<bool>, Failure>>();
        let refused = refused.map_err(JudgeError::Restriction)?;
        let accepted = trees.iter().zip(&refused).filter(|(_, refused)| !**refused);
        let accepted: Vec<Tree> = accepted.map(|(tree, _)| tree.clone()).collect();
        let mut values = judge(&accepted)?.into_iter();
        let value = |refused: bool| match refused {
            true => f64::INFINITY,
            false => values.next().expect("one value for each that is judged"),
        };
        Ok(refused.into_iter().map(value).collect())
    }
}

/// The sum over the scenes.
fn total(errors: Vec<f64>) -> f64 {
    let sum = errors.into_iter().fold(0.0, |sum, error| sum + error);
    if sum.is_nan() { f64::INFINITY } else { sum }
}

impl Fitness for ImageFitness<'_> {
    type Error = JudgeError;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Self::Error> {
        self.unless_refused(trees, |trees| self.errors(trees, &self.samples, self.breeding))
    }

    fn evaluate_full(&self, trees: &[Tree]) -> Result<Vec<f64>, Self::Error> {
        let whole: Vec<Sample> = self.scenes.iter().map(Sample::whole).collect();
        self.errors(trees, &whole, Precision::Standard)
    }

    fn difference(&self, tree: &Tree) -> Result<f64, Self::Error> {
        match self.greatest_difference(tree) {
            Err(JudgeError::Plan(_)) => Ok(f64::INFINITY),
            judged => judged,
        }
    }

    fn tolerance(&self) -> f64 {
        exact::TOLERANCE
    }

    fn objection(&self, tree: &Tree) -> Result<Option<String>, Self::Error> {
        let Some(restriction) = &self.restriction else { return Ok(None) };
        (restriction.objection)(tree).map_err(JudgeError::Restriction)
    }

    fn race(&self, entrants: &[Entrant<'_>]) -> Result<Vec<Ruling>, Self::Error> {
        match &self.course {
            Some(course) => self.run_race(course, entrants),
            None => self.judge_all(entrants),
        }
    }

    /// Pixel pairs.
    fn work(&self) -> u64 {
        self.pairs() as u64
    }

    fn is_stop(error: &Self::Error) -> bool {
        match error {
            JudgeError::Plan(_) => false,
            JudgeError::Backend { source, .. } => BackendError::is_stop(source),
            JudgeError::Restriction(failure) => BackendError::is_stop(&**failure),
        }
    }

    fn pictures(&self) -> Vec<Fingerprint> {
        let of = |training: &TrainingScene| {
            let name = training.scene.name();
            [
                Fingerprint::of_scene(format!("the noisy image of `{name}`"), &training.scene),
                Fingerprint::of_image(format!("the reference of `{name}`"), &training.reference),
            ]
        };
        self.scenes.par_iter().flat_map_iter(of).collect()
    }

    fn identity(&self) -> String {
        let names: Vec<&str> = self.scenes.iter().map(|t| t.scene.name()).collect();
        let precision = match self.breeding {
            Precision::Standard => String::new(),
            Precision::Fast => format!(", {}", self.breeding.name()),
        };
        let restriction = self.restriction.as_ref().map(|r| format!(", {}", r.name));
        format!(
            "{} of {} over {:?}, {:?}{precision}{}",
            self.measure.name(),
            names.join(" "),
            self.batching.window,
            self.coverage,
            restriction.unwrap_or_default()
        )
    }
}

#[cfg(test)]
mod tests;
