//! What is promised of the GPU back end alone.

use std::path::Path;
use std::process::Command;

use rayon::prelude::*;
use tamis::backend::gpu::{Gpu, GpuError, Options};
use tamis::backend::reference::oracle;
use tamis::backend::shader::wgsl::{Arithmetic, Dialect};
use tamis::backend::shader::{Loads, Shader, Style};
use tamis::backend::{ACCURACY, Backend, BackendError, Jit, Rect};
use tamis::expr::{Feature, Op, Quantity, Tree, codebook};
use tamis::filter::{Filter, Gather, Window, shipped};
use tamis::plan::{Passes, Plan, Precision, WindowPlan};
use tamis::scene::{Facts, LoadOptions, Needs, RawScene, Scene, load_image};

use crate::fixture::{bred, noise, parse, scene};
use crate::suite::{plan, run};

pub(crate) const CASES: &[(&str, fn())] = &[
    ("gpu::tiles_give_the_bits_of_the_whole", tiles_give_the_bits_of_the_whole),
    ("gpu::frames_at_once_give_what_they_give_alone", frames_at_once_give_what_they_give_alone),
    ("gpu::too_little_memory_is_said_before_any_work", too_little_memory),
    ("gpu::a_lost_device_is_an_error", a_lost_device_is_an_error),
    ("gpu::an_unknown_gpu_is_an_error", an_unknown_gpu_is_an_error),
    ("gpu::test_scenes", || test_scenes(&[named(), bred_filters()].concat(), 4, 24)),
    ("gpu::denoise_agrees_with_machine_code", denoise_agrees_with_machine_code),
];

/// Cases that take minutes:
/// `cargo test --release --test conformance long -- --ignored`
pub(crate) const LONG: &[(&str, fn())] = &[
    ("long::gpu::test_scenes_whole", || test_scenes(&[named(), bred_filters()].concat(), 3, 1)),
    ("long::gpu::test_scenes_in_whole_windows", || test_scenes(&named(), 10, 1)),
    ("long::gpu::a_frame_of_8192_by_4320", a_frame_of_8192_by_4320),
];

pub(crate) const WITHOUT_A_GPU: &[(&str, fn())] =
    &[("shaders::every_shader_is_valid", every_shader_is_valid)];

fn open(max_memory: u64) -> Gpu {
    Gpu::open(&Options { max_memory, ..Options::default() }).expect("a GPU")
}

fn tiles_give_the_bits_of_the_whole() {
    let scene = scene(128, 96, 11);
    let [whole, small, tiny] = [1 << 30, 1 << 18, 60_000].map(open);
    for known in codebook::known() {
        for window in [Window::dense(4), Window { radius: 2, dilation: 3 }] {
            let plan = plan(std::slice::from_ref(&known.weight), window, &scene, Passes::ALL);
            let expected = run(&whole, &plan, &scene);
            assert!(run(&small, &plan, &scene) == expected, "{}", known.name);
            assert!(run(&tiny, &plan, &scene) == expected, "{}", known.name);
        }
    }
}

fn frames_at_once_give_what_they_give_alone() {
    let gpu = open(1 << 19);
    let weight = codebook::named("cross-bilateral").expect("listed");
    let frames: Vec<_> = (0..4).map(|seed| scene(96, 64, seed)).collect();
    let plans: Vec<Plan> = frames
        .iter()
        .map(|scene| plan(std::slice::from_ref(weight), Window::dense(3), scene, Passes::ALL))
        .collect();
    let alone: Vec<_> =
        frames.iter().zip(&plans).map(|(scene, plan)| run(&gpu, plan, scene)).collect();
    let together: Vec<_> = std::thread::scope(|scope| {
        let frames = frames.iter().zip(&plans);
        let running: Vec<_> =
            frames.map(|(scene, plan)| scope.spawn(|| run(&gpu, plan, scene))).collect();
        running.into_iter().map(|thread| thread.join().expect("no panic")).collect()
    });
    assert!(alone == together);
}

fn too_little_memory() {
    let scene = scene(32, 32, 12);
    let weight = codebook::named("bilateral").expect("listed").clone();
    let plan = plan(&[weight], Window::dense(4), &scene, Passes::ALL);
    let code = open(1000).compile(&plan).expect("compiles");
    match code.run(&scene, &[Rect::whole(&scene)]) {
        Err(BackendError::Gpu(error @ GpuError::TooLittleMemory { needed, .. })) => {
            assert!(error.to_string().contains("--max-memory"));
            let enough = open(needed).compile(&plan).expect("compiles");
            assert!(enough.run(&scene, &[Rect { x: 9, y: 9, width: 2, height: 2 }]).is_ok());
        }
        other => panic!("{other:?}"),
    }
}

fn a_lost_device_is_an_error() {
    let scene = scene(32, 32, 14);
    let gpu = open(1 << 20);
    let weight = codebook::named("bilateral").expect("listed").clone();
    let before = plan(&[weight], Window::dense(2), &scene, Passes::ALL);
    let after = plan(&[parse("nVariance")], Window::dense(2), &scene, Passes::ALL);
    let code = gpu.compile(&before).expect("compiles");
    gpu.close();
    let run = code.run(&scene, &[Rect::whole(&scene)]).map(|_| ());
    let compiled = gpu.compile(&after).map(|_| ());
    for result in [run, compiled] {
        match result {
            Err(BackendError::Gpu(error @ GpuError::Lost { .. })) => {
                assert!(error.to_string().contains("--backend jit"), "{error}");
            }
            other => panic!("{other:?}"),
        }
    }
}

fn an_unknown_gpu_is_an_error() {
    let options = Options { adapter: Some("no such card".to_owned()), ..Options::default() };
    let Err(error) = Gpu::open(&options) else { panic!("there is no such card") };
    assert!(matches!(error, GpuError::NoSuchAdapter { .. }), "{error}");
}

/// The law of whole images: on the project's test scenes, filters are within what their
/// precision promises of the exact filter, by machine code and on a GPU, on every
/// `step`-th row. Prints the worst.
fn test_scenes(filters: &[(String, Tree)], radius: u32, step: usize) {
    let jit = Jit::new().expect("the host has a code generator");
    let gpus = Precision::ALL.map(|precision| {
        let options = Options { precision, ..Options::default() };
        Gpu::open(&options).expect("a GPU")
    });
    let [standard, fast] = Precision::ALL;
    let engines: [(&dyn Backend, Precision); 4] =
        [(&jit, standard), (&jit, fast), (&gpus[0], standard), (&gpus[1], fast)];
    for name in ["courtyard", "galley", "showroom"] {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test");
        let (file, needs) = (root.join(name).join("4spp.exr"), Needs::everything());
        let scene = Scene::load(&file, &needs, radius as usize, &LoadOptions::default())
            .expect("the project's own scene");
        let (width, height) = (scene.layout().width(), scene.layout().height());
        let row = |y| Rect { x: 0, y, width, height: 1 };
        let rows: Vec<Rect> = (0..height).step_by(step).map(row).collect();
        let region = if step == 1 { vec![Rect::whole(&scene)] } else { rows.clone() };
        let mut worst = [0.0f64; 4];
        let mut left_out = 0;
        for (filter, weight) in filters {
            let window = Window::dense(radius);
            let stage = Gather::of_color(weight.clone(), window);
            let exact: Vec<oracle::ExactGather> =
                rows.par_iter().flat_map(|&row| oracle::filter(&scene, &stage, row)).collect();
            left_out += exact.iter().filter(|exact| !exact.is_promised()).count();
            for ((engine, precision), worst) in engines.iter().zip(&mut worst) {
                let passes = Passes { precision: *precision, ..Passes::ALL };
                let plan = plan(std::slice::from_ref(weight), window, &scene, passes);
                let code = engine.compile(&plan).expect("compiles");
                let got = code.run(&scene, &region).expect("runs").swap_remove(0).pixels;
                let promised = exact.iter().zip(got).filter(|(exact, _)| exact.is_promised());
                let off = promised.map(|(exact, got)| exact.difference(got)).fold(0.0, f64::max);
                let bound = engine.agreement().bound(*precision);
                let title = precision.title(engine.name());
                assert!(off <= bound, "{title}: {filter} on {name}: {off:e} from exact");
                *worst = worst.max(off);
            }
        }
        let titles = engines.map(|(engine, precision)| precision.title(engine.name()));
        let figures = titles.iter().zip(worst).map(|(title, off)| format!("{title} {off:.1e}"));
        println!(
            "{name}, radius {radius}, at most from the exact filter: {}; of {left_out} pixels \
             nothing is promised",
            figures.collect::<Vec<_>>().join(", ")
        );
    }
}

/// Thirty trees from a search.
fn bred_filters() -> Vec<(String, Tree)> {
    bred().into_iter().map(|text| (text.to_owned(), parse(text))).collect()
}

/// The filters that have names, and those that ship and are single weights.
pub(crate) fn named() -> Vec<(String, Tree)> {
    let known = codebook::known().iter();
    let known = known.map(|known| (known.name.to_owned(), known.weight.clone()));
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/filters");
    let files = std::fs::read_dir(folder).expect("the repository's filters");
    let mut paths: Vec<_> = files.map(|entry| entry.expect("readable").path()).collect();
    paths.sort();
    let read = |path: &std::path::PathBuf| {
        let filter = Filter::read(path).expect("a shipped filter");
        let weight = filter.paper()?.weight.clone();
        Some((filter.name, weight))
    };
    known.chain(paths.iter().filter_map(read)).collect()
}

/// The program itself in little memory: with every filter that ships, and with a single weight.
fn denoise_agrees_with_machine_code() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let single = ("kan2017".to_owned(), "2M");
    let programs = shipped::programs().map(|filter| (filter.name, "64M"));
    let ways: Vec<_> = programs.chain([single]).collect();
    let scenes = ["courtyard", "galley", "showroom"];
    for (name, (filter, memory)) in scenes.iter().cycle().zip(&ways) {
        let input =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test").join(name).join("4spp.exr");
        let [gpu, jit] = [&["gpu", "--max-memory", memory][..], &["jit"]].map(|backend| {
            let output = folder.path().join(format!("{filter}-{}.exr", backend[0]));
            let done = Command::new(env!("CARGO_BIN_EXE_tamis"))
                .args(["denoise", "--filter", filter, "--backend"])
                .args(backend)
                .arg(&input)
                .arg("-o")
                .arg(&output)
                .output()
                .expect("the program starts");
            assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
            load_image(&output).expect("the result is an image")
        });
        let values = || gpu.rgb().into_iter().flatten().zip(jit.rgb().into_iter().flatten());
        let mean =
            values().map(|(_, jit)| f64::from(jit.abs())).sum::<f64>() / values().count() as f64;
        for (gpu, jit) in values() {
            // Results are halves, as the scenes are: they may be rounded apart.
            let size = f64::from(jit.abs());
            let allowed = 2.0 * ACCURACY * (size + mean) + size / 1024.0;
            let off = f64::from((gpu - jit).abs());
            assert!(off <= allowed, "{name}, {filter}: {gpu}, not {jit}");
        }
    }
}

/// A frame that no binding holds, in half a gibibyte of buffers: it is filtered,
/// and where a crop of it is filtered alone the bits are the same.
fn a_frame_of_8192_by_4320() {
    let (width, height) = (8192, 4320);
    let plane = |salt| noise(width * height, salt);
    let raw = RawScene::new("huge", width, height, [plane(1), plane(2), plane(3)]).with(
        Feature::Normal,
        Quantity::Value,
        vec![plane(4), plane(5), plane(6)],
    );
    let weight = parse("exp(-distance2(normal, normal) - distance1(pixel, pixel) / 3)");
    let needs = Needs::planes(weight.planes());
    let scene = raw.prepare(&needs, 2, &LoadOptions::default()).expect("a sound scene");
    let plan = plan(&[weight], Window::dense(2), &scene, Passes::ALL);
    let got = run(&open(512 << 20), &plan, &scene).swap_remove(0);
    let crop = Rect { x: 4000, y: 2000, width: 300, height: 300 };
    let code = open(1 << 30).compile(&plan).expect("compiles");
    let expected = code.run(&scene, &[crop]).expect("runs").swap_remove(0);
    for (k, expected) in expected.pixels.iter().enumerate() {
        let (x, y) = (crop.x + k % crop.width, crop.y + k / crop.width);
        assert_eq!(got.pixels[y * width + x], *expected, "pixel {x}, {y}");
    }
    let jit = Jit::new().expect("the host has a code generator");
    let machine = run(&jit, &plan, &scene).swap_remove(0);
    let all = got.pixels.iter().flatten().zip(machine.pixels.iter().flatten());
    let worst = all.map(|(g, m)| (g - m).abs() / m.abs().max(1e-30)).fold(0.0, f32::max);
    println!("8192 x 4320: at most {worst:.1e} from machine code");
    assert!(f64::from(worst) <= 2.0 * ACCURACY);
}

/// Needs no GPU: naga checks what a driver would be given.
fn every_shader_is_valid() {
    let scene = scene(24, 8, 13);
    let facts = Facts::of(&scene);
    let mut trees: Vec<Tree> = bred().into_iter().map(parse).collect();
    trees.extend(codebook::known().iter().map(|known| known.weight.clone()));
    trees.extend(Op::ALL.iter().map(|&op| {
        let (scalar, vector) = (parse("nVariance - 0.5"), parse("dot(normal, normal)").subtree(0));
        let operands: Vec<&Tree> = match op.operands() {
            [tamis::expr::Sort::Scalar] => vec![&scalar],
            [tamis::expr::Sort::Scalar, _] => vec![&scalar, &scalar],
            _ => vec![&vector, &vector],
        };
        Tree::apply(op, &operands).expect("the operands are of the sorts it takes")
    }));
    let mut batches: Vec<Vec<Tree>> = trees.iter().map(|tree| vec![tree.clone()]).collect();
    batches.push(trees[..5].to_vec());
    for weights in batches {
        for passes in [Passes::ALL, Passes::NONE] {
            let plan = WindowPlan::new(&weights, Window::dense(3), &facts, passes).expect("plans");
            for loads in Loads::ALL {
                for (precision, arithmetic) in [
                    (Precision::Standard, Arithmetic::IEEE),
                    (Precision::Standard, Arithmetic::WGSL),
                    (Precision::Fast, Arithmetic::WGSL),
                ] {
                    let dialect = Dialect { precision, arithmetic };
                    for tap_table in [true, false] {
                        let style = Style { dialect, loads, tap_table };
                        let shader = Shader::new(&plan, style);
                        validate(&shader.text, &weights[0].to_string());
                    }
                }
            }
        }
    }
}

pub(crate) fn validate(text: &str, what: &str) {
    let module = naga::front::wgsl::parse_str(text)
        .unwrap_or_else(|error| panic!("{what}: {}", error.emit_to_string(text)));
    let mut validator = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::empty(),
    );
    validator
        .validate(&module)
        .unwrap_or_else(|error| panic!("{what}: {}", error.emit_to_string(text)));
}
