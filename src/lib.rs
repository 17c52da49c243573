#![forbid(unsafe_code)]
//! Tamis (a cook's drum sieve) discovers analytic filters for Monte Carlo noise
//! by genetic programming, compiles each candidate to machine code, and applies
//! the best one to a renderer's images.
//!
//! A filter is a weight w(i, j) for a pair of pixels, an expression over the
//! features that a renderer writes beside its colours. The filtered colour is
//! the weighted mean ĉ_i = Σ_j c_j w(i, j) / Σ_j w(i, j) over a window.
//!
//! # A tour
//!
//! ```
//! use tamis::backend::{Backend, Interpreter, Rect};
//! use tamis::expr::{Feature, Quantity, Tree};
//! use tamis::filter::Window;
//! use tamis::plan::{Passes, Plan};
//! use tamis::scene::{Facts, LoadOptions, Needs, RawScene};
//!
//! // 1. An expression: nearby pixels with similar normals count most.
//! let weight: Tree =
//!     "exp(-distance1(pixel, pixel) / 4) * biweight(distance2(normal, normal))".parse()?;
//!
//! // 2. A scene. `Scene::load` reads one from EXR; this one is made of numbers:
//! //    a grey wall and a white one, with alternating "noise".
//! let (width, height) = (32, 8);
//! let image = |f: &dyn Fn(usize) -> f32| (0..width * height).map(f).collect::<Vec<f32>>();
//! let wall = |k: usize| if k % width < 16 { 0.2 } else { 0.8 };
//! let noisy = image(&|k| wall(k) + if (k + k / width) % 2 == 0 { 0.1 } else { -0.1 });
//! let normal = [image(&|k| f32::from(u8::from(wall(k) > 0.5))), image(&|_| 0.0), image(&|_| 0.0)];
//! let scene = RawScene::new("walls", width, height, [noisy.clone(), noisy.clone(), noisy])
//!     .with(Feature::Normal, Quantity::Value, normal.into())
//!     .prepare(&Needs::everything(), 10, &LoadOptions::default())?;
//!
//! // 3. A plan: the expression, specialised to what is known of the scene.
//! let plan = Plan::new(&[weight], Window::dense(5), &Facts::of(&scene), Passes::ALL)?;
//!
//! // 4. A back end runs it. The noise is gone and the edge is not.
//! let code = Interpreter.compile(&plan)?;
//! let filtered = code.run(&scene, &[Rect::whole(&scene)])?.swap_remove(0);
//! assert!(filtered.pixels.iter().enumerate().all(|(k, p)| (p[0] - wall(k)).abs() < 0.02));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where to look
//!
//! - [`expr`]: the language. [`expr::Op`] is the operator table,
//!   [`expr::Feature`] the features, [`expr::Tree`] an expression,
//!   [`expr::tape`] the primitives that everything is made of.
//! - [`image`]: images, OpenEXR files, metrics.
//! - [`scene`]: features to normalised planes and facts about them.
//! - [`plan`]: the passes; filters and their files.
//! - [`denoise`]: files, and frames in memory, filtered: where other programs begin.
//! - [`backend`]: interpreter, machine code, and the exact oracle.
//! - [`tune`]: constants of programs, by gradients.
//! - [`evolve`]: the search.
//! - [`explain`]: what a filter's parts are for.
//! - [`export`]: filters as code and equations for others.
//! - [`stress`]: whether a filter can be relied on.
//!
//! Floors and reasons are in `ARCHITECTURE.md`.

pub mod backend;
#[cfg(feature = "cli")]
pub mod cli;
pub mod denoise;
pub mod evolve;
pub mod explain;
pub mod export;
pub mod expr;
pub mod filter;
pub mod image;
pub mod plan;
pub mod report;
pub mod scene;
pub mod stress;
pub mod tune;
