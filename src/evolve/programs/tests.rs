use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::mutation::{CHANGES, change_alone};
use super::*;
use crate::backend::{Backend, Interpreter, Rect};
use crate::expr::{Feature, Quantity};
use crate::filter::{Filter, shipped};
use crate::image::Image;
use crate::plan::{Passes, Plan};
use crate::scene::{Facts, LoadOptions, Needs, RawScene};
use crate::tune::{Checkpoints, Control, Ending, Level, Reference, TuningScene, stream};

/// Two walls with noise on them.
fn scene(seed: u64) -> TuningScene {
    use rand::RngExt;
    let (width, height) = (40, 28);
    let mut random = stream(seed, 0, 0, 0);
    let wall = |k: usize| if k % width < 17 { 0.2f32 } else { 0.9 };
    let image = |f: &mut dyn FnMut(usize) -> f32| (0..width * height).map(f).collect::<Vec<f32>>();
    let clean = image(&mut |k| wall(k));
    let color = [(); 3].map(|()| {
        image(&mut |k| (wall(k) * (1.0 + 0.5 * random.random_range(-1.5f32..1.5))).max(0.0))
    });
    let normal = [image(&mut |k| wall(k).round()), image(&mut |_| 0.3), image(&mut |_| 0.0)];
    let albedo = [(); 3].map(|()| image(&mut |k| 0.5 + 0.1 * wall(k)));
    let variance = image(&mut |k| 0.75 * (wall(k) * 0.5).powi(2));
    let still = || vec![image(&mut |k| 1e-4 * (k % 7) as f32)];
    let noisy = RawScene::new("walls", width, height, color)
        .with(Feature::Color, Quantity::Variance, vec![variance])
        .with(Feature::Normal, Quantity::Value, normal.into())
        .with(Feature::Normal, Quantity::Variance, still())
        .with(Feature::Texture, Quantity::Value, albedo.into())
        .with(Feature::Texture, Quantity::Variance, still())
        .with(Feature::Depth, Quantity::Value, vec![image(&mut |k| 1.0 + 0.01 * k as f32)])
        .with(Feature::Depth, Quantity::Variance, still())
        .prepare(&Needs::everything(), 16, &LoadOptions::default())
        .expect("a sound scene");
    let image = Image::new("clean", width, height, [(); 3].map(|()| clean.clone()));
    let image = image.expect("it has its size");
    let reference = Reference::new(image.rgb());
    let levels = vec![Level { samples: Some(1), scene: noisy }];
    TuningScene { name: format!("walls {seed}"), levels, image, reference }
}

fn vocabulary() -> Vec<(Feature, Quantity)> {
    Settings::quick().vocabulary().expect("they are features")
}

fn begun() -> Vec<Genome> {
    let filters = shipped::programs().chain([seed()]);
    filters.map(|filter| Genome::new(filter).expect("it makes sense")).collect()
}

#[test]
fn every_change_applies_somewhere_and_makes_sense() {
    let features = vocabulary();
    for (k, (_, change)) in CHANGES.iter().enumerate() {
        let mut changed = 0;
        for (n, genome) in begun().iter().enumerate() {
            for index in 0..60 {
                let mut rng = stream(k as u64, n, 0, index);
                changed +=
                    usize::from(change_alone(genome, &features, &mut rng, *change).is_some());
            }
        }
        assert!(changed > 0, "change {k} applies nowhere");
    }
}

#[test]
fn children_read_back_from_their_text_and_run_on_a_scene() {
    let features = vocabulary();
    let scene = scene(1);
    let noisy = &scene.levels[0].scene;
    let mut shapes = BTreeSet::new();
    let mut genomes = begun();
    let admits = |genome: &Genome| {
        let reach = genome.filter().check().expect("genomes make sense").reach();
        reach <= 16 && genome.size() < 3500
    };
    for index in 0..160 {
        let mut rng = stream(9, 0, 0, index);
        let (first, second) = (genomes[index % genomes.len()].clone(), &genomes[index / 2 % 4]);
        let child = match index % 3 {
            0 => first.crossed(second, &features, &mut rng, admits),
            _ => first.mutant(&features, &mut rng, admits),
        };
        let Some(child) = child else { continue };
        let filter = child.filter();
        let text = filter.to_toml(toml::Table::new());
        let read = Filter::parse(&text, Path::new("child.toml")).expect("it is a filter file");
        assert_eq!(read, *filter, "{text}");
        assert_eq!(Genome::new(read).as_ref(), Some(&child), "nothing is left to be pruned");
        let facts = Facts::of(noisy);
        let checked = filter.check().expect("genomes make sense");
        let plan = Plan::of(&checked, &facts, Passes::ALL).expect("the scene has everything");
        let code = Interpreter.compile(&plan).expect("interpreted");
        let filtered = code.run(noisy, &[Rect::whole(noisy)]).expect("it runs").swap_remove(0);
        assert!(filtered.pixels.iter().flatten().all(|x| x.is_finite()), "{text}");
        shapes.insert(child.shape());
        genomes.push(child);
    }
    assert!(shapes.len() > 120, "{} different children", shapes.len());
}

fn settings() -> Settings {
    Settings {
        population: 6,
        children: 6,
        generations: 3,
        tune_steps: 3,
        finish_steps: 4,
        crop: 24,
        exam: 24,
        max_nodes: 300,
        interval: 1,
        ..Settings::quick()
    }
}

fn searched(settings: Settings, threads: usize) -> Outcome {
    let (training, validation) = ([scene(1), scene(2)], [scene(3)]);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let judge = Judge::new(settings, &training, &validation, &Interpreter).expect("scenes");
        let mut search = Search::new(seed(), judge).expect("it begins");
        search.run(&Control::default(), &|_| {}).expect("it runs")
    })
}

#[test]
fn threads_change_nothing_and_seeds_do() {
    let [one, three] = [1, 3].map(|threads| searched(settings(), threads));
    assert_eq!(one.best, three.best);
    assert_eq!(one.front, three.front);
    assert_eq!(history::csv(&one.history), history::csv(&three.history));
    let other = searched(Settings { seed: 2, ..settings() }, 2);
    assert_ne!(one.front, other.front);
}

#[test]
fn a_search_finds_something_better_and_its_front_is_one() {
    let outcome = searched(Settings { generations: 5, tune_steps: 8, ..settings() }, 2);
    let (first, last) = (&outcome.history[0], outcome.history.last().expect("rows"));
    assert!(last.best < first.best - 0.01, "{first:?} {last:?}");
    let goals: Vec<_> = outcome.front.iter().map(|f| f.judged.goals()).collect();
    assert!(selection::ranks(&goals).iter().all(|&rank| rank == 0));
    assert!(outcome.best.difference.expect("it was compared") < 1e-5);
    let made = outcome.judged + outcome.dropped;
    assert!((6 + 5..=6 + 5 * 6).contains(&made), "{made} of six, and six in each generation");
    // The least error of the population is never lost.
    assert!(outcome.history.windows(2).all(|rows| rows[1].best <= rows[0].best));
}

#[test]
fn what_was_interrupted_goes_on_to_the_same_result() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("checkpoint.json");
    let whole = searched(settings(), 2);
    let (training, validation) = ([scene(1), scene(2)], [scene(3)]);
    let judge = || Judge::new(settings(), &training, &validation, &Interpreter).expect("scenes");
    let stop = Arc::new(AtomicBool::new(false));
    let control = Control {
        stop: Arc::clone(&stop),
        time_limit: None,
        checkpoints: Some(Checkpoints { path: path.clone(), interval: 1 }),
    };
    let after = AtomicUsize::new(0);
    let mut search = Search::new(seed(), judge()).expect("it begins");
    let part = search.run(&control, &|event| {
        if let Event::Child { generation: 2, .. } = event {
            after.fetch_add(1, Ordering::Relaxed);
            stop.store(true, Ordering::Relaxed);
        }
    });
    assert_eq!(part.expect("it runs").ending, Ending::Stopped);
    // Whoever was being judged is judged, and nobody else.
    assert!(after.load(Ordering::Relaxed) <= rayon::current_num_threads());
    assert!(Checkpoint::is_one(&path));
    let checkpoint = Checkpoint::read(&path).expect("it was written");
    assert_eq!(checkpoint.state, search.checkpoint().state, "to the bit");
    let mut search = Search::resume(checkpoint, judge()).expect("it goes on");
    let resumed = search.run(&Control::default(), &|_| {}).expect("it runs");
    assert_eq!(resumed.best, whole.best);
    assert_eq!(history::csv(&resumed.history), history::csv(&whole.history));
}

#[test]
fn any_filter_that_the_scenes_feed_can_be_bred_from() {
    let (training, validation) = ([scene(1)], [scene(2)]);
    let begin = |filter: Filter, settings: Settings| {
        let judge = Judge::new(settings, &training, &validation, &Interpreter).expect("scenes");
        Search::new(filter, judge)
    };
    // Slower, larger and longer than the settings allow.
    let tamis = shipped::best();
    let small = Settings { max_cost: 1.0, max_nodes: 1, max_stages: 1, ..settings() };
    let settings = Settings { population: 4, generations: 0, tune_steps: 0, ..small };
    let mut search = begin(tamis, settings.clone()).expect("it can run");
    let outcome = search.run(&Control::default(), &|_| {}).expect("it runs");
    assert!(!outcome.front.is_empty());
    let weight: crate::expr::Tree = "exp(-distance2(normal, normal))".parse().expect("a weight");
    assert!(begin(Filter::single("plain", weight, 2), settings.clone()).is_ok());

    let weight: crate::expr::Tree = "exp(-distance2(direct, direct))".parse().expect("a weight");
    let refused = begin(Filter::single("lit", weight, 2), settings).err().expect("no direct light");
    assert!(refused.to_string().contains("`lit`"), "{refused}");
}

#[test]
fn a_search_that_ends_before_its_first_generation_gives_what_it_began_with() {
    let (training, validation) = ([scene(1)], [scene(2)]);
    let judge = Judge::new(settings(), &training, &validation, &Interpreter).expect("scenes");
    let mut search = Search::new(seed(), judge).expect("it begins");
    let control = Control { stop: Arc::new(AtomicBool::new(true)), ..Control::default() };
    let outcome = search.run(&control, &|_| {}).expect("it runs");
    assert_eq!(outcome.ending, Ending::Stopped);
    assert_eq!(Some(&outcome.best.judged.genome), Genome::new(seed()).as_ref());
    assert!(outcome.history.is_empty());
}
