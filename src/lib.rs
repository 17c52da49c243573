#![forbid(unsafe_code)]
//! Analytic filters for Monte Carlo noise.

pub mod expr;
pub mod scene;
