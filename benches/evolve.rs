//! The search's speed, on a population that is bred first.
//!
//! ```text
//! cargo bench --bench evolve                      # individuals and pixel pairs per second
//! cargo bench --bench evolve -- together          # how many expressions to compile into one program
//! cargo bench --bench evolve -- racing --seeds 10 # what racing saves, and whether it costs quality
//! cargo bench --bench evolve -- generation        # generations of the paper's size; minutes each
//! ```
//!
//! The first two take `--expressions`, `--generations` that breed them, and `--share`, the part of the
//! training pixels to judge on; `racing` takes `--share`, `--radius`, `--rungs`, `--bar` and `--deviations`
//! as `tamis evolve` does, `generation` those but the first two, and `--count`; both take `--precision`.
//!
//! On two cores of a Zen 4 virtual machine (512-bit vectors), 128 expressions, 32 of each island of a
//! population bred for sixty generations with the paper's settings, all training pixels, radius 10, medians
//! of three interleaved rounds:
//!
//! | way | individuals/s | pairs/s | ratio |
//! |---|---:|---:|---:|
//! | interp, one by one | 0.3 | 5.8e7 | 0.13 |
//! | jit, one by one | 2.5 | 4.3e8 | 1.00 |
//! | + support | 2.5 | 4.2e8 | 0.98 |
//! | + symmetry | 2.9 | 4.9e8 | 1.13 |
//! | jit, 32 together | 8.2 | 1.4e9 | 3.26 |
//! | + support, symmetry | 7.8 | 1.3e9 | 3.07 |
//! | + racing | 28.9 | 1.2e9 | 11.45 |
//! | + fast precision | 39.9 | 1.7e9 | 15.79 |
//!
//! The longer a population is bred, the longer its expressions and the more they have in common: in an earlier
//! measurement together against one by one was 2.61 after twenty generations (`--generations 20`), 3.93 after sixty.
//! Programs of many weights are not mirrored (`plan::symmetry` says why), and few of these expressions end within
//! the window. Those who race are held to the best tenth of all 128.
//!
//! `racing --precision standard --share 0.3 --radius 3`, thirty seeds: 37% of the pairs, and a logarithm of the ratio of final errors
//! of -0.018 ± 0.015. More in RESULTS.md.

use std::path::Path;
use std::time::Instant;

use tamis::backend::{Backend, Interpreter, Jit};
use tamis::evolve::settings::TOGETHER;
use tamis::evolve::{
    Bar, Control, Coverage, Entrant, Event, Fitness, ImageFitness, Outcome, Preset, Racing, Search,
    Settings, TrainingScene,
};
use tamis::expr::Tree;
use tamis::filter::Window;
use tamis::plan::{Passes, Precision};
use tamis::scene::{LoadOptions, Needs, Scene, load_reference};

const SCENES: [&str; 6] = ["foundry", "meadow", "old_town", "print_shop", "still_life", "study"];

/// The paper's window.
const RADIUS: u32 = 10;

/// How much of each measurement is done.
struct Extent {
    rounds: usize,
    /// Expressions judged in a round.
    expressions: usize,
    /// Generations bred before.
    generations: u32,
    /// Share of the pixels that they are bred on.
    share: f64,
    /// Share of the pixels that they are judged on.
    judged: f64,
}

const WHOLE: Extent =
    Extent { rounds: 3, expressions: 128, generations: 60, share: 0.02, judged: 1.0 };

/// To see that it runs.
const ONCE: Extent =
    Extent { rounds: 1, expressions: 3, generations: 1, share: 0.002, judged: 0.002 };

/// A way to judge expressions.
struct Way {
    name: String,
    backend: Box<dyn Backend>,
    passes: Passes,
    together: usize,
    /// It judges every so many-th expression only, as it is slow.
    every: usize,
    /// It gives up on expressions that are worse than the best tenth.
    racing: bool,
}

impl Way {
    fn jit(name: impl Into<String>, passes: Passes, together: usize) -> Self {
        let jit = Jit::new().expect("the host has a code generator");
        let backend = Box::new(jit);
        Self { name: name.into(), backend, passes, together, every: 1, racing: false }
    }
}

/// What is compared.
fn ways() -> Vec<Way> {
    let uniform = false;
    let symmetric = Passes { uniform, ..Passes::ALL };
    let supported = Passes { symmetry: false, ..symmetric };
    let fast = Passes { precision: Precision::Fast, ..symmetric };
    let plain = Passes { support: false, ..supported };
    vec![
        Way {
            name: "interp, one by one".to_owned(),
            backend: Box::new(Interpreter),
            every: 8,
            ..Way::jit("", plain, 1)
        },
        Way::jit("jit, one by one", plain, 1),
        Way::jit("+ support", supported, 1),
        Way::jit("+ symmetry", symmetric, 1),
        Way::jit(format!("jit, {TOGETHER} together"), plain, TOGETHER),
        Way::jit("+ support, symmetry", symmetric, TOGETHER),
        Way { racing: true, ..Way::jit("+ racing", symmetric, TOGETHER) },
        Way { racing: true, ..Way::jit("+ fast precision", fast, TOGETHER) },
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
        let reference = load_reference(&folder.join("reference.exr"));
        TrainingScene::new(noisy.expect("ours"), reference.expect("ours")).expect("of one size")
    };
    SCENES.map(load).into()
}

fn fitness<'a>(way: &'a Way, radius: u32, coverage: Coverage) -> ImageFitness<'a> {
    ImageFitness::new(training(radius), Window::dense(radius), coverage, &*way.backend)
        .with_passes(way.passes)
        .breeding_at(way.passes.precision)
        .together(way.together)
}

/// Distinct expressions of a bred population, as many of each island.
fn population(extent: &Extent) -> Vec<Tree> {
    let settings = Settings {
        generations: extent.generations,
        radius: 5,
        share: extent.share,
        ..Preset::Paper.settings()
    };
    let way = Way::jit("", Passes::ALL, TOGETHER);
    let fitness = fitness(&way, settings.radius, Coverage::of(&settings));
    let mut search = Search::new(settings, &fitness).expect("the paper's settings make sense");
    let outcome = search.run(&Control::default(), &mut |_| {}).expect("judging cannot fail");
    let each = extent.expressions.div_ceil(outcome.islands.len());
    let mut trees: Vec<Tree> = Vec::new();
    for island in outcome.islands {
        let before = trees.len();
        for individual in island {
            if !trees.contains(&individual.tree) && trees.len() < before + each {
                trees.push(individual.tree);
            }
        }
    }
    trees
}

/// Individuals and pairs per second of each way, in interleaved rounds, and as a ratio to
/// the way of this number.
fn rates(ways: &[Way], base: usize, trees: &[Tree], extent: &Extent) {
    let settings = Preset::Paper.settings();
    let coverage = match extent.judged < 1.0 {
        true => Coverage::Share { share: extent.judged, seed: 1 },
        false => Coverage::Full,
    };
    let racing = Racing { on: true, ..settings.racing };
    let judges: Vec<ImageFitness<'_>> = ways
        .iter()
        .map(|way| match way.racing {
            true => fitness(way, RADIUS, coverage).racing(&racing, settings.seed),
            false => fitness(way, RADIUS, coverage),
        })
        .collect();
    let mut ranked: Vec<(f64, &Tree)> =
        judges[base].evaluate(trees).expect("judging cannot fail").into_iter().zip(trees).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (fitness, tree) = ranked[(trees.len() as f64 * racing.bar) as usize];
    let bar = Bar { tree, fitness };

    let mut seconds = vec![Vec::new(); ways.len()];
    let mut work = vec![0; ways.len()];
    for _ in 0..extent.rounds {
        for (k, (way, judge)) in ways.iter().zip(&judges).enumerate() {
            let entrants: Vec<Entrant<'_>> = trees
                .iter()
                .step_by(way.every)
                .map(|tree| Entrant { tree, bar: way.racing.then_some(bar) })
                .collect();
            work[k] = 0;
            let start = Instant::now();
            for batch in entrants.chunks(settings.batch) {
                let rulings = judge.race(batch).expect("judging cannot fail");
                work[k] += rulings.iter().map(|ruling| ruling.work).sum::<u64>();
            }
            seconds[k].push(start.elapsed().as_secs_f64());
        }
    }
    println!(
        "{} expressions of a bred population on {:.1}% of the training pixels, radius {RADIUS}, \
         {} threads, medians of {} interleaved rounds",
        trees.len(),
        100.0 * extent.judged,
        rayon::current_num_threads(),
        extent.rounds
    );
    println!("{:<24} {:>14} {:>14} {:>8}", "way", "individuals/s", "pairs/s", "ratio");
    let rates: Vec<(f64, f64)> = ways
        .iter()
        .zip(seconds.into_iter().map(median).zip(&work))
        .map(|(way, (time, &work))| {
            (trees.len().div_ceil(way.every) as f64 / time, work as f64 / time)
        })
        .collect();
    for (way, (individuals, pairs)) in ways.iter().zip(&rates) {
        let ratio = individuals / rates[base].0;
        println!("{:<24} {individuals:>14.1} {pairs:>14.2e} {ratio:>8.2}", way.name);
    }
}

/// How many expressions to compile into one program.
fn together(trees: &[Tree], extent: &Extent) {
    let passes = Passes { uniform: false, ..Passes::ALL };
    let way = |together: usize| Way::jit(format!("{together} together"), passes, together);
    rates(&[1, 8, 16, 32, 64].map(way), 0, trees, extent);
}

/// A whole search, which the listener hears of with the time; how long it took.
fn breed(settings: &Settings, listener: &mut dyn FnMut(f64, Event<'_>)) -> (Outcome, f64) {
    let passes = Passes { precision: settings.precision, ..Passes::ALL };
    let way = Way::jit("", passes, settings.together);
    let fitness = fitness(&way, settings.radius, Coverage::of(settings))
        .racing(&settings.racing, settings.seed);
    let mut search = Search::new(settings.clone(), &fitness).expect("settings that make sense");
    let start = Instant::now();
    let mut listener = |event: Event<'_>| listener(start.elapsed().as_secs_f64(), event);
    let outcome = search.run(&Control::default(), &mut listener).expect("judging cannot fail");
    (outcome, start.elapsed().as_secs_f64())
}

/// Mean and standard error.
fn spread(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0).max(1.0) / count).sqrt())
}

/// Races as the command line asks for.
fn raced(options: &Options, otherwise: &Racing) -> Racing {
    Racing {
        on: true,
        rungs: options.list("--rungs").unwrap_or(otherwise.rungs.clone()),
        bar: options.number("--bar", otherwise.bar),
        deviations: options.number("--deviations", otherwise.deviations),
    }
}

/// Small searches with and without races, seed by seed.
fn racing(options: &Options, extent: &Extent) {
    let small = Settings {
        islands: 2,
        island_size: 30,
        generations: 12.min(extent.generations),
        radius: options.number("--radius", 3.0) as u32,
        share: options.number("--share", if extent.rounds > 1 { 1.0 } else { extent.share }),
        precision: options.precision(Preset::Paper.settings().precision),
        ..Preset::Paper.settings()
    };
    let racing = raced(options, &small.racing);
    let seeds = options.number("--seeds", if extent.rounds > 1 { 10.0 } else { 1.0 }) as u64;
    println!(
        "{} x {} expressions, {} generations, {} of the pixels, radius {}; {racing:?}",
        small.islands, small.island_size, small.generations, small.share, small.radius
    );
    println!(
        "{:>4} {:>12} {:>12} {:>10} {:>8} {:>8} {:>10} {:>10}",
        "seed", "all in full", "racing", "log ratio", "pairs", "dropped", "time, s", "racing, s"
    );
    let (mut ratios, mut shares, mut times) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 1..=seeds {
        let mut settings = Settings { seed, ..small.clone() };
        settings.racing.on = false;
        let (thorough, slow) = breed(&settings, &mut |_, _| {});
        settings.racing = racing.clone();
        let (raced, fast) = breed(&settings, &mut |_, _| {});
        let [thorough_error, raced_error] = [&thorough, &raced].map(full);
        ratios.push((raced_error / thorough_error).ln());
        shares.push(raced.work.done as f64 / thorough.work.done as f64);
        times.push(fast / slow);
        println!(
            "{seed:>4} {thorough_error:>12.4} {raced_error:>12.4} {:>10.4} {:>8.3} {:>8.3} {slow:>10.1} \
             {fast:>10.1}",
            ratios.last().expect("just pushed"),
            shares.last().expect("just pushed"),
            raced.dropped as f64 / raced.evaluations as f64,
        );
    }
    let (mean, error) = spread(&ratios);
    println!(
        "log of the ratio of final errors: mean {mean:.4}, standard error {error:.4}; pairs {:.3}, \
         time {:.3} of judging all in full",
        spread(&shares).0,
        spread(&times).0
    );
}

/// The paper's search for some generations, and what all of them will take.
fn generation(options: &Options, extent: &Extent) {
    let whole = Preset::Paper.settings().generations;
    let mut settings = match extent.rounds > 1 {
        true => Settings {
            generations: options.number("--count", 2.0) as u32,
            ..Preset::Paper.settings()
        },
        false => Settings {
            generations: 1,
            share: extent.share,
            radius: 2,
            island_size: 4,
            ..Preset::Paper.settings()
        },
    };
    settings.racing = raced(options, &settings.racing);
    settings.precision = options.precision(settings.precision);
    let mut ends: Vec<f64> = Vec::new();
    let mut done = 0;
    println!("{:>10} {:>10} {:>12} {:>12}", "generation", "seconds", "pairs", "of all");
    let (outcome, total) = breed(&settings, &mut |now, event| {
        if let Event::Generation { generation, islands, .. } = event {
            let before = ends.last().copied().unwrap_or(0.0);
            ends.push(now);
            let work = islands[0].work;
            println!(
                "{generation:>10} {:>10.1} {:>12.2e} {:>11.1}%",
                ends.last().expect("just pushed") - before,
                (work.done - done) as f64,
                100.0 * work.done as f64 / work.exhaustive as f64
            );
            done = work.done;
        }
    });
    let (first, last) = (ends[0], ends[ends.len() - 1]);
    let each = (last - first) / (ends.len() - 1).max(1) as f64;
    println!(
        "finalists {:.1} s; {each:.1} s a generation after the first, so that {whole} take {:.0} minutes; \
         error {:.4}",
        total - last,
        (total + each * (f64::from(whole) - (ends.len() - 1) as f64)) / 60.0,
        full(&outcome)
    );
}

/// The error of a search's result on all pixels.
fn full(outcome: &Outcome) -> f64 {
    outcome.best().full.expect("nobody stops it")
}

/// What the command line gives beside the measurement's name.
struct Options(Vec<String>);

impl Options {
    fn text(&self, name: &str) -> Option<&str> {
        let at = self.0.iter().position(|argument| argument == name)?;
        self.0.get(at + 1).map(String::as_str)
    }

    fn number(&self, name: &str, otherwise: f64) -> f64 {
        self.text(name).map_or(otherwise, |text| text.parse().expect("a number"))
    }

    fn precision(&self, otherwise: Precision) -> Precision {
        let named = |name| Precision::named(name).expect("`standard` or `fast`");
        self.text("--precision").map_or(otherwise, named)
    }

    fn list(&self, name: &str) -> Option<Vec<f64>> {
        let text = self.text(name)?;
        Some(text.split(',').map(|number| number.parse().expect("numbers")).collect())
    }
}

fn main() {
    // `cargo test --benches` runs this too, to see that it runs.
    let given: Vec<String> = std::env::args().skip(1).collect();
    let asked = given.iter().any(|argument| argument == "--bench");
    let extent = if asked { WHOLE } else { ONCE };
    let name = given.first().filter(|argument| !argument.starts_with('-')).cloned();
    let options = Options(given);
    let extent = Extent {
        expressions: options.number("--expressions", extent.expressions as f64) as usize,
        generations: options.number("--generations", f64::from(extent.generations)) as u32,
        judged: options.number("--share", extent.judged),
        ..extent
    };
    match name.as_deref() {
        None => {
            rates(&ways(), 1, &population(&extent), &extent);
            if !asked {
                racing(&options, &extent);
                generation(&options, &extent);
            }
        }
        Some("together") => together(&population(&extent), &extent),
        Some("racing") => racing(&options, &extent),
        Some("generation") => generation(&options, &extent),
        Some(other) => panic!("`{other}` is no measurement: see the head of benches/evolve.rs"),
    }
}
