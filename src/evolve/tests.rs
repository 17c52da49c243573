//! Laws of whole searches, on fitness functions that cost next to nothing.

use std::collections::HashSet;
use std::convert::Infallible;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use proptest::prelude::*;

use super::breeding::{Place, initial};
use super::canonical::canonical;
use super::crossover::crossover;
use super::islands::best;
use super::materials::Materials;
use super::mutation::{Mutation, mutate};
use super::rng::stream;
use super::*;
use crate::expr::tape::Side;
use crate::expr::{Feature, Op, PlaneId, Sort, Symbol, Tree};

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
        let leaf = |feature| Tree::leaf(Symbol::Vector(feature)).unwrap();
        let normal = leaf(Feature::Normal);
        let distance = Tree::apply(Op::DistanceMax, &[&normal, &normal]).unwrap();
        let target = Tree::apply(Op::Mul, &[&distance, &Tree::constant(3.0)]).unwrap();
        Self { target, asked: Mutex::default(), alarm: None }
    }

    fn error(&self, tree: &Tree) -> f64 {
        let squares = (0..32).map(|k| {
            let value = |t: &Tree| t.meaning(|plane, side| sample(k, plane, side));
            (value(tree) - value(&self.target)).powi(2)
        });
        squares.sum::<f64>() / 32.0 + 1e-4 * tree.len() as f64
    }
}

impl Fitness for Regression {
    type Error = Infallible;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        let mut asked = self.asked.lock().unwrap();
        asked.extend_from_slice(trees);
        if let Some((after, flag)) = &self.alarm
            && asked.len() >= *after
        {
            flag.store(true, Ordering::Relaxed);
        }
        Ok(trees.iter().map(|t| self.error(t)).collect())
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
    Settings { islands: 3, island_size: 20, generations: 12, batch: 7, ..Preset::Quick.settings() }
}

fn search(settings: &Settings, fitness: &Regression) -> Outcome {
    let mut search = Search::new(settings.clone(), fitness).unwrap();
    search.run(&Control::default(), &mut |_| {}).unwrap()
}

fn least(outcome: &Outcome) -> f64 {
    outcome.islands.iter().map(|p| best(p).fitness).fold(f64::INFINITY, f64::min)
}

proptest! {
    #[test]
    fn variation_keeps_trees_well_formed_and_within_limits(seed in any::<u32>()) {
        let settings = Settings {
            max_nodes: 40,
            max_depth: 10,
            initial_mutations: 20,
            ..Preset::Quick.settings()
        };
        let materials = Materials::new(&settings).unwrap();
        let mut rng = stream(u64::from(seed), 0, 0, 0);
        let mut parent = materials.initial().clone();
        for _ in 0..60 {
            let mutant = mutate(&parent, &materials, &settings, &mut rng);
            let child = crossover(&mutant, &parent, &settings, &mut rng);
            for tree in [&mutant, &child] {
                prop_assert!(Tree::new(tree.symbols()).is_ok());
                prop_assert_eq!(tree.sort(), Sort::Scalar);
                prop_assert!(settings.admit(tree));
            }
            parent = child;
        }
    }

    #[test]
    fn a_canonical_tree_means_the_same(seed in any::<u32>()) {
        let settings = Settings { initial_mutations: 20, ..Preset::Quick.settings() };
        let materials = Materials::new(&settings).unwrap();
        let mut tree = materials.initial().clone();
        let mut rng = stream(u64::from(seed), 0, 0, 0);
        for _ in 0..20 {
            tree = mutate(&tree, &materials, &settings, &mut rng);
        }
        let meaning = |t: &Tree| t.meaning(|plane, side| sample(0, plane, side));
        prop_assert_eq!(meaning(&canonical(&tree)), meaning(&tree));
    }

    #[test]
    fn each_mutation_does_what_its_name_says(seed in any::<u32>()) {
        let settings = Preset::Quick.settings();
        let materials = Materials::new(&settings).unwrap();
        let mut rng = stream(u64::from(seed), 0, 0, 0);
        let mut tree = materials.initial().clone();
        for _ in 0..5 {
            tree = mutate(&tree, &materials, &settings, &mut rng);
        }
        for kind in Mutation::ALL {
            let Some(mutant) = kind.apply(&tree, &materials, 0.5, &mut rng) else { continue };
            let shape = |t: &Tree| t.symbols().iter().map(|s| s.arity()).collect::<Vec<_>>();
            match kind {
                Mutation::Replace | Mutation::Jitter => {
                    prop_assert_eq!(shape(&mutant), shape(&tree));
                    let changed = tree.symbols().iter().zip(mutant.symbols());
                    prop_assert!(changed.filter(|(a, b)| a != b).count() <= 1);
                }
                Mutation::Swap => {
                    let sorted = |t: &Tree| {
                        let mut symbols = t.symbols().to_vec();
                        symbols.sort_unstable();
                        symbols
                    };
                    prop_assert_eq!(sorted(&mutant), sorted(&tree));
                }
                Mutation::Insert => {}
                Mutation::Delete => prop_assert!(mutant.len() <= tree.len()),
            }
        }
    }
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
    let settings = Settings { reproduction: 0.0, mutation: 0.55, ..small() };
    let outcome = search(&settings, &Regression::new());
    for island in 0..settings.islands {
        let course: Vec<f64> =
            outcome.history.iter().filter(|r| r.island == island).map(|r| r.best).collect();
        assert!(course.is_sorted_by(|earlier, later| earlier >= later), "{course:?}");
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
    let outcome = search(&small(), &fitness);
    let asked = fitness.asked.lock().unwrap();
    let distinct: HashSet<Tree> = asked.iter().map(canonical).collect();
    assert_eq!(distinct.len(), asked.len());
    assert_eq!(outcome.evaluations, asked.len());
    assert!(outcome.memo_hits > 0);
}

#[test]
fn the_best_is_chosen_by_the_full_fitness() {
    let outcome = search(&small(), &Regression::new());
    assert_eq!(outcome.finalists.len(), small().finalists);
    assert!(outcome.finalists.is_sorted_by_key(|f| f.full));
    // Here the full fitness is breeding's, turned round.
    assert!(outcome.finalists.iter().all(|f| f.full == -f.bred));
    assert!(outcome.best().bred > least(&outcome));
}

#[test]
fn a_time_limit_of_nothing_still_gives_a_best_so_far() {
    let fitness = Regression::new();
    let mut search = Search::new(small(), &fitness).unwrap();
    let control = Control { time_limit: Some(Duration::ZERO), ..Control::default() };
    let outcome = search.run(&control, &mut |_| {}).unwrap();
    assert_eq!(outcome.ending, Ending::TimeLimit);
    assert_eq!(outcome.evaluations, small().batch);
    assert!(outcome.islands.is_empty());
    assert!(outcome.best().full.is_finite());
}

/// Searches until so many evaluations, writing to `path`.
fn interrupted(settings: &Settings, after: usize, path: &Path) -> Outcome {
    let stop = Arc::new(AtomicBool::new(false));
    let fitness = Regression { alarm: Some((after, stop.clone())), ..Regression::new() };
    let checkpoints = Some(Checkpoints { path: path.to_owned(), interval: 2 });
    let control = Control { stop, checkpoints, ..Control::default() };
    Search::new(settings.clone(), &fitness).unwrap().run(&control, &mut |_| {}).unwrap()
}

#[test]
fn a_resumed_search_ends_as_if_never_interrupted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let whole = search(&small(), &Regression::new());
    // In the initial population, early, and late; always within a generation.
    for after in [10, 120, whole.evaluations - 10] {
        let part = interrupted(&small(), after, &path);
        assert_eq!(part.ending, Ending::Stopped);
        assert!(part.evaluations < whole.evaluations);

        let fitness = Regression::new();
        let checkpoint = Checkpoint::read(&path).unwrap();
        let mut search = Search::resume(checkpoint, &fitness).unwrap();
        let resumed = search.run(&Control::default(), &mut |_| {}).unwrap();
        assert_eq!(resumed, whole, "after {after} evaluations");
        assert_eq!(fitness.asked.lock().unwrap().len(), whole.evaluations - part.evaluations);
    }
}

#[test]
fn a_finished_search_can_go_on_for_more_generations() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let half = Settings { generations: 6, ..small() };
    interrupted(&half, usize::MAX, &path);
    let mut checkpoint = Checkpoint::read(&path).unwrap();
    checkpoint.settings.generations = small().generations;
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
    assert!(matches!(Checkpoint::read(&path), Err(Error::Read { .. })));
    std::fs::write(&path, "{}").unwrap();
    let error = Checkpoint::read(&path).unwrap_err();
    assert!(error.to_string().contains("other.json"), "{error}");
}

#[test]
fn the_listener_hears_of_every_generation() {
    let fitness = Regression::new();
    let mut generations = Vec::new();
    let mut judged = 0;
    let mut finals = 0;
    Search::new(small(), &fitness)
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
            Event::Finalists { count } => finals += count,
        })
        .unwrap();
    assert_eq!(generations, (0..=12).collect::<Vec<u32>>());
    assert_eq!(finals, small().finalists);
}

#[test]
fn what_is_forbidden_never_appears() {
    let forbidden = ["secTexture", "cVariance", "tGradient"].map(str::to_owned).to_vec();
    let settings = Settings {
        initial: "exp(0.3)".to_owned(),
        initial_mutations: 30,
        forbidden: forbidden.clone(),
        ..Preset::Quick.settings()
    };
    let materials = Materials::new(&settings).unwrap();
    for index in 1..100 {
        let child = initial(Place { generation: 0, island: 0, index }, &materials, &settings);
        let tree = child.tree().expect("new").clone();
        let summary = Summary::new([&tree]);
        for frequency in summary.terms.iter().filter(|f| f.occurrences > 0) {
            assert!(!forbidden.iter().any(|name| name == frequency.name), "{tree}");
        }
    }
}

#[test]
fn an_initial_expression_that_cannot_be_is_refused() {
    let refused = |change: fn(&mut Settings)| {
        let mut settings = Preset::Quick.settings();
        change(&mut settings);
        Materials::new(&settings).unwrap_err().to_string()
    };
    assert!(refused(|s| s.initial = "bilatral".to_owned()).contains("neither a filter's name"));
    assert!(refused(|s| s.initial = "normal".to_owned()).contains("nor an expression"));
    assert!(refused(|s| s.forbidden = vec!["color".to_owned()]).contains("what `forbidden` names"));
    assert!(refused(|s| s.forbidden = vec!["colour".to_owned()]).contains("`colour`"));
    assert!(refused(|s| s.max_nodes = 3).contains("fit into `max_nodes`"));
}
