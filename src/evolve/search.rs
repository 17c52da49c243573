//! The search itself: generation after generation, on all islands at once.

use std::path::Path;

use rayon::prelude::*;

use super::breeding::{Child, Place, initial, offspring};
use super::checkpoint::{Checkpoint, State};
use super::error::Error;
use super::event::Event;
use super::fitness::Fitness;
use super::history::{Progress, Row};
use super::individual::{Individual, Judgement};
use super::islands::{Population, migrate};
use super::materials::Materials;
use super::memo::Newcomer;
use super::race::{Entrant, Ruling, Work, bar};
use super::settings::Settings;
use crate::expr::Tree;
use crate::tune::{Control, Ending, Watch};

/// A search under way.
pub struct Search<'a, F> {
    settings: Settings,
    materials: Materials,
    fitness: &'a F,
    state: State,
}

/// An expression that has been judged by everything there is.
#[derive(Clone, Debug, PartialEq)]
pub struct Finalist {
    /// The expression.
    pub tree: Tree,
    /// Its fitness in breeding.
    pub bred: f64,
    /// Its fitness in full: lower is better.
    pub full: f64,
    /// How far what is computed for it is from what it means; none if somebody before
    /// it won.
    pub difference: Option<f64>,
    /// Why it must not win, if it is close enough and that was found.
    pub objection: Option<String>,
}

/// What a run found.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The hall of fame judged in full, the best first. Never empty.
    pub finalists: Vec<Finalist>,
    /// Which of them wins: the first that is computed accurately enough and to which
    /// there is no objection. If there is none, the most accurate.
    pub winner: usize,
    /// The islands after the last complete generation; none if the run was
    /// stopped within the initial one.
    pub islands: Vec<Population>,
    /// A row per complete generation and island.
    pub history: Vec<Row>,
    /// How many expressions were judged for breeding.
    pub evaluations: usize,
    /// How many of them were dropped and never judged in full.
    pub dropped: usize,
    /// How many expressions bred had been judged before.
    pub memo_hits: usize,
    /// What judging took, and would have taken without racing.
    pub work: Work,
    /// How the run ended.
    pub ending: Ending,
}

impl Outcome {
    /// The best of the finalists that is computed accurately and not objected to.
    pub fn best(&self) -> &Finalist {
        &self.finalists[self.winner]
    }
}

impl<'a, F: Fitness> Search<'a, F> {
    /// A search from the beginning.
    pub fn new(settings: Settings, fitness: &'a F) -> Result<Self, Error> {
        let state = State::new(&settings);
        Self::with_state(settings, fitness, state)
    }

    /// A search from where a checkpoint was written. It ends with what the
    /// search that wrote it would have ended with.
    pub fn resume(checkpoint: Checkpoint, fitness: &'a F) -> Result<Self, Error> {
        let given = fitness.identity();
        if checkpoint.identity != given {
            return Err(Error::Identity { bred: checkpoint.identity, given });
        }
        Self::with_state(checkpoint.settings, fitness, checkpoint.state)
    }

    fn with_state(settings: Settings, fitness: &'a F, state: State) -> Result<Self, Error> {
        settings.validate()?;
        let materials = Materials::new(&settings)?;
        Ok(Self { settings, materials, fitness, state })
    }

    /// What the search was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The search as it stands.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint::new(self.fitness.identity(), self.settings.clone(), self.state.clone())
    }

    /// Searches until the last generation or until `control` ends it, and
    /// judges the finalists in full either way. At least one batch is judged,
    /// so that there always is a best so far.
    ///
    /// # Errors
    /// If a checkpoint cannot be written, or the fitness fails. In the latter case the
    /// checkpoint that `control` asks for is written first, and the error names it.
    ///
    /// # Panics
    /// If the fitness breaks its contract: a NaN, or a wrong number of values.
    pub fn run(
        &mut self,
        control: &Control,
        listener: &mut dyn FnMut(Event<'_>),
    ) -> Result<Outcome, Error> {
        let watch = Watch::start(control);
        let bred = self.breed(&watch, control, listener);
        let written = self.save(control);
        let path = written.as_ref().ok().copied().flatten();
        let ending = bred.map_err(|error| error.resumable(path))?;
        written?;
        let judged = self.finals(listener).and_then(|mut finalists| {
            let winner = self.winner(&mut finalists, listener)?;
            Ok((finalists, winner))
        });
        let (finalists, winner) = judged.map_err(|error| error.resumable(path))?;
        Ok(Outcome {
            finalists,
            winner,
            islands: self.state.islands.clone(),
            history: self.state.history.clone(),
            evaluations: self.state.memo.len(),
            dropped: self.state.memo.dropped(),
            memo_hits: self.memo_hits(),
            work: self.state.work,
            ending,
        })
    }

    /// Writes the checkpoint that is asked for, if one is, and says where.
    fn save<'c>(&self, control: &'c Control) -> Result<Option<&'c Path>, Error> {
        let Some(checkpoints) = &control.checkpoints else { return Ok(None) };
        self.checkpoint().write(&checkpoints.path)?;
        Ok(Some(&checkpoints.path))
    }

    /// Forms generations until there is a reason to end.
    fn breed(
        &mut self,
        watch: &Watch<'_>,
        control: &Control,
        listener: &mut dyn FnMut(Event<'_>),
    ) -> Result<Ending, Error> {
        while self.state.next <= self.settings.generations {
            if let Some(ending) = watch.ending().filter(|_| !self.state.memo.is_empty()) {
                return Ok(ending);
            }
            let generation = self.state.next;
            let children = self.children(generation);
            if let Some(ending) = self.judge(&children, watch, listener)? {
                return Ok(ending);
            }
            self.settle(generation, children);
            let rows = self.state.history.len() - self.settings.islands;
            listener(Event::Generation {
                generation,
                of: self.settings.generations,
                islands: &self.state.history[rows..],
                best: &self.state.hall.members()[0],
            });
            if let Some(checkpoints) = &control.checkpoints
                && checkpoints.interval > 0
                && self.state.next.is_multiple_of(checkpoints.interval)
            {
                self.save(control)?;
            }
        }
        Ok(Ending::Finished)
    }

    /// The children that make up a generation, island by island. Each draws
    /// from its own stream, so that any thread may breed any of them.
    fn children(&self, generation: u32) -> Vec<Vec<Child>> {
        let Self { settings, materials, state, .. } = self;
        (0..settings.islands)
            .map(|island| {
                let child = |index| {
                    let place = Place { generation, island, index };
                    match state.islands.get(island) {
                        Some(previous) => offspring(place, previous, materials, settings),
                        None => initial(place, materials, settings),
                    }
                };
                (0..settings.island_size).into_par_iter().map(child).collect()
            })
            .collect()
    }

    /// Judges the children of all islands that are new to the search, in
    /// batches. If there is a reason to end in between, returns it.
    fn judge(
        &mut self,
        children: &[Vec<Child>],
        watch: &Watch<'_>,
        listener: &mut dyn FnMut(Event<'_>),
    ) -> Result<Option<Ending>, Error> {
        let bars = self.bars();
        let bred = children.iter().zip(&bars).flat_map(|(children, bar)| {
            children.iter().filter_map(Child::tree).map(move |tree| (tree, bar.as_ref()))
        });
        let missing = self.state.memo.missing(bred);
        let mut judged = 0;
        for batch in missing.chunks(self.settings.batch) {
            if judged > 0
                && let Some(ending) = watch.ending()
            {
                return Ok(Some(ending));
            }
            for (newcomer, ruling) in batch.iter().zip(self.race(batch)?) {
                let individual = Individual::new(newcomer.tree.clone(), ruling.verdict);
                if individual.full {
                    self.state.hall.offer(individual.clone());
                }
                self.state.work.done += ruling.work;
                if self.state.memo.insert(individual) {
                    self.state.work.exhaustive += self.fitness.work();
                }
            }
            judged += batch.len();
            listener(Event::Batch { generation: self.state.next, judged, of: missing.len() });
        }
        Ok(None)
    }

    /// What each island holds its newcomers to. Nothing, if races are off or
    /// there is no generation before: the initial population is one in two
    /// hundred, and nobody in it has been judged.
    fn bars(&self) -> Vec<Option<Individual>> {
        let racing = &self.settings.racing;
        let islands = self.state.islands.iter();
        let mut bars: Vec<Option<Individual>> =
            islands.map(|p| bar(p, racing.bar).filter(|_| racing.on)).collect();
        bars.resize(self.settings.islands, None);
        bars
    }

    /// Has newcomers judged, and holds the fitness to its contract.
    fn race(&self, newcomers: &[Newcomer<'_>]) -> Result<Vec<Ruling>, Error> {
        let entrants: Vec<Entrant<'_>> = newcomers.iter().map(Newcomer::entrant).collect();
        let rulings = self.fitness.race(&entrants).map_err(Error::fitness)?;
        assert_eq!(rulings.len(), entrants.len(), "a race ends with one ruling per entrant");
        for (Entrant { tree, bar }, ruling) in entrants.iter().zip(&rulings) {
            let value = ruling.verdict.value();
            assert!(!value.is_nan(), "a fitness is never NaN, but was for {tree}");
            let beaten = bar.is_some_and(|bar| value >= bar.fitness);
            assert!(ruling.verdict.is_full() || beaten, "only the beaten are dropped, not {tree}");
        }
        Ok(rulings)
    }

    /// Puts a generation's judged children on the islands, lets the best
    /// migrate, and closes the books.
    fn settle(&mut self, generation: u32, children: Vec<Vec<Child>>) {
        let Self { settings, state, .. } = self;
        state.bred += children.iter().flatten().filter_map(Child::tree).count();
        let occupant = |child| match child {
            Child::Judged(individual) => individual,
            Child::New(tree) => {
                let verdict = state.memo.get(&tree).expect("every new child has been judged");
                Individual::new(tree, verdict)
            }
        };
        let islands = children.into_iter().map(|c| c.into_iter().map(occupant).collect());
        state.islands = islands.collect();
        if generation > 0
            && settings.migration_interval > 0
            && generation.is_multiple_of(settings.migration_interval)
        {
            migrate(&mut state.islands);
        }
        state.next = generation + 1;
        let progress = Progress {
            evaluations: self.state.memo.len(),
            memo_hits: self.memo_hits(),
            work: self.state.work,
        };
        let islands = self.state.islands.iter().enumerate();
        let rows = islands.map(|(island, p)| Row::new(generation, island, p, progress));
        self.state.history.extend(rows);
    }

    /// Judges the hall of fame by everything there is.
    fn finals(&self, listener: &mut dyn FnMut(Event<'_>)) -> Result<Vec<Finalist>, Error> {
        let members = self.state.hall.members();
        listener(Event::Finalists { count: members.len() });
        let trees: Vec<Tree> = members.iter().map(|m| m.tree.clone()).collect();
        let values = contract(&trees, self.fitness.evaluate_full(&trees))?;
        let mut ranked: Vec<(Individual, f64)> = members
            .iter()
            .zip(values)
            .map(|(m, full)| (Individual::new(m.tree.clone(), Judgement::Full(full)), m.fitness))
            .collect();
        ranked.sort_by(|(a, _), (b, _)| a.cmp(b));
        let finalist = |(judged, bred): (Individual, f64)| Finalist {
            tree: judged.tree,
            bred,
            full: judged.fitness,
            difference: None,
            objection: None,
        };
        Ok(ranked.into_iter().map(finalist).collect())
    }

    /// Compares finalists with their exact meanings until one is close enough, and
    /// nothing else is to be said against it.
    fn winner(
        &self,
        finalists: &mut [Finalist],
        listener: &mut dyn FnMut(Event<'_>),
    ) -> Result<usize, Error> {
        let mut closest = (0, f64::INFINITY);
        for (rank, finalist) in finalists.iter_mut().enumerate() {
            listener(Event::Comparison { rank });
            let difference = self.fitness.difference(&finalist.tree).map_err(Error::fitness)?;
            finalist.difference = Some(difference);
            if difference <= self.fitness.tolerance() {
                finalist.objection =
                    self.fitness.objection(&finalist.tree).map_err(Error::fitness)?;
                if finalist.objection.is_none() {
                    return Ok(rank);
                }
            }
            if difference < closest.1 {
                closest = (rank, difference);
            }
        }
        Ok(closest.0)
    }

    /// How many of the expressions bred had been judged before. What a stopped
    /// generation judged in vain counts when it is bred again.
    fn memo_hits(&self) -> usize {
        self.state.bred.saturating_sub(self.state.memo.len())
    }
}

/// Holds a fitness to its contract.
fn contract<E>(trees: &[Tree], values: Result<Vec<f64>, E>) -> Result<Vec<f64>, Error>
where
    E: std::error::Error + Send + Sync + 'static,
{
    let values = values.map_err(Error::fitness)?;
    assert_eq!(values.len(), trees.len(), "a fitness gives one value per expression");
    for (tree, value) in trees.iter().zip(&values) {
        assert!(!value.is_nan(), "a fitness is never NaN, but was for {tree}");
    }
    Ok(values)
}
