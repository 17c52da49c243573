//! Every back end that there is.

use crate::backend::Backend;
use crate::cli::backend::{Lanes, Processor};
use crate::cli::error::Error;
use crate::plan::Precision;

/// A back end, or why there is none here.
pub(super) struct Opened {
    /// What the certificate calls it.
    pub(super) name: String,
    pub(super) backend: Result<Box<dyn Backend>, String>,
    pub(super) precision: Precision,
}

/// Opens all back ends, the fastest first. What a user asks for by name must be there.
///
/// # Errors
/// If the GPU or the lanes asked for are not.
pub(super) fn open(lanes: Lanes, gpu: Option<&str>) -> Result<Vec<Opened>, Error> {
    let mut all = Vec::new();
    for (processor, precision) in [
        (Processor::Jit, Precision::Standard),
        (Processor::Interp, Precision::Standard),
        (Processor::Jit, Precision::Fast),
    ] {
        let (name, lanes) = match processor {
            Processor::Jit => ("jit", lanes),
            Processor::Interp => ("interp", Lanes::Auto),
        };
        let backend = match processor.open(lanes) {
            Err(error) if lanes != Lanes::Auto => return Err(error),
            opened => opened.map_err(|error| error.to_string()),
        };
        all.push(Opened { name: precision.title(name), backend, precision });
    }
    all.extend(on_gpu(gpu)?);
    Ok(all)
}

#[cfg(feature = "gpu")]
fn on_gpu(gpu: Option<&str>) -> Result<Vec<Opened>, Error> {
    use crate::backend::gpu::Options;
    use crate::backend::{BackendError, Gpu};

    let opened = Precision::ALL.map(|precision| {
        let adapter = gpu.map(str::to_owned);
        let backend = match Gpu::open(&Options { adapter, precision, ..Options::default() }) {
            Ok(backend) => Ok(Box::new(backend) as Box<dyn Backend>),
            Err(error) if gpu.is_some() => return Err(BackendError::from(error).into()),
            Err(error) => Err(error.to_string()),
        };
        Ok(Opened { name: precision.title("gpu"), backend, precision })
    });
    opened.into_iter().collect()
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(gpu: Option<&str>) -> Result<Vec<Opened>, Error> {
    match gpu {
        Some(_) => Err(Error::NoGpu),
        None => Ok(vec![Opened {
            name: "gpu".to_owned(),
            backend: Err(Error::NoGpu.to_string()),
            precision: Precision::Standard,
        }]),
    }
}
