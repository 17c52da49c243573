//! Every back end that there is.

use crate::backend::Backend;
use crate::cli::backend::{Lanes, Processor};
use crate::cli::error::Error;

/// A name for the certificate, and the back end or why there is none here.
pub(super) type Opened = (String, Result<Box<dyn Backend>, String>);

/// Opens all back ends, the fastest first. What a user asks for by name must be there.
///
/// # Errors
/// If the GPU or the lanes asked for are not.
pub(super) fn open(lanes: Lanes, gpu: Option<&str>) -> Result<Vec<Opened>, Error> {
    let jit = match Processor::Jit.open(lanes) {
        Err(error) if lanes != Lanes::Auto => return Err(error),
        opened => opened.map_err(|error| error.to_string()),
    };
    let interp = Processor::Interp.open(Lanes::Auto).map_err(|error| error.to_string());
    let mut all = vec![("jit".to_owned(), jit), ("interp".to_owned(), interp)];
    all.extend(on_gpu(gpu)?);
    Ok(all)
}

#[cfg(feature = "gpu")]
fn on_gpu(gpu: Option<&str>) -> Result<Vec<Opened>, Error> {
    use crate::backend::{Gpu, Precision, gpu::Options};

    let opened = Precision::ALL.map(|precision| {
        let adapter = gpu.map(str::to_owned);
        let name = format!("gpu {}", precision.name());
        match Gpu::open(&Options { adapter, precision, ..Options::default() }) {
            Ok(backend) => Ok((name, Ok(Box::new(backend) as Box<dyn Backend>))),
            Err(error) if gpu.is_some() => Err(error.into()),
            Err(error) => Ok((name, Err(error.to_string()))),
        }
    });
    opened.into_iter().collect()
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(gpu: Option<&str>) -> Result<Vec<Opened>, Error> {
    match gpu {
        Some(_) => Err(Error::NoGpu),
        None => Ok(vec![("gpu".to_owned(), Err(Error::NoGpu.to_string()))]),
    }
}
