//! The search itself: generation after generation, on all islands at once.

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
use crate::scene::Fingerprint;
use crate::tune::{Control, Ending, Keeper, Watch};

/// A search under way.
pub struct Search<'a, F> {
    settings: Settings,
    materials: Materials,
    fitness: &'a F,
    /// What the fitness judges by: it takes a while to find.
    pictures: Vec<Fingerprint>,
    state: State,
}

/// One of the best expressions of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Finalist {
    /// The expression.
    pub tree: Tree,
    /// Its fitness in breeding.
    pub bred: f64,
    /// Its fitness by everything there is: lower is better. None if the run was stopped
    /// before that was known.
    pub full: Option<f64>,
    /// How far what is computed for it is from what it means; none if somebody before
    /// it won, or the run was stopped.
    pub difference: Option<f64>,
    /// Why it must not win, if it is close enough and that was found.
    pub objection: Option<String>,
}

/// What a run found.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The hall of fame judged in full, the best first; as breeding judged it, if the run was
    /// stopped before that was done. Never empty.
    pub finalists: Vec<Finalist>,
    /// Which of them wins: the first that is computed accurately enough and to which
    /// there is no objection. If there is none, the most accurate. If the run was stopped,
    /// the first of which nothing else is known yet.
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
        Self::with_state(settings, fitness, fitness.pictures(), state)
    }

    /// A search from where a checkpoint was written. It ends with what the
    /// search that wrote it would have ended with.
    pub fn resume(checkpoint: Checkpoint, fitness: &'a F) -> Result<Self, Error> {
        let given = fitness.identity();
        if checkpoint.identity != given {
            return Err(Error::Identity { bred: checkpoint.identity, given });
        }
        let pictures = fitness.pictures();
        if let Some(picture) = Fingerprint::first_changed(&checkpoint.pictures, &pictures) {
            return Err(Error::Picture { picture: picture.to_owned() });
        }
        Self::with_state(checkpoint.settings, fitness, pictures, checkpoint.state)
    }

    fn with_state(
        settings: Settings,
        fitness: &'a F,
        pictures: Vec<Fingerprint>,
        state: State,
    ) -> Result<Self, Error> {
        settings.validate()?;
        let materials = Materials::new(&settings)?;
        Ok(Self { settings, materials, fitness, pictures, state })
    }

    /// What the search was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The best so far, if anything was judged: as breeding judged it.
    pub fn best(&self) -> Option<&Individual> {
        self.state.hall.members().first()
    }

    /// The search as it stands.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            identity: self.fitness.identity(),
            pictures: self.pictures.clone(),
            settings: self.settings.clone(),
            state: self.state.clone(),
        }
    }

    /// Searches until the last generation or until `control` ends it, and
    /// judges the finalists in full either way. Unless the fitness gives up because of the
    /// same wish to stop, at least one expression is judged, so that there always is a best so far.
    ///
    /// A checkpoint is written before anything is judged, after the initial generation, then
    /// as `control` asks, and when breeding ends. That one cannot be written is told
    /// ([`Event::Checkpoint`]) and no reason to stop.
    ///
    /// # Errors
    /// If the fitness fails: the checkpoint that `control` asks for is written first, and the
    /// error names it. Or if it gives up before anything was judged.
    ///
    /// # Panics
    /// If the fitness breaks its contract: a NaN, or a wrong number of values.
    pub fn run(
        &mut self,
        control: &Control,
        listener: &mut dyn FnMut(Event<'_>),
    ) -> Result<Outcome, Error> {
        let watch = Watch::start(control);
        let mut keeper = Keeper::new(control);
        let bred = self.breed(&watch, &mut keeper, listener);
        self.save(&mut keeper, listener);
        let resumable = |error: Error| error.resumable(keeper.latest());
        let bred = bred.map_err(resumable)?;
        if self.state.memo.is_empty() {
            return Err(Error::Stopped);
        }
        let (finalists, done) = self.finals(listener).map_err(resumable)?;
        Ok(Outcome {
            winner: finalists.winner,
            finalists: finalists.all,
            islands: self.state.islands.clone(),
            history: self.state.history.clone(),
            evaluations: self.state.memo.len(),
            dropped: self.state.memo.dropped(),
            memo_hits: self.memo_hits(),
            work: self.state.work,
            ending: if done { bred } else { Ending::Stopped },
        })
    }

    /// Writes the checkpoint that is asked for, if one is.
    fn save(&self, keeper: &mut Keeper<'_>, listener: &mut dyn FnMut(Event<'_>)) {
        let failure = keeper.keep(|path| self.checkpoint().write(path));
        listener(Event::Checkpoint {
            written: keeper.latest().is_some(),
            complete: self.state.next,
            best: self.best(),
            evaluations: self.state.memo.len(),
            rows: &self.state.history,
            failure: failure.as_ref(),
        });
    }

    /// Forms generations until there is a reason to end.
    fn breed(
        &mut self,
        watch: &Watch<'_>,
        keeper: &mut Keeper<'_>,
        listener: &mut dyn FnMut(Event<'_>),
    ) -> Result<Ending, Error> {
        // Whoever is killed while the initial population is judged can be resumed, too.
        if self.state.memo.is_empty() && keeper.is_due(0) {
            self.save(keeper, listener);
        }
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
            // Counted from the initial population, which is the first to be safe.
            if keeper.is_due(generation) && generation < self.settings.generations {
                self.save(keeper, listener);
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
        let generation = self.state.next;
        let missing = self.state.memo.missing(generation, bred);
        let mut judged = 0;
        // The first expression of all is judged alone, so that there soon is a best so far.
        let first = if self.state.memo.is_empty() { 1 } else { self.settings.batch };
        let (first, rest) = missing.split_at(first.min(missing.len()));
        let batches = std::iter::once(first).chain(rest.chunks(self.settings.batch));
        for batch in batches.filter(|batch| !batch.is_empty()) {
            if judged > 0
                && let Some(ending) = watch.ending()
            {
                return Ok(Some(ending));
            }
            let Some(rulings) = self.race(batch)? else { return Ok(Some(Ending::Stopped)) };
            for (newcomer, ruling) in batch.iter().zip(rulings) {
                let individual = Individual::new(newcomer.tree.clone(), ruling.verdict);
                if individual.full {
                    self.state.hall.offer(individual.clone());
                }
                self.state.work.done += ruling.work;
                if self.state.memo.insert(generation, individual) {
                    self.state.work.exhaustive += self.fitness.work();
                }
            }
            judged += batch.len();
            listener(Event::Batch { generation, judged, of: missing.len() });
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

    /// Has newcomers judged, and holds the fitness to its contract. None if it gave up
    /// because somebody asked to stop.
    fn race(&self, newcomers: &[Newcomer<'_>]) -> Result<Option<Vec<Ruling>>, Error> {
        let entrants: Vec<Entrant<'_>> = newcomers.iter().map(Newcomer::entrant).collect();
        let Some(rulings) = unless_stopped::<F, _>(self.fitness.race(&entrants))? else {
            return Ok(None);
        };
        assert_eq!(rulings.len(), entrants.len(), "a race ends with one ruling per entrant");
        for (Entrant { tree, bar }, ruling) in entrants.iter().zip(&rulings) {
            let value = ruling.verdict.value();
            assert!(!value.is_nan(), "a fitness is never NaN, but was for {tree}");
            let beaten = bar.is_some_and(|bar| value >= bar.fitness);
            assert!(ruling.verdict.is_full() || beaten, "only the beaten are dropped, not {tree}");
        }
        Ok(Some(rulings))
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
        state.memo.forget(settings.remembered);
        let progress = Progress {
            evaluations: self.state.memo.len(),
            memo_hits: self.memo_hits(),
            work: self.state.work,
        };
        let islands = self.state.islands.iter().enumerate();
        let rows = islands.map(|(island, p)| Row::new(generation, island, p, progress));
        self.state.history.extend(rows);
    }

    /// Judges the hall of fame by everything there is, and finds the winner. Also returns
    /// whether the fitness saw it through, and did not give up because somebody asked to stop.
    fn finals(&self, listener: &mut dyn FnMut(Event<'_>)) -> Result<(Finalists, bool), Error> {
        let members = self.state.hall.members();
        listener(Event::Finalists { count: members.len() });
        let trees: Vec<Tree> = members.iter().map(|m| m.tree.clone()).collect();
        let finalist = |tree: Tree, bred: f64, full: Option<f64>| Finalist {
            tree,
            bred,
            full,
            difference: None,
            objection: None,
        };
        let Some(values) = unless_stopped::<F, _>(self.fitness.evaluate_full(&trees))? else {
            let bred = members.iter().map(|m| finalist(m.tree.clone(), m.fitness, None));
            return Ok((Finalists { all: bred.collect(), winner: 0 }, false));
        };
        contract(&trees, &values);
        let mut ranked: Vec<(Individual, f64)> = members
            .iter()
            .zip(values)
            .map(|(m, full)| (Individual::new(m.tree.clone(), Judgement::Full(full)), m.fitness))
            .collect();
        ranked.sort_by(|(a, _), (b, _)| a.cmp(b));
        let all = ranked.into_iter();
        let all = all.map(|(judged, bred)| finalist(judged.tree, bred, Some(judged.fitness)));
        let mut finalists = Finalists { all: all.collect(), winner: 0 };
        let done = self.decide(&mut finalists, listener)?;
        Ok((finalists, done))
    }

    /// Compares finalists with their exact meanings until one is close enough, and
    /// nothing else is to be said against it. Returns whether it got to the end of that; if
    /// not, the one that was being looked at is taken for the winner.
    fn decide(
        &self,
        finalists: &mut Finalists,
        listener: &mut dyn FnMut(Event<'_>),
    ) -> Result<bool, Error> {
        let mut closest = (0, f64::INFINITY);
        for (rank, finalist) in finalists.all.iter_mut().enumerate() {
            finalists.winner = rank;
            listener(Event::Comparison { rank });
            let difference = unless_stopped::<F, _>(self.fitness.difference(&finalist.tree))?;
            let Some(difference) = difference else { return Ok(false) };
            finalist.difference = Some(difference);
            if difference <= self.fitness.tolerance() {
                let objection = unless_stopped::<F, _>(self.fitness.objection(&finalist.tree))?;
                let Some(objection) = objection else { return Ok(false) };
                finalist.objection = objection;
                if finalist.objection.is_none() {
                    return Ok(true);
                }
            }
            if difference < closest.1 {
                closest = (rank, difference);
            }
        }
        finalists.winner = closest.0;
        Ok(true)
    }

    /// How many of the expressions bred had been judged before. What a stopped
    /// generation judged in vain counts when it is bred again.
    fn memo_hits(&self) -> usize {
        self.state.bred.saturating_sub(self.state.memo.len())
    }
}

/// The best of a run, and which of them wins.
struct Finalists {
    all: Vec<Finalist>,
    winner: usize,
}

/// What a fitness answered; none if it gave up because somebody asked to stop.
fn unless_stopped<F: Fitness, T>(answer: Result<T, F::Error>) -> Result<Option<T>, Error> {
    match answer {
        Ok(answer) => Ok(Some(answer)),
        Err(error) if F::is_stop(&error) => Ok(None),
        Err(error) => Err(Error::fitness(error)),
    }
}

/// Holds a fitness to its contract.
fn contract(trees: &[Tree], values: &[f64]) {
    assert_eq!(values.len(), trees.len(), "a fitness gives one value per expression");
    for (tree, value) in trees.iter().zip(values) {
        assert!(!value.is_nan(), "a fitness is never NaN, but was for {tree}");
    }
}
