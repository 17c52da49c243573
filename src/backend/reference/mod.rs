//! What filters mean, exactly, in f64: what back ends are held to.
//!
//! The [`oracle`] computes one gather of the colour, and [`meaning`] whole programs.
//! [`Exact`] is both as a back end.

mod exact;
pub mod meaning;
pub mod oracle;

pub use exact::Exact;
