//! Pages for browsers: one HTML file each, which holds all that it shows and fetches nothing.
//!
//! Figures and pictures are made in Rust, and tables can be read without JavaScript. Scripts are
//! for what moves: [`compare`] shows images with their range, so that a reader may choose the
//! exposure, and [`search`] draws its charts with Chart.js (`templates/vendor`).

pub mod compare;
mod crops;
mod embed;
mod ramp;
pub mod search;
