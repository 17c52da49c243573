//! From a [`Body`] to a [`Routine`]: the choice of code generator and instruction
//! set, and the way through Cranelift.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use cranelift_codegen::Context;
use cranelift_codegen::ir::types::I64;
use cranelift_codegen::ir::{AbiParam, Function, Signature, UserFuncName};
use cranelift_codegen::isa::{Builder, OwnedTargetIsa, TargetIsa};
use cranelift_codegen::settings::{self, Configurable, SetError};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};

use crate::cranelift::{Assembler, Emulation};
use crate::error::CompileError;
use crate::kernel::Routine;
use crate::lanes::Body;
#[cfg(target_arch = "x86_64")]
use crate::wide;
use crate::width::{CpuFeatures, Width};
use crate::window::{self, WindowSpec};

/// How many vectors side by side a kernel computes.
///
/// More chains hide more latency and take longer to compile; the results have
/// the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Chains {
    /// One vector per step: compiles fastest, for kernels that run once.
    One,
    /// Two vectors per step.
    Two,
    /// Four vectors per step.
    Four,
}

impl Chains {
    /// Every choice, from the fewest to the most.
    pub const ALL: [Self; 3] = [Self::One, Self::Two, Self::Four];

    /// Vectors per step.
    pub fn count(self) -> usize {
        match self {
            Self::One => 1,
            Self::Two => 2,
            Self::Four => 4,
        }
    }
}

/// Makes kernels for the processor that it runs on.
///
/// A compiler holds no state between kernels: threads can share one.
#[derive(Clone)]
pub struct Compiler {
    generator: Generator,
}

#[derive(Clone)]
enum Generator {
    /// 128 bits, on every processor that Cranelift knows.
    Cranelift(OwnedTargetIsa),
    /// 256 or 512 bits.
    #[cfg(target_arch = "x86_64")]
    Wide(Width),
}

impl Compiler {
    /// A compiler for this machine, with vectors as wide as it has them.
    ///
    /// # Errors
    ///
    /// [`CompileError::Host`] where there is no code generator for the processor.
    pub fn host() -> Result<Self, CompileError> {
        Self::with_features(CpuFeatures::of_host())
    }

    /// A compiler for this machine as if it had no more than these instruction sets,
    /// with vectors as wide as they allow: to the same bits.
    ///
    /// # Errors
    ///
    /// As for [`host`](Self::host).
    pub fn with_features(features: CpuFeatures) -> Result<Self, CompileError> {
        let features = features.and(CpuFeatures::of_host());
        Self::new(features.widest(), features)
    }

    /// A compiler for this machine, with vectors of this width.
    ///
    /// # Errors
    ///
    /// As for [`host`](Self::host), and [`CompileError::Width`] where the
    /// processor has no such vectors.
    pub fn with_width(width: Width) -> Result<Self, CompileError> {
        match CpuFeatures::of_host() {
            features if features.allow(width) => Self::new(width, features),
            _ => Err(CompileError::Width(width)),
        }
    }

    /// One for `features` that this machine has, and that allow `width`.
    fn new(width: Width, features: CpuFeatures) -> Result<Self, CompileError> {
        let generator = match width {
            #[cfg(target_arch = "x86_64")]
            Width::Bits256 | Width::Bits512 => Generator::Wide(width),
            _ => Generator::Cranelift(host_isa(features)?),
        };
        Ok(Self { generator })
    }

    /// How wide its vectors are.
    pub fn width(&self) -> Width {
        match self.generator {
            Generator::Cranelift(_) => Width::Bits128,
            #[cfg(target_arch = "x86_64")]
            Generator::Wide(width) => width,
        }
    }

    /// The instructions that this machine lacks, or is to do without: they are made of
    /// others, to the same bits in more time.
    pub fn emulated(&self) -> Vec<&'static str> {
        match &self.generator {
            Generator::Cranelift(isa) => Emulation::of(isa.as_ref()).names(),
            #[cfg(target_arch = "x86_64")]
            Generator::Wide(_) => Vec::new(),
        }
    }

    /// Compiles one kernel, with so many chains or as many as suit its body.
    ///
    /// # Errors
    ///
    /// Any [`CompileError`] but those of [`host`](Self::host). A panic inside
    /// `body` or the code generator is caught and returned as
    /// [`CompileError::Panic`]; the panic hook still runs, and prints.
    pub fn compile<B: Body>(
        &self,
        spec: WindowSpec,
        chains: Option<Chains>,
        body: &B,
    ) -> Result<Routine, CompileError> {
        spec.check()?;
        caught(|| match &self.generator {
            Generator::Cranelift(isa) => {
                let chains = chains.unwrap_or(Chains::Four);
                let context = Context::for_function(emit(isa.as_ref(), spec, chains, body)?);
                Routine::install(isa.clone(), context, spec, chains)
            }
            #[cfg(target_arch = "x86_64")]
            Generator::Wide(width) => {
                Routine::map(&wide::compile(spec, *width, chains, body)?, spec)
            }
        })
    }
}

/// A panic inside `work` as an error. All that `work` touches is to be made inside it
/// or only read.
pub(crate) fn caught<T>(work: impl FnOnce() -> Result<T, CompileError>) -> Result<T, CompileError> {
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|payload| Err(CompileError::Panic(message(payload.as_ref()))))
}

/// Writes a kernel in Cranelift's intermediate language.
pub(crate) fn emit<B: Body>(
    isa: &dyn TargetIsa,
    spec: WindowSpec,
    chains: Chains,
    body: &B,
) -> Result<Function, CompileError> {
    match chains {
        Chains::One => emit_chains::<B, 1>(isa, spec, body),
        Chains::Two => emit_chains::<B, 2>(isa, spec, body),
        Chains::Four => emit_chains::<B, 4>(isa, spec, body),
    }
}

fn emit_chains<B: Body, const N: usize>(
    isa: &dyn TargetIsa,
    spec: WindowSpec,
    body: &B,
) -> Result<Function, CompileError> {
    let mut signature = Signature::new(isa.default_call_conv());
    signature.params.push(AbiParam::new(I64));
    let mut function = Function::with_name_signature(UserFuncName::default(), signature);
    let mut scratch = FunctionBuilderContext::new();
    let builder = FunctionBuilder::new(&mut function, &mut scratch);
    let mut assembler = Assembler::<N>::new(builder, spec, Emulation::of(isa));
    window::emit(&mut assembler, &spec, body)?;
    assembler.finish()?.finalize(isa.frontend_config());
    Ok(function)
}

/// Cranelift for this machine, as if it had no more than `features`.
fn host_isa(features: CpuFeatures) -> Result<OwnedTargetIsa, CompileError> {
    // The flags of x86-64 that count are in `features`; those of others are Cranelift's
    // to find out.
    let builder = cranelift_native::builder_with_options(!cfg!(target_arch = "x86_64"));
    let mut builder = builder.map_err(|why| CompileError::Host(why.to_owned()))?;
    for flag in features.flags() {
        builder.enable(flag).expect("features are those of x86-64");
    }
    // The verifier guards against mistakes of this crate, not of its callers.
    finish(builder, cfg!(debug_assertions))
}

/// An instruction set, if it is one that the kernels' promises hold on.
pub(crate) fn finish(builder: Builder, verify: bool) -> Result<OwnedTargetIsa, CompileError> {
    let flags = flags(verify).map_err(|why| CompileError::Host(why.to_string()))?;
    let isa = builder.finish(flags).map_err(|why| CompileError::Host(why.to_string()))?;
    match isa.name() {
        "x64" | "aarch64" => Ok(isa),
        other => Err(CompileError::Host(format!("{other} is untested"))),
    }
}

/// The settings that suit kernels, whatever the instruction set.
fn flags(verify: bool) -> Result<settings::Flags, SetError> {
    let mut flags = settings::builder();
    // The optimiser reorders instructions and so undoes the interleaving of
    // chains. Allocating registers in a single pass would halve the time to
    // compile and cost 1.35-1.5 times as much to run: 0.24 ms for 0.4 ns per
    // pair, which pays only below some 600,000 pairs.
    flags.set("opt_level", "none")?;
    flags.set("regalloc_algorithm", "backtracking")?;
    flags.set("enable_verifier", if verify { "true" } else { "false" })?;
    // A frame full of spilled vectors may be larger than the guard page below
    // the stack; touching each of its pages keeps an overflow a clean fault.
    flags.set("enable_probestack", "true")?;
    flags.set("probestack_strategy", "inline")?;
    // Nothing unwinds through a kernel: it calls nothing and cannot fail.
    flags.set("unwind_info", "false")?;
    flags.set("is_pic", "false")?;
    flags.set("use_colocated_libcalls", "false")?;
    Ok(settings::Flags::new(flags))
}

/// The text of a panic, where it has one.
fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "without a message".to_owned())
}
