//! What is promised of the GPU back end alone.

use tamis::backend::gpu::{Gpu, GpuError, Options};
use tamis::backend::shader::{Loads, Shader, Style};
use tamis::backend::wgsl::{Arithmetic, Dialect, Precision};
use tamis::backend::{Backend, BackendError, Rect};
use tamis::expr::{Op, Tree, codebook};
use tamis::plan::{Passes, Plan, Window};
use tamis::scene::Facts;

use crate::fixture::{bred, parse, scene};
use crate::suite::{plan, run};

pub(crate) const CASES: &[(&str, fn())] = &[
    ("gpu::tiles_give_the_bits_of_the_whole", tiles_give_the_bits_of_the_whole),
    ("gpu::frames_at_once_give_what_they_give_alone", frames_at_once_give_what_they_give_alone),
    ("gpu::too_little_memory_is_said_before_any_work", too_little_memory),
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
            let plan = Plan::new(&weights, Window::dense(3), &facts, passes).expect("plans");
            for loads in Loads::ALL {
                for (precision, arithmetic) in [
                    (Precision::Exact, Arithmetic::IEEE),
                    (Precision::Exact, Arithmetic::WGSL),
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

fn validate(text: &str, what: &str) {
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
