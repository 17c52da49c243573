//! Tests that may be ignored, for suites without the standard harness.
//!
//! What needs a GPU, or a program that checks what GPUs run, is shown as ignored
//! where that is absent, never as passed; with `TAMIS_REQUIRE_GPU=1` in the
//! environment its absence is a failure.
#![allow(dead_code, reason = "without the feature `gpu` nothing is absent")]

use std::panic::{AssertUnwindSafe, catch_unwind};

use libtest_mimic::Trial;

/// Whether what is absent is to be missed.
pub(crate) fn is_required() -> bool {
    std::env::var_os("TAMIS_REQUIRE_GPU").is_some_and(|value| value != "0")
}

/// A test of a name, which a panic fails.
pub(crate) fn trial(name: String, ignored: bool, check: impl Fn() + Send + 'static) -> Trial {
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
