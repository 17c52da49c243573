//! The functions of filters.

use std::ffi::{c_char, c_int, c_void};
use std::ptr;

use super::call;
use super::device::TamisDevice;
use crate::callback::Monitor;
use crate::filter::Filter;
use crate::handle;
use crate::image::{Image, Layout};
use crate::slot::Slot;
use crate::text;
use crate::types::{TamisFormat, TamisProgressMonitorFunction};

/// A filter: images, parameters, and the code that was made for them. One thread uses it at a
/// time.
pub type TamisFilter = *mut Filter;

/// Makes a filter of a committed device, with one reference, which `tamisReleaseFilter` gives
/// back. Returns NULL if that fails.
///
/// `type` is `RT` for the best filter that ships (see the parameter `quality`); the name of a
/// filter (`tamis`, `tamis-fast`, `tamis-formula`, ...); the path of a filter file; or a weight as
/// an expression.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisNewFilter(device: TamisDevice, r#type: *const c_char) -> TamisFilter {
    // SAFETY: the caller has a reference to it.
    let device = unsafe { handle::get(device) };
    call(device, ptr::null_mut(), |device| {
        // SAFETY: the caller gives a text or NULL.
        let kind = unsafe { text::read(r#type, "the filter's type") }?;
        Ok(handle::hand_out(Filter::new(device.clone(), &kind)?))
    })
}

/// Adds a reference to a filter. Does nothing for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisRetainFilter(filter: TamisFilter) {
    // SAFETY: the caller has a reference to it.
    unsafe { handle::retain(filter) };
}

/// Gives a reference to a filter back. A filter goes with its last reference. Does nothing for
/// NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisReleaseFilter(filter: TamisFilter) {
    // SAFETY: the caller has a reference to it, and gives it up.
    unsafe { handle::release(filter) };
}

/// Sets an image of a filter, which stays in the caller's memory. That is used whenever the
/// filter is executed, until the image is set anew or unset.
///
/// `name` says what it is; all are linear, row by row from the top, in the renderer's units:
///
/// - `color`: the noisy colour, 3 components. Required.
/// - `output`: where the result goes, 3 components. Required. It may be `color`, and overlap any
///   image: everything is read before anything is written.
/// - `albedo`: the albedo of what is seen, from 0 to 1, 3 components.
/// - `normal`: shading normals of length 1, in the world or in the camera, 3 components.
/// - `depth`: the distance from the camera, in any unit, 1 component.
/// - `position`: the position of what is seen in the world, 3 components.
/// - `direct`: direct light, 3 components.
/// - `secondaryAlbedo`: the albedo seen through reflections, from 0 to 1, 3 components.
/// - `alpha`: how much of the pixel is covered, from 0 to 1, 1 component. Where that and the
///   colour are 0, the result is.
/// - `colorVariance`: the variance of the pixel's mean (the samples' variance divided by their
///   number), 3 components.
/// - `albedoVariance`, `normalVariance`, `depthVariance`, `positionVariance`, `directVariance`,
///   `secondaryAlbedoVariance`: the same of another image, averaged over its components, 1
///   component.
///
/// Filters read what they know of these, and estimate variances that are not set. `format` may
/// have more components than are used: others are not read, and of `output` not written. Images
/// need no alignment.
///
/// - `devPtr`: the memory, not NULL.
/// - `width`, `height`: pixels per row, and rows; the same for all images of a filter.
/// - `byteOffset`: from `devPtr` to the first pixel.
/// - `pixelByteStride`: from a pixel to the next, at least a pixel's size; 0 if nothing lies
///   between them.
/// - `rowByteStride`: from a row to the next, at least a row's size; 0 if nothing lies between
///   them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetSharedFilterImage(
    filter: TamisFilter,
    name: *const c_char,
    dev_ptr: *mut c_void,
    format: TamisFormat,
    width: usize,
    height: usize,
    byte_offset: usize,
    pixel_byte_stride: usize,
    row_byte_stride: usize,
) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    let (pixel_stride, row_stride) = (pixel_byte_stride, row_byte_stride);
    let layout = Layout { format, width, height, byte_offset, pixel_stride, row_stride };
    call(filter, (), |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the image's name") }?;
        let slot = Slot::named(&name)?;
        filter.set_image(slot, Image::new(&name, slot.components(), dev_ptr, layout)?)
    });
}

/// Removes an image of a filter, if it has it. Names are those of `tamisSetSharedFilterImage`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisUnsetFilterImage(filter: TamisFilter, name: *const c_char) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, (), |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the image's name") }?;
        filter.unset_image(Slot::named(&name)?)
    });
}

/// Sets a switch of a filter.
///
/// - `hdr`: whether the result may be above 1. The default is true (Open Image Denoise's is
///   false); with false it is cut off at 1.
/// - `srgb`: whether `color` and `output` are encoded by the sRGB curve, from 0 to 1: the colour
///   is decoded, filtered and encoded. The default is false. `colorVariance` cannot be set then.
/// - `cleanAux`: accepted without effect. How noisy albedo, normals and the others are is read
///   from their variances, or estimated.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetFilterBool(filter: TamisFilter, name: *const c_char, value: bool) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, (), |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        filter.set_bool(&name, value)
    });
}

/// Sets a whole number of a filter.
///
/// - `quality`: one of `TAMIS_QUALITY_...`; which filter `RT` is. A filter that was chosen by
///   its name stays.
/// - `samples`: how many samples each pixel is the mean of, or 0 (the default) if that is not
///   known. Clean images gain by it.
/// - `maxMemoryMB`: accepted without effect; -1 (the default) or more. Filters use their memory
///   again row by row; a GPU's is the device's `gpuMemoryMB`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetFilterInt(filter: TamisFilter, name: *const c_char, value: c_int) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, (), |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        filter.set_int(&name, value)
    });
}

/// Sets a number of a filter.
///
/// - `strength`: how much of the result is taken, from 0 to 1 (the default); the rest is the
///   noisy colour.
/// - `inputScale`: accepted without effect. Filters follow the exposure: a colour that is twice
///   as bright has a result that is.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetFilterFloat(filter: TamisFilter, name: *const c_char, value: f32) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, (), |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        filter.set_float(&name, value)
    });
}

/// Sets a text of a filter.
///
/// - `filter`: what `tamisNewFilter` takes as the type.
/// - `repair`: what becomes of pixels that are no numbers, or beyond 1e18: `median` (the default)
///   replaces each by the median around it, `error` refuses the image, `none` leaves them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetFilterString(
    filter: TamisFilter,
    name: *const c_char,
    value: *const c_char,
) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, (), |filter| {
        // SAFETY: the caller gives texts or NULL.
        let (name, value) =
            unsafe { (text::read(name, "the name")?, text::read(value, "the value")?) };
        filter.set_string(&name, &value)
    });
}

/// A switch of a filter as it was set: `hdr`, `srgb` or `cleanAux`. Returns false if there is no
/// such switch.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisGetFilterBool(filter: TamisFilter, name: *const c_char) -> bool {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, false, |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        filter.get_bool(&name)
    })
}

/// A whole number of a filter: `quality`, `samples` or `maxMemoryMB` as it was set, or
/// `keptPixels`: how many pixels kept what was to be averaged in the latest execution, because no
/// pixel around them counts; each is counted once per mean that the filter takes. Returns 0 if
/// there is no such number, or nothing was executed yet.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisGetFilterInt(filter: TamisFilter, name: *const c_char) -> c_int {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, 0, |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        filter.get_int(&name)
    })
}

/// A number of a filter: `strength` or `inputScale` as it was set, or what the latest execution
/// took in seconds: `preparingSeconds` (images are read and features derived), `planningSeconds`
/// and `compilationSeconds` (0 where the code was there already), `filteringSeconds`. Returns 0
/// if there is no such number, or nothing was executed yet.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisGetFilterFloat(filter: TamisFilter, name: *const c_char) -> f32 {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, 0.0, |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        filter.get_float(&name)
    })
}

/// A text of a filter: `filter`, the name of what is computed; or of the latest execution:
/// `notes`, a line for each thing that there is to say (pixels that were repaired, variances that
/// were estimated), and `backend`, what ran it. Returns NULL if there is no such text, or nothing
/// was executed yet. See the top for how long texts stay.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisGetFilterString(
    filter: TamisFilter,
    name: *const c_char,
) -> *const c_char {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, ptr::null(), |filter| {
        // SAFETY: the caller gives a text or NULL.
        let name = unsafe { text::read(name, "the name") }?;
        Ok(text::give(&filter.get_string(&name)?))
    })
}

/// Sets who is told how far an execution is and says whether to go on; NULL for nobody. Takes
/// effect at once. An execution that is told to stop ends with `TAMIS_ERROR_CANCELLED` and writes
/// nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisSetFilterProgressMonitorFunction(
    filter: TamisFilter,
    function: TamisProgressMonitorFunction,
    user_ptr: *mut c_void,
) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, (), |filter| {
        // SAFETY: the caller gives a function that may be called with that pointer.
        filter.set_monitor(unsafe { Monitor::new(function, user_ptr) })
    });
}

/// Makes images and parameters that were set take effect. It has to be called before the first
/// execution, and after every change before the next one. What is wrong with them together is
/// `TAMIS_ERROR_INVALID_OPERATION`: `color`, `output` or an image that the filter cannot do without
/// is missing, or sizes differ.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisCommitFilter(filter: TamisFilter) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, (), |filter| filter.commit());
}

/// Filters the images. Returns when the result is written; if it fails, nothing is written. The
/// first execution compiles the filter for what is known of the images: which are set, and the
/// range of values of each. Later ones use the code again as long as that is the same.
///
/// `TAMIS_ERROR_INVALID_OPERATION`: the filter is not committed, or an image cannot be used.
/// `TAMIS_ERROR_CANCELLED`: the progress monitor asked to stop.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tamisExecuteFilter(filter: TamisFilter) {
    // SAFETY: the caller has a reference to it.
    let filter = unsafe { handle::get(filter) };
    call(filter, (), |filter| {
        // SAFETY: the caller keeps the images' memory, and nobody else uses it, until this
        // function returns.
        unsafe { filter.execute() }
    });
}
