//! From a [`Body`] to a [`Kernel`]: the choice of code generator and instruction
//! set, and the way through Cranelift.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use cranelift_codegen::Context;
use cranelift_codegen::ir::types::I64;
use cranelift_codegen::ir::{AbiParam, Function, Signature, UserFuncName};
use cranelift_codegen::isa::{Builder, OwnedTargetIsa, TargetIsa};
use cranelift_codegen::settings::{self, Configurable, SetError};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};

use crate::cranelift::Assembler;
use crate::error::CompileError;
use crate::kernel::Kernel;
use crate::lanes::Body;
#[cfg(target_arch = "x86_64")]
use crate::wide;
use crate::width::{Features, Width};
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
    /// [`CompileError::Host`] where there is no code generator for the
    /// processor, [`CompileError::NoFma`] where it lacks fused multiply-add.
    pub fn host() -> Result<Self, CompileError> {
        Self::with_width(Features::of_host().widest())
    }

    /// A compiler for this machine, with vectors of this width.
    ///
    /// # Errors
    ///
    /// As for [`host`](Self::host), and [`CompileError::Width`] where the
    /// processor has no such vectors.
    pub fn with_width(width: Width) -> Result<Self, CompileError> {
        if !Features::of_host().allow(width) {
            return Err(CompileError::Width(width));
        }
        match width {
            #[cfg(target_arch = "x86_64")]
            Width::Bits256 | Width::Bits512 => Ok(Self { generator: Generator::Wide(width) }),
            _ => {
                let builder = cranelift_native::builder()
                    .map_err(|why| CompileError::Host(why.to_owned()))?;
                Self::with_isa(builder)
            }
        }
    }

    /// How wide its vectors are.
    pub fn width(&self) -> Width {
        match self.generator {
            Generator::Cranelift(_) => Width::Bits128,
            #[cfg(target_arch = "x86_64")]
            Generator::Wide(width) => width,
        }
    }

    /// A compiler for any instruction set. Its kernels would not run here, which
    /// is why nothing but [`host`](Self::host) makes one that is public.
    fn with_isa(builder: Builder) -> Result<Self, CompileError> {
        let flags = flags().map_err(|why| CompileError::Host(why.to_string()))?;
        let isa = builder.finish(flags).map_err(|why| CompileError::Host(why.to_string()))?;
        check(isa.as_ref())?;
        Ok(Self { generator: Generator::Cranelift(isa) })
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
    ) -> Result<Kernel, CompileError> {
        spec.check()?;
        // Everything the closure touches is made inside it or only read.
        catch_unwind(AssertUnwindSafe(|| match &self.generator {
            Generator::Cranelift(isa) => {
                let chains = chains.unwrap_or(Chains::Four);
                let context = Context::for_function(emit(isa.as_ref(), spec, chains, body)?);
                Kernel::install(isa.clone(), context, spec, chains)
            }
            #[cfg(target_arch = "x86_64")]
            Generator::Wide(width) => {
                Kernel::map(&wide::compile(spec, *width, chains, body)?, spec)
            }
        }))
        .unwrap_or_else(|payload| Err(CompileError::Panic(message(payload.as_ref()))))
    }
}

/// Writes a kernel in Cranelift's intermediate language.
fn emit<B: Body>(
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
    let mut assembler = Assembler::<N>::new(builder, spec);
    window::emit(&mut assembler, &spec, body)?;
    assembler.finish()?.finalize(isa.frontend_config());
    Ok(function)
}

/// The settings that suit kernels, whatever the instruction set.
fn flags() -> Result<settings::Flags, SetError> {
    let mut flags = settings::builder();
    // The optimiser reorders instructions and so undoes the interleaving of
    // chains. Allocating registers in a single pass would halve the time to
    // compile and cost 1.35-1.5 times as much to run: 0.24 ms for 0.4 ns per
    // pair, which pays only below some 600,000 pairs.
    flags.set("opt_level", "none")?;
    flags.set("regalloc_algorithm", "backtracking")?;
    // The verifier guards against mistakes of this crate, not of its callers.
    let verify = if cfg!(debug_assertions) { "true" } else { "false" };
    flags.set("enable_verifier", verify)?;
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

/// Refuses instruction sets that the kernels' promises do not hold on.
fn check(isa: &dyn TargetIsa) -> Result<(), CompileError> {
    let has = |name: &str| {
        isa.isa_flags().iter().any(|flag| flag.name == name && flag.as_bool() == Some(true))
    };
    match isa.name() {
        "x64" if has("has_avx") && has("has_fma") => Ok(()),
        "x64" => Err(CompileError::NoFma),
        "aarch64" => Ok(()),
        other => Err(CompileError::Host(format!("{other} is untested"))),
    }
}

/// The text of a panic, where it has one.
fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "without a message".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{Lanes, Side};
    use cranelift_codegen::isa;

    /// Every instruction once.
    struct Everything;

    impl Body for Everything {
        fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
            let (x, y, z) = (lanes.plane(0, Side::I), lanes.plane(0, Side::J), lanes.tap(0));
            let x = lanes.fma(x, y, z);
            let (a, b) = (lanes.min(x, y), lanes.max(x, z));
            let mask = lanes.lt(a, b);
            let x = lanes.select(mask, x, a);
            let (x, y) = (lanes.neg(x), lanes.abs(b));
            let (x, y) = (lanes.add(x, y), lanes.sub(x, y));
            let (x, y) = (lanes.mul(x, y), lanes.div(x, y));
            let (x, y) = (lanes.sqrt(x), lanes.round(y));
            let (x, y) = (lanes.exponent(x), lanes.exp2i(y));
            let y = lanes.mantissa(y);
            let one = lanes.constant(1.0);
            vec![lanes.fma(x, y, one)]
        }
    }

    const SPEC: WindowSpec =
        WindowSpec { planes: 1, taps: 1, channels: 1, weights: 1, absolute: true, mirrored: false };

    fn target(name: &str, flags: &[&str]) -> Result<Compiler, CompileError> {
        let mut builder = isa::lookup_by_name(name).expect("the tests build this target");
        for flag in flags {
            builder.enable(flag).expect("a flag of this target");
        }
        Compiler::with_isa(builder)
    }

    /// Compiles without installing and returns the number of relocations, which
    /// is that of calls into a library.
    fn relocations(compiler: &Compiler, chains: Chains) -> usize {
        let Generator::Cranelift(isa) = &compiler.generator else {
            panic!("an instruction set was named, so this is Cranelift's");
        };
        let function = emit(isa.as_ref(), SPEC, chains, &Everything).expect("emits");
        let mut context = Context::for_function(function);
        let code = context.compile(isa.as_ref(), &mut Default::default());
        code.expect("compiles").buffer.relocs().len()
    }

    #[test]
    fn aarch64_needs_no_library() {
        let compiler = target("aarch64-unknown-linux-gnu", &[]).expect("fused by nature");
        for chains in Chains::ALL {
            assert_eq!(relocations(&compiler, chains), 0);
        }
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn x86_64_needs_avx_and_fma() {
        let avx = ["has_sse3", "has_ssse3", "has_sse41", "has_sse42", "has_avx"];
        for flags in [&[][..], &avx] {
            let found = target("x86_64-unknown-linux-gnu", flags);
            assert!(matches!(found, Err(CompileError::NoFma)));
        }
        let fma = [&avx[..], &["has_fma"]].concat();
        let compiler = target("x86_64-unknown-linux-gnu", &fma).expect("fused");
        for chains in Chains::ALL {
            assert_eq!(relocations(&compiler, chains), 0);
        }
    }
}
