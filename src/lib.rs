#![forbid(unsafe_code)]
//! Analytic filters for Monte Carlo noise.

pub mod backend;
pub mod cli;
pub mod evolve;
pub mod expr;
pub mod plan;
pub mod report;
pub mod scene;
