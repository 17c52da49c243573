//! The functions that C calls, and how each begins and ends.
#![allow(non_snake_case, reason = "the names are Open Image Denoise's but for their beginning")]
#![allow(
    clippy::missing_safety_doc,
    reason = "the header says once what handles and pointers have to be; docs say the rest"
)]

pub mod device;
pub mod filter;

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use crate::device::Device;
use crate::error::Failure;
use crate::filter::Filter;
use crate::reports::{Errors, report_without_device};
use crate::types::TAMIS_ERROR_UNKNOWN;

/// What a handle stands for.
trait Owner {
    /// What messages call it.
    const WHAT: &str;

    /// Whom its errors are for.
    fn errors(&self) -> &Errors;
}

impl Owner for Device {
    const WHAT: &str = "device";

    fn errors(&self) -> &Errors {
        &self.errors
    }
}

impl Owner for Filter {
    const WHAT: &str = "filter";

    fn errors(&self) -> &Errors {
        &self.device.errors
    }
}

/// Does what a function of the library does. If that fails, the function returns `otherwise`, and
/// the device gets the error; this thread, if there is no device.
fn call<T: Owner, R>(
    owner: Option<Arc<T>>,
    otherwise: R,
    work: impl FnOnce(&Arc<T>) -> Result<R, Failure>,
) -> R {
    let Some(owner) = owner else {
        report_without_device(Failure::argument(format!("the {} is NULL", T::WHAT)));
        return otherwise;
    };
    match caught(|| work(&owner)) {
        Ok(result) => result,
        Err(failure) => {
            owner.errors().report(failure);
            otherwise
        }
    }
}

/// The same where there is no device yet.
fn call_without_device<R>(otherwise: R, work: impl FnOnce() -> Result<R, Failure>) -> R {
    caught(work).unwrap_or_else(|failure| {
        report_without_device(failure);
        otherwise
    })
}

/// A panic is a mistake of this library. C is told of it as of any other error.
fn caught<R>(work: impl FnOnce() -> Result<R, Failure>) -> Result<R, Failure> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let message = format!("a mistake in Tamis: {}; please report it", said(&*panic));
        Err(Failure::new(TAMIS_ERROR_UNKNOWN, message))
    })
}

fn said(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it panicked")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reports::take_without_device;

    #[test]
    fn a_panic_is_an_error() {
        let result = call_without_device(7, || panic!("no such row: {}", 3));
        assert_eq!(result, 7);
        let failure = take_without_device().expect("it was kept");
        assert_eq!(failure.code, TAMIS_ERROR_UNKNOWN);
        assert!(failure.message.contains("no such row: 3"), "{failure:?}");
    }
}
