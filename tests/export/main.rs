//! Exports, as people use them: code is given to compilers, and C is run; all
//! are compared with those that were read and found right.
//!
//! Compilers of shading languages that are absent are shown as ignored, never as
//! passed; with `TAMIS_REQUIRE_GPU=1` in the environment their absence is a
//! failure.

mod c;
mod every;
#[path = "../fixture/mod.rs"]
mod fixture;
#[path = "../fixture/programs.rs"]
mod fixture_programs;
#[path = "../harness/mod.rs"]
mod harness;
mod latex;
mod programs;
mod python;
#[cfg(feature = "gpu")]
mod shading;

use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};
use tamis::export::{Language, Options, export};
use tamis::expr::codebook;
use tamis::filter::{Filter, Window};
use tamis::plan::Precision;

use harness::trial;

fn main() -> ExitCode {
    let cases = c::CASES.iter().chain(programs::CASES).chain(latex::CASES).chain(every::CASES);
    #[cfg(feature = "gpu")]
    let cases = cases.chain(shading::CASES);
    let trials = cases.map(|&(name, check)| trial(name.to_owned(), false, check));
    #[cfg(feature = "gpu")]
    let trials = trials.chain(shading::compiled());
    let trials: Vec<Trial> = trials.chain(python::trials()).chain(latex::typeset()).collect();
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}

/// An export that is one file.
fn exported(filter: &Filter, language: Language, options: &Options<'_>) -> Vec<u8> {
    let exported = export(filter, language, options).unwrap_or_else(|error| panic!("{error}"));
    exported.into_file().expect("it is no folder")
}

/// The same for renderers that have all features.
fn bytes(filter: &Filter, language: Language, precision: Precision) -> Vec<u8> {
    exported(filter, language, &Options { precision, without: &[] })
}

/// An exact export in a language that is text.
fn text(filter: &Filter, language: Language) -> String {
    let bytes = bytes(filter, language, Precision::Standard);
    String::from_utf8(bytes).expect("the language is text")
}

/// The single weights that have names.
fn known() -> Vec<Filter> {
    let known = codebook::known().iter();
    known
        .map(|known| Filter::single(known.name, known.weight.clone(), Window::DEFAULT_RADIUS))
        .collect()
}
