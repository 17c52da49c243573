//! Laws of whole searches, on fitness functions that cost next to nothing.

use std::collections::HashSet;
use std::convert::Infallible;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::canonical::canonical;
use super::islands::best;
use super::*;
use crate::expr::tape::Side;
use crate::expr::{PlaneId, Tree};
use crate::tune::SealedError;

mod interruptions;

/// Mean squared difference from a target weight at sampled pixel pairs, plus a
/// little for size: symbolic regression.
struct Regression {
    target: Tree,
    /// Every expression that was ever asked for.
    asked: Mutex<Vec<Tree>>,
    /// Raised when so many expressions have been asked for.
    alarm: Option<(usize, Arc<AtomicBool>)>,
}

/// A plane's value at either end of pair `k`: arbitrary, but always the same.
fn sample(k: usize, plane: PlaneId, side: Side) -> f64 {
    let salt = plane.feature as usize * 31 + plane.quantity as usize * 7;
    let phase =
        (salt + usize::from(plane.component)) as f64 + if side == Side::I { 0.0 } else { 0.4 };
    (phase * 1.7 + k as f64 * 0.61).sin()
}

impl Regression {
    fn new() -> Self {
        let target = "3 * distanceMax(normal, normal)".parse().unwrap();
        Self { target, asked: Mutex::default(), alarm: None }
    }

    fn error(&self, tree: &Tree) -> f64 {
        self.squares(tree, 32) + 1e-4 * tree.len() as f64
    }

    fn squares(&self, tree: &Tree, samples: usize) -> f64 {
        let squares = (0..samples).map(|k| {
            let value = |t: &Tree| t.meaning(|plane, side| sample(k, plane, side));
            (value(tree) - value(&self.target)).powi(2)
        });
        squares.sum::<f64>() / samples as f64
    }

    fn note(&self, tree: &Tree) {
        let mut asked = self.asked.lock().unwrap();
        asked.push(tree.clone());
        if let Some((after, flag)) = &self.alarm
            && asked.len() >= *after
        {
            flag.store(true, Ordering::Relaxed);
        }
    }
}

impl Fitness for Regression {
    type Error = Infallible;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        trees.iter().for_each(|tree| self.note(tree));
        Ok(trees.iter().map(|t| self.error(t)).collect())
    }

    /// Drops who is worse by half on an eighth of the samples.
    fn race(&self, entrants: &[Entrant<'_>]) -> Result<Vec<Ruling>, Infallible> {
        let ruling = |entrant: &Entrant<'_>| {
            let Entrant { tree, bar } = *entrant;
            self.note(tree);
            let full = |work| Ruling { verdict: Judgement::Full(self.error(tree)), work };
            let Some(bar) = bar else { return full(8) };
            let excess = self.squares(tree, 4) - self.squares(bar.tree, 4);
            if excess > 0.5 {
                Ruling { verdict: Judgement::Dropped(bar.fitness + excess), work: 1 }
            } else {
                full(9)
            }
        };
        Ok(entrants.iter().map(ruling).collect())
    }

    fn work(&self) -> u64 {
        8
    }

    /// Disagrees with breeding, to show which of the two decides in the end.
    fn evaluate_full(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        Ok(trees.iter().map(|t| -self.error(t)).collect())
    }

    fn identity(&self) -> String {
        self.target.to_string()
    }
}

fn small() -> Settings {
    let quick = Preset::Weights.settings();
    let racing = Racing { on: true, ..quick.racing.clone() };
    Settings { islands: 3, island_size: 20, generations: 12, batch: 7, racing, ..quick }
}

/// Without races.
fn thorough() -> Settings {
    let racing = Racing { on: false, ..small().racing };
    Settings { racing, ..small() }
}

fn search<F: Fitness>(settings: &Settings, fitness: &F) -> Outcome {
    let mut search = Search::new(settings.clone(), fitness).unwrap();
    search.run(&Control::default(), &mut |_| {}).unwrap()
}

fn least(outcome: &Outcome) -> f64 {
    outcome.islands.iter().map(|p| best(p).fitness).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_same_seed_gives_the_same_result_for_any_number_of_threads() {
    let outcomes: Vec<Outcome> = [1, 2, 5]
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| search(&small(), &Regression::new()))
        })
        .into();
    assert_eq!(outcomes[0], outcomes[1]);
    assert_eq!(outcomes[0], outcomes[2]);
    let other = search(&Settings { seed: 2, ..small() }, &Regression::new());
    assert_ne!(outcomes[0].islands, other.islands);
}

#[test]
fn the_size_of_batches_changes_nothing() {
    let whole = search(&Settings { batch: 1000, ..small() }, &Regression::new());
    assert_eq!(whole, search(&small(), &Regression::new()));
}

#[test]
fn the_elite_is_never_lost() {
    // Without any reproduction, too.
    for settings in [small(), thorough()] {
        let settings = Settings { reproduction: 0.0, mutation: 0.55, ..settings };
        let outcome = search(&settings, &Regression::new());
        for island in 0..settings.islands {
            let course: Vec<f64> =
                outcome.history.iter().filter(|r| r.island == island).map(|r| r.best).collect();
            assert!(course.is_sorted_by(|earlier, later| earlier >= later), "{course:?}");
        }
    }
}

#[test]
fn the_search_finds_better_expressions() {
    let outcome =
        search(&Settings { island_size: 40, generations: 40, ..small() }, &Regression::new());
    let first = outcome.history[0].best;
    assert!(least(&outcome) < first / 10.0, "{} from {first}", least(&outcome));
}

#[test]
fn after_a_migration_the_neighbour_is_as_good() {
    let settings = Settings { generations: 5, migration_interval: 5, ..small() };
    let outcome = search(&settings, &Regression::new());
    let bests: Vec<f64> = outcome.islands.iter().map(|p| best(p).fitness).collect();
    let apart = search(&Settings { migration_interval: 0, ..settings }, &Regression::new());
    let before: Vec<f64> = apart.islands.iter().map(|p| best(p).fitness).collect();
    for k in 0..bests.len() {
        let from = (k + bests.len() - 1) % bests.len();
        assert_eq!(bests[k], before[k].min(before[from]), "island {k}");
    }
}

#[test]
fn nothing_is_judged_twice() {
    let fitness = Regression::new();
    let outcome = search(&thorough(), &fitness);
    let asked = fitness.asked.lock().unwrap();
    let distinct: HashSet<Tree> = asked.iter().map(canonical).collect();
    assert_eq!(distinct.len(), asked.len());
    assert_eq!(outcome.evaluations, asked.len());
    assert!(outcome.memo_hits > 0);
    let all = 8 * asked.len() as u64;
    assert_eq!((outcome.dropped, outcome.work), (0, Work { done: all, exhaustive: all }));
}

/// Judges as the fitness within, but never races.
struct Patient(Regression);

impl Fitness for Patient {
    type Error = Infallible;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        self.0.evaluate(trees)
    }

    fn evaluate_full(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        self.0.evaluate_full(trees)
    }

    fn work(&self) -> u64 {
        self.0.work()
    }

    fn identity(&self) -> String {
        self.0.identity()
    }
}

#[test]
fn a_search_whose_fitness_drops_nobody_is_a_search_without_races() {
    let patient = search(&small(), &Patient(Regression::new()));
    assert_eq!(patient, search(&thorough(), &Regression::new()));
}

#[test]
fn what_is_best_or_reported_was_judged_in_full() {
    let fitness = Regression::new();
    let outcome = search(&small(), &fitness);
    assert!(outcome.dropped > 0);
    assert!(outcome.work.done < outcome.work.exhaustive);
    assert_eq!(outcome.work.exhaustive, 8 * outcome.evaluations as u64);
    for row in &outcome.history {
        assert_eq!(row.best, fitness.error(&canonical(&row.expression)));
    }
    for finalist in &outcome.finalists {
        assert_eq!(finalist.bred, fitness.error(&finalist.tree));
    }
    let all: Vec<&Individual> = outcome.islands.iter().flatten().collect();
    assert!(all.iter().any(|individual| !individual.full));
    for individual in all.iter().filter(|individual| individual.full) {
        assert_eq!(individual.fitness, fitness.error(&canonical(&individual.tree)));
    }
}

#[test]
fn the_best_is_chosen_by_the_full_fitness() {
    let outcome = search(&small(), &Regression::new());
    assert_eq!(outcome.finalists.len(), small().finalists);
    assert!(outcome.finalists.is_sorted_by(|a, b| a.full <= b.full));
    // Here the full fitness is breeding's, turned round.
    assert!(outcome.finalists.iter().all(|f| f.full == Some(-f.bred)));
    assert!(outcome.best().bred > least(&outcome));
}

/// Computes every finalist badly: the shorter, the worse.
struct Shaky {
    within: Regression,
    tolerance: f64,
    compared: Mutex<usize>,
}

impl Shaky {
    fn new(tolerance: f64) -> Self {
        Self { within: Regression::new(), tolerance, compared: Mutex::default() }
    }
}

impl Fitness for Shaky {
    type Error = Infallible;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        self.within.evaluate(trees)
    }

    fn difference(&self, tree: &Tree) -> Result<f64, Infallible> {
        *self.compared.lock().unwrap() += 1;
        Ok(1.0 + (1 << 20) as f64 / tree.len() as f64)
    }

    fn tolerance(&self) -> f64 {
        self.tolerance
    }

    fn identity(&self) -> String {
        self.within.identity()
    }
}

#[test]
fn the_first_finalist_that_is_accurate_wins() {
    let least = |outcome: &Outcome| {
        let differences = outcome.finalists.iter().filter_map(|f| f.difference);
        differences.fold(f64::INFINITY, f64::min)
    };
    let none = Shaky::new(0.5);
    let hopeless = search(&small(), &none);
    assert_eq!(*none.compared.lock().unwrap(), hopeless.finalists.len());
    assert_eq!(hopeless.best().difference, Some(least(&hopeless)));
    let first = hopeless.finalists[0].difference.expect("all were compared");
    assert!(first > least(&hopeless), "the test shows nothing");

    // Tolerate a little less than the first has.
    let some = Shaky::new(first.next_down());
    let outcome = search(&small(), &some);
    assert!(outcome.winner > 0);
    assert_eq!(*some.compared.lock().unwrap(), outcome.winner + 1);
    let (refused, rest) = outcome.finalists.split_at(outcome.winner);
    assert!(refused.iter().all(|f| f.difference >= Some(first)));
    assert!(outcome.best().difference < Some(first));
    assert!(rest[1..].iter().all(|f| f.difference.is_none()));

    let all = search(&small(), &Shaky::new(first));
    assert_eq!(all.winner, 0);
}

/// Objects to every expression but one.
struct Partial {
    within: Regression,
    favourite: Option<Tree>,
}

impl Fitness for Partial {
    type Error = Infallible;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        self.within.evaluate(trees)
    }

    fn objection(&self, tree: &Tree) -> Result<Option<String>, Infallible> {
        Ok((self.favourite.as_ref() != Some(tree)).then(|| format!("not {tree}")))
    }

    fn identity(&self) -> String {
        self.within.identity()
    }
}

#[test]
fn the_first_finalist_without_an_objection_wins() {
    let none = search(&small(), &Partial { within: Regression::new(), favourite: None });
    assert_eq!(none.winner, 0);
    assert!(none.finalists.iter().all(|finalist| finalist.objection.is_some()));

    let favourite = none.finalists[2].tree.clone();
    let some = Partial { within: Regression::new(), favourite: Some(favourite.clone()) };
    let outcome = search(&small(), &some);
    assert_eq!((outcome.winner, &outcome.best().tree), (2, &favourite));
    let objections = outcome.finalists.iter().map(|finalist| finalist.objection.is_some());
    assert!(objections.take(4).eq([true, true, false, false]), "{:?}", outcome.finalists);
}

#[test]
fn a_time_limit_of_nothing_still_gives_a_best_so_far() {
    let fitness = Regression::new();
    let mut search = Search::new(small(), &fitness).unwrap();
    let control = Control { time_limit: Some(Duration::ZERO), ..Control::default() };
    let outcome = search.run(&control, &mut |_| {}).unwrap();
    assert_eq!(outcome.ending, Ending::TimeLimit);
    assert_eq!(outcome.evaluations, 1);
    assert!(outcome.islands.is_empty());
    assert!(outcome.best().full.is_some_and(f64::is_finite));
}

/// Searches until so many expressions were asked for, writing to `path`; how it
/// ended, and how many there were.
fn interrupted(settings: &Settings, after: usize, path: &Path) -> (Outcome, usize) {
    let stop = Arc::new(AtomicBool::new(false));
    let fitness = Regression { alarm: Some((after, stop.clone())), ..Regression::new() };
    let checkpoints = Some(Checkpoints { path: path.to_owned(), interval: 2 });
    let control = Control { stop, checkpoints, ..Control::default() };
    let mut search = Search::new(settings.clone(), &fitness).unwrap();
    let outcome = search.run(&control, &mut |_| {}).unwrap();
    let asked = fitness.asked.lock().unwrap().len();
    (outcome, asked)
}

#[test]
fn a_resumed_search_ends_as_if_never_interrupted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let fitness = Regression::new();
    let whole = search(&small(), &fitness);
    let all = fitness.asked.lock().unwrap().len();
    // In the initial population, early, and late; always within a generation.
    for after in [10, 120, all - 10] {
        let (part, asked) = interrupted(&small(), after, &path);
        assert_eq!(part.ending, Ending::Stopped);
        assert!(part.evaluations < whole.evaluations);

        let fitness = Regression::new();
        let checkpoint = Checkpoint::read(&path).unwrap();
        let mut search = Search::resume(checkpoint, &fitness).unwrap();
        let resumed = search.run(&Control::default(), &mut |_| {}).unwrap();
        assert_eq!(resumed, whole, "after {after} evaluations");
        assert_eq!(fitness.asked.lock().unwrap().len(), all - asked);
    }
}

#[test]
fn a_finished_search_can_go_on_for_more_generations() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let half = Settings { generations: 6, ..small() };
    interrupted(&half, usize::MAX, &path);
    let checkpoint = Checkpoint::read(&path).unwrap().until(small().generations);
    let fitness = Regression::new();
    let resumed = Search::resume(checkpoint, &fitness)
        .unwrap()
        .run(&Control::default(), &mut |_| {})
        .unwrap();
    assert_eq!(resumed, search(&small(), &Regression::new()));
}

#[test]
fn a_checkpoint_of_another_fitness_is_refused() {
    let fitness = Regression::new();
    let checkpoint = Search::new(small(), &fitness).unwrap().checkpoint();
    let other = Regression { target: Tree::constant(3.0), ..Regression::new() };
    let error = Search::resume(checkpoint, &other).err().expect("another target");
    assert!(matches!(error, Error::Identity { .. }), "{error}");
}

#[test]
fn what_is_no_checkpoint_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.json");
    let missing = Checkpoint::read(&path);
    assert!(matches!(missing, Err(Error::Checkpoint(SealedError::Read { .. }))));
    std::fs::write(&path, "{}").unwrap();
    let error = Checkpoint::read(&path).unwrap_err();
    assert!(error.to_string().contains("other.json"), "{error}");

    std::fs::write(&path, r#"{ "format": "tamis-search-1", "identity": "another" }"#).unwrap();
    let error = Checkpoint::read(&path).unwrap_err();
    assert!(error.to_string().contains("start anew"), "{error}");

    // One individual short.
    let fitness = Regression::new();
    let mut search = Search::new(small(), &fitness).unwrap();
    search.run(&Control::default(), &mut |_| {}).unwrap();
    let mut checkpoint = search.checkpoint();
    checkpoint.state.islands[1].pop();
    checkpoint.write(&path).unwrap();
    let unfit = Checkpoint::read(&path);
    assert!(matches!(unfit, Err(Error::Checkpoint(SealedError::Content { .. }))));

    // One byte is not what was written.
    search.checkpoint().write(&path).unwrap();
    Checkpoint::read(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.len() / 2;
    bytes[at] ^= 4;
    std::fs::write(&path, bytes).unwrap();
    let error = Checkpoint::read(&path).unwrap_err();
    assert!(matches!(error, Error::Checkpoint(SealedError::Damaged { .. })), "{error}");
    assert!(error.to_string().contains("other.json is damaged"), "{error}");
}

#[test]
fn the_listener_hears_of_every_generation() {
    let fitness = Regression::new();
    let mut generations = Vec::new();
    let mut judged = 0;
    let mut finals = 0;
    Search::new(thorough(), &fitness)
        .unwrap()
        .run(&Control::default(), &mut |event| match event {
            Event::Batch { of, judged: j, .. } if j == of => judged += of,
            Event::Batch { .. } => {}
            Event::Generation { generation, of, islands, best } => {
                assert_eq!((of, islands.len()), (12, 3));
                assert!(islands.iter().all(|row| row.best >= best.fitness));
                assert_eq!(islands[0].evaluations, judged);
                generations.push(generation);
            }
            Event::Checkpoint { written, complete, failure, .. } => {
                assert!(!written && failure.is_none(), "nobody asked for one");
                assert_eq!(complete, 13, "breeding has ended");
            }
            Event::Finalists { count } => finals += count,
            Event::Comparison { rank } => assert_eq!(rank, 0, "the first is good enough"),
        })
        .unwrap();
    assert_eq!(generations, (0..=12).collect::<Vec<u32>>());
    assert_eq!(finals, small().finalists);
}

/// Fails once so many expressions were judged.
struct Mortal {
    within: Regression,
    left: AtomicUsize,
    finals: bool,
}

#[derive(Debug, thiserror::Error)]
#[error("the device was lost")]
struct Lost;

impl Mortal {
    fn new(left: usize, finals: bool) -> Self {
        Self { within: Regression::new(), left: AtomicUsize::new(left), finals }
    }
}

impl Fitness for Mortal {
    type Error = Lost;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Lost> {
        let left = self.left.load(Ordering::Relaxed).checked_sub(trees.len()).ok_or(Lost)?;
        self.left.store(left, Ordering::Relaxed);
        let Ok(values) = self.within.evaluate(trees);
        Ok(values)
    }

    fn evaluate_full(&self, trees: &[Tree]) -> Result<Vec<f64>, Lost> {
        let Ok(values) = self.within.evaluate_full(trees);
        if self.finals { Ok(values) } else { Err(Lost) }
    }

    fn work(&self) -> u64 {
        self.within.work()
    }

    fn identity(&self) -> String {
        self.within.identity()
    }
}

/// In the first batch, between two generations, within one, and among the finalists.
#[test]
fn a_search_whose_fitness_fails_stops_and_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let expected = search(&thorough(), &Patient(Regression::new()));
    let always = expected.evaluations;
    for (left, finals) in [(0, true), (5, true), (60, true), (always / 2, true), (always, false)] {
        let fitness = Mortal::new(left, finals);
        let checkpoints = Some(Checkpoints { path: path.clone(), interval: 0 });
        let control = Control { checkpoints, ..Control::default() };
        let mut started = Search::new(thorough(), &fitness).unwrap();
        let error = started.run(&control, &mut |_| {}).unwrap_err();
        let Error::Fitness { source, checkpoint } = &error else { panic!("{error}") };
        assert_eq!(source.to_string(), "the device was lost");
        assert_eq!(checkpoint.as_deref(), Some(&*path));

        let text = std::fs::read_to_string(&path).unwrap();
        assert!(!text.contains("inf"), "after {left} a failure is remembered as a value");
        let sound = Mortal::new(usize::MAX, true);
        let mut resumed = Search::resume(Checkpoint::read(&path).unwrap(), &sound).unwrap();
        assert_eq!(resumed.run(&Control::default(), &mut |_| {}).unwrap(), expected, "{left}");
        let before = fitness.within.asked.lock().unwrap().len();
        let after = sound.within.asked.lock().unwrap().len();
        assert_eq!(before + after, always, "what was judged before {left} is judged again");
    }

    // Without a place for a checkpoint there is nothing to resume from.
    let fitness = Mortal::new(5, true);
    let mut started = Search::new(thorough(), &fitness).unwrap();
    let error = started.run(&Control::default(), &mut |_| {}).unwrap_err();
    assert!(matches!(error, Error::Fitness { checkpoint: None, .. }));
}

/// A fitness of integers alone: no computer rounds it otherwise.
struct Spelling;

impl Fitness for Spelling {
    type Error = Infallible;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        let value = |tree: &Tree| {
            let letters: u32 = tree.to_string().bytes().map(u32::from).sum();
            f64::from((letters * 7919) % 997) + 10.0 * (tree.len() as f64 - 30.0).abs()
        };
        Ok(trees.iter().map(value).collect())
    }

    fn identity(&self) -> String {
        "spelling".to_owned()
    }
}

/// A change of any of these changes what every seed finds.
#[test]
fn presets_find_for_a_seed_what_they_always_found() {
    let found = Preset::ALL.map(|preset| {
        let outcome = search(&Settings { generations: 12, ..preset.settings() }, &Spelling);
        let best = outcome.best();
        format!("{}: {} {} {}", preset.name(), outcome.evaluations, best.bred, best.tree)
    });
    insta::assert_snapshot!(found.join("\n"), @"
    paper: 3775 0 2 / pow(2, 2) * exp(exp(-pow(distance2(color, color), exp(pow(-pow(distance2(pixel, pixel), 2), 2))) / pow(distance2(color, color), distance2(pixel, pixel))))
    weights: 1762 20 exp(-pow(2, 2) / 2048) * (2 * exp(pow(distance2(worldPosition, worldPosition), 2)) * acos(-pow(distance2(texture, texture), distance2(dirIllumination, dirIllumination)) / 0.0468))
    ");
}
