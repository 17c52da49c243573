//! An f32 lane assembler, and the loops of a windowed weighted sum around it.
//!
//! Someone who knows what a weight w(i, j) *is* writes it once as a [`Body`],
//! against the instructions of [`Lanes`]; a [`Compiler`] turns it into a
//! [`Routine`] that runs it over a window around every pixel. This crate knows no
//! operator and no filter, only instructions and loops.
//!
//! ```
//! use tamis_jit::{Body, Border, Compiler, Job, Lanes, Layout, Rect, Run, WindowSpec};
//!
//! /// A Gaussian blur's weight: the same for every pixel, so a value per tap.
//! struct Gaussian;
//!
//! impl Body for Gaussian {
//!     fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
//!         vec![lanes.tap(0)]
//!     }
//! }
//!
//! // Two planes, both summed: the picture, and the constant 1.
//! let spec = WindowSpec {
//!     planes: 2,
//!     taps: 1,
//!     channels: 2,
//!     weights: 1,
//!     absolute: false,
//!     lone: false,
//!     mirrored: false,
//! };
//! let kernel = Compiler::host()?.compile(spec, None, &Gaussian)?;
//!
//! let layout = Layout::new(100, 50, 3);
//! let picture = layout.plane(Border::Zero, |_, _| 0.25);
//! let one = layout.plane(Border::Zero, |_, _| 1.0);
//! let runs = Run::square(3);
//! let squares = |y: i32| (-3..=3).map(move |x| (x * x + y * y) as f32);
//! let taps: Vec<f32> = (-3..=3).flat_map(squares).map(|d| (-d / 4.0).exp()).collect();
//!
//! let rect = Rect::all(&layout);
//! let job = Job { layout, planes: &[&picture, &one], runs: &runs, taps: &taps, rect };
//! let mut out = vec![0.0; kernel.output_shape(&job.rect).len()];
//! let shape = kernel.run(&job, &mut out, &mut [])?;
//!
//! // Blurring a constant picture leaves it as it was, at the border too.
//! for row in 0..50 {
//!     let sums = &out[shape.row(row, spec.result(0, 0))];
//!     let weights = &out[shape.row(row, spec.result(0, 1))];
//!     for (sum, weight) in sums.iter().zip(weights) {
//!         assert!((sum / weight - 0.25).abs() < 1e-6);
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where to look
//!
//! - [`Lanes`]: the instructions, each with its exact meaning in `f32`;
//!   [`Scalar`] is that meaning as a program.
//! - [`WindowSpec`]: what a kernel sums, and in which order: the bits of a result
//!   depend on neither the number of chains nor the rectangle.
//! - [`Width`]: how many lanes an instruction has. There are two code generators,
//!   Cranelift for 128 bits anywhere and one for wide vectors on x86-64, and all
//!   widths give the same bits. So do processors that lack instructions
//!   ([`Compiler::emulated`]), and other architectures ([`CrossCompiler`]).
//! - [`Layout`], [`Run`], [`Job`]: the data; mirrored kernels, which use every
//!   weight at both ends of its pair, are explained at [`WindowSpec::mirrored`].
//! - [`Routine`]: running it. Safe with any data: all that machine code relies on
//!   is checked before it starts.
//! - [`CompileError`], [`ShapeError`]: what can go wrong.

mod call;
mod compiler;
mod cranelift;
mod cross;
mod error;
mod kernel;
mod lanes;
mod scalar;
mod shape;
#[cfg(target_arch = "x86_64")]
mod wide;
mod width;
mod window;

pub use compiler::{Chains, Compiler};
pub use cross::CrossCompiler;
pub use error::{CompileError, ShapeError};
pub use kernel::Routine;
pub use lanes::{Body, Lanes, Side};
pub use scalar::Scalar;
pub use shape::{Border, Job, Layout, MirrorShape, OutputShape, Rect, Run};
pub use width::{CpuFeatures, Width};
pub use window::WindowSpec;
