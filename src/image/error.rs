//! What can go wrong with images and their files: one enum, each case naming the file,
//! what was expected, what the file has instead, and what to do.

use std::io;
use std::path::PathBuf;

/// Why an image or a file could not be read, compared or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The operating system refused.
    #[error("{path}: cannot {action}: {source}", path = path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried, as a verb.
        action: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// The file is no OpenEXR file at all.
    #[error(
        "{path}: not an OpenEXR file (the first four bytes are not 76 2f 31 01), nor PFM, TIFF \
         or PNG: images are read from these",
        path = path.display()
    )]
    NotExr {
        /// The file.
        path: PathBuf,
    },
    /// The file claims to be OpenEXR, but its contents contradict that.
    #[error(
        "{path}: damaged or incomplete OpenEXR file ({detail}); render or copy it again",
        path = path.display()
    )]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// What contradicts what.
        detail: String,
    },
    /// The file cannot be read as what it begins like.
    #[error("{path}: it cannot be read as {format}: {detail}", path = path.display())]
    NotRead {
        /// The file.
        path: PathBuf,
        /// The format.
        format: &'static str,
        /// Why not.
        detail: String,
    },
    /// A sound file of a kind that is not read.
    #[error("{path}: {what}; {advice}", path = path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it is or has.
        what: String,
        /// How to get one that is read.
        advice: &'static str,
    },
    /// A channel asked for by its full name is not there.
    #[error("{path}: no channel \"{channel}\"; the file has {present}", path = path.display())]
    MissingChannel {
        /// The file.
        path: PathBuf,
        /// The full name asked for.
        channel: String,
        /// What the file has, as text.
        present: String,
    },
    /// A render that was not finished.
    #[error(
        "{path}: the render was not finished: {missing} of {rows} rows are missing; render it \
         again, or read what is there with `--repair median`",
        path = path.display()
    )]
    Unfinished {
        /// The file.
        path: PathBuf,
        /// Rows in which pixels are missing.
        missing: usize,
        /// Of how many.
        rows: usize,
    },
    /// Two images that are to be compared differ in size.
    #[error(
        "{image} is {}x{} pixels but {reference} is {}x{}; \
         only images of the same size can be compared",
        size.0, size.1, reference_size.0, reference_size.1
    )]
    SizeMismatch {
        /// Name of the one.
        image: String,
        /// Its width and height.
        size: (usize, usize),
        /// Name of the other.
        reference: String,
        /// Its width and height.
        reference_size: (usize, usize),
    },
    /// Pixels of a reference that are no numbers.
    #[error(
        "{image}: channel \"{channel}\" has {count} pixel(s) that are not finite or beyond \
         ±1e18, the first at x = {}, y = {}; nothing can be measured against them: \
         render the reference again",
        first.0, first.1
    )]
    BadReference {
        /// What errors call the image.
        image: String,
        /// The channel's full name.
        channel: String,
        /// How many.
        count: usize,
        /// Where the first one is.
        first: (usize, usize),
    },
}

/// A channel list for an error message: sorted as the file has it, cut where it
/// would stop being read.
pub(crate) fn listing<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const SHOWN: usize = 48;
    let names: Vec<&str> = names.collect();
    match names.len() {
        0 => "no channels".to_owned(),
        n if n <= SHOWN => names.join(", "),
        n => format!("{}, … and {} more", names[..SHOWN].join(", "), n - SHOWN),
    }
}
