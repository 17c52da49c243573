//! One suite for every back end, one line each below.
//!
//! A GPU that is absent is shown as ignored, never as passed; with
//! `TAMIS_REQUIRE_GPU=1` in the environment its absence is a failure.

#[path = "../fixture/mod.rs"]
mod fixture;
mod gpu;
#[path = "../harness/mod.rs"]
mod harness;
mod rows;
mod suite;

use std::process::ExitCode;
use std::sync::LazyLock;

use libtest_mimic::Arguments;
use tamis::backend::gpu::{Gpu, Options, adapters};
use tamis::backend::shader::Loads;
use tamis::backend::wgsl::Precision;
use tamis::backend::{Backend, Interpreter, Jit};
use tamis_jit::Chains;

use harness::{is_required, trial};

type Opened = LazyLock<Box<dyn Backend + Send>>;

static INTERP: Opened = LazyLock::new(|| Box::new(Interpreter));
static JIT: Opened = LazyLock::new(|| jit(Chains::Four));
static JIT_OF_ONE_CHAIN: Opened = LazyLock::new(|| jit(Chains::One));
static GPU: Opened = LazyLock::new(|| open(Options::default()));
static GPU_PLANAR: Opened = LazyLock::new(|| open(loading(Loads::Planar)));
static GPU_TILED: Opened = LazyLock::new(|| open(loading(Loads::Tiled)));
static GPU_FAST: Opened =
    LazyLock::new(|| open(Options { precision: Precision::Fast, ..Options::default() }));
static GPU_WITHOUT_TABLE: Opened =
    LazyLock::new(|| open(Options { tap_table: false, ..Options::default() }));

const PROCESSOR: &[(&str, &Opened)] =
    &[("interp", &INTERP), ("jit", &JIT), ("jit_of_one_chain", &JIT_OF_ONE_CHAIN)];
const GPUS: &[(&str, &Opened)] = &[
    ("gpu", &GPU),
    ("gpu_planar", &GPU_PLANAR),
    ("gpu_tiled", &GPU_TILED),
    ("gpu_fast", &GPU_FAST),
    ("gpu_without_table", &GPU_WITHOUT_TABLE),
];

fn jit(chains: Chains) -> Box<dyn Backend + Send> {
    Box::new(Jit::new().expect("the host has a code generator").with_chains(chains))
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
    for (backends, ignored) in [(PROCESSOR, false), (GPUS, absent)] {
        for &(name, opened) in backends {
            for case in suite::CASES {
                let name = format!("{name}::{}", case.name);
                trials.push(trial(name, ignored, || (case.check)(&***opened)));
            }
        }
    }
    for &(name, check) in rows::CASES.iter().chain(gpu::CASES) {
        trials.push(trial(name.to_owned(), absent, check));
    }
    for &(name, check) in gpu::LONG {
        trials.push(trial(name.to_owned(), true, check));
    }
    for &(name, check) in gpu::WITHOUT_A_GPU {
        trials.push(trial(name.to_owned(), false, check));
    }
    libtest_mimic::run(&arguments, trials).exit_code()
}
