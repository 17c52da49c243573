//! What a gradient costs: forward and backward together against forward alone.
//!
//! ```text
//! cargo bench --bench gradient
//! cargo bench --bench gradient -- --filters tamis-formula out/tuned.toml --size 128 --rounds 9
//! ```
//!
//! Machine code on one thread, on the middle of test scenes; both are interleaved, round by
//! round, and medians count. A pair is a tap of a gather at a pixel; at half resolution it is
//! a quarter of one.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use tamis::backend::{Backend, Differentiator, Jit, Rect, Workspace};
use tamis::filter::{Filter, Grid};
use tamis::plan::{Gradient, Passes, Plan};
use tamis::report::{Align, Format, Table, number};
use tamis::scene::{Crop, Facts, LoadOptions, Scene, discover};

/// Gradients measured on scenes.
#[derive(Parser)]
struct Arguments {
    /// Names or files of programs
    #[arg(long, num_args = 1.., default_values = ["tamis"])]
    filters: Vec<String>,

    /// Folders with scenes
    #[arg(long, num_args = 1.., default_values = [concat!(env!("CARGO_MANIFEST_DIR"), "/data/test")])]
    scenes: Vec<PathBuf>,

    /// Columns and rows of the part of each that is filtered
    #[arg(long, default_value_t = 128)]
    size: usize,

    /// Measurements of each
    #[arg(long, default_value_t = 9)]
    rounds: usize,

    /// Given by cargo; without it this only checks that the bench runs
    #[arg(long)]
    bench: bool,
}

fn main() {
    let mut arguments = Arguments::parse();
    if !arguments.bench {
        (arguments.size, arguments.rounds) = (16, 1);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let jit = Jit::new().expect("machine code");
    let mut table = Table::new([
        ("filter", Align::Left),
        ("scene", Align::Left),
        ("pairs per pixel", Align::Right),
        ("forward, ms", Align::Right),
        ("gradient, ms", Align::Right),
        ("ratio", Align::Right),
        ("ms per million pairs", Align::Right),
        ("compile, ms", Align::Right),
    ]);
    for text in &arguments.filters {
        let filter = read(text);
        let checked = filter.check().expect("files are checked");
        let taps = filter.stages.iter().filter_map(|stage| match &stage.kind {
            tamis::filter::StageKind::Gather(gather) => {
                let share = if stage.grid == Grid::Half { 0.25 } else { 1.0 };
                Some(gather.window.taps() as f64 * share)
            }
            tamis::filter::StageKind::Map(_) => None,
        });
        let pairs: f64 = taps.sum();
        for files in discover(&arguments.scenes).expect("folders with scenes") {
            let pad = checked.reach().max(1);
            let scene = Scene::load(&files.noisy, &checked.needs(), pad, &LoadOptions::default());
            let scene = middle(&scene.expect("a sound scene"), arguments.size);
            let facts = Facts::of(&scene);
            let plan = Plan::of(&checked, &facts, Passes::ALL).expect("every feature");
            let forward = jit.compile(&plan).expect("it compiles");
            let start = Instant::now();
            let gradient = Gradient::new(&checked, &facts, Passes::ALL).expect("every feature");
            let backward = jit.differentiate(&gradient).expect("it compiles");
            let compiled = start.elapsed().as_secs_f64() * 1e3;
            let constants = filter.constants.values();
            let mut derivatives = vec![0.0; constants.len()];
            let mut workspace = Workspace::default();
            let mut times = [Vec::new(), Vec::new()];
            for _ in 0..arguments.rounds + 1 {
                let start = Instant::now();
                pool.install(|| forward.run(&scene, &[Rect::whole(&scene)])).expect("it runs");
                times[0].push(start.elapsed().as_secs_f64() * 1e3);
                let start = Instant::now();
                let mut loss = |colors: &[[f32; 3]], owed: &mut [[f32; 3]]| {
                    owed.copy_from_slice(colors);
                    0.0
                };
                backward
                    .run(&scene, &constants, &mut loss, &mut workspace, &mut derivatives)
                    .expect("it runs");
                times[1].push(start.elapsed().as_secs_f64() * 1e3);
            }
            let [forward, gradient] = times.map(median);
            let pixels = scene.layout().pixels() as f64;
            table.row(vec![
                filter.name.clone(),
                scene.name().to_owned(),
                format!("{pairs:.0}"),
                number::milliseconds(forward),
                number::milliseconds(gradient),
                format!("{:.2}", gradient / forward),
                number::milliseconds(gradient / (pairs * pixels / 1e6)),
                number::milliseconds(compiled),
            ]);
        }
    }
    print!("{}", table.render(Format::Markdown));
}

/// The middle of a scene.
fn middle(scene: &Scene, size: usize) -> Scene {
    let whole = [scene.layout().width(), scene.layout().height()];
    let size = whole.map(|length| length.min(size));
    let corner = [0, 1].map(|axis| (whole[axis] - size[axis]) / 2);
    scene.crop(&Crop { corner, size, flipped: [false; 2], transposed: false }, 1.0)
}

/// The median, but for the first, which was for warming up.
fn median(times: Vec<f64>) -> f64 {
    let mut times = times[1..].to_vec();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn read(text: &str) -> Filter {
    let shipped = format!("{}/data/filters/{text}.toml", env!("CARGO_MANIFEST_DIR"));
    let files = [Path::new(text), Path::new(&shipped)];
    let file = files.into_iter().find(|path| path.is_file()).expect("a file, or one that ships");
    Filter::read(file).unwrap_or_else(|error| panic!("{error}"))
}
