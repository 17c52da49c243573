//! Time beside error: nanoseconds per pixel pair and the greatest relative
//! difference from the exact filter, for every CPU back end on the named
//! filters, the shipped one and thirty bred trees.
//!
//! All measurements of a filter are interleaved, round by round, on one thread,
//! and medians are printed: on a shared machine only ratios within one run mean
//! anything. Compile time stands apart from run time.
//!
//! ```text
//! cargo bench --bench backends
//! ```
//!
//! `PLANNED` holds the ratios of four-lane Cranelift code (four chains) to a block
//! interpreter with 512-bit lanes that were measured when the project was
//! planned: 2.3 / 2.1 for a cross-bilateral filter, 12.5 / 5.1 for the paper's
//! with merged exponentials. The last column compares with them.

use std::hint::black_box;
use std::time::Instant;

use tamis::backend::{Backend, Executable, Interpreter, Jit, Rect, oracle};
use tamis::expr::{Tree, codebook};
use tamis::plan::{Passes, Plan, Source, Stage, Window};
use tamis::scene::{Facts, LoadOptions, Needs, Scene};

/// The validation radius of the planning measurements.
const RADIUS: u32 = 8;
const ROUNDS: usize = 7;

const PLANNED: [(&str, f64); 2] = [("cross-bilateral", 2.3 / 2.1), ("kan2017", 12.5 / 5.1)];

struct Row {
    name: String,
    interp: f64,
    jit: f64,
    compile_ms: f64,
    error: f64,
}

fn median(mut samples: Vec<f64>) -> f64 {
    samples.sort_by(f64::total_cmp);
    samples[samples.len() / 2]
}

fn nanoseconds(code: &dyn Executable, scene: &Scene, region: &[Rect], pairs: usize) -> f64 {
    let start = Instant::now();
    black_box(code.run(scene, region).expect("the plan was made for this scene"));
    start.elapsed().as_secs_f64() * 1e9 / pairs as f64
}

/// The greatest relative difference from the exact filter over some pixels.
fn error(scene: &Scene, weight: &Tree, code: &dyn Executable) -> f64 {
    let window = Window::dense(RADIUS);
    let stage = Stage { weight: weight.clone(), window, source: Source::Color };
    let (width, height) = (scene.layout().width(), scene.layout().height());
    let rect = Rect { x: 0, y: height / 2, width, height: 1 };
    let got = code.run(scene, &[rect]).expect("inside the image").swap_remove(0);
    let exact = oracle::filter(scene, &stage, rect);
    let pixels = got.pixels.iter().zip(&exact);
    pixels
        .filter(|(_, exact)| exact.total.abs() > 1e-25)
        .flat_map(|(got, exact)| got.iter().zip(exact.color))
        .filter(|(_, exact)| *exact > 0.0)
        .map(|(got, exact)| (f64::from(*got) - exact).abs() / exact)
        .fold(0.0, f64::max)
}

fn measure(name: String, weight: &Tree, scene: &Scene, facts: &Facts, jit: &Jit) -> Row {
    let window = Window::dense(RADIUS);
    let plan = Plan::new(std::slice::from_ref(weight), window, facts, Passes::ALL)
        .expect("the scene has every feature");
    let interpreted = Interpreter.compile(&plan).expect("always possible");
    let start = Instant::now();
    let compiled = jit.compile(&plan).expect("a plan of moderate size");
    let compile_ms = start.elapsed().as_secs_f64() * 1e3;
    let region = [Rect { x: 0, y: 60, width: scene.layout().width(), height: 64 }];
    let pairs = region[0].pixels() * window.taps();
    let (mut slow, mut fast) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        slow.push(nanoseconds(&*interpreted, scene, &region, pairs));
        fast.push(nanoseconds(&*compiled, scene, &region, pairs));
    }
    let error = error(scene, weight, &*compiled);
    Row { name, interp: median(slow), jit: median(fast), compile_ms, error }
}

fn print(row: &Row) {
    let ratio = row.jit / row.interp;
    let planned = PLANNED.iter().find(|(name, _)| *name == row.name);
    let against = planned.map_or(String::new(), |(_, plan)| format!("{:.2}", ratio / plan));
    println!(
        "{:<16} {:>8.2} {:>8.2} {:>10.2} {:>11.2} {:>10.1e} {:>14}",
        row.name, row.interp, row.jit, ratio, row.compile_ms, row.error, against
    );
}

fn main() {
    // `cargo test --benches` runs this too, to see that it runs.
    let once = !std::env::args().any(|argument| argument == "--bench");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/data/test/courtyard/4spp.exr");
    let scene =
        Scene::load(path.as_ref(), &Needs::everything(), RADIUS as usize, &LoadOptions::default())
            .expect("the project's own scene");
    let facts = Facts::of(&scene);
    let jit = Jit::new().expect("the host has a code generator");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    pool.install(|| {
        println!("courtyard, radius {RADIUS}, one thread, medians of {ROUNDS} interleaved rounds");
        println!(
            "{:<16} {:>8} {:>8} {:>10} {:>11} {:>10} {:>14}",
            "filter", "interp", "jit", "jit/interp", "compile, ms", "error", "against plan"
        );
        for known in codebook::known() {
            print(&measure(known.name.to_owned(), &known.weight, &scene, &facts, &jit));
            if once {
                return;
            }
        }
        let bred = include_str!("../tests/fixture/bred.txt");
        let trees = bred.lines().filter(|line| !line.starts_with('#'));
        let rows: Vec<Row> = trees
            .zip(1..)
            .map(|(text, k)| {
                let tree = text.parse().expect("bred trees are expressions");
                measure(format!("bred {k}"), &tree, &scene, &facts, &jit)
            })
            .collect();
        rows.iter().for_each(print);
        let of = |column: fn(&Row) -> f64| median(rows.iter().map(column).collect());
        print(&Row {
            name: "bred, median".to_owned(),
            interp: of(|row| row.interp),
            jit: of(|row| row.jit),
            compile_ms: of(|row| row.compile_ms),
            error: of(|row| row.error),
        });
    });
}
