//! Functions of the caller, which this library calls.

use std::ffi::c_void;
use std::ops::ControlFlow;
use std::ptr;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;

use crate::error::Failure;
use crate::lock::{lock, try_lock};
use crate::text::for_c;
use crate::types::{TamisErrorFunction, TamisProgressMonitorFunction};

/// The caller's error function.
#[derive(Clone, Copy)]
pub(crate) struct ErrorListener {
    function: TamisErrorFunction,
    user: *mut c_void,
}

/// The caller's progress monitor.
#[derive(Clone, Copy)]
pub(crate) struct Monitor {
    function: TamisProgressMonitorFunction,
    user: *mut c_void,
}

// SAFETY: the pointer is never followed here, and the header says that functions are called from
// any thread: whoever sets one says that its data can be used so.
unsafe impl Send for ErrorListener {}
// SAFETY: as above.
unsafe impl Send for Monitor {}
// SAFETY: as above; nothing in it changes.
unsafe impl Sync for Monitor {}

impl ErrorListener {
    /// # Safety
    /// `function` is NULL, or may be called with `user` from any thread, as
    /// [`TamisErrorFunction`] says.
    pub(crate) unsafe fn new(function: TamisErrorFunction, user: *mut c_void) -> Self {
        Self { function, user }
    }

    pub(crate) fn tell(&self, failure: &Failure) {
        let Some(function) = self.function else { return };
        let message = for_c(&failure.message);
        // SAFETY: `new` was promised that it may be called so; the message is a C text that
        // lives until it returns.
        unsafe { function(self.user, failure.code, message.as_ptr()) };
    }
}

impl Default for ErrorListener {
    fn default() -> Self {
        Self { function: None, user: ptr::null_mut() }
    }
}

impl Monitor {
    /// # Safety
    /// `function` is NULL, or may be called with `user` from any thread, as
    /// [`TamisProgressMonitorFunction`] says.
    pub(crate) unsafe fn new(function: TamisProgressMonitorFunction, user: *mut c_void) -> Self {
        Self { function, user }
    }

    fn tell(&self, share: f64) -> ControlFlow<()> {
        let Some(function) = self.function else { return ControlFlow::Continue(()) };
        // SAFETY: `new` was promised that it may be called so.
        match unsafe { function(self.user, share) } {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        }
    }
}

impl Default for Monitor {
    fn default() -> Self {
        Self { function: None, user: ptr::null_mut() }
    }
}

/// One run, as its monitor sees it.
pub(crate) struct Watched {
    monitor: Monitor,
    /// The share that was told last.
    told: Mutex<f64>,
    stopped: AtomicBool,
}

impl Watched {
    pub(crate) fn new(monitor: Monitor) -> Self {
        Self { monitor, told: Mutex::new(-1.0), stopped: AtomicBool::new(false) }
    }

    /// Tells of a share, if it is the largest so far and nobody is telling of another. Waiting
    /// for who does could last forever: a monitor that filters another image may find itself
    /// doing a piece of this run.
    pub(crate) fn tell(&self, share: f64) -> ControlFlow<()> {
        if let Some(mut told) = try_lock(&self.told)
            && !self.stopped.load(Relaxed)
            && share > *told
        {
            *told = share;
            if self.monitor.tell(share).is_break() {
                self.stopped.store(true, Relaxed);
            }
        }
        match self.stopped.load(Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// Tells that all is done, if that was not told.
    pub(crate) fn finish(&self) -> Result<(), Failure> {
        // Everybody else is done: the lock is free.
        let told = *lock(&self.told);
        let last = if told < 1.0 { self.tell(1.0) } else { ControlFlow::Continue(()) };
        match last.is_break() || self.stopped.load(Relaxed) {
            true => Err(Failure::cancelled()),
            false => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    unsafe extern "C" fn until_half(user: *mut c_void, share: f64) -> bool {
        // SAFETY: the test hands in a list of shares that outlives the run.
        let told = unsafe { &*user.cast::<Mutex<Vec<f64>>>() };
        lock(told).push(share);
        share < 0.5
    }

    #[test]
    fn shares_grow_and_nothing_is_told_after_a_stop() {
        let told: Mutex<Vec<f64>> = Mutex::default();
        let user = (&raw const told).cast_mut().cast();
        // SAFETY: `told` outlives it, and has a lock.
        let watched = Watched::new(unsafe { Monitor::new(Some(until_half), user) });
        let breaks = [0.0, 0.25, 0.25, 0.1, 0.75, 1.0].map(|share| watched.tell(share).is_break());
        assert_eq!(breaks, [false, false, false, false, true, true]);
        assert!(watched.finish().is_err());
        assert_eq!(*lock(&told), [0.0, 0.25, 0.75]);
    }

    #[test]
    fn the_end_is_told_once() {
        let told: Mutex<Vec<f64>> = Mutex::default();
        let user = (&raw const told).cast_mut().cast();
        // SAFETY: `told` outlives it, and has a lock.
        let watched = Watched::new(unsafe { Monitor::new(Some(until_half), user) });
        assert!(watched.tell(0.25).is_continue());
        // It stops at the end, which counts: nothing is written yet.
        assert!(watched.finish().is_err());
        assert_eq!(*lock(&told), [0.25, 1.0]);
        assert!(Watched::new(Monitor::default()).finish().is_ok());
    }
}
