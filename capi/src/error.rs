//! Why calls fail.

use tamis::backend::BackendError;
use tamis::denoise::DenoiseError;

use crate::types::{
    TAMIS_ERROR_CANCELLED, TAMIS_ERROR_INVALID_ARGUMENT, TAMIS_ERROR_INVALID_OPERATION,
    TAMIS_ERROR_OUT_OF_MEMORY, TAMIS_ERROR_UNKNOWN, TAMIS_ERROR_UNSUPPORTED_HARDWARE, TamisError,
};

/// Why a call failed.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    pub(crate) code: TamisError,
    pub(crate) message: String,
}

impl Failure {
    pub(crate) fn new(code: TamisError, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }

    pub(crate) fn argument(message: impl Into<String>) -> Self {
        Self::new(TAMIS_ERROR_INVALID_ARGUMENT, message)
    }

    pub(crate) fn operation(message: impl Into<String>) -> Self {
        Self::new(TAMIS_ERROR_INVALID_OPERATION, message)
    }

    pub(crate) fn cancelled() -> Self {
        Self::new(TAMIS_ERROR_CANCELLED, "the progress monitor asked to stop")
    }
}

impl From<DenoiseError> for Failure {
    fn from(error: DenoiseError) -> Self {
        if error.is_stop() {
            return Self::cancelled();
        }
        let code = match &error {
            DenoiseError::Backend(_) => TAMIS_ERROR_UNSUPPORTED_HARDWARE,
            DenoiseError::TooLittleMemory { .. } => TAMIS_ERROR_OUT_OF_MEMORY,
            DenoiseError::Filter { .. }
            | DenoiseError::Strength(_)
            | DenoiseError::Size { .. }
            | DenoiseError::NoBuffer { .. }
            | DenoiseError::View { .. } => TAMIS_ERROR_INVALID_ARGUMENT,
            // What the filter needs is missing, or is no image.
            DenoiseError::Scene(_)
            | DenoiseError::NoColor
            | DenoiseError::Carries { .. }
            | DenoiseError::Plan { .. } => TAMIS_ERROR_INVALID_OPERATION,
            DenoiseError::Run { source, .. } if is_out_of_memory(source) => {
                TAMIS_ERROR_OUT_OF_MEMORY
            }
            DenoiseError::Run { .. } | DenoiseError::Threads { .. } => TAMIS_ERROR_UNKNOWN,
        };
        Self::new(code, error.to_string())
    }
}

/// Whether a GPU's memory is too small, or too little of it may be used.
#[cfg(feature = "gpu")]
fn is_out_of_memory(error: &BackendError) -> bool {
    use tamis::backend::gpu::GpuError;

    matches!(
        error,
        BackendError::Gpu(GpuError::OutOfMemory { .. } | GpuError::TooLittleMemory { .. })
    )
}

/// Only GPUs say so.
#[cfg(not(feature = "gpu"))]
fn is_out_of_memory(_: &BackendError) -> bool {
    false
}
