#![forbid(unsafe_code)]
//! Analytic filters for Monte Carlo noise.

pub mod evolve;
pub mod expr;
