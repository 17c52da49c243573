//! One suite for every back end, one line each below.
//!
//! Vectors and instructions that the processor lacks and a GPU that is absent are shown as ignored,
//! never as passed; with
//! `TAMIS_REQUIRE_GPU=1` in the environment its absence is a failure.

#[path = "../fixture/mod.rs"]
mod fixture;
mod gpu;
#[path = "../harness/mod.rs"]
mod harness;
mod pixels;
mod programs;
mod rows;
#[path = "../fixture/programs.rs"]
mod samples;
mod suite;

use std::process::ExitCode;
use std::sync::LazyLock;

use libtest_mimic::Arguments;
use tamis::backend::Chains;
use tamis::backend::gpu::{Gpu, Options, adapters};
use tamis::backend::shader::Loads;
use tamis::backend::{Backend, CpuFeatures, Exact, Interpreter, Jit, Width};
use tamis::plan::Precision;

use harness::{is_required, trial};

type Opened = LazyLock<Box<dyn Backend + Send>>;

static EXACT: Opened = LazyLock::new(|| Box::new(Exact));
static INTERP: Opened = LazyLock::new(|| Box::new(Interpreter));
static JIT_128: Opened = LazyLock::new(|| jit(Width::Bits128, Chains::Four));
static JIT_128_OF_ONE_CHAIN: Opened = LazyLock::new(|| jit(Width::Bits128, Chains::One));
static JIT_256: Opened = LazyLock::new(|| jit(Width::Bits256, Chains::Two));
static JIT_512: Opened = LazyLock::new(|| jit(Width::Bits512, Chains::One));
static JIT_512_OF_TWO_CHAINS: Opened = LazyLock::new(|| jit(Width::Bits512, Chains::Two));
static JIT_SSE2: Opened = LazyLock::new(|| older(SSE2));
static JIT_SSE41: Opened = LazyLock::new(|| older(SSE41));
static JIT_AVX: Opened = LazyLock::new(|| older(AVX));
static GPU: Opened = LazyLock::new(|| open(Options::default()));
static GPU_PLANAR: Opened = LazyLock::new(|| open(loading(Loads::Planar)));
static GPU_TILED: Opened = LazyLock::new(|| open(loading(Loads::Tiled)));
static GPU_FAST: Opened =
    LazyLock::new(|| open(Options { precision: Precision::Fast, ..Options::default() }));
static GPU_WITHOUT_TABLE: Opened =
    LazyLock::new(|| open(Options { tap_table: false, ..Options::default() }));

/// x86-64 processors without fused multiply-add, from the first ones on.
const SSE2: CpuFeatures =
    CpuFeatures { sse41: false, avx: false, avx2: false, fma: false, avx512f: false };
const SSE41: CpuFeatures = CpuFeatures { sse41: true, ..SSE2 };
const AVX: CpuFeatures = CpuFeatures { avx: true, ..SSE41 };

/// With the width that each takes.
const PROCESSOR: &[(&str, Option<Width>, &Opened)] = &[
    ("exact", None, &EXACT),
    ("interp", None, &INTERP),
    ("jit_128", Some(Width::Bits128), &JIT_128),
    ("jit_128_of_one_chain", Some(Width::Bits128), &JIT_128_OF_ONE_CHAIN),
    ("jit_256", Some(Width::Bits256), &JIT_256),
    ("jit_512", Some(Width::Bits512), &JIT_512),
    ("jit_512_of_two_chains", Some(Width::Bits512), &JIT_512_OF_TWO_CHAINS),
];
/// Machine code as on processors that lack instructions.
const OLDER: &[(&str, CpuFeatures, &Opened)] =
    &[("jit_sse2", SSE2, &JIT_SSE2), ("jit_sse41", SSE41, &JIT_SSE41), ("jit_avx", AVX, &JIT_AVX)];
const GPUS: &[(&str, &Opened)] = &[
    ("gpu", &GPU),
    ("gpu_planar", &GPU_PLANAR),
    ("gpu_tiled", &GPU_TILED),
    ("gpu_fast", &GPU_FAST),
    ("gpu_without_table", &GPU_WITHOUT_TABLE),
];

fn jit(width: Width, chains: Chains) -> Box<dyn Backend + Send> {
    Box::new(Jit::with_width(width).expect("the host has it").with_chains(chains))
}

fn older(features: CpuFeatures) -> Box<dyn Backend + Send> {
    Box::new(Jit::with_features(features).expect("it needs no more than the host has"))
}

fn loading(loads: Loads) -> Options {
    Options { loads, ..Options::default() }
}

fn open(options: Options) -> Box<dyn Backend + Send> {
    Box::new(Gpu::open(&options).unwrap_or_else(|error| panic!("{error}")))
}

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let absent = adapters().is_empty() && !is_required();

    let mut trials = Vec::new();
    let processor = PROCESSOR.iter().map(|&(name, width, opened)| {
        let lacking = width.is_some_and(|width| !CpuFeatures::of_host().allow(width));
        (name, lacking, opened)
    });
    let older = OLDER.iter().map(|&(name, features, opened)| {
        let lacking =
            !cfg!(target_arch = "x86_64") || features.and(CpuFeatures::of_host()) != features;
        (name, lacking, opened)
    });
    let gpus = GPUS.iter().map(|&(name, opened)| (name, absent, opened));
    for (name, ignored, opened) in processor.chain(older).chain(gpus) {
        for case in suite::CASES {
            let name = format!("{name}::{}", case.name);
            trials.push(trial(name, ignored, || (case.check)(&***opened)));
        }
    }
    for &(name, check) in rows::CASES.iter().chain(gpu::CASES).chain(programs::CASES) {
        trials.push(trial(name.to_owned(), absent, check));
    }
    for &(name, check) in
        gpu::LONG.iter().chain(programs::LONG).chain(rows::LONG).chain(pixels::LONG)
    {
        trials.push(trial(name.to_owned(), true, check));
    }
    for &(name, check) in gpu::WITHOUT_A_GPU.iter().chain(programs::WITHOUT_A_GPU) {
        trials.push(trial(name.to_owned(), false, check));
    }
    libtest_mimic::run(&arguments, trials).exit_code()
}
