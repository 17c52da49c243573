//! Programs on a GPU.

use std::path::Path;

use tamis::backend::gpu::{Gpu, GpuError, Options};
use tamis::backend::reference::meaning;
use tamis::backend::shader::program::ProgramShader;
use tamis::backend::shader::wgsl::{Arithmetic, Dialect};
use tamis::backend::{
    ACCURACY, Backend, BackendError, FAST_ACCURACY, Filtered, Interpreter, Jit, Rect,
};
use tamis::expr::{Feature, Quantity};
use tamis::filter::{Filter, shipped};
use tamis::plan::{Passes, Plan, Precision};
use tamis::scene::{Facts, LoadOptions, RawScene, Scene};

use crate::fixture;
use crate::gpu::validate;
use crate::samples;

pub(crate) const CASES: &[(&str, fn())] = &[
    ("programs::images_of_any_size", images_of_any_size),
    ("programs::random_programs", random_programs),
    ("programs::tiles_give_the_bits_of_the_whole", tiles_give_the_bits_of_the_whole),
    ("programs::frames_at_once_give_what_they_give_alone", frames_at_once),
    ("programs::several_pictures", several_pictures),
    ("programs::shipped_programs", shipped_programs),
];

/// Takes minutes.
pub(crate) const LONG: &[(&str, fn())] =
    &[("long::programs::a_frame_of_8192_by_4320", a_frame_of_8192_by_4320)];

pub(crate) const WITHOUT_A_GPU: &[(&str, fn())] =
    &[("shaders::every_kernel_of_a_program_is_valid", every_kernel_is_valid)];

fn open(max_memory: u64, precision: Precision) -> Gpu {
    let options = Options { max_memory, precision, ..Options::default() };
    Gpu::open(&options).expect("a GPU")
}

fn parse(text: &str) -> Filter {
    Filter::parse(text, Path::new("test.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn schedule(filter: &Filter, scene: &Scene, passes: Passes) -> Plan {
    let checked = filter.check().expect("the filter makes sense");
    Plan::of(&checked, &Facts::of(scene), passes).expect("it can be planned")
}

fn whole(backend: &dyn Backend, plan: &Plan, scene: &Scene) -> Filtered {
    let code = backend.compile(plan).expect("compiles");
    code.run(scene, &[Rect::whole(scene)]).expect("runs").swap_remove(0)
}

/// The greatest difference of a pixel, by its colour and the image's mean: where a result is
/// near zero by cancellation, nothing is promised.
fn apart(a: &Filtered, b: &Filtered) -> f64 {
    let mean = b.pixels.iter().flatten().map(|x| f64::from(x.abs())).sum::<f64>()
        / (3 * b.pixels.len()) as f64;
    let pixels = a.pixels.iter().zip(&b.pixels);
    let differences = pixels.map(|(a, b)| {
        let size = b.iter().map(|x| f64::from(x.abs())).fold(0.0, f64::max);
        let off = a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
        off / size.max(0.01 * mean).max(1e-30)
    });
    differences.fold(0.0, f64::max)
}

/// The result, and what is averaged where weights vanish.
fn images_of_any_size() {
    let gpu = open(1 << 30, Precision::Standard);
    let filter = parse(samples::SAMPLE);
    for (width, height) in [(70, 41), (1, 1), (5, 90), (64, 2)] {
        let scene = fixture::scene(width, height, 3);
        for passes in [Passes::ALL, Passes::NONE] {
            let plan = schedule(&filter, &scene, passes);
            let (got, expected) = (whole(&gpu, &plan, &scene), whole(&Interpreter, &plan, &scene));
            let apart = apart(&got, &expected);
            assert!(apart < ACCURACY, "{width}x{height}: {apart:e} from the interpreter");
            assert_eq!(got.kept, expected.kept, "{width}x{height}");
        }
    }
}

fn random_programs() {
    let gpu = open(1 << 30, Precision::Standard);
    let scenes: Vec<Scene> = (0..3).map(|seed| fixture::scene(37, 29, seed)).collect();
    let mut worst = 0.0f64;
    for seed in 0..60 {
        let text = samples::random(seed, 1 + seed as usize % 12);
        let filter = parse(&text);
        let scene = &scenes[seed as usize % scenes.len()];
        let plan = schedule(&filter, scene, Passes::ALL);
        let (got, expected) = (whole(&gpu, &plan, scene), whole(&Interpreter, &plan, scene));
        let apart = apart(&got, &expected);
        assert!(apart < 1e-3, "seed {seed}: {apart:e} from the interpreter\n{text}");
        assert_eq!(got.kept, expected.kept, "seed {seed}\n{text}");
        worst = worst.max(apart);
    }
    println!("60 random programs: at most {worst:.1e} from the interpreter");
}

fn tiles_give_the_bits_of_the_whole() {
    let scene = fixture::scene(256, 192, 11);
    let open = |memory| open(memory, Precision::Standard);
    let (large, none) = (open(1 << 30), open(1));
    let mut filters: Vec<Filter> = shipped::programs().collect();
    filters.push(parse(samples::SAMPLE));
    for filter in filters {
        let plan = schedule(&filter, &scene, Passes::ALL);
        let expected = whole(&large, &plan, &scene);
        // Half as much again as one pixel's tile takes is too little for the whole.
        let code = none.compile(&plan).expect("compiles");
        let needed = match code.run(&scene, &[Rect::whole(&scene)]) {
            Err(BackendError::Gpu(GpuError::TooLittleMemory { needed, .. })) => needed,
            other => panic!("{}: a byte is enough? {other:?}", filter.name),
        };
        let small = open(needed + needed / 2);
        assert!(whole(&small, &plan, &scene) == expected, "{}", filter.name);
        // Rectangles of odd sizes at odd places.
        let rect = Rect { x: 33, y: 7, width: 41, height: 59 };
        let code = large.compile(&plan).expect("compiles");
        let part = code.run(&scene, &[rect]).expect("runs").swap_remove(0);
        for (k, pixel) in part.pixels.iter().enumerate() {
            let (x, y) = (rect.x + k % rect.width, rect.y + k / rect.width);
            assert_eq!(*pixel, expected.pixels[y * 256 + x], "{}: {x}, {y}", filter.name);
        }
    }
}

/// A frame of noise that no binding holds, in half a gibibyte of buffers: where a crop of it
/// is filtered alone the bits are the same, and machine code agrees.
fn a_frame_of_8192_by_4320() {
    let (width, height) = (8192, 4320);
    let plane = |salt| fixture::noise(width * height, salt);
    let three = |salt: u32| vec![plane(salt), plane(salt + 1), plane(salt + 2)];
    let raw = RawScene::new("huge", width, height, [plane(1), plane(2), plane(3)])
        .with(Feature::Normal, Quantity::Value, three(4))
        .with(Feature::Texture, Quantity::Value, three(7));
    let filter = shipped::programs().find(|filter| filter.name == "tamis-fast").expect("ships");
    let checked = filter.check().expect("shipped filters make sense");
    let scene = raw.prepare(&checked.needs(), checked.reach(), &LoadOptions::default());
    let scene = scene.expect("a sound scene");
    let plan = schedule(&filter, &scene, Passes::ALL);
    let got = whole(&open(512 << 20, Precision::Standard), &plan, &scene);
    let crop = Rect { x: 4000, y: 2000, width: 300, height: 300 };
    let code = open(1 << 30, Precision::Standard).compile(&plan).expect("compiles");
    let expected = code.run(&scene, &[crop]).expect("runs").swap_remove(0);
    for (k, expected) in expected.pixels.iter().enumerate() {
        let (x, y) = (crop.x + k % crop.width, crop.y + k / crop.width);
        assert_eq!(got.pixels[y * width + x], *expected, "pixel {x}, {y}");
    }
    let jit = Jit::new().expect("the host has a code generator");
    let apart = apart(&got, &whole(&jit, &plan, &scene));
    println!("8192 x 4320: at most {apart:.1e} from machine code");
    assert!(apart < 10.0 * ACCURACY);
}

fn frames_at_once() {
    let gpu = open(24 << 20, Precision::Standard);
    let filter = parse(samples::SAMPLE);
    let frames: Vec<Scene> = (0..4).map(|seed| fixture::scene(96, 64, seed)).collect();
    let plans: Vec<Plan> =
        frames.iter().map(|scene| schedule(&filter, scene, Passes::ALL)).collect();
    let alone: Vec<Filtered> =
        frames.iter().zip(&plans).map(|(scene, plan)| whole(&gpu, plan, scene)).collect();
    let together: Vec<Filtered> = std::thread::scope(|scope| {
        let frames = frames.iter().zip(&plans);
        let running: Vec<_> =
            frames.map(|(scene, plan)| scope.spawn(|| whole(&gpu, plan, scene))).collect();
        running.into_iter().map(|thread| thread.join().expect("no panic")).collect()
    });
    assert!(alone == together);
}

/// Pictures by the weights of the colour, in tiles too.
fn several_pictures() {
    let pixels = |salt: u32| [0, 1, 2].map(|k| fixture::noise(70 * 41, salt + k));
    let scene = fixture::scene(70, 41, 5).with_pictures(&[pixels(20), pixels(30)]);
    let carrying = shipped::best().carrying(2).expect("it carries others");
    let plan = Plan::of_pictures(&carrying, &Facts::of(&scene), Passes::ALL).expect("a plan");
    let run = |backend: &dyn Backend| {
        let code = backend.compile(&plan).expect("compiles");
        code.run(&scene, &[Rect::whole(&scene)]).expect("runs")
    };
    let (got, expected) = (run(&open(1 << 30, Precision::Standard)), run(&Interpreter));
    assert_eq!((got.len(), expected.len()), (3, 3));
    for (k, (got, expected)) in got.iter().zip(&expected).enumerate() {
        let apart = apart(got, expected);
        assert!(apart < ACCURACY, "picture {k}: {apart:e} from the interpreter");
    }
    let none = open(1, Precision::Standard).compile(&plan).expect("compiles");
    let needed = match none.run(&scene, &[Rect::whole(&scene)]) {
        Err(BackendError::Gpu(GpuError::TooLittleMemory { needed, .. })) => needed,
        other => panic!("a byte is enough? {other:?}"),
    };
    assert!(run(&open(needed + needed / 2, Precision::Standard)) == got);
}

/// The shipped programs, on a made scene beside the exact meaning, and on a render beside
/// machine code.
fn shipped_programs() {
    let jit = Jit::new().expect("the host has a code generator");
    let gpus = Precision::ALL.map(|precision| (open(1 << 30, precision), precision));
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test/showroom/4spp.exr");
    for filter in shipped::programs() {
        let checked = filter.check().expect("shipped filters make sense");
        let render = Scene::load(&file, &checked.needs(), checked.reach(), &LoadOptions::default());
        let render = render.expect("the project's own scene");
        let small = fixture::scene(48, 40, 10);
        let exact = meaning::of(&small, &checked);
        for (gpu, precision) in &gpus {
            let bound = [ACCURACY, FAST_ACCURACY][usize::from(*precision == Precision::Fast)];
            let passes = Passes { precision: *precision, ..Passes::ALL };
            let got = whole(gpu, &schedule(&filter, &small, passes), &small);
            let pixels = exact.pixels.iter().zip(&got.pixels);
            let off = pixels.map(|(exact, got)| exact.difference(*got)).fold(0.0, f64::max);
            let plan = schedule(&filter, &render, passes);
            let (got, machine) = (whole(gpu, &plan, &render), whole(&jit, &plan, &render));
            let apart = apart(&got, &machine);
            let name = precision.title(&filter.name);
            println!("{name}: {off:.1e} from exact, on a render {apart:.1e} from machine code");
            assert!(off < bound, "{name}: {off:e} from exact");
            assert!(apart < 10.0 * bound, "{name}: {apart:e} from machine code");
        }
    }
}

/// Needs no GPU: naga checks what a driver would be given.
fn every_kernel_is_valid() {
    let scene = fixture::scene(24, 8, 13);
    let mut filters: Vec<Filter> = shipped::programs().collect();
    filters.push(parse(samples::SAMPLE));
    for filter in filters {
        for passes in [Passes::ALL, Passes::NONE] {
            let Plan::Program(program) = schedule(&filter, &scene, passes) else {
                panic!("{} is a program", filter.name)
            };
            for (precision, arithmetic) in [
                (Precision::Standard, Arithmetic::IEEE),
                (Precision::Standard, Arithmetic::WGSL),
                (Precision::Fast, Arithmetic::WGSL),
            ] {
                let shader = ProgramShader::new(&program, Dialect { precision, arithmetic });
                validate(&shader.whole(), &filter.name);
            }
        }
    }
}
