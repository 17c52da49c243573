//! The program's own back ends as contestants.

use std::rc::Rc;
use std::time::{Duration, Instant};

use clap::ValueEnum;

use super::contest::{Contestant, Lap, Round, Runner};
use crate::backend::{Backend, Exact, Filtered, Rect};
use crate::cli::backend::{Lanes, Processor};
use crate::cli::error::Error;
use crate::denoise::{Code, Run};
use crate::filter::Filter;
use crate::image::Image;
use crate::plan::{Passes, Precision};

/// Which back ends take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Choice {
    /// Machine code, compiled for this processor
    Jit,
    /// The interpreter: the same bits, more slowly
    Interp,
    /// A shader on the GPU
    Gpu,
}

/// A back end with what the table calls it.
pub(super) struct Engine {
    pub(super) name: String,
    backend: Box<dyn Backend>,
    precision: Precision,
    /// Whether the first pixels cost more than the others.
    lazy: bool,
}

impl Choice {
    /// All that run on the processor.
    pub(super) fn processors() -> Vec<Self> {
        match Processor::DEFAULT {
            Processor::Jit => vec![Self::Jit, Self::Interp],
            Processor::Interp => vec![Self::Interp],
        }
    }

    /// Opens it, once for each of the precisions and each width of its vectors.
    pub(super) fn open(
        self,
        precisions: &[Precision],
        lanes: &[Lanes],
        gpu: Option<&str>,
    ) -> Result<Vec<Engine>, Error> {
        let on_processor = |processor: Processor, precision: Precision, lanes: Lanes| {
            let backend = processor.open(lanes)?;
            let name = match lanes {
                Lanes::Auto => backend.name().to_owned(),
                _ => format!("{} {}", backend.name(), lanes.name()),
            };
            Ok::<Engine, Error>(Engine {
                name: precision.title(&name),
                backend,
                precision,
                lazy: false,
            })
        };
        let mut engines = Vec::new();
        for &precision in precisions {
            match self {
                Self::Jit => {
                    for &lanes in lanes {
                        engines.push(on_processor(Processor::Jit, precision, lanes)?);
                    }
                }
                Self::Interp => {
                    engines.push(on_processor(Processor::Interp, precision, Lanes::Auto)?);
                }
                Self::Gpu => engines.push(on_gpu(gpu, precision)?),
            }
        }
        Ok(engines)
    }
}

impl Engine {
    /// What filters mean, in f64.
    pub(super) fn exact() -> Self {
        let backend = Box::new(Exact);
        let name = backend.name().to_owned();
        Self { name, backend, precision: Precision::Standard, lazy: false }
    }
}

#[cfg(feature = "gpu")]
fn on_gpu(gpu: Option<&str>, precision: Precision) -> Result<Engine, Error> {
    use crate::backend::gpu::Options;
    use crate::backend::{BackendError, Gpu};

    let adapter = gpu.map(str::to_owned);
    let backend = Gpu::open(&Options { adapter, precision, ..Options::default() });
    let backend = backend.map_err(BackendError::from)?;
    let name = precision.title(backend.name());
    // Drivers compile when a shader is first dispatched.
    Ok(Engine { name, backend: Box::new(backend), precision, lazy: true })
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(_: Option<&str>, _: Precision) -> Result<Engine, Error> {
    Err(Error::NoGpu)
}

/// A filter on a back end.
pub(super) struct OnEngine {
    pub(super) engine: Rc<Engine>,
    pub(super) filter: Filter,
}

struct Entered<'a> {
    round: &'a Round,
    code: Code,
    compile: Duration,
    filtered: Filtered,
}

impl Contestant for OnEngine {
    fn enter<'a>(&'a self, round: &'a Round) -> Result<Box<dyn Runner + 'a>, Error> {
        let checked = self.filter.check().expect("only filters that make sense get here");
        round.scene.require(&checked.required())?;
        let start = Instant::now();
        let passes = Passes { precision: self.engine.precision, ..Passes::ALL };
        let scene = (round.scene.name(), &round.facts);
        let code = Code::new(&self.filter, scene, &*self.engine.backend, passes)?;
        if self.engine.lazy {
            let Rect { width, height, .. } = Rect::whole(&round.scene);
            let corner = Rect { x: 0, y: 0, width: width.min(8), height: height.min(8) };
            code.run(&round.scene, corner, Run::default())?;
        }
        let compile = start.elapsed();
        Ok(Box::new(Entered { round, code, compile, filtered: Filtered::default() }))
    }
}

impl Runner for Entered<'_> {
    fn run(&mut self) -> Result<Lap, Error> {
        let scene = &self.round.scene;
        let start = Instant::now();
        let filtered = self.code.run(scene, Rect::whole(scene), Run::default());
        let time = start.elapsed();
        self.filtered = filtered?;
        Ok(Lap { time, process: None })
    }

    fn result(&mut self) -> Result<Image, Error> {
        let Rect { width, height, .. } = Rect::whole(&self.round.scene);
        let pixels = &self.filtered.pixels;
        let rgb = [0, 1, 2].map(|channel| pixels.iter().map(|c| c[channel]).collect());
        let image = Image::new(self.round.scene.name(), width, height, rgb);
        Ok(image.expect("one colour per pixel of the last run"))
    }

    fn compile(&self) -> Option<Duration> {
        Some(self.compile)
    }
}
