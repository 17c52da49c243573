//! Tamis for renderers in C and C++.
//!
//! `include/tamis.h` is the library's documentation for those who call it; it is generated from
//! the functions in [`calls`] and their [`types`]. The functions have the names and the
//! order of Open Image Denoise's, so that a search and a replacement port most of a renderer.
//!
//! ```text
//! calls/          what C calls: pointers in, errors to their device; no decision is made here
//! filter.rs       a filter: what was set, what of it is committed, what the latest run said
//! execution.rs    one run: images to views, the library's denoiser, the result written
//! device.rs       a device: settings, the back end, the threads
//! parameter.rs    the table of a filter's parameters
//! image.rs        an image in the caller's memory
//! slot.rs         what images can be, from the library's feature table
//! reports.rs      who is told of errors: the caller's function, and the thread that asks
//! callback.rs     functions of the caller
//! text.rs         texts in and out
//! error.rs        why calls fail
//! handle.rs       handles that are counted
//! types.rs        the numbers and functions that C and this library give each other
//! lock.rs         locks
//! ```
//!
//! A file knows those below it. `unsafe` code is in `calls/`, `execution.rs`, `image.rs`,
//! `callback.rs`, `text.rs` and `handle.rs` alone.

pub mod calls;
pub mod types;

mod callback;
mod device;
mod error;
mod execution;
mod filter;
mod handle;
mod image;
mod lock;
mod parameter;
mod reports;
mod slot;
mod text;
