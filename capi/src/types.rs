//! The numbers and the functions that C and this library give each other.
//!
//! Numbers are plain `int`s and no enumerations: whatever C hands in is a value that can be
//! looked at.
#![allow(non_snake_case, reason = "C reads the parameters' names in the header")]

use std::ffi::{c_char, c_int, c_void};

/// The version of the library: 10000 times the major, plus 100 times the minor, plus the patch
/// number.
pub const TAMIS_VERSION: c_int = 100;

/// What runs filters: one of `TAMIS_DEVICE_TYPE_...`.
pub type TamisDeviceType = c_int;

/// The processor, by machine code.
pub const TAMIS_DEVICE_TYPE_DEFAULT: TamisDeviceType = 0;
/// The processor, by machine code.
pub const TAMIS_DEVICE_TYPE_CPU: TamisDeviceType = 1;
/// A GPU, through Vulkan, Metal or Direct3D 12.
pub const TAMIS_DEVICE_TYPE_GPU: TamisDeviceType = 2;
/// A GPU if there is one that is no program itself, with the processor behind it.
pub const TAMIS_DEVICE_TYPE_AUTO: TamisDeviceType = 3;

/// What went wrong: one of `TAMIS_ERROR_...`.
pub type TamisError = c_int;

/// Nothing went wrong.
pub const TAMIS_ERROR_NONE: TamisError = 0;
/// Something else, a mistake of this library included.
pub const TAMIS_ERROR_UNKNOWN: TamisError = 1;
/// An argument makes no sense: a handle or a pointer is NULL, a name is unknown, a size, a
/// format or a value is out of its range.
pub const TAMIS_ERROR_INVALID_ARGUMENT: TamisError = 2;
/// The function cannot be called now: something is not committed, an image is missing, or
/// another call is using the filter.
pub const TAMIS_ERROR_INVALID_OPERATION: TamisError = 3;
/// There is too little memory on the GPU.
pub const TAMIS_ERROR_OUT_OF_MEMORY: TamisError = 4;
/// This computer does not have the device that was asked for.
pub const TAMIS_ERROR_UNSUPPORTED_HARDWARE: TamisError = 5;
/// The progress monitor returned false.
pub const TAMIS_ERROR_CANCELLED: TamisError = 6;

/// What a pixel of an image is: one of `TAMIS_FORMAT_...`. The numbers are those of Open Image
/// Denoise.
pub type TamisFormat = c_int;

/// No format: it is refused.
pub const TAMIS_FORMAT_UNDEFINED: TamisFormat = 0;
/// One number of 32 bits.
pub const TAMIS_FORMAT_FLOAT: TamisFormat = 1;
/// Two numbers of 32 bits.
pub const TAMIS_FORMAT_FLOAT2: TamisFormat = 2;
/// Three numbers of 32 bits.
pub const TAMIS_FORMAT_FLOAT3: TamisFormat = 3;
/// Four numbers of 32 bits.
pub const TAMIS_FORMAT_FLOAT4: TamisFormat = 4;
/// One number of 16 bits (IEEE 754 binary16).
pub const TAMIS_FORMAT_HALF: TamisFormat = 257;
/// Two numbers of 16 bits.
pub const TAMIS_FORMAT_HALF2: TamisFormat = 258;
/// Three numbers of 16 bits.
pub const TAMIS_FORMAT_HALF3: TamisFormat = 259;
/// Four numbers of 16 bits.
pub const TAMIS_FORMAT_HALF4: TamisFormat = 260;

/// How good a result has to be: one of `TAMIS_QUALITY_...`. The numbers are those of Open Image
/// Denoise.
pub type TamisQuality = c_int;

/// The filter `tamis`.
pub const TAMIS_QUALITY_DEFAULT: TamisQuality = 0;
/// The filter `tamis-fast`: about two thirds of the time, and some more error.
pub const TAMIS_QUALITY_FAST: TamisQuality = 4;
/// The filter `tamis`.
pub const TAMIS_QUALITY_BALANCED: TamisQuality = 5;
/// The filter `tamis`: there is no better one.
pub const TAMIS_QUALITY_HIGH: TamisQuality = 6;

/// Is told of every error of a device, on the thread whose call failed, before the call returns.
/// `message` is a text of the library, which stays until this function returns. It may call this
/// library, and must neither throw nor jump out.
pub type TamisErrorFunction =
    Option<unsafe extern "C" fn(userPtr: *mut c_void, code: TamisError, message: *const c_char)>;

/// Is told which share of the work is done, `n` from 0 to 1, and returns whether to go on. It is
/// called from any thread of the device, but by one thread at a time, and `n` only grows. It may
/// call this library for other filters, and must neither throw nor jump out.
pub type TamisProgressMonitorFunction =
    Option<unsafe extern "C" fn(userPtr: *mut c_void, n: f64) -> bool>;
