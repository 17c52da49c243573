//! Shaders: time beside error, on frames of 1280 x 720 and 1920 x 1080.
//!
//! For every filter and radius: milliseconds of the kernel alone (by the device's
//! clock) and of the whole run, transfers included, with planar loads, packed
//! loads and workgroup tiles side by side; the fast precision with packed loads;
//! machine code on all threads, from the same run; and the greatest relative
//! difference from the exact filter in f64, over part of a row.
//!
//! ```text
//! cargo bench --bench gpu
//! cargo bench --bench gpu -- --sizes 1280x720 --radii 8 --gpu 0 --rounds 5
//! ```
//!
//! Rounds are interleaved and medians printed. The frame is the test scene
//! courtyard, repeated.
//!
//! What was measured stands in `benches/RESULTS.md`. In short, 1280 x 720, radius
//! 8, milliseconds of the kernel on llvmpipe (Mesa 22.3.6, two cores):
//!
//! | filter | planar | packed | tiled | fast | error | fast error |
//! |---|---|---|---|---|---|---|
//! | bilateral | 3277 | 2746 | 3481 | 2185 | 3.8e-7 | 5.1e-7 |
//! | cross-bilateral | 5912 | 5370 | 6814 | 4338 | 3.8e-7 | 3.5e-7 |
//! | kan2017 | 14591 | 12522 | 13279 | 6258 | 3.8e-7 | 4.0e-7 |
//!
//! So packed loads are what the back end uses.

use std::time::{Duration, Instant};

use clap::Parser;
use tamis::backend::gpu::{Gpu, Options};
use tamis::backend::reference::oracle;
use tamis::backend::shader::Loads;
use tamis::backend::{Backend, Executable, Jit, Rect};
use tamis::expr::{Tree, codebook};
use tamis::filter::Gather;
use tamis::filter::{Filter, Window};
use tamis::plan::Precision;
use tamis::plan::{Passes, Plan};
use tamis::report::{Align, Format, Table};
use tamis::scene::{Facts, LoadOptions, Needs, RawScene, Scene};

/// Shaders measured on frames.
#[derive(Parser)]
struct Arguments {
    /// Widths and heights of frames
    #[arg(long, num_args = 1.., default_values = ["1280x720", "1920x1080"])]
    sizes: Vec<String>,

    /// Window radii
    #[arg(long, num_args = 1.., default_values_t = [5, 8, 10, 16])]
    radii: Vec<u32>,

    /// Those of the filters that are measured
    #[arg(long, num_args = 1.., default_values = ["bilateral", "cross-bilateral", "kan2017", "tamis-2"])]
    filters: Vec<String>,

    /// Which GPU
    #[arg(long)]
    gpu: Option<String>,

    /// Measurements of each
    #[arg(long, default_value_t = 3)]
    rounds: usize,

    /// Given by cargo; without it this only checks that the bench runs
    #[arg(long)]
    bench: bool,
}

struct Shader {
    gpu: Gpu,
    code: Box<dyn Executable>,
    kernel: Vec<Duration>,
    whole: Vec<Duration>,
}

fn main() {
    let mut arguments = Arguments::parse();
    if !arguments.bench {
        (arguments.sizes, arguments.radii, arguments.rounds) = (vec!["64x48".into()], vec![2], 1);
    }
    let variants = [
        (Precision::Standard, Loads::Planar),
        (Precision::Standard, Loads::Packed),
        (Precision::Standard, Loads::Tiled),
        (Precision::Fast, Loads::Packed),
    ];
    let opened: Result<Vec<Gpu>, _> = variants
        .iter()
        .map(|&(precision, loads)| {
            let adapter = arguments.gpu.clone();
            Gpu::open(&Options { adapter, precision, loads, ..Options::default() })
        })
        .collect();
    let gpus = match opened {
        Ok(gpus) => gpus,
        Err(error) => return println!("nothing measured: {error}"),
    };
    println!("{}, {:?}", gpus[0].adapter_name(), gpus[0].arithmetic());
    println!("kernel / whole run in ms; error: relative, against the exact filter");
    let columns = ["planar", "packed", "tiled", "fast", "jit", "error", "fast error"];
    let columns = columns.map(|name| (name, Align::Right));
    let mut table = Table::new(
        [("frame", Align::Left), ("filter", Align::Left), ("radius", Align::Right)]
            .into_iter()
            .chain(columns),
    );
    for size in &arguments.sizes {
        let (width, height) = size.split_once('x').expect("a size is WIDTHxHEIGHT");
        let [width, height] = [width, height].map(|n| n.parse().expect("sizes are whole numbers"));
        for &radius in &arguments.radii {
            let scene = frame(width, height, radius);
            let wanted = |(name, _): &(String, Tree)| arguments.filters.contains(name);
            for (name, weight) in filters().into_iter().filter(wanted) {
                let row = measure(&gpus, &scene, &weight, radius, arguments.rounds);
                let cells = [size.clone(), name, radius.to_string()].into_iter().chain(row);
                let cells: Vec<String> = cells.collect();
                eprintln!("{}", cells.join("  "));
                table.row(cells);
            }
        }
    }
    print!("{}", table.render(Format::Markdown));
}

fn filters() -> Vec<(String, Tree)> {
    let named = ["bilateral", "cross-bilateral", "kan2017"]
        .map(|name| (name.to_owned(), codebook::named(name).expect("a known filter").clone()));
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/data/filters/tamis-2.toml");
    let evolved = Filter::read(path.as_ref()).expect("the project's own filter");
    let weight = evolved.paper().expect("one gather").weight.clone();
    named.into_iter().chain([(evolved.name, weight)]).collect()
}

/// The test scene, repeated to a size.
fn frame(width: usize, height: usize, radius: u32) -> Scene {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/data/test/courtyard/4spp.exr");
    let (needs, options) = (Needs::everything(), LoadOptions::default());
    let mut raw = RawScene::read(path.as_ref(), &needs, &options).expect("the project's own scene");
    let (columns, rows) = (raw.width, raw.height);
    for image in raw.features.values_mut().flatten() {
        let repeat = |k: usize| image[(k / width % rows) * columns + k % width % columns];
        *image = (0..width * height).map(repeat).collect();
    }
    (raw.width, raw.height) = (width, height);
    raw.prepare(&needs, radius as usize, &options).expect("a sound scene")
}

fn measure(gpus: &[Gpu], scene: &Scene, weight: &Tree, radius: u32, rounds: usize) -> Vec<String> {
    let window = Window::dense(radius);
    let plan = Plan::new(std::slice::from_ref(weight), window, &Facts::of(scene), Passes::ALL)
        .expect("the scene has every feature");
    let (width, height) = (scene.layout().width(), scene.layout().height());
    let corner = [Rect { x: 0, y: 0, width: 8.min(width), height: 8.min(height) }];
    let mut shaders: Vec<Shader> = gpus
        .iter()
        .map(|gpu| {
            let code = gpu.compile(&plan).expect("a shader of moderate size");
            // Drivers compile at the first dispatch.
            code.run(scene, &corner).expect("runs");
            Shader { gpu: gpu.clone(), code, kernel: Vec::new(), whole: Vec::new() }
        })
        .collect();
    let jit = Jit::new().expect("the host has a code generator").compile(&plan).expect("compiles");
    let mut machine = Vec::new();
    let whole = [Rect::whole(scene)];
    for _ in 0..rounds {
        for shader in &mut shaders {
            let before = shader.gpu.kernel_time();
            let start = Instant::now();
            shader.code.run(scene, &whole).expect("runs");
            shader.whole.push(start.elapsed());
            shader.kernel.extend(shader.gpu.kernel_time().zip(before).map(|(a, b)| a - b));
        }
        let start = Instant::now();
        jit.run(scene, &whole).expect("runs");
        machine.push(start.elapsed());
    }
    let ms = |times: &mut Vec<Duration>| {
        times.sort();
        times
            .get(times.len() / 2)
            .map_or("-".to_owned(), |time| format!("{:.1}", time.as_secs_f64() * 1e3))
    };
    let rect = Rect { x: 0, y: height / 2, width: width.min(288), height: 1 };
    let stage = Gather::of_color(weight.clone(), window);
    let exact = oracle::filter(scene, &stage, rect);
    let error = |code: &dyn Executable| {
        let got = code.run(scene, &[rect]).expect("inside the image").swap_remove(0).pixels;
        let worst = got
            .iter()
            .zip(&exact)
            .filter(|(_, exact)| exact.total.abs() > 1e-25)
            .flat_map(|(got, exact)| got.iter().zip(exact.color))
            .filter(|(_, exact)| *exact > 0.0)
            .map(|(got, exact)| (f64::from(*got) - exact).abs() / exact)
            .fold(0.0, f64::max);
        format!("{worst:.1e}")
    };
    let errors = [error(&*shaders[1].code), error(&*shaders[3].code)];
    let times = shaders.iter_mut().map(|s| format!("{} / {}", ms(&mut s.kernel), ms(&mut s.whole)));
    let mut cells: Vec<String> = times.collect();
    cells.push(ms(&mut machine));
    cells.extend(errors);
    cells
}
