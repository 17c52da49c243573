//! OpenEXR files: what is in them, chosen channels as `f32`, and RGB out.
//!
//! Read: single-part and multi-part, scan lines and tiles (the full-resolution
//! level of several), half, float and unsigned samples, every compression that
//! the `exr` crate knows. Not read, with an error that says so: files with deep
//! data or subsampled channels (in any part: the crate refuses the whole file),
//! and channels of different data windows in one request.
//!
//! **Names.** A channel's *full name* is what the rest of Tamis calls it by. In a
//! single-part file it is the channel's own name (`Albedo.R`). In a multi-part
//! file it is the part's name, a dot, and the channel's name
//! (`ViewLayer.Combined` and `R` give `ViewLayer.Combined.R`), unless the
//! channel's name starts with the part's already.
//!
//! **Trust.** Files come from anywhere. Sizes are checked against the file's
//! length before anything of that size is allocated, and a panic inside the
//! decoder becomes [`ImageError::Corrupt`](super::ImageError::Corrupt), silently.

mod decode;
mod dwa;
mod guard;
mod header;
#[cfg(test)]
mod tests;
mod write;

pub use decode::{Decoded, Pixels, Sink, decode_channels, read_channels};
pub use header::{Attributes, Channel, Header, Part, SampleKind};
pub use write::write_rgb;
