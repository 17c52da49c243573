//! Time beside error: nanoseconds per pixel pair and the greatest relative
//! difference from the exact filter, for the interpreter and machine code of every
//! width that the host has, on the named filters, the shipped one and thirty bred
//! trees.
//!
//! All measurements of a filter are interleaved, round by round, on one thread,
//! and medians are printed: on a shared machine only ratios within one run mean
//! anything. Compile time stands apart from run time.
//!
//! ```text
//! cargo bench --bench backends
//! ```
//!
//! All of them give the same bits, so one error stands for all. Compile times are
//! of the narrowest and the widest code, planning not included.

use std::hint::black_box;
use std::time::Instant;

use tamis::backend::{Backend, Executable, Interpreter, Jit, Rect, Width, oracle};
use tamis::expr::{Tree, codebook};
use tamis::plan::{Passes, Plan, Source, Stage, Window};
use tamis::scene::{Facts, LoadOptions, Needs, Scene};

/// The validation radius of the planning measurements.
const RADIUS: u32 = 8;
const ROUNDS: usize = 7;

struct Row {
    name: String,
    interp: f64,
    /// By width.
    jit: Vec<f64>,
    compile_ms: [f64; 2],
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

fn measure(name: String, weight: &Tree, scene: &Scene, facts: &Facts, jits: &[Jit]) -> Row {
    let window = Window::dense(RADIUS);
    let plan = Plan::new(std::slice::from_ref(weight), window, facts, Passes::ALL)
        .expect("the scene has every feature");
    let interpreted = Interpreter.compile(&plan).expect("always possible");
    let compile = |jit: &Jit| {
        let start = Instant::now();
        let code = jit.compile(&plan).expect("a plan of moderate size");
        (code, start.elapsed().as_secs_f64() * 1e3)
    };
    let compiled: Vec<Box<dyn Executable>> = jits.iter().map(|jit| compile(jit).0).collect();
    let ends = [&jits[0], &jits[jits.len() - 1]];
    let compile_ms = ends.map(|jit| median((0..ROUNDS).map(|_| compile(jit).1).collect()));
    let region = [Rect { x: 0, y: 60, width: scene.layout().width(), height: 64 }];
    let pairs = region[0].pixels() * window.taps();
    let mut slow = Vec::new();
    let mut fast = vec![Vec::new(); jits.len()];
    for _ in 0..ROUNDS {
        slow.push(nanoseconds(&*interpreted, scene, &region, pairs));
        for (code, fast) in compiled.iter().zip(&mut fast) {
            fast.push(nanoseconds(&**code, scene, &region, pairs));
        }
    }
    let error = error(scene, weight, &*compiled[0]);
    let jit = fast.into_iter().map(median).collect();
    Row { name, interp: median(slow), jit, compile_ms, error }
}

fn print(row: &Row) {
    let widths: String = row.jit.iter().map(|time| format!(" {time:>8.2}")).collect();
    let ratio = row.jit[row.jit.len() - 1] / row.interp;
    let [narrow, wide] = row.compile_ms;
    println!(
        "{:<16} {:>8.2}{widths} {ratio:>13.2} {narrow:>8.2} {wide:>8.2} {:>10.1e}",
        row.name, row.interp, row.error
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
    let jits: Vec<Jit> = Width::ALL.into_iter().filter_map(|w| Jit::with_width(w).ok()).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    pool.install(|| {
        println!("courtyard, radius {RADIUS}, one thread, medians of {ROUNDS} interleaved rounds");
        let widths: String = jits.iter().map(|jit| format!(" {:>8}", jit.width().bits())).collect();
        println!(
            "{:<16} {:>8}{widths} {:>13} {:>17} {:>10}",
            "filter", "interp", "widest/interp", "compile, ms", "error"
        );
        for known in codebook::known() {
            print(&measure(known.name.to_owned(), &known.weight, &scene, &facts, &jits));
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
                measure(format!("bred {k}"), &tree, &scene, &facts, &jits)
            })
            .collect();
        rows.iter().for_each(print);
        let of = |column: &dyn Fn(&Row) -> f64| median(rows.iter().map(column).collect());
        print(&Row {
            name: "bred, median".to_owned(),
            interp: of(&|row| row.interp),
            jit: (0..jits.len()).map(|k| of(&|row| row.jit[k])).collect(),
            compile_ms: [of(&|row| row.compile_ms[0]), of(&|row| row.compile_ms[1])],
            error: of(&|row| row.error),
        });
    });
}
