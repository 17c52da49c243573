//! The calling convention of a kernel: one struct, read by machine code.
//!
//! A kernel is a function of one argument in the host's C convention, a pointer
//! to a [`Call`], and computes one row of output pixels. It reads `Call` and
//! what it points to, writes only through `out`, calls nothing, and cannot fail.
//! It runs these loops, each at least once:
//!
//! ```text
//! for chunk in 0..chunks              `step` pixels at a time, step = 4 lanes × chains
//!     for row in 0..rows              taps, top to bottom
//!         for column in 0..columns    taps, left to right
//! ```
//!
//! | cursor      | starts at   | per column     | per row        | per chunk   |
//! |-------------|-------------|----------------|----------------|-------------|
//! | pixel i     | `pixel`     |                |                | 4 × `step`  |
//! | neighbour j | `neighbour` | `column_step`  | `row_step`     | 4 × `step`  |
//! | tap values  | `taps`      | 4 × spec.taps  | (runs on)      | (restarts)  |
//! | results     | `out`       |                |                | 4 × `step`  |
//!
//! `pixel` and `neighbour` are distances in bytes from the start of any plane;
//! all strides and steps are in bytes too. Result number n of the row lies
//! n × `out_stride` behind the results' cursor. Code generators address the
//! fields through `offset_of!`, so their order is free.

/// The argument of one call: one row of output pixels.
#[repr(C)]
#[derive(Debug)]
pub(crate) struct Call {
    /// The addresses of the planes' first elements.
    pub(crate) planes: *const *const f32,
    /// The uniform values of the first tap.
    pub(crate) taps: *const f32,
    /// Result 0 of the first pixel.
    pub(crate) out: *mut f32,
    /// From one result of a pixel to its next.
    pub(crate) out_stride: usize,
    /// The first output pixel.
    pub(crate) pixel: usize,
    /// Its neighbour at the first tap.
    pub(crate) neighbour: usize,
    /// Steps in this row of pixels.
    pub(crate) chunks: usize,
    /// Rows of taps that lie inside the image.
    pub(crate) rows: usize,
    /// From a row of taps to the next.
    pub(crate) row_step: usize,
    /// Taps in a row.
    pub(crate) columns: usize,
    /// From a tap to the next.
    pub(crate) column_step: usize,
}
