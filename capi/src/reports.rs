//! Who is told of errors.

use std::cell::RefCell;
use std::sync::{Arc, Mutex, Weak};

use crate::callback::ErrorListener;
use crate::error::Failure;
use crate::lock::lock;

/// The errors of a device: who is told of all, and of every thread the first that it has not
/// asked for yet.
#[derive(Default)]
pub(crate) struct Errors {
    /// What the threads' errors name the device by.
    device: Arc<()>,
    listener: Mutex<ErrorListener>,
}

/// A device's error that its thread has not asked for.
struct Pending {
    device: Weak<()>,
    failure: Failure,
}

thread_local! {
    /// What failed on this thread, by device. It goes with the thread, and with the devices.
    static PENDING: RefCell<Vec<Pending>> = const { RefCell::new(Vec::new()) };
    /// What failed on this thread without a device.
    static WITHOUT_DEVICE: RefCell<Option<Failure>> = const { RefCell::new(None) };
}

impl Errors {
    /// Keeps an error, and tells whoever listens. No lock is held while the caller's function
    /// runs, so that it may call this library.
    pub(crate) fn report(&self, failure: Failure) {
        let listener = *lock(&self.listener);
        listener.tell(&failure);
        // A thread that ends asks for no error any more.
        let _ = PENDING.try_with(|pending| {
            let mut pending = pending.borrow_mut();
            pending.retain(|other| other.device.strong_count() > 0);
            if !pending.iter().any(|other| self.is_of(other)) {
                pending.push(Pending { device: Arc::downgrade(&self.device), failure });
            }
        });
    }

    /// Takes the error of this thread.
    pub(crate) fn take(&self) -> Option<Failure> {
        let taken = PENDING.try_with(|pending| {
            let mut pending = pending.borrow_mut();
            let place = pending.iter().position(|pending| self.is_of(pending))?;
            Some(pending.swap_remove(place).failure)
        });
        taken.ok().flatten()
    }

    pub(crate) fn listen(&self, listener: ErrorListener) {
        *lock(&self.listener) = listener;
    }

    fn is_of(&self, pending: &Pending) -> bool {
        pending.device.as_ptr() == Arc::as_ptr(&self.device)
    }
}

/// Keeps an error that no device has.
pub(crate) fn report_without_device(failure: Failure) {
    let _ = WITHOUT_DEVICE.try_with(|pending| {
        pending.borrow_mut().get_or_insert(failure);
    });
}

/// Takes the error of this thread that no device has.
pub(crate) fn take_without_device() -> Option<Failure> {
    WITHOUT_DEVICE.try_with(|pending| pending.borrow_mut().take()).ok().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_device_keeps_its_first_error_and_takes_it_along() {
        let (first, second) = (Errors::default(), Errors::default());
        for (errors, message) in [(&first, "a"), (&first, "b"), (&second, "c")] {
            errors.report(Failure::argument(message));
        }
        assert_eq!(first.take().expect("it was kept").message, "a");
        assert!(first.take().is_none());
        drop(second);
        first.report(Failure::argument("d"));
        PENDING.with(|pending| assert_eq!(pending.borrow().len(), 1, "the second device is gone"));
        let other = std::thread::scope(|scope| scope.spawn(|| first.take()).join());
        assert!(other.expect("it does not panic").is_none(), "errors are a thread's own");
    }
}
