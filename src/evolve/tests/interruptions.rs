//! What happens to searches that are stopped, killed or cannot write, and to those that are
//! resumed.

use std::collections::HashSet;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{Regression, interrupted, search, small, thorough};
use crate::evolve::canonical::canonical;
use crate::evolve::*;
use crate::expr::Tree;
use crate::scene::Fingerprint;

/// Gives up once a flag is raised, as a fitness does that looks at it while it judges.
struct Obedient {
    within: Regression,
    stop: Arc<AtomicBool>,
    /// Full values it gives before the flag is raised, if it is to be raised there.
    full: Option<usize>,
    /// The same of differences.
    differences: Option<usize>,
}

#[derive(Debug, thiserror::Error)]
#[error("somebody asked to stop")]
struct Asked;

impl Obedient {
    /// Raises the flag itself after so many expressions.
    fn new(after: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let within = Regression { alarm: Some((after, stop.clone())), ..Regression::new() };
        Self { within, stop, full: None, differences: None }
    }

    fn go_on(&self) -> Result<(), Asked> {
        if self.stop.load(Ordering::Relaxed) { Err(Asked) } else { Ok(()) }
    }
}

impl Fitness for Obedient {
    type Error = Asked;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Asked> {
        let value = |tree: &Tree| {
            self.go_on()?;
            let Ok(values) = self.within.evaluate(std::slice::from_ref(tree));
            Ok(values[0])
        };
        let values: Vec<f64> = trees.iter().map(value).collect::<Result<_, Asked>>()?;
        self.go_on().map(|()| values)
    }

    fn evaluate_full(&self, trees: &[Tree]) -> Result<Vec<f64>, Asked> {
        if self.full == Some(0) {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.go_on()?;
        let Ok(values) = self.within.evaluate_full(trees);
        Ok(values)
    }

    fn difference(&self, _: &Tree) -> Result<f64, Asked> {
        if self.differences == Some(0) {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.go_on().map(|()| 0.0)
    }

    fn is_stop(_: &Asked) -> bool {
        true
    }

    fn work(&self) -> u64 {
        self.within.work()
    }

    fn identity(&self) -> String {
        self.within.identity()
    }
}

/// In the initial population, within a batch, at its end, and late: not one expression is
/// judged after the flag is up, and the half of a batch that was judged counts for nothing.
#[test]
fn a_fitness_that_gives_up_ends_the_search_at_once_and_costs_a_resumed_one_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let expected = search(&thorough(), &Obedient::new(usize::MAX));
    let all = expected.evaluations;
    for after in [2, 8, 10, 14, 60, all / 2, all - 3] {
        let fitness = Obedient::new(after);
        let checkpoints = Some(Checkpoints { path: path.clone(), interval: 2 });
        let control = Control { stop: fitness.stop.clone(), checkpoints, ..Control::default() };
        let mut started = Search::new(thorough(), &fitness).unwrap();
        let outcome = started.run(&control, &mut |_| {}).unwrap();
        assert_eq!(outcome.ending, Ending::Stopped);
        assert_eq!(fitness.within.asked.lock().unwrap().len(), after, "judged after the flag");
        assert!(outcome.evaluations < after && after - outcome.evaluations <= thorough().batch);
        // There was no time for the finals.
        assert!(outcome.finalists.iter().all(|f| f.full.is_none() && f.difference.is_none()));
        assert_eq!(outcome.winner, 0);
        assert!(outcome.finalists.is_sorted_by(|a, b| a.bred <= b.bred));

        let fitness = Obedient::new(usize::MAX);
        let mut resumed = Search::resume(Checkpoint::read(&path).unwrap(), &fitness).unwrap();
        let resumed = resumed.run(&Control::default(), &mut |_| {}).unwrap();
        assert_eq!(resumed, expected, "after {after}");
    }
}

#[test]
fn a_search_that_is_stopped_before_anything_was_judged_says_so_and_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let fitness = Obedient::new(1);
    let checkpoints = Some(Checkpoints { path: path.clone(), interval: 5 });
    let control = Control { stop: fitness.stop.clone(), checkpoints, ..Control::default() };
    let mut started = Search::new(thorough(), &fitness).unwrap();
    let error = started.run(&control, &mut |_| {}).unwrap_err();
    assert!(matches!(error, Error::Stopped), "{error}");
    assert!(started.best().is_none());
    let fitness = Obedient::new(usize::MAX);
    let mut resumed = Search::resume(Checkpoint::read(&path).unwrap(), &fitness).unwrap();
    let resumed = resumed.run(&Control::default(), &mut |_| {}).unwrap();
    assert_eq!(resumed, search(&thorough(), &Obedient::new(usize::MAX)));
}

#[test]
fn finals_that_are_stopped_end_with_what_is_known_by_then() {
    let whole = search(&thorough(), &Obedient::new(usize::MAX));
    let stopped = search(&thorough(), &Obedient { full: Some(0), ..Obedient::new(usize::MAX) });
    assert_eq!((whole.ending, stopped.ending), (Ending::Finished, Ending::Stopped));
    assert!(stopped.finalists.iter().all(|f| f.full.is_none()));
    assert_eq!((&stopped.islands, &stopped.history), (&whole.islands, &whole.history));

    let stopped =
        search(&thorough(), &Obedient { differences: Some(0), ..Obedient::new(usize::MAX) });
    assert_eq!(stopped.ending, Ending::Stopped);
    assert_eq!((stopped.winner, stopped.best().difference), (0, None));
    assert_eq!(stopped.best().full, whole.best().full);
}

/// A killed process leaves what is in the file at that moment.
#[test]
fn a_search_can_be_resumed_from_wherever_it_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let expected = search(&small(), &Regression::new());
    let checkpoints = Some(Checkpoints { path: path.clone(), interval: 5 });
    let control = Control { checkpoints, ..Control::default() };
    let fitness = Regression::new();
    let mut started = Search::new(small(), &fitness).unwrap();
    let mut left: Vec<(u32, Checkpoint)> = Vec::new();
    started
        .run(&control, &mut |event| match event {
            // It is there before anything is known of the first batch.
            Event::Batch { generation, judged, .. } if judged <= small().batch => {
                left.push((generation, Checkpoint::read(&path).unwrap()));
            }
            _ => {}
        })
        .unwrap();
    let states: Vec<u32> = left.iter().map(|(_, checkpoint)| checkpoint.state.next).collect();
    assert_eq!(states, [0, 1, 1, 1, 1, 1, 6, 6, 6, 6, 6, 11, 11]);
    for (generation, checkpoint) in left.into_iter().step_by(3) {
        let mut resumed = Search::resume(checkpoint, &fitness).unwrap();
        let resumed = resumed.run(&Control::default(), &mut |_| {}).unwrap();
        assert_eq!(resumed, expected, "killed in generation {generation}");
    }
}

#[test]
fn checkpoints_that_cannot_be_written_are_told_once_and_the_search_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gone/checkpoint.json");
    let checkpoints = Some(Checkpoints { path, interval: 2 });
    let control = Control { checkpoints, ..Control::default() };
    let fitness = Regression::new();
    let (mut told, mut due) = (Vec::new(), 0);
    let outcome = Search::new(small(), &fitness)
        .unwrap()
        .run(&control, &mut |event| {
            if let Event::Checkpoint { written, failure, .. } = event {
                due += 1;
                assert!(!written);
                told.extend(failure.map(ToString::to_string));
            }
        })
        .unwrap();
    assert_eq!(outcome, search(&small(), &Regression::new()));
    // Before the first batch, after generations 0, 2, … 10, and at the end.
    assert_eq!(due, 8);
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("checkpoint.json: cannot write"), "{told:?}");
}

/// A fitness with pictures.
struct Pictured(Regression, [u32; 2]);

impl Fitness for Pictured {
    type Error = Infallible;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, Infallible> {
        self.0.evaluate(trees)
    }

    fn pictures(&self) -> Vec<Fingerprint> {
        let picture = |(name, &checksum): (&str, &u32)| Fingerprint { name: name.into(), checksum };
        ["the noisy image", "the reference"].into_iter().zip(&self.1).map(picture).collect()
    }

    fn identity(&self) -> String {
        self.0.identity()
    }
}

#[test]
fn a_picture_that_has_changed_is_refused_by_name() {
    let fitness = |pictures| Pictured(Regression::new(), pictures);
    let begun = fitness([1, 2]);
    let checkpoint = Search::new(small(), &begun).unwrap().checkpoint();
    let resume = |pictures| {
        let fitness = fitness(pictures);
        Search::resume(checkpoint.clone(), &fitness).err().map(|error| error.to_string())
    };
    assert_eq!(resume([1, 2]), None);
    let error = resume([1, 3]).expect("the reference is another one");
    assert!(error.contains("the reference is not the one"), "{error}");
    let error = resume([2, 1]).expect("both are others");
    assert!(error.contains("the noisy image is not the one"), "{error}");
}

/// So few are remembered that many are judged again.
#[test]
fn a_memory_that_is_full_changes_the_same_with_any_threads_and_after_a_resume() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    for settings in [small(), thorough()] {
        let settings = Settings { remembered: 3000, generations: 20, ..settings };
        let fitness = Regression::new();
        let whole = search(&settings, &fitness);
        let asked = fitness.asked.lock().unwrap().len();
        let distinct: HashSet<Tree> = fitness.asked.lock().unwrap().iter().map(canonical).collect();
        assert!(distinct.len() < asked, "nothing was judged again, so nothing was forgotten");
        assert_eq!(whole.history.last().unwrap().evaluations, whole.evaluations);
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let other = Settings { batch: 11 * threads, ..settings.clone() };
            assert_eq!(pool.install(|| search(&other, &Regression::new())), whole);
        }
        for after in [asked / 3, asked / 2, asked - 5] {
            interrupted(&settings, after, &path);
            let fitness = Regression::new();
            let mut resumed = Search::resume(Checkpoint::read(&path).unwrap(), &fitness).unwrap();
            let resumed = resumed.run(&Control::default(), &mut |_| {}).unwrap();
            assert_eq!(resumed, whole, "after {after}");
        }
    }
}

/// Sums that no short decimal stands for: seven expressions' mean sizes, and shares of any bits.
#[test]
fn a_checkpoint_gives_back_every_bit() {
    use rand::RngExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.json");
    let fitness = Regression::new();
    let settings = Settings { island_size: 7, ..small() };
    let mut search = Search::new(settings, &fitness).unwrap();
    let outcome = search.run(&Control::default(), &mut |_| {}).unwrap();
    let written = search.checkpoint();
    let mut random = crate::tune::stream(1, 0, 0, 0);
    for _ in 0..300 {
        let mut written = written.clone();
        let mut draw = || random.random_range(0.0..1.0f64);
        let settings = &mut written.settings;
        settings.share = draw();
        settings.jitter_sigma = draw() * 3.0;
        settings.racing.rungs = vec![draw() / 2.0, 0.5 + draw() / 2.0];
        settings.reproduction = draw();
        for row in &mut written.state.history {
            (row.best, row.median, row.mean_nodes) = (draw().exp(), 1.0 / draw(), 100.0 * draw());
        }
        written.write(&path).unwrap();
        let read = Checkpoint::read(&path).unwrap();
        assert_eq!(read.settings, written.settings);
        assert_eq!(read.settings.share.to_bits(), written.settings.share.to_bits());
        assert_eq!(history::csv(&read.state.history), history::csv(&written.state.history));
        // The share is in the name that the fitness of images goes by.
        assert_eq!(
            format!("{:?}", Coverage::of(&read.settings)),
            format!("{:?}", Coverage::of(&written.settings))
        );
    }
    assert_eq!(outcome.history.len(), 39);
}
