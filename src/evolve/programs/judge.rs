//! How programs are judged: tuned for a few steps on parts of the training scenes, and then
//! scored on a fixed part of each.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::backend::reference::meaning;
use crate::backend::{Backend, Differentiator, Rect};
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::filter::Filter;
use crate::plan::{Passes, Plan, PlanError, Program};
use crate::scene::{Crop, Fact, Facts, Fingerprint};
use crate::tune::{self, Control, Score, Tuner, TuningScene, pictures, scores, stream};

use super::genome::Genome;
use super::settings::Settings;
use crate::evolve::Error;

/// Scenes of which finalists are compared with their exact meaning.
const COMPARED: usize = 4;

/// Most steps of the tuning that shows whether two judges agree.
const PROBED: u32 = 2;

/// Judges programs.
pub struct Judge<'a, B> {
    settings: Settings,
    training: &'a [TuningScene],
    validation: &'a [TuningScene],
    backend: &'a B,
    /// A part of every training scene, the same for all programs.
    exam: Vec<TuningScene>,
    facts: Facts,
    /// Nanoseconds per pixel that a program may be predicted to take.
    limit: f64,
}

/// A program with how it does.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// The program, its constants tuned.
    pub genome: Genome,
    /// The loss's score by training scene: lower is better.
    pub scores: Vec<f64>,
    /// Their mean.
    pub error: f64,
    /// Nanoseconds per pixel that it is predicted to take.
    pub cost: f64,
    /// Steps by which its constants were tuned, by its ancestors too.
    pub steps: u32,
}

impl Judged {
    /// What is made small: error, cost, size.
    pub fn goals(&self) -> [f64; 3] {
        [self.error, self.cost, self.genome.size() as f64]
    }
}

/// What came of a child.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// It was judged.
    Judged(Box<Judged>),
    /// It was given up before it was tuned.
    Dropped,
    /// It cannot run on the scenes, or takes longer than is allowed.
    Unfit,
}

/// What a child has to come near to before it is tuned: the scores, by scene, of a program that
/// would be better than it by all goals.
pub type Bar<'b> = Option<&'b [f64]>;

/// A program that is to be judged. With the settings, the training scenes and the filter that a
/// search begins with, a job determines its verdict to the bit, on whatever machine.
#[derive(Clone, Copy, Debug)]
pub struct Job<'c> {
    /// The program.
    pub genome: &'c Genome,
    /// Steps by which its constants were tuned before.
    pub earlier: u32,
    /// Steps by which they are tuned now; 0 for none.
    pub steps: u32,
    /// What it has to come near to, if anything.
    pub bar: Bar<'c>,
    /// Generation and place: names the random numbers.
    pub name: [usize; 2],
}

impl<'a, B: Backend + Differentiator> Judge<'a, B> {
    /// One that judges on these scenes.
    ///
    /// # Errors
    /// If there are none to train on.
    pub fn new(
        settings: Settings,
        training: &'a [TuningScene],
        validation: &'a [TuningScene],
        backend: &'a B,
    ) -> Result<Self, tune::Error> {
        if training.is_empty() {
            return Err(tune::Error::NoScenes);
        }
        let exam: Vec<TuningScene> = training
            .iter()
            .enumerate()
            .map(|(k, scene)| scene.part(&crop(scene, &settings, k)))
            .collect();
        let levels = training.iter().flat_map(|scene| &scene.levels);
        let facts = Facts::of_all(levels.map(|level| &level.scene));
        let limit = settings.max_cost;
        Ok(Self { settings, training, validation, backend, exam, facts, limit })
    }

    /// Lets the filter that a search begins with take part, and whatever takes no longer.
    ///
    /// # Errors
    /// If it reads what a training scene lacks.
    pub(super) fn allow(&mut self, initial: &Filter) -> Result<(), Error> {
        let cost = self.cost(initial).ok_or_else(|| Error::Setting {
            name: "initial",
            value: format!("`{}`", initial.name),
            wanted: "it must not read what a training scene lacks, unless it says what stands in \
                     for that",
        })?;
        self.limit = self.limit.max(cost);
        Ok(())
    }

    /// What the search was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The pictures that programs are judged by.
    pub fn pictures(&self) -> Vec<Fingerprint> {
        pictures(self.training, self.validation)
    }

    /// Those of them that children are judged by, in the order of the scenes.
    pub(super) fn training_pictures(&self) -> Vec<Fingerprint> {
        pictures(self.training, &[])
    }

    /// Whether every training scene has a quantity of a feature.
    pub fn has(&self, (feature, quantity): (Feature, Quantity)) -> bool {
        PlaneId::of(feature, quantity).all(|plane| self.facts.get(plane) != Fact::Absent)
    }

    /// Whether there are scenes to validate on.
    pub fn validates(&self) -> bool {
        !self.validation.is_empty()
    }

    /// Nanoseconds per pixel that a program is predicted to take on the training scenes; none
    /// if it reads what one lacks.
    pub fn cost(&self, filter: &Filter) -> Option<f64> {
        let checked = filter.check().expect("genomes make sense");
        Some(Program::new(&checked, &self.facts, Passes::ALL).ok()?.cost())
    }

    /// Tunes a program by some steps and judges it. Once `stop` is raised, what it gives means
    /// nothing.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn judge(&self, job: &Job<'_>, stop: &Arc<AtomicBool>) -> Result<Verdict, tune::Error> {
        let Job { genome, earlier, steps, bar, name } = *job;
        match self.cost(genome.filter()) {
            Some(cost) if cost <= self.limit => {}
            Some(_) | None => return Ok(Verdict::Unfit),
        }
        if let Some(bar) = bar
            && !self.comes_near(genome, bar)?
        {
            return Ok(Verdict::Dropped);
        }
        let genome = match steps {
            0 => genome.clone(),
            _ => self.tuned(genome, &self.tuning(steps, name), &[], stop)?,
        };
        let scores = self.scores(genome.filter(), &self.exam)?;
        let scores: Vec<f64> = scores.iter().map(|score| score.score).collect();
        let error = scores.iter().sum::<f64>() / scores.len() as f64;
        // Constants that became nothing let stages go.
        let cost = self.cost(genome.filter()).expect("it was found above");
        let steps = earlier + steps;
        Ok(Verdict::Judged(Box::new(Judged { genome, scores, error, cost, steps })))
    }

    /// The verdict on the filter that a search begins with, after a step or two. Judges that give
    /// the same bits here compute alike.
    ///
    /// # Errors
    /// If the back end fails.
    pub(super) fn probe(&self, initial: &Genome) -> Result<Verdict, tune::Error> {
        let steps = self.settings.tune_steps.min(PROBED);
        let job = Job { genome: initial, earlier: 0, steps, bar: None, name: [0, 0] };
        self.judge(&job, &Arc::default())
    }

    /// Whether a program that is not tuned yet does not do far worse than another on the first
    /// rung of scenes.
    fn comes_near(&self, genome: &Genome, bar: &[f64]) -> Result<bool, tune::Error> {
        let rung = (self.exam.len() as f64 * self.settings.rung).ceil() as usize;
        if rung == 0 {
            return Ok(true);
        }
        let scores = self.scores(genome.filter(), &self.exam[..rung])?;
        let worse = scores.iter().zip(bar).map(|(score, bar)| score.score - bar);
        Ok(worse.sum::<f64>() / rung as f64 <= self.settings.slack)
    }

    /// How a program does on the validation scenes: the mean score, and RelMSE and its trimmed
    /// kind as geometric means.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn validate(&self, genome: &Genome) -> Result<[f64; 3], tune::Error> {
        let scores = self.scores(genome.filter(), self.validation)?;
        let count = scores.len() as f64;
        let mean = |part: fn(&Score) -> f64| scores.iter().map(part).sum::<f64>() / count;
        let [rel_mse, trimmed] = [mean(|s| s.log_rel_mse), mean(|s| s.log_trimmed)].map(f64::exp);
        Ok([mean(|s| s.score), rel_mse, trimmed])
    }

    fn scores(&self, filter: &Filter, scenes: &[TuningScene]) -> Result<Vec<Score>, tune::Error> {
        scores(filter, scenes, self.settings.loss, self.backend)
    }

    /// The winner, tuned further until `stop` is raised, with the constants that are best on the
    /// validation scenes.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn finished(&self, genome: &Genome, stop: &Arc<AtomicBool>) -> Result<Genome, tune::Error> {
        let steps = self.settings.finish_steps;
        if steps == 0 {
            return Ok(genome.clone());
        }
        let tuning = tune::Settings {
            interval: steps.div_ceil(4),
            crop: self.settings.crop * 3 / 4 * 2,
            batch: self.settings.batch.max(4),
            ..self.tuning(steps, [usize::MAX, 0])
        };
        self.tuned(genome, &tuning, self.validation, stop)
    }

    fn tuning(&self, steps: u32, [generation, index]: [usize; 2]) -> tune::Settings {
        let Settings { seed, batch, crop, loss, rate, layer_rate, .. } = self.settings;
        // A name for a run among those of this search.
        let seed = rand::RngExt::random(&mut stream(seed, 2, generation as u32, index));
        tune::Settings {
            seed,
            steps,
            batch,
            crop,
            loss,
            rate,
            layer_rate,
            drop: 0.0,
            interval: steps,
            ..tune::Settings::default()
        }
    }

    fn tuned(
        &self,
        genome: &Genome,
        settings: &tune::Settings,
        validation: &[TuningScene],
        stop: &Arc<AtomicBool>,
    ) -> Result<Genome, tune::Error> {
        let filter = genome.filter().clone();
        let tuner = Tuner::new(filter, settings.clone(), self.training, validation, self.backend);
        let mut tuner = match tuner {
            Ok(tuner) => tuner,
            Err(tune::Error::NoConstants(_)) => return Ok(genome.clone()),
            Err(error) => return Err(error),
        };
        let outcome =
            tuner.run(&Control { stop: Arc::clone(stop), ..Control::default() }, &mut |_| {})?;
        Ok(genome.with_constants_of(&outcome.filter))
    }

    /// How far what is computed for a program is from its exact meaning, at worst, of pixels
    /// of which anything is promised.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn difference(&self, genome: &Genome) -> Result<f64, tune::Error> {
        let checked = genome.filter().check().expect("genomes make sense");
        let plan = Plan::of(&checked, &self.facts, Passes::ALL);
        let refused = |source: PlanError| tune::Error::Plan { scene: String::new(), source };
        let code = self.backend.compile(&plan.map_err(refused)?)?;
        let mut greatest = 0.0f64;
        for scene in self.exam.iter().take(COMPARED) {
            let noisy = &scene.levels[0].scene;
            let computed = code.run(noisy, &[Rect::whole(noisy)])?.swap_remove(0).pixels;
            let exact = meaning::of(noisy, &checked).pixels;
            let pairs = exact.iter().zip(computed).filter(|(exact, _)| exact.promised);
            greatest = pairs.map(|(exact, color)| exact.difference(color)).fold(greatest, f64::max);
        }
        Ok(greatest)
    }
}

/// The part of a scene that programs are judged by.
fn crop(scene: &TuningScene, settings: &Settings, index: usize) -> Crop {
    let mut rng = stream(settings.seed, 1, 0, index);
    let (width, height) = scene.image.size();
    let size = [width, height].map(|length| length.min(settings.exam).max(2) / 2 * 2);
    let size = [size[0].min(width), size[1].min(height)];
    let corner = [width - size[0], height - size[1]]
        .map(|room| rand::RngExt::random_range(&mut rng, 0..=room / 2) * 2);
    Crop { corner, size, flipped: [false; 2], transposed: false }
}
