//! One suite for every back end, one line each below.
//!
//! A GPU that is absent is shown as ignored, never as passed; with
//! `TAMIS_REQUIRE_GPU=1` in the environment its absence is a failure.

#[path = "../fixture/mod.rs"]
mod fixture;
mod gpu;
mod rows;
mod suite;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::LazyLock;

use libtest_mimic::{Arguments, Trial};
use tamis::backend::gpu::{Gpu, Options, adapters};
use tamis::backend::shader::Loads;
use tamis::backend::wgsl::Precision;
use tamis::backend::{Backend, Interpreter, Jit};
use tamis_jit::Chains;

type Opened = LazyLock<Box<dyn Backend + Send>>;

static INTERP: Opened = LazyLock::new(|| Box::new(Interpreter));
static JIT: Opened = LazyLock::new(|| jit(Chains::Four));
static JIT_OF_ONE_CHAIN: Opened = LazyLock::new(|| jit(Chains::One));
static GPU: Opened = LazyLock::new(|| open(Precision::Exact, Loads::Packed));
static GPU_PLANAR: Opened = LazyLock::new(|| open(Precision::Exact, Loads::Planar));
static GPU_TILED: Opened = LazyLock::new(|| open(Precision::Exact, Loads::Tiled));
static GPU_FAST: Opened = LazyLock::new(|| open(Precision::Fast, Loads::Packed));

const PROCESSOR: &[(&str, &Opened)] =
    &[("interp", &INTERP), ("jit", &JIT), ("jit_of_one_chain", &JIT_OF_ONE_CHAIN)];
const GPUS: &[(&str, &Opened)] = &[
    ("gpu", &GPU),
    ("gpu_planar", &GPU_PLANAR),
    ("gpu_tiled", &GPU_TILED),
    ("gpu_fast", &GPU_FAST),
];

fn jit(chains: Chains) -> Box<dyn Backend + Send> {
    Box::new(Jit::new().expect("the host has a code generator").with_chains(chains))
}

fn open(precision: Precision, loads: Loads) -> Box<dyn Backend + Send> {
    let options = Options { precision, loads, ..Options::default() };
    Box::new(Gpu::open(&options).unwrap_or_else(|error| panic!("{error}")))
}

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let required = std::env::var_os("TAMIS_REQUIRE_GPU").is_some_and(|value| value != "0");
    let absent = adapters().is_empty() && !required;

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

fn trial(name: String, ignored: bool, check: impl Fn() + Send + 'static) -> Trial {
    let test = move || {
        catch_unwind(AssertUnwindSafe(check)).map_err(|panic| {
            let text = panic.downcast_ref::<String>().cloned();
            text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
                .unwrap_or_else(|| "panicked".to_owned())
                .into()
        })
    };
    Trial::test(name, test).with_ignored_flag(ignored)
}
