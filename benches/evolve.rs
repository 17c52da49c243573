//! The search's speed, on a population that is bred first.
//!
//! ```text
//! cargo bench --bench evolve                      # individuals and pixel pairs per second
//! cargo bench --bench evolve -- together          # how many expressions to compile into one program
//! ```

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use tamis::backend::{Backend, Interpreter, Jit};
use tamis::evolve::images::TOGETHER;
use tamis::evolve::{
    Control, Coverage, Fitness, ImageFitness, Preset, Search, Settings, TrainingScene,
};
use tamis::expr::Tree;
use tamis::plan::{Passes, Window};
use tamis::scene::{Image, LoadOptions, Needs, Scene};
use tamis_jit::Chains;

const SCENES: [&str; 6] = ["foundry", "meadow", "old_town", "print_shop", "still_life", "study"];

/// The paper's window.
const RADIUS: u32 = 10;

/// Share of the pixels that the rates are measured on.
const SHARE: f64 = 0.03;

/// How much of each measurement is done.
struct Extent {
    rounds: usize,
    /// Expressions judged in a round.
    expressions: usize,
    /// Generations bred before.
    generations: u32,
    share: f64,
}

const WHOLE: Extent = Extent { rounds: 5, expressions: 128, generations: 20, share: SHARE };

/// To see that it runs.
const ONCE: Extent = Extent { rounds: 1, expressions: 3, generations: 1, share: 0.002 };

/// A way to judge expressions.
struct Way {
    name: String,
    backend: Box<dyn Backend>,
    passes: Passes,
    together: usize,
}

impl Way {
    fn jit(name: impl Into<String>, chains: Chains, passes: Passes, together: usize) -> Self {
        let jit = Jit::new().expect("the host has a code generator").with_chains(chains);
        Self { name: name.into(), backend: Box::new(jit), passes, together }
    }
}

/// What is compared: each adds one saving to the one before.
fn ways() -> Vec<Way> {
    let all = Passes::ALL;
    vec![
        Way {
            name: "interp, one by one".to_owned(),
            backend: Box::new(Interpreter),
            passes: all,
            together: 1,
        },
        Way::jit("jit, one by one", Chains::Four, all, 1),
        Way::jit(format!("jit, {TOGETHER} together"), Chains::Four, all, TOGETHER),
    ]
}

fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}

fn training(radius: u32) -> Vec<TrainingScene> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/train");
    let load = |name| {
        let folder = root.join(name);
        let (options, pad) = (LoadOptions::default(), radius as usize);
        let noisy = Scene::load(&folder.join("4spp.exr"), &Needs::everything(), pad, &options);
        let reference = Image::load(&folder.join("reference.exr"));
        TrainingScene::new(noisy.expect("ours"), reference.expect("ours")).expect("of one size")
    };
    SCENES.map(load).into()
}

fn fitness<'a>(way: &'a Way, radius: u32, coverage: Coverage) -> ImageFitness<'a> {
    ImageFitness::new(training(radius), Window::dense(radius), coverage, &*way.backend)
        .with_passes(way.passes)
        .together(way.together)
}

/// Distinct expressions of a bred population, island by island.
fn population(extent: &Extent) -> Vec<Tree> {
    let settings = Settings {
        generations: extent.generations,
        radius: 5,
        share: extent.share,
        initial: "cross-bilateral".to_owned(),
        ..Preset::Paper.settings()
    };
    let way = Way::jit("", Chains::Four, Passes::ALL, TOGETHER);
    let fitness = fitness(&way, settings.radius, Coverage::of(&settings));
    let mut search = Search::new(settings, &fitness).expect("the paper's settings make sense");
    let outcome = search.run(&Control::default(), &mut |_| {}).expect("judging cannot fail");
    let mut trees: Vec<Tree> = Vec::new();
    for individual in outcome.islands.into_iter().flatten() {
        if !trees.contains(&individual.tree) {
            trees.push(individual.tree);
        }
    }
    trees.truncate(extent.expressions);
    trees
}

/// Individuals and pairs per second of each way, in interleaved rounds.
fn rates(ways: &[Way], trees: &[Tree], extent: &Extent) {
    let batch = Preset::Paper.settings().batch;
    let coverage = Coverage::Share { share: extent.share, seed: 1 };
    let judges: Vec<ImageFitness<'_>> =
        ways.iter().map(|way| fitness(way, RADIUS, coverage)).collect();
    let mut seconds = vec![Vec::new(); ways.len()];
    for _ in 0..extent.rounds {
        for (judge, seconds) in judges.iter().zip(&mut seconds) {
            let start = Instant::now();
            for batch in trees.chunks(batch) {
                black_box(judge.evaluate(batch).expect("judging cannot fail"));
            }
            seconds.push(start.elapsed().as_secs_f64());
        }
    }
    let seconds: Vec<f64> = seconds.into_iter().map(median).collect();
    println!(
        "{} expressions of a bred population on {:.1}% of the training pixels, radius {RADIUS}, \
         {} threads, medians of {} interleaved rounds",
        trees.len(),
        100.0 * extent.share,
        rayon::current_num_threads(),
        extent.rounds
    );
    println!("{:<24} {:>14} {:>14} {:>8}", "way", "individuals/s", "pairs/s", "ratio");
    for ((way, judge), time) in ways.iter().zip(&judges).zip(&seconds) {
        let (individuals, pairs) = (trees.len() as f64 / time, judge.pairs() as f64);
        let ratio = seconds[ways.len().min(2) - 1] / time;
        println!(
            "{:<24} {individuals:>14.1} {:>14.2e} {ratio:>8.2}",
            way.name,
            pairs * individuals
        );
    }
}

/// How many expressions to compile into one program, and with how many chains.
fn together(trees: &[Tree], extent: &Extent) {
    let mut ways = vec![Way::jit("1, 16 pixels a step", Chains::Four, Passes::ALL, 1)];
    ways.push(Way::jit("1, again", Chains::Four, Passes::ALL, 1));
    for chains in Chains::ALL {
        for together in [4, 8, 16, 32] {
            let name = format!("{together}, {} pixels a step", chains.step());
            ways.push(Way::jit(name, chains, Passes::ALL, together));
        }
    }
    rates(&ways, trees, extent);
}

fn main() {
    // `cargo test --benches` runs this too, to see that it runs.
    let given: Vec<String> = std::env::args().skip(1).collect();
    let extent = if given.iter().any(|argument| argument == "--bench") { WHOLE } else { ONCE };
    match given.iter().map(String::as_str).find(|argument| !argument.starts_with('-')) {
        None => rates(&ways(), &population(&extent), &extent),
        Some("together") => together(&population(&extent), &extent),
        Some(other) => panic!("`{other}` is no measurement: see the head of benches/evolve.rs"),
    }
}
