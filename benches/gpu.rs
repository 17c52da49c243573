//! Filters on a GPU: whether they agree with machine code, how long frames take, and what
//! each kernel of a program does.
//!
//! * **Agreement.** Every filter and precision on the scenes of `data/test`: the greatest
//!   difference of a pixel from machine code, relative to the pixel and the image's mean.
//! * **Frames.** Per size: milliseconds of the kernels alone, by the device's clock; of the
//!   whole run, transfers included; and of machine code on all threads in the same run.
//!   Rounds are interleaved and medians taken.
//! * **Kernels.** Of every program on the last size but one: milliseconds, operations per
//!   second, bytes per second, and which share that is of what the device reaches where it
//!   only copies. Bytes count each plane once that a kernel reads or writes.
//!
//! ```text
//! scripts/measure_gpu                       # builds this, and runs it
//! cargo bench --bench gpu -- --sizes 1280x720 --filters tamis bilateral --rounds 5
//! ```
//!
//! It runs in the folder of the repository, whose scenes it reads. Frames are the test scene
//! courtyard, repeated. What was measured stands in `benches/RESULTS.md`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Parser;
use serde_json::{Value, json};
use tamis::backend::gpu::{Gpu, Options};
use tamis::backend::{Backend, Executable, Filtered, Jit, Rect};
use tamis::expr::codebook;
use tamis::filter::{Filter, shipped};
use tamis::plan::{Passes, Plan, Precision};
use tamis::report::{Align, Format, Table};
use tamis::scene::{Facts, LoadOptions, RawScene, Scene};

/// Filters measured on a GPU.
#[derive(Parser)]
struct Arguments {
    /// Widths and heights of frames
    #[arg(long, num_args = 1.., default_values = ["1280x720", "1920x1080", "3840x2160"])]
    sizes: Vec<String>,

    /// Shipped programs and known single weights
    #[arg(long, num_args = 1.., default_values = ["tamis", "tamis-fast", "tamis-formula", "bilateral"])]
    filters: Vec<String>,

    /// Window radius of single weights
    #[arg(long, default_value_t = 8)]
    radius: u32,

    /// Which GPU
    #[arg(long)]
    gpu: Option<String>,

    /// Gibibytes of the GPU's memory that may be used
    #[arg(long, default_value_t = 8)]
    max_memory: u64,

    /// Measurements of each
    #[arg(long, default_value_t = 5)]
    rounds: usize,

    /// Where all figures go as JSON
    #[arg(long, value_name = "FILE", overrides_with = "json")]
    json: Option<PathBuf>,

    /// Given by cargo; without it this only checks that the bench runs
    #[arg(long)]
    bench: bool,
}

/// A GPU as it computes with one precision.
struct Device {
    precision: Precision,
    gpu: Gpu,
}

fn main() {
    let mut arguments = Arguments::parse();
    if !arguments.bench {
        (arguments.sizes, arguments.radius, arguments.rounds) = (vec!["96x64".into()], 2, 1);
        arguments.filters = vec!["tamis-fast".into(), "bilateral".into()];
    }
    let open = |precision| {
        let (adapter, max_memory) = (arguments.gpu.clone(), arguments.max_memory << 30);
        let gpu = Gpu::open(&Options { adapter, max_memory, precision, ..Options::default() })?;
        Ok::<_, tamis::backend::gpu::GpuError>(Device { precision, gpu })
    };
    let devices: Vec<Device> = match Precision::ALL.into_iter().map(open).collect() {
        Ok(devices) => devices,
        Err(error) => return println!("nothing measured: {error}"),
    };
    let gpu = &devices[0].gpu;
    let copies = gpu.copy_bandwidth().expect("the device copies");
    println!("{}, {:?}", gpu.adapter_name(), gpu.arithmetic());
    if let Some(copies) = copies {
        println!("copies {:.1} GB/s, read and written", copies / 1e9);
    }
    let filters: Vec<Filter> =
        arguments.filters.iter().map(|name| named(name, arguments.radius)).collect();
    let report = json!({
        "device": gpu.adapter_name(),
        "arithmetic": format!("{:?}", gpu.arithmetic()),
        "copy_bytes_per_second": copies,
        "agreement": agreement(&devices, &filters, arguments.bench),
        "frames": frames(&devices, &filters, &arguments),
        "kernels": kernels(&devices, &filters, &arguments, copies),
    });
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&report).expect("numbers and names");
        std::fs::write(path, text + "\n").expect("the file can be written");
    }
}

fn named(name: &str, radius: u32) -> Filter {
    let program = shipped::programs().find(|filter| filter.name == name);
    program.unwrap_or_else(|| {
        let weight = codebook::named(name).unwrap_or_else(|| panic!("no filter is called {name}"));
        Filter::single(name, weight.clone(), radius)
    })
}

fn planned(filter: &Filter, scene: &Scene, precision: Precision) -> Plan {
    let checked = filter.check().expect("shipped filters make sense");
    let passes = Passes { precision, ..Passes::ALL };
    Plan::of(&checked, &Facts::of(scene), passes).expect("the scene has every feature")
}

fn read(file: &Path) -> RawScene {
    let (needs, options) = (tamis::scene::Needs::everything(), LoadOptions::default());
    RawScene::read(file, &needs, &options).expect("a scene of the project's own; run this there")
}

fn prepared(raw: RawScene, filter: &Filter) -> Scene {
    let checked = filter.check().expect("shipped filters make sense");
    let scene = raw.prepare(&checked.needs(), checked.reach(), &LoadOptions::default());
    scene.expect("a sound scene")
}

fn whole(code: &dyn Executable, scene: &Scene) -> Filtered {
    code.run(scene, &[Rect::whole(scene)]).expect("runs").swap_remove(0)
}

/// The greatest difference of a pixel, by its colour and the image's mean.
fn apart(a: &Filtered, b: &Filtered) -> f64 {
    let sums = b.pixels.iter().flatten().map(|&x| f64::from(x.abs()));
    let mean = sums.sum::<f64>() / (3 * b.pixels.len()) as f64;
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    pairs.map(|(&a, &b)| f64::from((a - b).abs()) / (f64::from(b.abs()) + mean)).fold(0.0, f64::max)
}

fn agreement(devices: &[Device], filters: &[Filter], every_scene: bool) -> Value {
    let mut scenes: Vec<PathBuf> = std::fs::read_dir("data/test")
        .expect("the repository's scenes")
        .map(|entry| entry.expect("a folder").path().join("4spp.exr"))
        .filter(|file| file.exists())
        .collect();
    scenes.sort();
    scenes.truncate(if every_scene { usize::MAX } else { 1 });
    let jit = Jit::new().expect("the host has a code generator");
    let mut table = Table::new([("filter", Align::Left), ("from machine code", Align::Right)]);
    let mut values = Vec::new();
    for filter in filters {
        for Device { precision, gpu } in devices {
            let name = precision.title(&filter.name);
            let mut worst: f64 = 0.0;
            for file in &scenes {
                let scene = prepared(read(file), filter);
                let plan = planned(filter, &scene, *precision);
                let filtered = [gpu as &dyn Backend, &jit]
                    .map(|backend| whole(&*backend.compile(&plan).expect("compiles"), &scene));
                worst = worst.max(apart(&filtered[0], &filtered[1]));
            }
            table.row([name.clone(), format!("{worst:.1e}")]);
            values.push(json!({"filter": name, "scenes": scenes.len(), "difference": worst}));
        }
    }
    println!("\nThe greatest difference on {} test scenes:\n", scenes.len());
    print!("{}", table.render(Format::Markdown));
    Value::Array(values)
}

/// The test scene, repeated to a size.
fn frame(size: &str, filter: &Filter) -> Scene {
    let (width, height) = size.split_once('x').expect("a size is WIDTHxHEIGHT");
    let [width, height] =
        [width, height].map(|n| n.parse::<usize>().expect("sizes are whole numbers"));
    let mut raw = read(Path::new("data/test/courtyard/4spp.exr"));
    let (columns, rows) = (raw.width, raw.height);
    for image in raw.features.values_mut().flatten() {
        let repeat = |k: usize| image[(k / width % rows) * columns + k % width % columns];
        *image = (0..width * height).map(repeat).collect();
    }
    (raw.width, raw.height) = (width, height);
    prepared(raw, filter)
}

/// What was measured of a frame with one precision.
struct Measured {
    code: Box<dyn Executable>,
    kernel: Vec<Duration>,
    run: Vec<Duration>,
}

fn frames(devices: &[Device], filters: &[Filter], arguments: &Arguments) -> Value {
    let columns = ["kernels", "run", "fast kernels", "fast run", "jit"];
    let columns = columns.map(|name| (name, Align::Right));
    let first = [("frame", Align::Left), ("filter", Align::Left)];
    let mut table = Table::new(first.into_iter().chain(columns));
    let mut values = Vec::new();
    for size in &arguments.sizes {
        for filter in filters {
            let scene = frame(size, filter);
            let plan = |precision| planned(filter, &scene, precision);
            let mut measured: Vec<Measured> = devices
                .iter()
                .map(|Device { precision, gpu }| {
                    let code = gpu.compile(&plan(*precision)).expect("shaders of moderate size");
                    // Drivers compile at the first dispatch.
                    whole(&*code, &scene);
                    Measured { code, kernel: Vec::new(), run: Vec::new() }
                })
                .collect();
            let jit = Jit::new().expect("the host has a code generator");
            let jit = jit.compile(&plan(Precision::Standard)).expect("compiles");
            let mut machine = Vec::new();
            for _ in 0..arguments.rounds {
                for (Device { gpu, .. }, measured) in devices.iter().zip(&mut measured) {
                    let before = gpu.kernel_time();
                    let start = Instant::now();
                    whole(&*measured.code, &scene);
                    measured.run.push(start.elapsed());
                    measured.kernel.extend(gpu.kernel_time().zip(before).map(|(a, b)| a - b));
                }
                let start = Instant::now();
                whole(&*jit, &scene);
                machine.push(start.elapsed());
            }
            let machine = median(&mut machine);
            let mut cells = vec![size.clone(), filter.name.clone()];
            for (Device { precision, .. }, measured) in devices.iter().zip(&mut measured) {
                let (kernel, run) = (median(&mut measured.kernel), median(&mut measured.run));
                cells.extend([shown(kernel), shown(run)]);
                values.push(json!({
                    "frame": size, "filter": precision.title(&filter.name),
                    "kernels_ms": kernel, "run_ms": run, "jit_ms": machine,
                }));
            }
            cells.push(shown(machine));
            eprintln!("{}", cells.join("  "));
            table.row(cells);
        }
    }
    println!("\nMilliseconds per frame, without and with transfers:\n");
    print!("{}", table.render(Format::Markdown));
    Value::Array(values)
}

fn median(times: &mut [Duration]) -> Option<f64> {
    times.sort();
    times.get(times.len() / 2).map(|time| time.as_secs_f64() * 1e3)
}

fn shown(milliseconds: Option<f64>) -> String {
    milliseconds.map_or("-".to_owned(), |ms| format!("{ms:.2}"))
}

fn kernels(
    devices: &[Device],
    filters: &[Filter],
    arguments: &Arguments,
    copies: Option<f64>,
) -> Value {
    let size = &arguments.sizes[arguments.sizes.len().saturating_sub(2)];
    let mut values = Vec::new();
    for filter in filters {
        let scene = frame(size, filter);
        let Plan::Program(program) = planned(filter, &scene, Precision::Standard) else { continue };
        let gpu = &devices[0].gpu;
        // Drivers compile at the first dispatch.
        gpu.profile(&program, &scene).expect("runs");
        let Some(times) = gpu.profile(&program, &scene).expect("runs") else {
            println!("\nThe device has no clock: kernels are not timed.");
            break;
        };
        let columns = ["ms", "Gop/s", "GB/s", "of copying"].map(|name| (name, Align::Right));
        let first = [("kernel", Align::Left), ("pixels", Align::Right)];
        let mut table = Table::new(first.into_iter().chain(columns));
        let mut rest = Duration::ZERO;
        let total: Duration = times.iter().map(|kernel| kernel.time).sum();
        for kernel in &times {
            let seconds = kernel.time.as_secs_f64();
            let [operations, bytes] = [kernel.operations, kernel.bytes].map(|n| n / seconds / 1e9);
            let [columns, rows] = kernel.extent;
            values.push(json!({
                "frame": size, "filter": filter.name, "kernel": kernel.name,
                "columns": columns, "rows": rows, "ms": seconds * 1e3,
                "gigaoperations_per_second": operations, "gigabytes_per_second": bytes,
            }));
            if kernel.time < total / 100 {
                rest += kernel.time;
                continue;
            }
            let share = copies
                .map_or("-".to_owned(), |copies| format!("{:.0}%", 100.0 * bytes * 1e9 / copies));
            table.row([
                kernel.name.clone(),
                format!("{columns}x{rows}"),
                format!("{:.3}", seconds * 1e3),
                format!("{operations:.1}"),
                format!("{bytes:.1}"),
                share,
            ]);
        }
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        println!(
            "\n`{}` at {size}: {:.2} ms in {} kernels; those below 1%, {:.2} ms together, are \
             left out:\n",
            filter.name,
            ms(total),
            times.len(),
            ms(rest)
        );
        print!("{}", table.render(Format::Markdown));
    }
    Value::Array(values)
}
