//! The functions of devices.

use std::ffi::{c_char, c_int, c_void};
use std::ptr;

use super::{call, call_without_device};
use crate::callback::ErrorListener;
use crate::device::Device;
use crate::handle;
use crate::reports::take_without_device;
use crate::text;
use crate::types::{
    TAMIS_ERROR_NONE, TAMIS_VERSION, TamisDeviceType, TamisError, TamisErrorFunction,
};

/// A device: what runs filters, and on how many threads. Several threads may use one.
pub type TamisDevice = *mut Device;

/// The version of the library that is loaded, as `TAMIS_VERSION` is that of this header.
#[unsafe(no_mangle)]
pub extern "C" fn tamisGetVersion() -> c_int {
    TAMIS_VERSION
}

/// Makes a device with one reference, which `tamisReleaseDevice` gives back. It can be used once
/// it is committed. Returns NULL if there is no such type (`TAMIS_ERROR_INVALID_ARGUMENT`, which
/// `tamisGetDeviceError(NULL, ...)` gives).
#[unsafe(no_mangle)]
pub extern "C" fn tamisNewDevice(r#type: TamisDeviceType) -> TamisDevice {
    call_without_device(ptr::null_mut(), || Ok(handle::hand_out(Device::new(r#type)?)))
}

/// Adds a reference to a device. Does nothing for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisRetainDevice(device: TamisDevice) {
    // SAFETY: the caller has a reference to it.
    unsafe { handle::retain(device) };
}

/// Gives a reference to a device back. A device goes with its last reference; each of its
/// filters has one. Does nothing for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisReleaseDevice(device: TamisDevice) {
    // SAFETY: the caller has a reference to it, and gives it up.
    unsafe { handle::release(device) };
}

/// Sets a switch of a device. There is one, `setAffinity`, which is accepted without effect:
/// threads are never bound to cores.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetDeviceBool(device: TamisDevice, name: *const c_char, value: bool) {
    // SAFETY: the caller has a reference to it.
    let device = unsafe { handle::get(device) };
    call(device, (), |device| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        device.set_bool(&name, value)
    });
}

/// Sets a number of a device. No result depends on them.
///
/// - `numThreads`: from 1 to 4096, or 0 (the default) for as many as the processor has.
/// - `gpuMemoryMB`: the memory for buffers on a GPU, in MiB, at least 1; the default is 1024.
///   Images that need more are filtered in tiles.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetDeviceInt(device: TamisDevice, name: *const c_char, value: c_int) {
    // SAFETY: the caller has a reference to it.
    let device = unsafe { handle::get(device) };
    call(device, (), |device| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        device.set_int(&name, value)
    });
}

/// Sets a text of a device.
///
/// - `backend`: what runs filters, instead of what the device's type says: `jit` (machine code),
///   `interp` (the interpreter: the same bits, more slowly), `gpu`, `auto`, or `exact` (what
///   filters mean, in double precision, in hundreds of times the time).
/// - `gpu`: which GPU, if one is used: its index or a part of its name; "" for the best one.
/// - `precision`: `standard` (the default; within 1e-5 of the exact colour) or `fast` (1e-4).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetDeviceString(
    device: TamisDevice,
    name: *const c_char,
    value: *const c_char,
) {
    // SAFETY: the caller has a reference to it.
    let device = unsafe { handle::get(device) };
    call(device, (), |device| {
        // SAFETY: the caller gives texts or NULL.
        let (name, value) =
            unsafe { (text::read(name, "the name")?, text::read(value, "the value")?) };
        device.set_string(&name, &value)
    });
}

/// A number of a device: `numThreads` or `gpuMemoryMB` as it was set, or `version`, the library's. Returns 0 if
/// there is no such number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisGetDeviceInt(device: TamisDevice, name: *const c_char) -> c_int {
    // SAFETY: the caller has a reference to it.
    let device = unsafe { handle::get(device) };
    call(device, 0, |device| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        device.get_int(&name)
    })
}

/// A text of a device that is committed: `backend`, what runs filters, or `remarks`, a line for
/// each thing that there is to say of it: which GPU was taken, why none was, that one failed.
/// Returns NULL if there is no such text. See the top for how long
/// texts stay.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisGetDeviceString(
    device: TamisDevice,
    name: *const c_char,
) -> *const c_char {
    // SAFETY: the caller has a reference to it.
    let device = unsafe { handle::get(device) };
    call(device, ptr::null(), |device| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        Ok(text::give(&device.get_string(&name)?))
    })
}

/// Sets who is told of every error of the device and of its filters; NULL for nobody. Takes
/// effect at once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetDeviceErrorFunction(
    device: TamisDevice,
    function: TamisErrorFunction,
    user_ptr: *mut c_void,
) {
    // SAFETY: the caller has a reference to it.
    let device = unsafe { handle::get(device) };
    call(device, (), |device| {
        // SAFETY: the caller gives a function that may be called with that pointer.
        device.errors.listen(unsafe { ErrorListener::new(function, user_ptr) });
        Ok(())
    });
}

/// Takes the first error of this thread's calls that it did not ask for yet, and returns its
/// code; `TAMIS_ERROR_NONE` if there is none. With NULL for the device it takes that of calls
/// that had no device: which got NULL for one, or for a filter, or failed to make one.
///
/// If `outMessage` is not NULL, it gets the message, or NULL if there is no error. See the
/// top for how long texts stay.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisGetDeviceError(
    device: TamisDevice,
    out_message: *mut *const c_char,
) -> TamisError {
    // SAFETY: the caller has a reference to it, or gives NULL.
    let failure = match unsafe { handle::get(device) } {
        Some(device) => device.errors.take(),
        None => take_without_device(),
    };
    let message = failure.as_ref().map(|failure| text::give(&failure.message));
    if !out_message.is_null() {
        // SAFETY: it is not NULL, so the caller gives a place for a pointer.
        unsafe { out_message.write(message.unwrap_or(ptr::null())) };
    }
    failure.map_or(TAMIS_ERROR_NONE, |failure| failure.code)
}

/// Makes what was set take effect: opens the back end and starts the threads. It has to be called
/// before the first filter is made, and after every change before the next filter is made or
/// committed. `TAMIS_ERROR_UNSUPPORTED_HARDWARE`: this computer does not have the device.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisCommitDevice(device: TamisDevice) {
    // SAFETY: the caller has a reference to it.
    let device = unsafe { handle::get(device) };
    call(device, (), |device| device.commit());
}
