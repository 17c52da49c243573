//! The run itself.

use std::collections::BTreeMap;
use std::sync::{Mutex, OnceLock};

use rayon::prelude::*;

use super::checkpoint::{Best, Checkpoint, Row, State};
use super::control::{Control, Ending, Keeper, Watch};
use super::draw::{Draw, LACKS, Lack};
use super::error::Error;
use super::loss::{PARTS, parts};
use super::optimizer::{Rates, Scales};
use super::rng::stream;
use super::scenes::{TuningScene, pictures};
use super::settings::Settings;
use super::trial::{is_estimated, refused, trial};
use crate::backend::{Backend, Differentiable, Differentiator, Workspace};
use crate::expr::builder::LIMIT;
use crate::expr::interval::Interval;
use crate::expr::{Feature, PlaneId, Quantity};
use crate::filter::Filter;
use crate::plan::{Gradient, Passes};
use crate::scene::{Fact, Facts, Fingerprint, MOST_SAMPLES};

/// How much of what a part of the loss is for an image by now comes from the last time that
/// some of it was drawn.
const NEWS: f64 = 0.25;

/// News of a run.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A step was made.
    Step {
        /// How many were made by now.
        step: u32,
        /// Of how many.
        of: u32,
    },
    /// A row was added to the history.
    Row(&'a Row),
    /// A checkpoint could not be written, and no earlier one failed for the same cause. The
    /// run goes on.
    Unwritten(&'a Error),
}

/// What a run came to.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The filter with the constants of the best trial; without validation scenes, with the
    /// average of the last ones.
    pub filter: Filter,
    /// After how many steps they were found.
    pub step: u32,
    /// The whole course.
    pub history: Vec<Row>,
    /// Why it ended.
    pub ending: Ending,
}

/// A set of features that files have, and the code for it.
struct Code {
    lack: &'static Lack,
    facts: Facts,
    code: Box<dyn Differentiable>,
    workspaces: Mutex<Vec<Workspace>>,
}

/// A run.
pub struct Tuner<'a, B> {
    filter: Filter,
    settings: Settings,
    training: &'a [TuningScene],
    validation: &'a [TuningScene],
    backend: &'a B,
    scales: Scales,
    codes: Vec<Code>,
    /// Those of the scenes: it takes a while to find them.
    /// The pictures of the scenes, once somebody asked.
    pictures: OnceLock<Vec<Fingerprint>>,
    state: State,
}

impl<'a, B: Backend + Differentiator> Tuner<'a, B> {
    /// Begins a run.
    ///
    /// # Errors
    /// If the settings make no sense, the filter has nothing to tune, or it cannot run on a
    /// scene.
    ///
    /// # Panics
    /// If the filter makes no sense: see [`Filter::check`].
    pub fn new(
        filter: Filter,
        settings: Settings,
        training: &'a [TuningScene],
        validation: &'a [TuningScene],
        backend: &'a B,
    ) -> Result<Self, Error> {
        settings.validate()?;
        if training.is_empty() {
            return Err(Error::NoScenes);
        }
        let scales = Scales::of(&filter.constants);
        if !scales.any() {
            return Err(Error::NoConstants(filter.name));
        }
        let codes = codes(&filter, &settings, training, backend)?;
        let unseen = |scene: &TuningScene| vec![[f64::NAN; PARTS]; scene.levels.len()];
        let state = State {
            next: 0,
            position: scales.position(&filter.constants.values()),
            norms: training.iter().map(unseen).collect(),
            best: None,
            waiting: 0,
            lost: 0.0,
            drawn: 0,
            history: Vec::new(),
        };
        let pictures = OnceLock::new();
        Ok(Self { filter, settings, training, validation, backend, scales, codes, pictures, state })
    }

    /// Goes on with a run, which must have been begun with the same filter and scenes.
    ///
    /// # Errors
    /// Those of [`new`](Self::new), and if they differ.
    pub fn resume(
        checkpoint: Checkpoint,
        filter: Filter,
        training: &'a [TuningScene],
        validation: &'a [TuningScene],
        backend: &'a B,
    ) -> Result<Self, Error> {
        let Checkpoint { filter: begun, scenes, pictures, settings, state } = checkpoint;
        let fresh = Self::new(filter, settings, training, validation, backend)?;
        let expected = fresh.state.norms.iter().map(Vec::len);
        let fits = state.position.at.len() == fresh.state.position.at.len()
            && state.norms.iter().map(Vec::len).eq(expected);
        if fresh.written_filter() != begun {
            return Err(Error::Other { what: "filter" });
        }
        if fresh.scene_names() != scenes || !fits {
            return Err(Error::Other { what: "set of scenes" });
        }
        if let Some(picture) = Fingerprint::first_changed(&pictures, fresh.pictures()) {
            return Err(Error::Picture { picture: picture.to_owned() });
        }
        Ok(Self { state, ..fresh })
    }

    /// What there is to go on from.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            filter: self.written_filter(),
            scenes: self.scene_names(),
            pictures: self.pictures().to_vec(),
            settings: self.settings.clone(),
            state: self.state.clone(),
        }
    }

    fn pictures(&self) -> &[Fingerprint] {
        self.pictures.get_or_init(|| pictures(self.training, self.validation))
    }

    fn written_filter(&self) -> String {
        self.filter.to_toml(toml::Table::new())
    }

    fn scene_names(&self) -> Vec<String> {
        let sets = [("training", self.training), ("validation", self.validation)];
        let name = |(set, scene): (&str, &TuningScene)| {
            let level = |samples: Option<u32>| samples.map_or("-".to_owned(), |n| n.to_string());
            let levels: Vec<String> = scene.levels.iter().map(|l| level(l.samples)).collect();
            let (width, height) = scene.image.size();
            format!("{set} {} {width}x{height} {}", scene.name, levels.join(" "))
        };
        sets.iter().flat_map(|&(set, scenes)| scenes.iter().map(move |s| name((set, s)))).collect()
    }

    /// The names of the sets of features that parts are filtered with.
    pub fn feature_sets(&self) -> Vec<&'static str> {
        self.codes.iter().map(|code| code.lack.name).collect()
    }

    /// What the run was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Runs to the end, however that comes, and says what happens.
    ///
    /// A checkpoint that cannot be written is told ([`Event::Unwritten`]) and no reason to
    /// stop.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn run(
        &mut self,
        control: &Control,
        hear: &mut dyn FnMut(Event<'_>),
    ) -> Result<Outcome, Error> {
        let watch = Watch::start(control);
        let mut keeper = Keeper::new(control);
        let steps = self.settings.steps;
        if self.state.history.is_empty() {
            self.row(hear)?;
        }
        let mut ending = Ending::Finished;
        while self.state.next < steps {
            if let Some(early) = watch.ending() {
                ending = early;
                break;
            }
            self.step()?;
            let step = self.state.next;
            hear(Event::Step { step, of: steps });
            if step.is_multiple_of(self.settings.interval) || step == steps {
                self.row(hear)?;
                let patience = self.settings.patience;
                if patience > 0 && self.state.waiting >= patience {
                    break;
                }
            }
            if keeper.is_due(step) && step < steps {
                self.save(&mut keeper, hear);
            }
        }
        self.save(&mut keeper, hear);
        let (values, step) = match &self.state.best {
            Some(best) => (self.scales.values(&best.values), best.step),
            None => (self.scales.values(&self.state.position.average), self.state.next),
        };
        let mut filter = self.filter.clone();
        filter.constants.set_values(&values);
        Ok(Outcome { filter, step, history: self.state.history.clone(), ending })
    }

    /// Writes the checkpoint that is asked for, if one is.
    fn save(&self, keeper: &mut Keeper<'_>, hear: &mut dyn FnMut(Event<'_>)) {
        if let Some(error) = keeper.keep(|path| self.checkpoint().write(path)) {
            hear(Event::Unwritten(&error));
        }
    }

    /// One step of the optimizer.
    fn step(&mut self) -> Result<(), Error> {
        let (settings, state) = (&self.settings, &self.state);
        let constants = self.scales.values(&state.position.at);
        let draws: Vec<Draw> = (0..settings.batch)
            .map(|k| {
                let mut stream = stream(settings.seed, 0, state.next, k);
                Draw::new(settings, self.training, self.codes.len(), &mut stream)
            })
            .collect();
        let gradients = draws
            .par_iter()
            .map(|draw| self.gradient(draw, &constants))
            .collect::<Result<Vec<_>, Error>>()?;
        let mut sum = vec![0.0; constants.len()];
        let share = 1.0 / draws.len() as f64;
        for (_, gradient) in &gradients {
            sum.iter_mut().zip(gradient).for_each(|(sum, x)| *sum += share * x);
        }
        let rates =
            Rates { constants: settings.rate, layers: settings.layer_rate, decay: settings.decay };
        let rates = rates.at(state.next, settings.steps);
        let state = &mut self.state;
        self.scales.step(&mut state.position, &sum, state.next, rates);
        for (draw, (parts, _)) in draws.iter().zip(&gradients).filter(|(draw, _)| draw.noise == 1.0)
        {
            let norms = &mut state.norms[draw.scene][draw.level];
            for (norm, part) in norms.iter_mut().zip(parts) {
                *norm = if norm.is_nan() { *part } else { *norm + NEWS * (part - *norm) };
            }
            state.lost += settings.loss.score(*parts);
            state.drawn += 1;
        }
        state.next += 1;
        Ok(())
    }

    /// The parts of the loss for a part of an image, and their gradient.
    fn gradient(&self, draw: &Draw, constants: &[f32]) -> Result<([f64; PARTS], Vec<f64>), Error> {
        let scene = &self.training[draw.scene];
        let whole = &scene.levels[draw.level].scene;
        let pixels = draw.crop.pixels(whole.layout().width());
        let reference = super::loss::Reference {
            pixels: pixels.map(|k| scene.reference.pixels[k]).collect(),
            exposure: scene.reference.exposure,
        };
        let code = &self.codes[draw.lack];
        let mut noisy = whole.crop(&draw.crop, draw.gain);
        if draw.noise < 1.0 {
            let bright = |pixel: &[f32; 3]| pixel.map(|x| x * draw.gain);
            let truth: Vec<[f32; 3]> = reference.pixels.iter().map(bright).collect();
            noisy = noisy.quieter(&truth, draw.noise);
        }
        if !code.lack.variances || is_estimated(whole) {
            noisy = noisy.without_variances();
        }
        if let (true, Some(samples)) = (draw.told, scene.levels[draw.level].samples) {
            // Noise falls with the root of their number.
            noisy = noisy.with_samples((samples as f32 / draw.noise.powi(2)) as u32);
        }
        // The result is as much brighter as what was filtered.
        let unit = whole.normalization().exposure / draw.gain;
        // What a part loses that is less noisy than its image says nothing of the others.
        let quiet = draw.noise < 1.0;
        let norms = match quiet {
            true => [f64::NAN; PARTS],
            false => self.state.norms[draw.scene][draw.level],
        };
        let shares = self.settings.loss.shares();
        let [width, _] = draw.crop.turned();
        let mut lost = [0.0; PARTS];
        let mut loss = |colors: &[[f32; 3]], owed: &mut [[f32; 3]]| {
            let weigh = |norms: [f64; PARTS]| {
                let mut weights = shares;
                for (weight, norm) in weights.iter_mut().zip(norms) {
                    *weight /= norm.max(1e-9);
                }
                weights
            };
            if norms[0].is_nan() {
                // Of what is seen for the first time, what it is now.
                lost = parts(colors, width, unit, &reference, shares, owed);
                parts(colors, width, unit, &reference, weigh(lost), owed);
            } else {
                lost = parts(colors, width, unit, &reference, weigh(norms), owed);
            }
            0.0
        };
        let free = || code.workspaces.lock().expect("nobody panics with it");
        let mut workspace = free().pop().unwrap_or_default();
        let mut derivatives = vec![0.0; constants.len()];
        code.code.run(&noisy, constants, &mut loss, &mut workspace, &mut derivatives)?;
        free().push(workspace);
        Ok((lost, derivatives))
    }

    /// Tries the average of the constants, and adds a row to the history.
    fn row(&mut self, hear: &mut dyn FnMut(Event<'_>)) -> Result<(), Error> {
        let values = self.scales.values(&self.state.position.average);
        let mut filter = self.filter.clone();
        filter.constants.set_values(&values);
        let lacks: Vec<&Lack> = self.codes.iter().map(|code| code.lack).collect();
        let trial = match self.validation.is_empty() {
            true => None,
            false => Some(trial(&filter, self.validation, &lacks, &self.settings, self.backend)?),
        };
        let state = &mut self.state;
        if let Some(trial) = trial {
            let better = state.best.as_ref().is_none_or(|best| trial.score < best.score);
            if better {
                let (step, score) = (state.next, trial.score);
                let values = state.position.average.clone();
                state.best = Some(Best { step, score, values });
            }
            state.waiting = if better { 0 } else { state.waiting + 1 };
        }
        let training = state.lost / f64::from(state.drawn);
        (state.lost, state.drawn) = (0.0, 0);
        let [validation, rel_mse, trimmed_rel_mse] = trial
            .map_or([f64::NAN; 3], |trial| [trial.score, trial.rel_mse, trial.trimmed_rel_mse]);
        let step = state.next;
        state.history.push(Row { step, training, validation, rel_mse, trimmed_rel_mse });
        hear(Event::Row(state.history.last().expect("it was pushed")));
        Ok(())
    }
}

/// Code for every set of features that makes a difference to a filter, all of them first.
fn codes(
    filter: &Filter,
    settings: &Settings,
    scenes: &[TuningScene],
    backend: &impl Differentiator,
) -> Result<Vec<Code>, Error> {
    let checked = filter.check().expect("whoever has a filter has checked it");
    let levels = scenes.iter().flat_map(|scene| &scene.levels);
    let all = Facts::of_all(levels.map(|level| &level.scene));
    let mut levels = scenes.iter().flat_map(|scene| &scene.levels);
    let estimated = levels.any(|level| is_estimated(&level.scene));
    let needs = checked.needs();
    let reads: BTreeMap<PlaneId, ()> =
        needs.named().into_iter().flatten().map(|&plane| (plane, ())).collect();
    let mut codes: Vec<Code> = Vec::new();
    // Who drops no features meets the first set alone.
    let met = if settings.drop > 0.0 { LACKS.len() } else { 1 };
    for lack in &LACKS[..met] {
        let kept = all.iter().filter(|(plane, _)| {
            reads.contains_key(plane) && !lack.features.contains(&plane.feature)
        });
        let facts = Facts::from_planes(kept.map(|(plane, fact)| {
            let fact = match (plane.feature, plane.quantity) {
                (Feature::Measured, _) if !lack.variances => Fact::Constant(0.0),
                (Feature::Samples, _) => Fact::Range(Interval::new(0.0, MOST_SAMPLES as f32)),
                // Parts of images are estimated anew.
                (Feature::Grain, _) | (_, Quantity::Variance) if !lack.variances || estimated => {
                    Fact::Range(Interval::new(0.0, LIMIT))
                }
                _ => within(plane, fact.join(truth(plane, fact, scenes)), settings),
            };
            (plane, fact)
        }));
        if codes.iter().any(|code| code.facts == facts) {
            continue;
        }
        let gradient = match Gradient::new(&checked, &facts, Passes::ALL) {
            Ok(gradient) => gradient,
            // Who cannot do without a feature is not tuned without it.
            Err(_) if !codes.is_empty() => continue,
            Err(source) => return Err(refused(scenes, source)),
        };
        let code = backend.differentiate(&gradient)?;
        codes.push(Code { lack, facts, code, workspaces: Mutex::default() });
    }
    Ok(codes)
}

/// What is known of the colour without its noise; of other planes what is known anyway.
fn truth(plane: PlaneId, fact: Fact, scenes: &[TuningScene]) -> Fact {
    if (plane.feature, plane.quantity) != (Feature::Color, Quantity::Value) {
        return fact;
    }
    let component = usize::from(plane.component);
    let of = |scene: &TuningScene| {
        let channel = scene.image.rgb()[component].iter().copied();
        let (low, high) = channel.fold((0.0f32, 0.0f32), |(l, h), x| (l.min(x), h.max(x)));
        let exposures = scene.levels.iter().map(|level| level.scene.normalization().exposure);
        let least = exposures.fold(f32::INFINITY, f32::min);
        Fact::Range(Interval::new(low / least, high / least))
    };
    scenes.iter().map(of).fold(fact, Fact::join)
}

/// What is known of a plane where light is made brighter or darker.
fn within(plane: PlaneId, fact: Fact, settings: &Settings) -> Fact {
    let light = matches!(plane.feature, Feature::Color | Feature::DirIllumination);
    let Interval { lo, hi } = fact.interval();
    if !light || fact == Fact::Absent || (lo == 0.0 && hi == 0.0) {
        return fact;
    }
    let gain = settings.stops.exp2().next_up();
    let gain = if plane.quantity == Quantity::Variance { gain * gain } else { gain };
    // Of parts that are made less noisy, the colour's variance is less than any of the image's.
    let quieter = settings.clean > 0.0 && plane.quantity == Quantity::Variance;
    let low = if lo < 0.0 { lo * gain } else { lo / gain };
    let low = if quieter { low.min(0.0) } else { low };
    let high = if hi < 0.0 { hi / gain } else { hi * gain };
    Fact::Range(Interval::new(low.next_down(), high.next_up()))
}
