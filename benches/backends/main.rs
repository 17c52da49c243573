//! Time beside error: nanoseconds per pixel pair and the greatest relative
//! difference from the exact filter, for the interpreter and machine code of every
//! width that the host has, on the named filters, the shipped one and thirty bred
//! trees; and the same for exported C, as a compiler vectorises it at its best.
//!
//! ```text
//! cargo bench --bench backends
//! cargo bench --bench backends -- --cc clang-19 gcc
//! ```
//!
//! All measurements of a filter are interleaved, round by round, on one thread,
//! and medians are printed: on a shared machine only ratios within one run mean
//! anything. All widths give the same bits, so one error stands for all. Compile
//! times are of the narrowest and the widest code, planning not included.
//!
//! With `--cc` a second table compares with compilers at standard precision, and a third at
//! fast precision, with which searches breed. `jit` is machine code as it is
//! used; `alike` is machine code of the very tape that is exported, which knows nothing
//! of the scene, computes everything per pair, and each pair for one of its ends. Their
//! rivals get that tape as C, in a loop nest that is the same as ours (`nest.c`), and
//! of the variants that are tried (vectors of 256 and 512 bits, blocks of 16 and 32
//! pixels, every compiler given) the fastest counts. Colours are compared: those of
//! `alike` and of C are the same to the bit, or the bench fails.
//!
//! `fresh` is what it takes to judge an expression that was never seen on the training
//! set, all pixels at radius 10, in milliseconds: planning, compiling and running,
//! against exporting, compiling, loading and running the fastest variant. Below the table
//! stands what the bred ones take when they are judged as searches do it: in one program.

mod compiled;

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use tamis::backend::reference::oracle;
use tamis::backend::{Backend, Executable, Filtered, Interpreter, Jit, Rect, Width};
use tamis::evolve::{Coverage, Fitness, ImageFitness, TrainingScene};
use tamis::expr::{Tree, codebook};
use tamis::filter::{Gather, Window};
use tamis::plan::{Passes, Plan, Precision, WindowPlan};
use tamis::report::{Align, Format, Table, number};
use tamis::scene::{Facts, LoadOptions, Needs, Scene, SceneFiles, discover, load_reference};

use compiled::{Nest, Supply, Variant};

/// The validation radius of the planning measurements.
const RADIUS: u32 = 8;
/// The radius that expressions are bred with.
const BREEDING_RADIUS: u32 = 10;
const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data");

/// Back ends, and compilers, compared.
#[derive(Parser)]
struct Arguments {
    /// C compilers to compare with
    #[arg(long, num_args = 1..)]
    cc: Vec<PathBuf>,

    /// Measurements of each
    #[arg(long, default_value_t = 7)]
    rounds: usize,

    /// Given by cargo; without it this only checks that the bench runs
    #[arg(long)]
    bench: bool,
}

/// What all filters are measured with.
struct Setting {
    arguments: Arguments,
    scene: Scene,
    facts: Facts,
    jits: Vec<Jit>,
    /// The training set, and what holds of all of it.
    training: Vec<Scene>,
    joint: Facts,
}

struct Row {
    name: String,
    nodes: f64,
    interp: f64,
    /// By width.
    jit: Vec<f64>,
    compile_ms: [f64; 2],
    error: f64,
    /// Against compilers, if any were given: one for each of [`Precision::ALL`].
    rivalries: Vec<Rivalry>,
}

/// Machine code against compilers, at one precision.
struct Rivalry {
    jit: f64,
    alike: f64,
    compiled: f64,
    /// Which variant was fastest.
    variant: String,
    plan_ms: f64,
    jit_ms: f64,
    compiled_ms: f64,
    fresh: f64,
    compiled_fresh: f64,
}

fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    let [low, high] = [(samples.len() - 1) / 2, samples.len() / 2].map(|k| samples[k]);
    low + (high - low) / 2.0
}

/// What a function gives, and the milliseconds that it takes.
fn timed<T>(run: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = black_box(run());
    (result, start.elapsed().as_secs_f64() * 1e3)
}

fn run(code: &dyn Executable, scene: &Scene, rect: Rect) -> Filtered {
    code.run(scene, &[rect]).expect("the plan was made for this scene").swap_remove(0)
}

/// The greatest difference from the exact filter in the middle row; no number if nothing
/// is promised of any of its pixels.
fn error(scene: &Scene, weight: &Tree, code: &dyn Executable) -> f64 {
    let window = Window::dense(RADIUS);
    let stage = Gather::of_color(weight.clone(), window);
    let (width, height) = (scene.layout().width(), scene.layout().height());
    let rect = Rect { x: 0, y: height / 2, width, height: 1 };
    let got = run(code, scene, rect);
    let exact = oracle::filter(scene, &stage, rect);
    let promised = got.pixels.iter().zip(&exact).filter(|(_, exact)| exact.is_promised());
    promised.map(|(&got, exact)| exact.difference(got)).fold(f64::NAN, f64::max)
}

/// What `export` makes of a weight: one tape, for any scene.
fn exported_plan(weight: &Tree, radius: u32, precision: Precision) -> WindowPlan {
    let passes = Passes { hoist: false, symmetry: false, precision, ..Passes::ALL };
    let weights = std::slice::from_ref(weight);
    WindowPlan::new(weights, Window::dense(radius), &Facts::of_any_scene(), passes)
        .expect("any scene has what the grammar knows")
}

impl Setting {
    fn new(arguments: Arguments) -> Self {
        let load = |path: &Path, radius: u32| {
            Scene::load(path, &Needs::everything(), radius as usize, &LoadOptions::default())
                .expect("the project's own scene")
        };
        let scene = load(&Path::new(DATA).join("test/courtyard/4spp.exr"), RADIUS);
        let facts = Facts::of(&scene);
        let widths = Width::ALL.into_iter();
        let jits = widths.filter_map(|width| Jit::with_width(width).ok()).collect();
        let training = discover(&[Path::new(DATA).join("train")]).expect("the training scenes");
        let training: Vec<Scene> =
            training.iter().map(|files| load(&files.noisy, BREEDING_RADIUS)).collect();
        let joint = Facts::of_all(&training);
        Self { arguments, scene, facts, jits, training, joint }
    }

    /// The widest code that the host runs.
    fn widest(&self) -> &Jit {
        self.jits.last().expect("128 bits are always to be had")
    }

    /// The plan for the scene that is filtered.
    fn plan(&self, weight: &Tree, precision: Precision) -> Plan {
        let passes = Passes { precision, ..Passes::ALL };
        Plan::new(std::slice::from_ref(weight), Window::dense(RADIUS), &self.facts, passes)
            .expect("the scene has every feature")
    }

    /// The median over the rounds of the milliseconds that something takes.
    fn median_ms<T>(&self, run: impl Fn() -> T) -> f64 {
        median((0..self.arguments.rounds).map(|_| timed(&run).1).collect())
    }

    /// Where the scene is filtered.
    fn rect(&self) -> Rect {
        Rect { x: 0, y: 60, width: self.scene.layout().width(), height: 64 }
    }

    /// From milliseconds to nanoseconds per pixel pair of it.
    fn per_pair(&self) -> f64 {
        1e6 / (self.rect().pixels() * Window::dense(RADIUS).taps()) as f64
    }

    fn measure(&self, name: &str, weight: &Tree) -> Row {
        eprintln!("{name}");
        let (scene, jits) = (&self.scene, &self.jits);
        let own = self.plan(weight, Precision::Standard);
        let compile = |jit: &Jit| jit.compile(&own).expect("a plan of moderate size");
        let compile_ms = [&jits[0], self.widest()].map(|jit| self.median_ms(|| compile(jit)));
        let mut codes = vec![Interpreter.compile(&own).expect("always possible")];
        codes.extend(jits.iter().map(compile));
        let mut times = vec![Vec::new(); codes.len()];
        for _ in 0..self.arguments.rounds {
            for (code, times) in codes.iter().zip(&mut times) {
                times.push(timed(|| run(&**code, scene, self.rect())).1 * self.per_pair());
            }
        }
        let mut times = times.into_iter().map(median);
        let interp = times.next().expect("the interpreter's");
        let rivalries = match self.arguments.cc.is_empty() {
            true => Vec::new(),
            false => Precision::ALL.map(|precision| self.rivalry(weight, precision)).into(),
        };
        Row {
            name: name.to_owned(),
            nodes: weight.len() as f64,
            interp,
            jit: times.collect(),
            compile_ms,
            error: error(scene, weight, &*codes[1]),
            rivalries,
        }
    }

    /// Compares with the compilers that were given.
    fn rivalry(&self, weight: &Tree, precision: Precision) -> Rivalry {
        let (scene, rect) = (&self.scene, self.rect());
        let own = self.plan(weight, precision);
        let alike = exported_plan(weight, RADIUS, precision);
        let compile = |plan: &Plan| self.widest().compile(plan).expect("a plan of moderate size");
        let codes = [&own, &alike.clone().into()].map(compile);
        let source = compiled::Source::new(weight, RADIUS, precision);
        let variants = self.arguments.cc.iter().flat_map(|compiler| Variant::of(compiler));
        let nests: Vec<(Nest<'_>, Variant)> =
            variants.map(|variant| (source.compile(&variant), variant)).collect();
        let supply = Supply::new(scene);
        let mut times = [const { Vec::new() }; 2];
        let mut nest_times = vec![Vec::new(); nests.len()];
        for _ in 0..self.arguments.rounds {
            for (code, times) in codes.iter().zip(&mut times) {
                times.push(timed(|| run(&**code, scene, rect)).1 * self.per_pair());
            }
            for ((nest, _), times) in nests.iter().zip(&mut nest_times) {
                let (sums, time) = timed(|| nest.sums(&supply, alike.taps().runs(), rect));
                times.push(time * self.per_pair());
                drop(sums);
            }
        }
        let expected = run(&*codes[1], scene, rect).pixels;
        for (nest, variant) in &nests {
            let sums = nest.sums(&supply, alike.taps().runs(), rect);
            for (color, expected) in nest.colors(&sums, rect).into_iter().zip(&expected) {
                let same = color.is_none_or(|color| color == *expected);
                assert!(same, "{} computes something else: {weight}", variant.name());
            }
        }
        let nest_times = nest_times.into_iter().map(median).zip(&nests);
        let (compiled, (_, variant)) =
            nest_times.min_by(|(a, _), (b, _)| a.total_cmp(b)).expect("a compiler");
        let [fresh, compiled_fresh] = self.fresh(weight, variant, precision);
        let compiled_ms = || timed(|| drop(source.compile(variant))).1;
        let [jit, alike] = times.map(median);
        Rivalry {
            jit,
            alike,
            compiled,
            variant: variant.name(),
            plan_ms: self.median_ms(|| self.plan(weight, precision)),
            jit_ms: self.median_ms(|| compile(&own)),
            compiled_ms: median((0..3).map(|_| compiled_ms()).collect()),
            fresh,
            compiled_fresh,
        }
    }

    /// Milliseconds to judge a weight on the training set, planning and compiling
    /// included: as machine code, and as exported C. Medians over the rounds, in turn.
    fn fresh(&self, weight: &Tree, variant: &Variant, precision: Precision) -> [f64; 2] {
        let taps = exported_plan(weight, BREEDING_RADIUS, precision).taps().runs().to_vec();
        let supplies: Vec<Supply<'_>> = self.training.iter().map(Supply::new).collect();
        let as_machine_code = || {
            let window = Window::dense(BREEDING_RADIUS);
            let passes = Passes { uniform: false, precision, ..Passes::ALL };
            let plan = Plan::new(std::slice::from_ref(weight), window, &self.joint, passes);
            let plan = plan.expect("the training scenes have every feature");
            let code = self.widest().compile(&plan).expect("a plan of moderate size");
            for scene in &self.training {
                black_box(run(&*code, scene, Rect::whole(scene)));
            }
        };
        let as_c = || {
            let source = compiled::Source::new(weight, BREEDING_RADIUS, precision);
            let nest = source.compile(variant);
            for (scene, supply) in self.training.iter().zip(&supplies) {
                black_box(nest.sums(supply, &taps, Rect::whole(scene)));
            }
        };
        let rounds: Vec<[f64; 2]> =
            (0..self.arguments.rounds).map(|_| [timed(as_machine_code).1, timed(as_c).1]).collect();
        [0, 1].map(|k| median(rounds.iter().map(|times| times[k]).collect()))
    }

    /// Milliseconds per expression to judge some on the training set as searches do it,
    /// planning, compiling and the comparison with the references included.
    fn together(&self, trees: &[Tree], precision: Precision) -> f64 {
        let pad = BREEDING_RADIUS as usize;
        let found = discover(&[Path::new(DATA).join("train")]).expect("the training scenes");
        let load = |files: &SceneFiles| {
            let options = LoadOptions::default();
            let scene = Scene::load(&files.noisy, &Needs::everything(), pad, &options);
            let reference = load_reference(&files.reference).expect("its reference");
            TrainingScene::new(scene.expect("the project's own scene"), reference)
                .expect("the same size")
        };
        let training = found.iter().map(load).collect();
        let window = Window::dense(BREEDING_RADIUS);
        let fitness = ImageFitness::new(training, window, Coverage::Full, self.widest())
            .breeding_at(precision);
        let judge = || timed(|| fitness.evaluate(trees)).1 / trees.len() as f64;
        median((0..3).map(|_| judge()).collect())
    }

    fn backends(&self, rows: &[Row], bred: &[Row]) -> Table {
        let columns = ["filter".to_owned(), "interp".to_owned()]
            .into_iter()
            .chain(self.jits.iter().map(|jit| jit.width().bits().to_string()))
            .chain(["widest / interp", "compile, ms", "widest, ms", "error"].map(str::to_owned));
        let right = |(k, name)| (name, if k == 0 { Align::Left } else { Align::Right });
        let mut table = Table::new(columns.enumerate().map(right));
        let figures = |row: &Row| {
            let times = [row.interp].into_iter().chain(row.jit.iter().copied());
            let [narrow, wide] = row.compile_ms;
            times.chain([row.widest() / row.interp, narrow, wide, row.error]).collect()
        };
        for (name, mut figures) in with_medians(rows, bred, figures) {
            let error = match figures.pop().expect("it is the last") {
                x if x.is_nan() => "-".to_owned(),
                x => number::difference(x),
            };
            let figures = figures.into_iter().map(two_digits);
            table.row([name].into_iter().chain(figures).chain([error]));
        }
        table
    }
}

impl Row {
    fn widest(&self) -> f64 {
        self.jit[self.jit.len() - 1]
    }
}

/// Lines of figures: those of all rows, and the median of every figure over bred ones,
/// ratios included.
fn with_medians(
    rows: &[Row],
    bred: &[Row],
    figures: impl Fn(&Row) -> Vec<f64>,
) -> Vec<(String, Vec<f64>)> {
    let of_bred: Vec<Vec<f64>> = bred.iter().map(&figures).collect();
    let medians = (0..of_bred[0].len())
        .map(|k| median(of_bred.iter().map(|figures| figures[k]).collect()))
        .collect();
    let lines = rows.iter().chain(bred).map(|row| (row.name.clone(), figures(row)));
    lines.chain([("bred, median".to_owned(), medians)]).collect()
}

/// The comparison with compilers at the precision of this number.
fn compilers(rows: &[Row], bred: &[Row], precision: usize) -> Table {
    let left = ["filter"].map(|name| (name, Align::Left));
    let right = [
        "nodes",
        "jit",
        "alike",
        "C",
        "jit / C",
        "alike / C",
        "plan, ms",
        "jit, ms",
        "C, ms",
        "fresh",
        "C",
        "C / jit",
    ]
    .map(|name| (name, Align::Right));
    let fastest = [("fastest C", Align::Left)];
    let mut table = Table::new(left.into_iter().chain(right).chain(fastest));
    let figures = |row: &Row| {
        let rivalry = &row.rivalries[precision];
        let Rivalry { jit, alike, compiled, .. } = *rivalry;
        vec![
            row.nodes,
            jit,
            alike,
            compiled,
            jit / compiled,
            alike / compiled,
            rivalry.plan_ms,
            rivalry.jit_ms,
            rivalry.compiled_ms,
            rivalry.fresh,
            rivalry.compiled_fresh,
            rivalry.compiled_fresh / rivalry.fresh,
        ]
    };
    let variants = rows.iter().chain(bred).map(|row| row.rivalries[precision].variant.clone());
    let lines = with_medians(rows, bred, figures).into_iter();
    for ((name, figures), variant) in lines.zip(variants.chain([String::new()])) {
        let cell = |(k, x): (usize, f64)| match k {
            0 => x.to_string(),
            8..=10 => number::milliseconds(x),
            _ => two_digits(x),
        };
        let cells = figures.into_iter().enumerate().map(cell);
        table.row([name].into_iter().chain(cells).chain([variant]));
    }
    table
}

fn two_digits(x: f64) -> String {
    format!("{x:.2}")
}

fn main() {
    let arguments = Arguments::parse();
    let once = !arguments.bench;
    let rounds = arguments.rounds;
    let setting = Setting::new(arguments);
    let bred = include_str!("../../tests/fixture/bred.txt");
    let bred: Vec<Tree> = bred
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|text| text.parse().expect("bred trees are expressions"))
        .collect();
    let named: Vec<(&str, &Tree)> =
        codebook::known().iter().map(|known| (known.name, &known.weight)).collect();
    let few = if once { 1 } else { usize::MAX };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    let (rows, measured, together) = pool.install(|| {
        let named = named.iter().take(few).map(|(name, tree)| setting.measure(name, tree));
        let rows: Vec<Row> = named.collect();
        let measured: Vec<Row> = bred
            .iter()
            .zip(1..)
            .take(few)
            .map(|(tree, k)| setting.measure(&format!("bred {k}"), tree))
            .collect();
        let together: Vec<f64> = match setting.arguments.cc.is_empty() {
            true => Vec::new(),
            false => Precision::ALL.map(|precision| setting.together(&bred, precision)).into(),
        };
        (rows, measured, together)
    });
    println!(
        "courtyard, radius {RADIUS}, one thread, ns per pixel pair, medians of {}\n\n{}",
        number::plural(rounds, "interleaved round"),
        setting.backends(&rows, &measured).render(Format::Markdown)
    );
    for (k, (precision, together)) in Precision::ALL.iter().zip(together).enumerate() {
        let mean = |of: fn(&Rivalry) -> f64| {
            measured.iter().map(|row| of(&row.rivalries[k])).sum::<f64>() / measured.len() as f64
        };
        let (alone, compiled) = (mean(|r| r.fresh), mean(|r| r.compiled_fresh));
        println!(
            "At {} precision:\n\n{}",
            precision.name(),
            compilers(&rows, &measured, k).render(Format::Markdown)
        );
        println!(
            "The bred ones on the training set, milliseconds per expression: {} in one program, {} \
             one by one, {} with C: {} and {} times as long.\n",
            number::milliseconds(together),
            number::milliseconds(alone),
            number::milliseconds(compiled),
            two_digits(compiled / together),
            two_digits(compiled / alone),
        );
    }
}
