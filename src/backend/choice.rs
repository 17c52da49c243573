//! Back ends by name, and which is taken where nobody insists on one.

use super::{Backend, BackendError, Exact, Interpreter, Remarks};
use crate::plan::Precision;

/// What is to run filters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Choice {
    /// A GPU if there is one that is no program itself, with the processor behind it.
    Auto,
    /// Machine code, compiled for this processor.
    Jit,
    /// The interpreter: the same bits, more slowly.
    Interp,
    /// A shader on the GPU: another rounding, the same accuracy.
    Gpu,
    /// What filters mean, in f64 on the processor, in hundreds of times the time.
    Exact,
}

/// The best that this build has on the processor.
impl Default for Choice {
    fn default() -> Self {
        if cfg!(feature = "jit") { Self::Jit } else { Self::Interp }
    }
}

/// How a back end is opened.
#[derive(Clone)]
pub struct Opening {
    /// How accurate filters are run.
    pub precision: Precision,
    /// Which GPU: an index or a part of its name; the best if nothing is said.
    pub gpu: Option<String>,
    /// Memory for buffers on the GPU, in bytes.
    pub gpu_memory: u64,
    /// Who is told what [`Choice::Auto`] takes, and what failed later.
    pub remarks: Remarks,
}

impl Default for Opening {
    fn default() -> Self {
        Self {
            precision: Precision::Standard,
            gpu: None,
            gpu_memory: 1 << 30,
            remarks: std::sync::Arc::new(|_| {}),
        }
    }
}

impl Choice {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Jit, Self::Interp, Self::Gpu, Self::Exact];

    /// What `--backend` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Jit => "jit",
            Self::Interp => "interp",
            Self::Gpu => "gpu",
            Self::Exact => "exact",
        }
    }

    /// The one of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|choice| choice.name() == name)
    }

    /// The back end, if this computer and this build have it.
    ///
    /// # Errors
    /// If they do not.
    pub fn open(self, how: &Opening) -> Result<Box<dyn Backend>, BackendError> {
        match self {
            Self::Auto => auto(Self::default().open(how)?, how),
            Self::Jit => jit(),
            Self::Interp => Ok(Box::new(Interpreter)),
            Self::Gpu => gpu(how),
            Self::Exact => Ok(Box::new(Exact)),
        }
    }
}

#[cfg(feature = "jit")]
fn jit() -> Result<Box<dyn Backend>, BackendError> {
    Ok(Box::new(super::Jit::new()?))
}

#[cfg(not(feature = "jit"))]
fn jit() -> Result<Box<dyn Backend>, BackendError> {
    Err(BackendError::NotBuilt { backend: "jit" })
}

#[cfg(feature = "gpu")]
fn options(how: &Opening) -> super::gpu::Options {
    super::gpu::Options {
        adapter: how.gpu.clone(),
        max_memory: how.gpu_memory,
        precision: how.precision,
        ..super::gpu::Options::default()
    }
}

#[cfg(feature = "gpu")]
fn gpu(how: &Opening) -> Result<Box<dyn Backend>, BackendError> {
    Ok(Box::new(super::Gpu::open(&options(how))?))
}

#[cfg(not(feature = "gpu"))]
fn gpu(_: &Opening) -> Result<Box<dyn Backend>, BackendError> {
    Err(BackendError::NotBuilt { backend: "gpu" })
}

/// A GPU with this processor behind it, or that alone where there is none. A GPU that is a
/// program itself serves nobody, unless it is named.
///
/// # Errors
/// Never where no GPU can be opened: the processor is then taken.
#[cfg(feature = "gpu")]
pub fn auto(processor: Box<dyn Backend>, how: &Opening) -> Result<Box<dyn Backend>, BackendError> {
    use super::Fallback;
    use super::gpu::{Gpu, Kind, choose};

    let opened = choose(how.gpu.as_deref()).and_then(|adapter| match adapter.kind() {
        Kind::Software if how.gpu.is_none() => Ok(Err(adapter.name().to_owned())),
        Kind::Discrete | Kind::Integrated | Kind::Virtual | Kind::Unknown | Kind::Software => {
            Gpu::with(&adapter, &options(how)).map(Ok)
        }
    });
    let name = processor.name();
    let reason = match opened {
        Ok(Ok(gpu)) => {
            (how.remarks)(gpu.adapter_name());
            return Ok(Box::new(Fallback::new(Box::new(gpu), processor, how.remarks.clone())));
        }
        Ok(Err(software)) => format!("{software} computes on the processor itself"),
        Err(error) => error.to_string(),
    };
    (how.remarks)(&format!("{name}, as there is no GPU to use: {reason}"));
    Ok(processor)
}

/// The processor, as this build has no other back end.
///
/// # Errors
/// Never.
#[cfg(not(feature = "gpu"))]
pub fn auto(processor: Box<dyn Backend>, how: &Opening) -> Result<Box<dyn Backend>, BackendError> {
    (how.remarks)(&format!("{}, as this program was built without GPUs", processor.name()));
    Ok(processor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for choice in Choice::ALL {
            assert_eq!(Choice::named(choice.name()), Some(choice));
        }
        assert_eq!(Choice::named("cuda"), None);
    }

    #[test]
    fn the_processor_opens_everywhere() {
        for choice in [Choice::default(), Choice::Interp, Choice::Exact, Choice::Auto] {
            assert!(choice.open(&Opening::default()).is_ok(), "{choice:?}");
        }
    }
}
