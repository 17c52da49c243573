//! The calling convention of a kernel: one struct, read by machine code.
//!
//! A kernel is a function of one argument in the host's C convention, a pointer
//! to a [`Call`], and computes one row of output pixels. It reads `Call` and
//! what it points to, writes only through `out`, `scratch` and the mirrored sums'
//! addresses, calls nothing, and cannot fail. It runs these loops, each at least once:
//!
//! ```text
//! for chunk in 0..chunks              `step` pixels at a time, step = lanes × chains
//!     for run in runs                 in their order
//!         for tap in 0..run.count     in its order
//! ```
//!
//! | cursor       | starts at               | per tap       | per chunk   |
//! |--------------|-------------------------|---------------|-------------|
//! | pixel i      | `pixel`                 |               | 4 × `step`  |
//! | neighbour j  | pixel + `run.neighbour` | `run.step`    |             |
//! | mirrored sum | pixel + `run.mirror`    | `run.step`    |             |
//! | tap values   | `run.taps`              | 4 × spec.taps |             |
//! | results      | `out`                   |               | 4 × `step`  |
//!
//! `pixel` and the neighbour are distances in bytes from the start of any plane,
//! the mirrored sum is an address; all strides and steps are in bytes too. What
//! is added to the cursor of pixel i may be negative, and wraps. Result number n
//! of the row lies n × `out_stride` behind the results' cursor, mirrored sum n
//! lies n × `mirror_stride` behind its cursor. Code generators address the fields
//! through `offset_of!`, so their order is free.

/// The argument of one call: one row of output pixels.
#[repr(C)]
#[derive(Debug)]
pub(crate) struct Call {
    /// The addresses of the planes' first elements.
    pub(crate) planes: *const *const f32,
    /// Result 0 of the first pixel.
    pub(crate) out: *mut f32,
    /// From one result of a pixel to its next.
    pub(crate) out_stride: usize,
    /// From one mirrored sum of a pixel to its next.
    pub(crate) mirror_stride: usize,
    /// The first output pixel.
    pub(crate) pixel: usize,
    /// Steps in this row of pixels.
    pub(crate) chunks: usize,
    /// The runs of taps.
    pub(crate) runs: *const RunCall,
    /// How many there are.
    pub(crate) run_count: usize,
    /// Memory for what does not fit into registers, aligned to a cache line; its
    /// contents mean nothing between calls.
    pub(crate) scratch: *mut Line,
}

/// A cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line(pub(crate) [u8; 64]);

/// A run of taps.
#[repr(C)]
#[derive(Debug)]
pub(crate) struct RunCall {
    /// From pixel i to its neighbour at the first tap.
    pub(crate) neighbour: usize,
    /// From pixel i, as a distance, to the address of that neighbour's mirrored
    /// sum number 0.
    pub(crate) mirror: usize,
    /// From a tap to the next.
    pub(crate) step: usize,
    /// The uniform values of the first tap.
    pub(crate) taps: *const f32,
    /// How many taps there are.
    pub(crate) count: usize,
}
