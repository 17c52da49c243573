//! The native half of the Python package `tamis`.
//!
//! What people call is written in Python (`package/tamis`): signatures, defaults, docstrings.
//! Here is what they stand on: filters and denoisers as classes, arrays as the library's views of
//! memory (`array.rs`), long work that can be watched and interrupted (`patient.rs`), and errors as
//! exceptions (`errors.rs`). Nothing here computes anything.

mod array;
mod denoiser;
mod errors;
mod files;
mod filter;
mod image;
mod patient;
mod scenes;
mod search;
mod tuning;

/// The native half of `tamis`: call the functions of that package instead.
#[pyo3::pymodule]
mod _tamis {
    #[pymodule_export]
    use super::denoiser::Denoiser;
    #[pymodule_export]
    use super::files::{inspect, read};
    #[pymodule_export]
    use super::filter::{Filter, names};
    #[pymodule_export]
    use super::image::{compare, png};
    #[pymodule_export]
    use super::search::{preset, search};
    #[pymodule_export]
    use super::tuning::{settings, tune};

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
