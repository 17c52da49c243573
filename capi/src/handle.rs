//! Handles: pointers that stand for counted references.

use std::sync::Arc;

/// A handle with one reference, which [`release`] gives back.
pub(crate) fn hand_out<T>(value: T) -> *mut T {
    Arc::into_raw(Arc::new(value)).cast_mut()
}

/// What a handle stands for, kept alive while the caller has it; nothing for NULL.
///
/// # Safety
/// `handle` is NULL, or comes from [`hand_out`] and somebody has a reference to it.
pub(crate) unsafe fn get<T>(handle: *const T) -> Option<Arc<T>> {
    if handle.is_null() {
        return None;
    }
    // SAFETY: it is not NULL, so it comes from `hand_out`, which is `Arc::into_raw`; the
    // reference that somebody has keeps the count above zero. The count that is added is the
    // one that `from_raw` takes over.
    unsafe {
        Arc::increment_strong_count(handle);
        Some(Arc::from_raw(handle))
    }
}

/// Adds a reference; does nothing for NULL.
///
/// # Safety
/// As for [`get`].
pub(crate) unsafe fn retain<T>(handle: *const T) {
    if !handle.is_null() {
        // SAFETY: as in `get`.
        unsafe { Arc::increment_strong_count(handle) };
    }
}

/// Takes a reference away, and with the last one what the handle stands for; does nothing for
/// NULL.
///
/// # Safety
/// `handle` is NULL, or comes from [`hand_out`] and the caller has a reference to it, which it
/// does not use any more.
pub(crate) unsafe fn release<T>(handle: *const T) {
    if !handle.is_null() {
        // SAFETY: it comes from `Arc::into_raw`, and the caller's reference is the one that is
        // taken away.
        drop(unsafe { Arc::from_raw(handle) });
    }
}
