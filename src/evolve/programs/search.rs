//! The search itself: generation after generation.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rand::RngExt;
use rayon::prelude::*;

use super::checkpoint::{Checkpoint, State};
use super::evaluator::{Batch, Evaluator, InProcess};
use super::genome::{Genome, Shape};
use super::history::Row;
use super::judge::{Job, Judge, Judged, Verdict};
use super::protocol::Briefing;
use super::selection::{Goals, crowding, lexicase, ranks, survivors, tournament};
use crate::backend::{ACCURACY, Backend, Differentiator};
use crate::evolve::Error;
use crate::expr::feature::{Feature, Quantity};
use crate::filter::Filter;
use crate::scene::Fingerprint;
use crate::tune::{self, Control, Ending, Keeper, Stream, Watch, stream};

/// Share of the parents that are chosen by the scenes; the others by rank and room.
const BY_SCENES: f64 = 0.7;

/// How much more steps those get that are tuned further.
const POLISHED: u32 = 3;

/// How far a winner may be from its exact meaning: half of what back ends promise.
const TOLERANCE: f64 = ACCURACY / 2.0;

/// News of a search.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A child was judged.
    Child {
        /// The generation that is being formed.
        generation: u32,
        /// How many of its children are judged.
        judged: usize,
        /// Of how many.
        of: usize,
    },
    /// A generation is complete.
    Generation {
        /// The rows of all generations so far, its own the last.
        rows: &'a [Row],
        /// The program of the least error.
        best: &'a Judged,
    },
    /// A checkpoint could not be written, for a cause that is new; the search goes on.
    NoCheckpoint(&'a Error),
    /// The winner is tuned.
    Finish {
        /// By how many steps.
        steps: u32,
    },
}

/// A program of the front, judged by everything there is.
#[derive(Clone, Debug, PartialEq)]
pub struct Finalist {
    /// The program and how it does on the training scenes.
    pub judged: Judged,
    /// On the validation scenes: the mean score, RelMSE, trimmed RelMSE; none without such
    /// scenes.
    pub validation: Option<[f64; 3]>,
    /// How far what is computed is from exact; none where a search was stopped before that
    /// was found.
    pub difference: Option<f64>,
}

impl Finalist {
    /// What finalists are compared by: their score on the validation scenes, without any that
    /// on the training scenes.
    fn score(&self) -> f64 {
        self.validation.map_or(self.judged.error, |[score, ..]| score)
    }

    fn is_accurate(&self) -> bool {
        self.difference.is_some_and(|difference| difference <= TOLERANCE)
    }
}

/// What a search found.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The winner, finished.
    pub best: Finalist,
    /// Programs of which none is better by all goals, the fastest first.
    pub front: Vec<Finalist>,
    /// A row per generation.
    pub history: Vec<Row>,
    /// Programs that were judged.
    pub judged: u64,
    /// Programs that were given up before they were tuned, or that could not run.
    pub dropped: u64,
    /// How the search ended.
    pub ending: Ending,
}

/// A search under way.
pub struct Search<'a, B> {
    judge: Judge<'a, B>,
    evaluator: Box<dyn Evaluator>,
    features: Vec<(Feature, Quantity)>,
    initial: Genome,
    /// How far a stage of the filter that it begins with looks.
    reach: usize,
    pictures: Vec<Fingerprint>,
    state: State,
}

/// What a place of a generation holds before it is judged.
struct Child {
    genome: Genome,
    /// Steps by which its constants were tuned before.
    earlier: u32,
    steps: u32,
    /// Which program of the population it is, tuned further.
    polishes: Option<usize>,
}

impl<'a, B: Backend + Differentiator> Search<'a, B> {
    /// A search that begins with mutants of a filter.
    ///
    /// # Errors
    /// If the settings make no sense, or the filter reads what a training scene lacks.
    ///
    /// # Panics
    /// If the filter makes no sense.
    pub fn new(initial: Filter, mut judge: Judge<'a, B>) -> Result<Self, Error> {
        judge.settings().validate()?;
        let mut features = judge.settings().vocabulary()?;
        // New formulas read nothing that a scene lacks.
        features.retain(|&term| judge.has(term));
        let initial = Genome::new(initial).expect("whoever has a filter has checked it");
        // What it begins with may always take part, and its like.
        judge.allow(initial.filter())?;
        let reach = initial.filter().check().expect("genomes make sense").reach();
        let pictures = judge.pictures();
        let (evaluator, state) = (Box::new(InProcess), State::default());
        Ok(Self { judge, evaluator, features, initial, reach, pictures, state })
    }

    /// A search that goes on from a checkpoint, and ends with what the search that wrote it
    /// would have ended with.
    ///
    /// # Errors
    /// If the settings make no sense, or a picture is not what it was.
    pub fn resume(checkpoint: Checkpoint, judge: Judge<'a, B>) -> Result<Self, Error> {
        let Checkpoint { initial, pictures, state, .. } = checkpoint;
        let fresh = Self::new(initial, judge)?;
        if let Some(picture) = Fingerprint::first_changed(&pictures, &fresh.pictures) {
            return Err(Error::Picture { picture: picture.to_owned() });
        }
        Ok(Self { state, ..fresh })
    }

    /// What others have to know to judge the children of this search.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn briefing(&self) -> Result<Briefing, Error> {
        let probe = self.judge.probe(&self.initial).map_err(Error::fitness)?;
        let (settings, initial) = (self.judge.settings(), self.initial.filter());
        Ok(Briefing::new(settings, initial, self.judge.training_pictures(), &probe))
    }

    /// The same search, whose children somebody else judges.
    #[must_use]
    pub fn judged_by(self, evaluator: impl Evaluator + 'static) -> Self {
        Self { evaluator: Box::new(evaluator), ..self }
    }

    /// What there is to go on from.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            initial: self.initial.filter().clone(),
            settings: self.judge.settings().clone(),
            pictures: self.pictures.clone(),
            state: self.state.clone(),
        }
    }

    /// Searches to the end, however that comes. A checkpoint that cannot be written is told
    /// and no reason to stop.
    ///
    /// # Errors
    /// If the back end fails.
    pub fn run(
        &mut self,
        control: &Control,
        hear: &(dyn Fn(Event<'_>) + Sync),
    ) -> Result<Outcome, Error> {
        let watch = Watch::start(control);
        let mut keeper = Keeper::new(control);
        let bred = self.breed(&watch, &control.stop, &mut keeper, hear);
        self.evaluator.release();
        self.keep(&mut keeper, hear);
        let ending = bred.map_err(|error| error.resumable(keeper.latest()))?;
        self.outcome(ending, &control.stop, hear).map_err(|error| error.resumable(keeper.latest()))
    }

    fn keep(&self, keeper: &mut Keeper<'_>, hear: &(dyn Fn(Event<'_>) + Sync)) {
        if let Some(error) = keeper.keep(|path| self.checkpoint().write(path)) {
            hear(Event::NoCheckpoint(&error));
        }
    }

    fn breed(
        &mut self,
        watch: &Watch<'_>,
        stop: &Arc<AtomicBool>,
        keeper: &mut Keeper<'_>,
        hear: &(dyn Fn(Event<'_>) + Sync),
    ) -> Result<Ending, Error> {
        // A run that is killed before its first generation is complete can be resumed, too.
        if self.state.next == 0 && keeper.is_due(0) {
            self.keep(keeper, hear);
        }
        while self.state.next <= self.judge.settings().generations {
            if let Some(ending) = watch.ending() {
                return Ok(ending);
            }
            let generation = self.state.next;
            let children = self.children(generation);
            let Some(verdicts) = self.judged(generation, &children, watch, stop, hear)? else {
                return Ok(watch.ending().unwrap_or(Ending::Stopped));
            };
            self.settle(generation, &children, verdicts)?;
            hear(Event::Generation { rows: &self.state.history, best: self.best_by_error() });
            if keeper.is_due(generation) {
                self.keep(keeper, hear);
            }
            let patience = self.judge.settings().patience;
            if patience > 0 && self.state.waiting >= patience {
                break;
            }
        }
        Ok(Ending::Finished)
    }

    /// The programs of a generation that are yet to be judged, each of another shape than the
    /// others and than the population's, but for those that are tuned further.
    fn children(&self, generation: u32) -> Vec<Child> {
        let settings = self.judge.settings();
        let count = if generation == 0 { settings.population } else { settings.children };
        let population = &self.state.population;
        let goals: Vec<Goals> = population.iter().map(Judged::goals).collect();
        let ranks = ranks(&goals);
        let room = crowding(&goals, &ranks);
        let cases: Vec<&[f64]> = population.iter().map(|judged| &judged.scores[..]).collect();
        let parent = |rng: &mut Stream| match rng.random_bool(BY_SCENES) {
            true => lexicase(&cases, rng),
            false => tournament(&ranks, &room, rng),
        };
        let child = |index: usize| -> Option<Child> {
            let mut rng = stream(settings.seed, 0, generation, index);
            let admits = |genome: &Genome| self.admits(genome);
            let steps = settings.tune_steps;
            if population.is_empty() {
                let mut genome = self.initial.clone();
                if index > 0 {
                    for _ in 0..rng.random_range(1..=3) {
                        genome = genome.mutant(&self.features, &mut rng, admits)?;
                    }
                }
                return Some(Child { genome, earlier: 0, steps, polishes: None });
            }
            let share = (index as f64 + 0.5) / count as f64;
            let first = parent(&mut rng);
            let judged = &population[first];
            if share < settings.polish {
                let (genome, earlier) = (judged.genome.clone(), judged.steps);
                let steps = POLISHED * steps;
                return Some(Child { genome, earlier, steps, polishes: Some(first) });
            }
            let genome = if share < settings.polish + settings.crossover {
                let second = &population[parent(&mut rng)];
                judged.genome.crossed(&second.genome, &self.features, &mut rng, admits)?
            } else {
                judged.genome.mutant(&self.features, &mut rng, admits)?
            };
            Some(Child { genome, earlier: judged.steps, steps, polishes: None })
        };
        let children: Vec<Option<Child>> = (0..count).into_par_iter().map(child).collect();
        let mut shapes: BTreeSet<Shape> =
            population.iter().map(|judged| judged.genome.shape()).collect();
        let mut polished = BTreeSet::new();
        let is_new = |child: &Child| match child.polishes {
            Some(which) => polished.insert(which),
            None => shapes.insert(child.genome.shape()),
        };
        children.into_iter().flatten().filter(is_new).collect()
    }

    fn admits(&self, genome: &Genome) -> bool {
        let settings = self.judge.settings();
        let filter = genome.filter();
        let known = |symbol: &crate::expr::Symbol| match symbol.reads() {
            None => true,
            Some((Feature::Pixel, _)) => true,
            Some(term) => self.features.contains(&term) || self.reads_at_first(term),
        };
        let checked = filter.check().expect("genomes make sense");
        genome.size() <= settings.max_nodes.max(self.initial.size())
            && checked.reach() <= settings.max_reach.max(self.reach)
            && filter.stages.len() <= settings.max_stages.max(self.initial.filter().stages.len())
            && filter
                .stages
                .iter()
                .flat_map(|s| s.trees())
                .all(|tree| tree.is_stationary() && tree.symbols().iter().all(known))
    }

    /// Whether the filter that the search begins with reads something.
    fn reads_at_first(&self, term: (Feature, Quantity)) -> bool {
        let trees = self.initial.filter().stages.iter().flat_map(|stage| stage.trees());
        trees.flat_map(|tree| tree.symbols()).any(|symbol| symbol.reads() == Some(term))
    }

    /// Judges children, in any order; nothing if there was a reason to end before all were.
    fn judged<'c>(
        &'c self,
        generation: u32,
        children: &'c [Child],
        watch: &Watch<'_>,
        stop: &Arc<AtomicBool>,
        hear: &(dyn Fn(Event<'_>) + Sync),
    ) -> Result<Option<Vec<Verdict>>, Error> {
        let job = |(index, child): (usize, &'c Child)| {
            let Child { ref genome, earlier, steps, .. } = *child;
            let name = [generation as usize, index];
            Job { genome, earlier, steps, bar: self.bar(child), name }
        };
        let jobs: Vec<Job<'_>> = children.par_iter().enumerate().map(job).collect();
        let done = AtomicUsize::new(0);
        let ended = || watch.ending().is_some();
        let judge = |job: &Job<'_>| {
            if ended() {
                return Ok(None);
            }
            let verdict = self.judge.judge(job, stop)?;
            // What is tuned while somebody asks to stop is tuned by fewer steps.
            Ok((!stop.load(Ordering::Relaxed)).then_some(verdict))
        };
        let heard = || {
            let judged = 1 + done.fetch_add(1, Ordering::Relaxed);
            hear(Event::Child { generation, judged, of: children.len() });
        };
        let batch = Batch { jobs: &jobs, judge: &judge, ended: &ended, heard: &heard };
        self.evaluator.evaluate(&batch)
    }

    /// The scores of the best program that is neither slower nor larger than a child, if there is
    /// one: a child that stays worse than that is of no use.
    fn bar(&self, child: &Child) -> Option<&[f64]> {
        if child.polishes.is_some() {
            return None;
        }
        let (cost, size) = (self.judge.cost(child.genome.filter())?, child.genome.size());
        let population = self.state.population.iter();
        let rivals = population.filter(|r| r.cost <= cost && r.genome.size() <= size);
        rivals.min_by(|a, b| a.error.total_cmp(&b.error)).map(|rival| &rival.scores[..])
    }

    /// Takes a generation's children into the population.
    fn settle(
        &mut self,
        generation: u32,
        children: &[Child],
        verdicts: Vec<Verdict>,
    ) -> Result<(), Error> {
        let state = &mut self.state;
        for (child, verdict) in children.iter().zip(verdicts) {
            match (verdict, child.polishes) {
                (Verdict::Judged(judged), Some(which)) => {
                    state.judged += 1;
                    if judged.error < state.population[which].error {
                        state.population[which] = *judged;
                    }
                }
                (Verdict::Judged(judged), None) => {
                    state.judged += 1;
                    state.population.push(*judged);
                }
                (Verdict::Dropped | Verdict::Unfit, _) => state.dropped += 1,
            }
        }
        let goals: Vec<Goals> = state.population.iter().map(Judged::goals).collect();
        let stay = survivors(&goals, self.judge.settings().population);
        let mut k = 0;
        state.population.retain(|_| {
            k += 1;
            stay.binary_search(&(k - 1)).is_ok()
        });
        state.next = generation + 1;
        let settings = self.judge.settings();
        let last = generation == settings.generations;
        let trial =
            if self.judge.validates() && (generation.is_multiple_of(settings.interval) || last) {
                let best = self.best_by_error();
                let [score, rel_mse, trimmed] =
                    self.judge.validate(&best.genome).map_err(Error::fitness)?;
                let state = &mut self.state;
                let better = state.validated.is_none_or(|least| score < least);
                if better {
                    state.validated = Some(score);
                }
                state.waiting = if better { 0 } else { state.waiting + 1 };
                Some([score, rel_mse, trimmed])
            } else {
                None
            };
        let State { population, judged, dropped, .. } = &self.state;
        let row = Row::new(generation, population, trial, *judged, *dropped);
        self.state.history.push(row);
        Ok(())
    }

    fn best_by_error(&self) -> &Judged {
        let by_error = |a: &&Judged, b: &&Judged| a.error.total_cmp(&b.error);
        self.state.population.iter().min_by(by_error).expect("a generation leaves somebody")
    }

    /// Judges the front by everything there is, and finishes the winner.
    fn outcome(
        &self,
        ending: Ending,
        stop: &Arc<AtomicBool>,
        hear: &(dyn Fn(Event<'_>) + Sync),
    ) -> Result<Outcome, Error> {
        let begun;
        let population = match self.state.population.as_slice() {
            // It ended before a generation was complete: what it began with is the result.
            [] => {
                begun = self.as_begun().map_err(Error::fitness)?;
                std::slice::from_ref(&begun)
            }
            population => population,
        };
        let goals: Vec<Goals> = population.iter().map(Judged::goals).collect();
        let ranks = ranks(&goals);
        let members = population.iter().zip(&ranks).filter(|&(_, &rank)| rank == 0);
        let members: Vec<&Judged> = members.map(|(judged, _)| judged).collect();
        let mut front = match ending {
            Ending::Finished | Ending::TimeLimit => members
                .par_iter()
                .map(|judged| self.finalist((*judged).clone()))
                .collect::<Result<Vec<Finalist>, tune::Error>>()
                .map_err(Error::fitness)?,
            // Whoever stops a search wants it to end: what is known is told.
            Ending::Stopped => {
                let known = |judged: &&Judged| Finalist {
                    judged: (*judged).clone(),
                    validation: None,
                    difference: None,
                };
                members.iter().map(known).collect()
            }
        };
        front.sort_by(|a, b| {
            a.judged.cost.total_cmp(&b.judged.cost).then(a.judged.error.total_cmp(&b.judged.error))
        });
        let by_score = |a: &&Finalist, b: &&Finalist| a.score().total_cmp(&b.score());
        let accurate = front.iter().filter(|finalist| finalist.is_accurate()).min_by(by_score);
        let closest = |finalist: &Finalist| finalist.difference.unwrap_or(f64::INFINITY);
        let winner = accurate.or_else(|| {
            let by_difference = |a: &&Finalist, b: &&Finalist| {
                closest(a).total_cmp(&closest(b)).then(by_score(a, b))
            };
            front.iter().min_by(by_difference)
        });
        let winner = winner.expect("the population is not empty").clone();
        let best = match ending {
            Ending::Finished => {
                let steps = self.judge.settings().finish_steps;
                hear(Event::Finish { steps });
                let finished = self.finished(&winner, stop).map_err(Error::fitness)?;
                // What tuning made worse, or inaccurate, is not taken.
                match finished.score() < winner.score() && finished.is_accurate() {
                    true => finished,
                    false => winner,
                }
            }
            Ending::Stopped | Ending::TimeLimit => winner,
        };
        Ok(Outcome {
            best,
            front,
            history: self.state.history.clone(),
            judged: self.state.judged,
            dropped: self.state.dropped,
            ending,
        })
    }

    fn finalist(&self, judged: Judged) -> Result<Finalist, tune::Error> {
        let validation = match self.judge.validates() {
            true => Some(self.judge.validate(&judged.genome)?),
            false => None,
        };
        let difference = Some(self.judge.difference(&judged.genome)?);
        Ok(Finalist { judged, validation, difference })
    }

    /// The filter that the search begins with.
    fn as_begun(&self) -> Result<Judged, tune::Error> {
        match self.scored(&self.initial, 0)? {
            Verdict::Judged(judged) => Ok(*judged),
            Verdict::Dropped | Verdict::Unfit => unreachable!("it was found fit, and has no bar"),
        }
    }

    /// The verdict on a program as it is, tuned by so many steps before.
    fn scored(&self, genome: &Genome, earlier: u32) -> Result<Verdict, tune::Error> {
        let job = Job { genome, earlier, steps: 0, bar: None, name: [0, 0] };
        self.judge.judge(&job, &Arc::default())
    }

    fn finished(&self, winner: &Finalist, stop: &Arc<AtomicBool>) -> Result<Finalist, tune::Error> {
        let genome = self.judge.finished(&winner.judged.genome, stop)?;
        let steps = winner.judged.steps + self.judge.settings().finish_steps;
        match self.scored(&genome, steps)? {
            Verdict::Judged(judged) => self.finalist(*judged),
            Verdict::Dropped | Verdict::Unfit => Ok(winner.clone()),
        }
    }
}
