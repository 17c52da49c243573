//! OpenEXR files: what is in them, chosen channels as `f32`, and RGB out.
//!
//! Read: single-part and multi-part, scan lines and tiles (the full-resolution level of
//! several), half, float and unsigned samples, every compression that the `exr` crate knows,
//! parts of other data windows than the colour's, and files with deep parts or subsampled
//! channels, as long as nobody wants those.
//!
//! **Whole files.** [`rewrite`] writes a file like another with some channels replaced; it
//! takes along all the rest, understood or not.
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
mod rewrite;
mod source;
#[cfg(test)]
mod tests;
mod write;

pub(crate) use decode::Memory;
pub use decode::{Decoded, Pixels, Sink, Unfinished, decode_channels};
pub use header::{Attributes, Channel, Header, Part, SampleKind, Window};
pub use rewrite::{Lost, Replacement, rewrite};
pub use write::write_rgb;
