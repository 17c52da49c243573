//! What runs filters, as the command line asks for it.

use std::num::NonZeroUsize;
use std::sync::Arc;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};

use super::error::Error;
use super::log::Log;
use crate::backend::{self, Backend, Differentiator, Exact, Interpreter, Opening};
use crate::plan::{Passes, Precision};

/// What runs filters on the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Processor {
    /// Machine code, compiled for this processor
    Jit,
    /// The interpreter: the same bits, more slowly
    Interp,
}

/// Work for a back end that differentiates, whichever it is.
pub(super) trait OnProcessor {
    /// What comes of it.
    type Output;

    /// Does it.
    fn on(self, backend: &(impl Backend + Differentiator)) -> Result<Self::Output, Error>;
}

impl Processor {
    /// The best that this build has.
    pub(super) const DEFAULT: Self = if cfg!(feature = "jit") { Self::Jit } else { Self::Interp };

    /// The back end, if this computer has it.
    pub(super) fn open(self, lanes: Lanes) -> Result<Box<dyn Backend>, Error> {
        match self {
            #[cfg(feature = "jit")]
            Self::Jit => Ok(Box::new(lanes.open()?)),
            #[cfg(not(feature = "jit"))]
            Self::Jit => Err(no_machine_code()),
            Self::Interp if lanes != Lanes::Auto => Err(lanes.refused()),
            Self::Interp => Ok(Box::new(Interpreter)),
        }
    }

    /// Does work on the back end, if this computer has it.
    pub(super) fn run<W: OnProcessor>(self, lanes: Lanes, work: W) -> Result<W::Output, Error> {
        match self {
            #[cfg(feature = "jit")]
            Self::Jit => work.on(&lanes.open()?),
            #[cfg(not(feature = "jit"))]
            Self::Jit => Err(no_machine_code()),
            Self::Interp if lanes != Lanes::Auto => Err(lanes.refused()),
            Self::Interp => work.on(&Interpreter),
        }
    }

    /// As on the command line.
    pub(super) fn name(self) -> String {
        let value = self.to_possible_value().expect("none is skipped");
        value.get_name().to_owned()
    }
}

#[cfg(not(feature = "jit"))]
fn no_machine_code() -> Error {
    Error::NoMachineCode { reason: "the program was built without the feature `jit`".to_owned() }
}

/// How wide the vectors of machine code are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Lanes {
    /// As wide as this processor has them
    #[default]
    Auto,
    /// Four lanes, on any processor
    #[value(name = "128")]
    Four,
    /// Eight lanes: AVX2 and FMA
    #[value(name = "256")]
    Eight,
    /// Sixteen lanes: AVX-512F
    #[value(name = "512")]
    Sixteen,
}

impl Lanes {
    /// As on the command line.
    pub(super) fn name(self) -> String {
        let value = self.to_possible_value().expect("none is skipped");
        value.get_name().to_owned()
    }

    /// For what has no lanes to choose.
    fn refused(self) -> Error {
        let lanes = self.name();
        Error::Usage(format!("--lanes {lanes}: only machine code (`--backend jit`) has them"))
    }

    /// Machine code of that width.
    #[cfg(feature = "jit")]
    pub(super) fn open(self) -> Result<backend::Jit, Error> {
        self.jit().map_err(|error| Error::NoMachineCode { reason: error.to_string() })
    }

    #[cfg(feature = "jit")]
    fn jit(self) -> Result<backend::Jit, backend::BackendError> {
        use backend::{Jit, Width};

        match self {
            Self::Auto => Jit::new(),
            Self::Four => Jit::with_width(Width::Bits128),
            Self::Eight => Jit::with_width(Width::Bits256),
            Self::Sixteen => Jit::with_width(Width::Bits512),
        }
    }
}

/// How wide machine code is to be.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(super) struct LanesArgs {
    /// Bits of the vectors of machine code; no result depends on it
    #[arg(long, value_enum, value_name = "BITS", default_value_t = Lanes::Auto)]
    pub(super) lanes: Lanes,
}

/// What runs filters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Choice {
    /// Machine code, compiled for this processor
    Jit,
    /// The interpreter: the same bits, more slowly
    Interp,
    /// A shader on the GPU: another rounding, the same accuracy
    Gpu,
    /// A GPU if there is one that is no program itself, and if that fails machine
    /// code
    Auto,
}

impl Choice {
    const DEFAULT: Self = match Processor::DEFAULT {
        Processor::Jit => Self::Jit,
        Processor::Interp => Self::Interp,
    };
}

/// How accurate filters are run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tier {
    /// By code of a precision.
    Code(Precision),
    /// By their meaning.
    Exact,
}

impl Tier {
    /// How plans are made for it.
    pub(super) fn precision(self) -> Precision {
        match self {
            Self::Code(precision) => precision,
            Self::Exact => Precision::Standard,
        }
    }
}

/// Reads a tier by its name, and lists all.
pub(super) fn tiers() -> impl TypedValueParser<Value = Tier> {
    let exact = PossibleValue::new("exact").help(
        "What the filter means, in f64, on the processor: within rounding to f32, in hundreds of \
         times the time",
    );
    PossibleValuesParser::new(Precision::ALL.map(listed).into_iter().chain([exact]))
        .map(|name| Precision::named(&name).map_or(Tier::Exact, Tier::Code))
}

fn listed(precision: Precision) -> PossibleValue {
    PossibleValue::new(precision.name()).help(precision.doc())
}

/// Reads a precision of code by its name, and lists both.
pub(super) fn precisions() -> impl TypedValueParser<Value = Precision> {
    PossibleValuesParser::new(Precision::ALL.map(listed))
        .map(|name| Precision::named(&name).expect("the command line accepts no other name"))
}

/// Which back end runs filters, and how.
#[derive(Debug, Args)]
pub(super) struct BackendArgs {
    /// What runs the filters
    #[arg(long, value_enum, value_name = "BACKEND", default_value_t = Choice::DEFAULT)]
    backend: Choice,

    #[command(flatten)]
    lanes: LanesArgs,

    /// Which GPU: an index or a part of its name (see `tamis gpus`) [default: the
    /// best]
    #[arg(long, value_name = "NAME|INDEX")]
    gpu: Option<String>,

    /// Memory that may be used: on the processor for images and what is made of them
    /// [default: half of what is free], on the GPU for buffers [default: 1GiB]. Larger
    /// images are filtered part by part, to the same bits
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    max_memory: Option<u64>,

    /// How accurate filters are run
    #[arg(long, value_name = "PRECISION", default_value = Precision::Standard.name(), value_parser = tiers())]
    precision: Tier,
}

const TWO: NonZeroUsize = NonZeroUsize::new(2).expect("not zero");

/// Half of the memory that is free, in bytes; no bound where nobody can tell.
fn half_of_what_is_free() -> u64 {
    let mut system = sysinfo::System::new();
    system.refresh_memory();
    let free = match (system.available_memory(), system.cgroup_limits()) {
        (0, _) => u64::MAX,
        (free, None) => free,
        (free, Some(limits)) => free.min(limits.free_memory),
    };
    free / 2
}

/// An opened back end.
pub(super) struct Opened {
    pub(super) backend: Box<dyn Backend>,
    /// How many frames it wants at a time: two where it has a processor of its own,
    /// so that one is uploaded while the other is filtered.
    pub(super) frames: NonZeroUsize,
}

fn memory(text: &str) -> Result<u64, String> {
    let size = text.parse::<bytesize::ByteSize>();
    size.map(|size| size.as_u64()).map_err(|_| "expected a size such as 512M or 2GiB".to_owned())
}

impl BackendArgs {
    /// Memory for images and what is made of them on the processor, in bytes. GPUs have
    /// memory of their own.
    pub(super) fn memory_for_scenes(&self) -> u64 {
        let on_gpu = matches!(self.backend, Choice::Gpu | Choice::Auto);
        self.max_memory.filter(|_| !on_gpu).unwrap_or_else(half_of_what_is_free)
    }

    /// The back end, if this computer has it. What `auto` settles for is said.
    pub(super) fn open(&self, log: Log) -> Result<Opened, Error> {
        match self.backend {
            Choice::Jit => self.processor(Processor::Jit),
            Choice::Interp => self.processor(Processor::Interp),
            Choice::Gpu => self.gpu(),
            Choice::Auto => self.auto(log),
        }
    }

    /// Every pass, as accurate as asked for.
    pub(super) fn passes(&self) -> Passes {
        Passes { precision: self.precision.precision(), ..Passes::ALL }
    }

    fn open_processor(&self, processor: Processor) -> Result<Box<dyn Backend>, Error> {
        match self.precision {
            Tier::Code(_) => processor.open(self.lanes.lanes),
            Tier::Exact if self.lanes.lanes != Lanes::Auto => Err(self.lanes.lanes.refused()),
            Tier::Exact => Ok(Box::new(Exact)),
        }
    }

    fn processor(&self, processor: Processor) -> Result<Opened, Error> {
        if self.gpu.is_some() {
            return Err(Error::Usage(
                "--gpu: only `--backend gpu` and `--backend auto` use one".to_owned(),
            ));
        }
        Ok(Opened { backend: self.open_processor(processor)?, frames: NonZeroUsize::MIN })
    }

    #[cfg(not(feature = "gpu"))]
    fn gpu(&self) -> Result<Opened, Error> {
        Err(Error::NoGpu)
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Result<Opened, Error> {
        if self.precision == Tier::Exact {
            return Err(Error::Usage(
                "--precision exact: GPUs compute in f32; leave out `--backend gpu`, or take \
                 `--precision standard`"
                    .to_owned(),
            ));
        }
        if self.lanes.lanes != Lanes::Auto {
            return Err(self.lanes.lanes.refused());
        }
        let backend = backend::Choice::Gpu.open(&self.opening(Log::new(true)))?;
        Ok(Opened { backend, frames: TWO })
    }

    fn auto(&self, log: Log) -> Result<Opened, Error> {
        if self.precision == Tier::Exact {
            log.say("--backend auto: the processor, as GPUs do not compute in f64");
            return self.processor(Processor::DEFAULT);
        }
        let processor = self.open_processor(Processor::DEFAULT)?;
        let name = processor.name();
        let backend = backend::auto(processor, &self.opening(log))?;
        let frames = if backend.name() == name { NonZeroUsize::MIN } else { TWO };
        Ok(Opened { backend, frames })
    }

    fn opening(&self, log: Log) -> Opening {
        let defaults = Opening::default();
        Opening {
            precision: self.precision.precision(),
            gpu: self.gpu.clone(),
            gpu_memory: self.max_memory.unwrap_or(defaults.gpu_memory),
            remarks: Arc::new(move |text| log.say(format_args!("--backend auto: {text}"))),
        }
    }
}
