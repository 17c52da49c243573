//! A compiled kernel: executable memory, and all the `unsafe` there is but that of the C library
//! and of the Python package.
//!
//! Each kernel has memory of its own, written first and only then made
//! executable, never both at once: Cranelift's module sees to that for what it
//! makes, a private mapping for wide code. It is given back when the kernel is
//! dropped; a process can compile and drop without end. Kernels that are alive at
//! the same time cost at least a page and one mapping each, of which systems allow
//! some tens of thousands.

use std::fmt;
use std::sync::Mutex;

use cranelift_codegen::isa::OwnedTargetIsa;
use cranelift_codegen::{CompiledCode, Context};
use cranelift_jit::{JITBuilder, JITModule};
use cranelift_module::{Module as _, ModuleError, default_libcall_names};
#[cfg(target_arch = "x86_64")]
use memmap2::{Mmap, MmapMut};

use crate::call::{Call, Line, RunCall};
use crate::compiler::Chains;
use crate::error::{CompileError, ShapeError};
use crate::shape::{Job, MirrorShape, OutputShape, Rect};
#[cfg(target_arch = "x86_64")]
use crate::wide::Code;
use crate::width::Width;
use crate::window::WindowSpec;

/// The convention is [`Call`]'s: one row of output pixels per call.
#[derive(Clone, Copy)]
enum Entry {
    /// As the host passes arguments.
    Host(unsafe extern "C" fn(*const Call)),
    /// As wide code expects them on every system, Windows too.
    #[cfg(target_arch = "x86_64")]
    SystemV(unsafe extern "sysv64" fn(*const Call)),
}

/// Machine code for one [`WindowSpec`] and one [`Body`](crate::Body).
///
/// Threads can run one kernel at the same time, on rectangles of their own.
pub struct Routine {
    entry: Entry,
    spec: WindowSpec,
    step: usize,
    code_bytes: usize,
    /// Cache lines of scratch memory that a call takes.
    scratch: usize,
    /// Holds what `entry` points to.
    _memory: Memory,
}

impl Routine {
    /// Compiles the function in `context`, which follows the convention of
    /// [`Call`] for `spec` and so many chains, and puts it into executable memory.
    pub(crate) fn install(
        isa: OwnedTargetIsa,
        mut context: Context,
        spec: WindowSpec,
        chains: Chains,
    ) -> Result<Self, CompileError> {
        let step = chains.count() * Width::Bits128.lanes();
        let builder = JITBuilder::with_isa(isa, default_libcall_names());
        let mut memory = Module::new(JITModule::new(builder));
        let module = memory.module();
        let id = module.declare_anonymous_function(&context.func.signature).map_err(generator)?;
        module.define_function(id, &mut context).map_err(generator)?;
        let code = context.compiled_code().expect("the function was just compiled");
        without_calls(code)?;
        let code_bytes = code.code_buffer().len();
        module.finalize_definitions().map_err(generator)?;
        let address = module.get_finalized_function(id);
        // SAFETY: `address` is the start of a finished function with one pointer as
        // argument, in the host's C convention, and no result.
        let entry =
            unsafe { std::mem::transmute::<*const u8, unsafe extern "C" fn(*const Call)>(address) };
        let (entry, memory) = (Entry::Host(entry), Memory::Module(Box::new(memory)));
        Ok(Self { entry, spec, step, code_bytes, scratch: 0, _memory: memory })
    }

    /// Puts finished wide code into executable memory.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn map(code: &Code, spec: WindowSpec) -> Result<Self, CompileError> {
        let mapped = || {
            let mut memory = MmapMut::map_anon(code.bytes.len())?;
            memory.copy_from_slice(&code.bytes);
            memory.make_exec()
        };
        let memory = mapped().map_err(|why| CompileError::Generator(why.to_string()))?;
        let address = memory[code.entry..].as_ptr();
        // SAFETY: the function that begins at `entry` takes one pointer in the
        // System V convention and returns nothing.
        let entry = unsafe {
            std::mem::transmute::<*const u8, unsafe extern "sysv64" fn(*const Call)>(address)
        };
        Ok(Self {
            entry: Entry::SystemV(entry),
            spec,
            step: code.step,
            code_bytes: code.bytes.len(),
            scratch: code.scratch.div_ceil(size_of::<Line>()),
            _memory: Memory::Mapping(memory),
        })
    }

    /// What it was compiled for.
    pub fn spec(&self) -> &WindowSpec {
        &self.spec
    }

    /// Pixels per step.
    pub fn step(&self) -> usize {
        self.step
    }

    /// The size of the machine code, constants included.
    pub fn code_bytes(&self) -> usize {
        self.code_bytes
    }

    /// The shape of the output buffer for `rect`.
    pub fn output_shape(&self, rect: &Rect) -> OutputShape {
        OutputShape::new(rect, &self.spec, self.step)
    }

    /// The shape of the mirrored sums for `job`; of length 0 if the kernel is not
    /// mirrored.
    pub fn mirror_shape(&self, job: &Job<'_>) -> MirrorShape {
        job.mirror_shape(&self.spec)
    }

    /// Adds all results of `job`'s rectangle to `out`, and the mirrored sums, where
    /// the kernel makes any, to `mirror`. Says how the results lie in `out`.
    ///
    /// # Errors
    ///
    /// A [`ShapeError`] where the data do not fit the kernel or one another;
    /// then nothing was read or written.
    pub fn run(
        &self,
        job: &Job<'_>,
        out: &mut [f32],
        mirror: &mut [f32],
    ) -> Result<OutputShape, ShapeError> {
        const FLOAT: usize = size_of::<f32>();
        let (shape, mirrored) = job.check(&self.spec, self.step, out.len(), mirror.len())?;
        if shape.columns == 0 {
            return Ok(shape);
        }
        let planes: Vec<*const f32> = job.planes.iter().map(|plane| plane.as_ptr()).collect();
        let mut runs: Vec<RunCall> = Vec::with_capacity(job.runs.len());
        let mut scratch = vec![Line([0; 64]); self.scratch];
        for (row, y) in job.rect.y.clone().enumerate() {
            let pixel = job.layout.index(job.rect.x.start, y) * FLOAT;
            runs.clear();
            let mut taps = job.taps;
            for (index, run) in job.runs.iter().enumerate() {
                let values;
                (values, taps) = taps.split_at(run.count * self.spec.taps);
                let inside = y.checked_add_signed(run.dy).is_some_and(|y| y < job.layout.height);
                if run.count == 0 || !inside {
                    continue;
                }
                let neighbour = run.dy * job.layout.stride as isize + run.dx;
                let bytes = |samples: isize| samples.wrapping_mul(FLOAT as isize) as usize;
                // The sums are padded like the planes: pixel x has number pad + x.
                let first = (job.layout.pad + job.rect.x.start).wrapping_add_signed(run.dx);
                let sums = match self.spec.mirrored {
                    true => mirror[mirrored.row(index, 0)].as_mut_ptr() as usize,
                    false => 0,
                };
                runs.push(RunCall {
                    neighbour: bytes(neighbour),
                    mirror: sums.wrapping_add(first * FLOAT).wrapping_sub(pixel),
                    step: bytes(run.step),
                    taps: values.as_ptr(),
                    count: run.count,
                });
            }
            if runs.is_empty() {
                continue;
            }
            let call = Call {
                planes: planes.as_ptr(),
                out: out[shape.row(row, 0).start..].as_mut_ptr(),
                out_stride: shape.stride * FLOAT,
                mirror_stride: mirrored.stride * FLOAT,
                pixel,
                chunks: shape.stride / self.step,
                runs: runs.as_ptr(),
                run_count: runs.len(),
                scratch: scratch.as_mut_ptr(),
            };
            // SAFETY: `Job::check` held for this spec and step, so every address
            // that the code reaches from `call` lies inside `job.planes`,
            // `job.taps`, `out` or `mirror`, or in as much scratch memory as the
            // code said that it takes; all are borrowed, and what is written
            // exclusively. The code is alive because `self` owns its memory, and
            // `Compiler` makes none that this processor lacks instructions for.
            unsafe {
                match self.entry {
                    Entry::Host(entry) => entry(&raw const call),
                    #[cfg(target_arch = "x86_64")]
                    Entry::SystemV(entry) => entry(&raw const call),
                }
            };
        }
        Ok(shape)
    }
}

impl fmt::Debug for Routine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Routine")
            .field("spec", &self.spec)
            .field("step", &self.step)
            .field("code_bytes", &self.code_bytes)
            .finish_non_exhaustive()
    }
}

fn generator(error: ModuleError) -> CompileError {
    CompileError::Generator(error.to_string())
}

/// Refuses code that refers to anything outside of itself, as calls do.
pub(crate) fn without_calls(code: &CompiledCode) -> Result<(), CompileError> {
    match code.buffer.relocs() {
        [] => Ok(()),
        _ => Err(CompileError::Generator("an instruction became a library call".to_owned())),
    }
}

/// Executable memory, which is freed when dropped.
#[expect(dead_code, reason = "it is kept, not looked at")]
enum Memory {
    Module(Box<Module>),
    #[cfg(target_arch = "x86_64")]
    Mapping(Mmap),
}

/// A module that frees its memory when dropped; on its own it would leak it.
///
/// The mutex is never locked. It makes the module shareable between threads,
/// none of which touches it before the last owner drops it.
struct Module(Mutex<Option<JITModule>>);

impl Module {
    fn new(module: JITModule) -> Self {
        Self(Mutex::new(Some(module)))
    }

    fn module(&mut self) -> &mut JITModule {
        let slot = self.0.get_mut().expect("never locked, so never poisoned");
        slot.as_mut().expect("taken by drop alone")
    }
}

impl Drop for Module {
    fn drop(&mut self) {
        if let Ok(Some(module)) = self.0.get_mut().map(Option::take) {
            // SAFETY: the kernel that owns this memory is being dropped, and no
            // pointer to its code was ever given away: none can run any more.
            unsafe { module.free_memory() };
        }
    }
}
