//! The CPU back ends: the interpreter, which is the reference, and machine code. They
//! give the same bits, as they differ in nothing but how a tape's code is run.
//!
//! [`paper`] runs filters of one gather of the colour, and batches of them; [`program`]
//! walks the kernels of programs. Both hand strips of rows to threads.

mod band;
mod block;
mod gradient;
mod interp;
#[cfg(feature = "jit")]
mod jit;
#[cfg(test)]
mod numerics;
mod paper;
mod program;
mod rows;
mod sums;
mod transpose;
mod uniform;

pub use interp::Interpreter;
#[cfg(feature = "jit")]
pub use jit::Jit;
#[cfg(feature = "gpu")]
pub(super) use paper::dense_taps;
