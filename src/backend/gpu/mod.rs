//! Plans on a GPU, through wgpu: Vulkan, Metal or Direct3D 12.
//!
//! ```text
//!  Plan ──shader──▶ WGSL ──wgpu──▶ pipelines: one for a window, one per kernel of a program
//!                                     │
//!  Scene ──tiles──▶ pack ─upload─▶ dispatches ─read back─▶ Filtered
//! ```
//!
//! * **Memory.** An image is cut into tiles with halos, so that two tiles' buffers
//!   fit into [`Options::max_memory`] and each into the largest binding. Tiles
//!   give the bits of the whole.
//! * **Overlap.** While the device works on a tile the next one is packed, of the
//!   same frame or, where several threads run frames, of another.
//! * **Watchdogs.** Drivers end dispatches that take seconds. So the tile of a window is
//!   dispatched in bands of rows, and the kernels of a program in parts, of about a tenth of a
//!   second on a small GPU.
//! * **Pipelines** are kept by the text of their shader: frames whose plans differ
//!   in facts that change nothing share one.
//!
//! What it promises: [`Precision::Standard`] is within [`ACCURACY`]
//! of the exact filter, as the CPU back ends are, [`Precision::Fast`] within
//! [`FAST_ACCURACY`]; a device gives the same bits every time. No bits are
//! promised across devices.

mod adapter;
mod device;
mod error;
mod evaluate;
mod pack;
mod profile;
mod program;
mod run;
mod slots;
mod tiles;
mod window;

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

pub use adapter::{Adapter, Kind, adapters, choose};
pub use error::GpuError;
pub use profile::KernelTime;

use super::cpu::dense_taps;
use super::shader::wgsl::{Arithmetic, Dialect};
use super::shader::{Loads, QUAD, Shader, Style};
use super::{ACCURACY, Agreement, Backend, BackendError, Executable, FAST_ACCURACY};
use crate::expr::tape::Tape;
use crate::plan::{Plan, Precision, WindowPlan};
use device::Device;
use program::ProgramLayout;
use slots::Slots;

/// How a GPU is opened.
#[derive(Clone, Debug)]
pub struct Options {
    /// Which one: see [`choose`].
    pub adapter: Option<String>,
    /// Bytes that the buffers for tiles may take, all together.
    pub max_memory: u64,
    /// How accurate shaders are.
    pub precision: Precision,
    /// How shaders read.
    pub loads: Loads,
    /// What to assume of the device's rounding, where exact results are wanted; it
    /// is measured if nothing is assumed.
    pub arithmetic: Option<Arithmetic>,
    /// Whether they read what depends on the offset alone from a table; else they
    /// compute it for every pair, as exports do.
    pub tap_table: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            adapter: None,
            max_memory: 1 << 30,
            precision: Precision::default(),
            loads: Loads::default(),
            arithmetic: None,
            tap_table: true,
        }
    }
}

/// An opened GPU. Clones share it.
#[derive(Clone)]
pub struct Gpu(Arc<Opened>);

struct Opened {
    device: Device,
    kind: Kind,
    max_memory: u64,
    style: Style,
    pipelines: Mutex<HashMap<String, wgpu::ComputePipeline>>,
    /// The bindings of programs' kernels.
    layout: ProgramLayout,
    slots: Slots,
    /// What kernels of a program leave to later ones. Whoever gives the device a tile holds it
    /// until all of the tile's commands are given.
    planes: Mutex<Option<wgpu::Buffer>>,
    /// Nanoseconds that kernels took.
    busy: AtomicU64,
}

impl Gpu {
    /// Opens a GPU and, if exact results are wanted, finds out how it rounds.
    ///
    /// # Errors
    /// If there is none, or it is too small or does not open.
    pub fn open(options: &Options) -> Result<Self, GpuError> {
        let adapter = choose(options.adapter.as_deref())?;
        Self::with(&adapter, options)
    }

    /// The same with an adapter that has been chosen.
    ///
    /// # Errors
    /// If it is too small or does not open.
    pub fn with(adapter: &Adapter, options: &Options) -> Result<Self, GpuError> {
        let device = Device::open(adapter)?;
        let arithmetic = match (options.precision, options.arithmetic) {
            (Precision::Standard, Some(assumed)) => assumed,
            (Precision::Standard, None) => evaluate::probe(&device)?,
            (Precision::Fast, _) => Arithmetic::WGSL,
        };
        let dialect = Dialect { precision: options.precision, arithmetic };
        let layout = ProgramLayout::new(&device)?;
        Ok(Self(Arc::new(Opened {
            device,
            kind: adapter.kind(),
            max_memory: options.max_memory,
            style: Style { dialect, loads: options.loads, tap_table: options.tap_table },
            pipelines: Mutex::default(),
            layout,
            slots: Slots::default(),
            planes: Mutex::default(),
            busy: AtomicU64::new(0),
        })))
    }

    /// What the driver calls it.
    pub fn adapter_name(&self) -> &str {
        self.0.device.name()
    }

    /// What it is.
    pub fn kind(&self) -> Kind {
        self.0.kind
    }

    /// What it was found to round correctly, if exact results were asked for.
    pub fn arithmetic(&self) -> Arithmetic {
        self.0.style.dialect.arithmetic
    }

    /// The time that its kernels took so far, without transfers; `None` if the
    /// device has no clock.
    pub fn kernel_time(&self) -> Option<Duration> {
        let busy = || Duration::from_nanos(self.0.busy.load(Ordering::Relaxed));
        self.0.device.tick.map(|_| busy())
    }

    /// Gives the device back. What runs on it or is compiled for it from now on
    /// fails as on a device that is lost.
    pub fn close(&self) {
        self.0.device.device.destroy();
    }

    /// Evaluates a tape element by element. Its inputs are `PerPixel(k)`, given as
    /// `inputs[k]`, slices of one length; returns one vector per result.
    ///
    /// # Errors
    /// If the device fails.
    pub fn evaluate(&self, tape: &Tape, inputs: &[&[f32]]) -> Result<Vec<Vec<f32>>, GpuError> {
        evaluate::evaluate(&self.0.device, tape, self.0.style.dialect, inputs)
    }
}

impl Backend for Gpu {
    fn name(&self) -> &'static str {
        "gpu"
    }

    fn agreement(&self) -> Agreement {
        Agreement::Budget(match self.0.style.dialect.precision {
            Precision::Standard => ACCURACY,
            Precision::Fast => FAST_ACCURACY,
        })
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        let plan = match plan {
            Plan::Window(plan) => plan,
            Plan::Program(program) => {
                return Ok(Box::new(program::ProgramCode::new(self.0.clone(), program)?));
            }
        };
        let device = &self.0.device;
        let mut style = self.0.style;
        let mut shader = Shader::new(plan, style);
        let shared = device.limits.max_compute_workgroup_storage_size as usize;
        if shader.workgroup_bytes > shared {
            // The strip of a wide window of many planes does not fit.
            style.loads = Loads::Packed;
            shader = Shader::new(plan, style);
        }
        let pipeline = self.0.pipeline(&shader.text, "main", false)?;
        let table = tap_table(plan, shader.tap_quads);
        let usage = wgpu::BufferUsages::STORAGE;
        let taps = device.filled("the table of offsets", bytemuck::cast_slice(&table), usage)?;
        Ok(Box::new(window::ShaderCode {
            gpu: self.0.clone(),
            plan: (**plan).clone(),
            loads: style.loads,
            shader,
            pipeline,
            taps,
        }))
    }
}

impl Opened {
    /// The pipeline of a shader's function; of a program's kernel, with their bindings.
    fn pipeline(
        &self,
        text: &str,
        function: &str,
        of_program: bool,
    ) -> Result<wgpu::ComputePipeline, GpuError> {
        let known = || self.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pipeline) = known().get(text) {
            return Ok(pipeline.clone());
        }
        let layout = of_program.then_some(&self.layout.pipeline);
        let pipeline = self.device.pipeline(text, function, layout)?;
        known().insert(text.to_owned(), pipeline.clone());
        Ok(pipeline)
    }
}

/// The tap tape's results, padded to whole vectors per tap; nothing if a shader
/// reads none.
fn tap_table(plan: &WindowPlan, quads: usize) -> Vec<f32> {
    let values = plan.tap().results().len();
    if quads == 0 {
        return Vec::new();
    }
    let dense = dense_taps(plan);
    let padded = dense
        .chunks_exact(values)
        .flat_map(|tap| tap.iter().copied().chain(std::iter::repeat_n(0.0, quads * QUAD - values)));
    padded.collect()
}
