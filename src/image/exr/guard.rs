//! The decoder at arm's length: whatever it does with a damaged file becomes an error.
//!
//! The `exr` crate guards against most damaged files by errors, but asserts some
//! invariants that a damaged file can break. Such a panic is caught, and says nothing on
//! stderr: the error says it all, and a library has no business there. What is printed is
//! up to the process' panic hook, so the first step puts one in front of whatever hook
//! there is: it is silent for a thread that is inside a step, and hands all other panics
//! on. A program that sets a hook of its own later has the last word, at the price of
//! messages about damaged files.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::Once;
use std::thread;

use crate::image::ImageError;

thread_local! {
    /// Whether this thread is inside a step. A step runs the decoder and nothing else on
    /// its thread, so that nobody else's panic can happen in one.
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

/// The step panicked. With what, nobody could use.
struct Panicked;

/// Runs a step; that it panics is a result like others.
fn catch_quietly<T>(step: impl FnOnce() -> T) -> Result<T, Panicked> {
    static HOOK: Once = Once::new();
    // A thread that unwinds may not touch the hook.
    if !thread::panicking() {
        HOOK.call_once(|| {
            let previous = panic::take_hook();
            panic::set_hook(Box::new(move |panic| {
                if !INSIDE.get() {
                    previous(panic);
                }
            }));
        });
    }
    let outside = INSIDE.replace(true);
    let result = panic::catch_unwind(AssertUnwindSafe(step));
    INSIDE.set(outside);
    result.map_err(|_| Panicked)
}

/// Runs a decoder step; its errors and its panics become errors about `path`.
pub(super) fn guarded<T>(
    path: &Path,
    step: impl FnOnce() -> exr::error::Result<T>,
) -> Result<T, ImageError> {
    let corrupt = |detail: String| ImageError::Corrupt { path: path.to_owned(), detail };
    match catch_quietly(step) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(exr::error::Error::Io(source))) => {
            Err(ImageError::Io { path: path.to_owned(), action: "read", source })
        }
        Ok(Err(exr::error::Error::NotSupported(what))) => Err(unsupported(path, &what)),
        // The crate's words for an unexpected end of the file.
        Ok(Err(exr::error::Error::Invalid(what))) if what == "reference to missing bytes" => {
            Err(corrupt("it ends too early".to_owned()))
        }
        Ok(Err(exr::error::Error::Invalid(what))) => Err(corrupt(what.into_owned())),
        Ok(Err(exr::error::Error::Aborted)) => Err(corrupt("reading was aborted".to_owned())),
        Err(Panicked) => Err(corrupt("its contents break the decoder's assumptions".to_owned())),
    }
}

/// The crate refuses a file as a whole for one part that it cannot read.
fn unsupported(path: &Path, what: &str) -> ImageError {
    let (what, advice) = if what.contains("deep") {
        (
            "the file holds deep data (several samples per pixel)".to_owned(),
            "flatten it to one sample per pixel",
        )
    } else if what.contains("subsampling") {
        (
            "the file holds a channel with fewer samples than pixels (subsampled)".to_owned(),
            "save the image as RGB, not as luminance and chroma",
        )
    } else {
        (
            format!("the file needs something that is not supported ({what})"),
            "save it as a flat OpenEXR 2 file with ZIP compression",
        )
    };
    ImageError::Unsupported { path: path.to_owned(), what, advice }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_silent_inside_a_step_alone() {
        let caught = catch_quietly(|| {
            assert!(INSIDE.get());
            assert!(catch_quietly(|| assert!(INSIDE.get())).is_ok());
            assert!(INSIDE.get(), "a step within a step ends itself only");
            panic!("the decoder's assumptions are broken");
        });
        assert!(caught.is_err());
        assert!(!INSIDE.get(), "also after a panic");
        let elsewhere = catch_quietly(|| thread::spawn(|| INSIDE.get()).join());
        assert!(elsewhere.is_ok_and(|inside| inside.is_ok_and(|inside| !inside)));
    }
}
