//! Kernels for other kinds of processors: made and checked here, to be run there.

use cranelift_codegen::Context;
use cranelift_codegen::control::ControlPlane;
use cranelift_codegen::isa::{self, OwnedTargetIsa};
use cranelift_codegen::settings::Configurable;

use crate::compiler::{Chains, caught, emit, finish};
use crate::error::CompileError;
use crate::kernel::without_calls;
use crate::lanes::Body;
use crate::window::WindowSpec;

/// Makes the machine code that [`Compiler`](crate::Compiler) makes on another
/// processor, with Cranelift's verifier on. What comes out are bytes: only a
/// [`Routine`](crate::Routine) runs, and only where it was compiled.
///
/// Of other architectures than this machine's it knows those that the features of
/// `cranelift-codegen` name.
pub struct CrossCompiler {
    isa: OwnedTargetIsa,
}

impl CrossCompiler {
    /// A compiler for a target triple, `aarch64-unknown-linux-gnu` say, whose
    /// processors have these of the instruction sets that Cranelift has flags for, beyond
    /// those that all have.
    ///
    /// # Errors
    ///
    /// [`CompileError::Host`] where there is no code generator for the target, or no
    /// such flag, and [`CompileError::Panic`] where the triple is none.
    pub fn new(triple: &str, flags: &[&str]) -> Result<Self, CompileError> {
        let refused =
            |why: &dyn ToString| CompileError::Host(format!("{triple}: {}", why.to_string()));
        // Cranelift panics where it does not know the name.
        let mut builder = caught(|| isa::lookup_by_name(triple).map_err(|why| refused(&why)))?;
        for flag in flags {
            builder.enable(flag).map_err(|why| refused(&why))?;
        }
        Ok(Self { isa: finish(builder, true)? })
    }

    /// Compiles one kernel to machine code, constants included.
    ///
    /// # Errors
    ///
    /// As [`Compiler::compile`](crate::Compiler::compile).
    pub fn compile<B: Body>(
        &self,
        spec: WindowSpec,
        chains: Chains,
        body: &B,
    ) -> Result<Vec<u8>, CompileError> {
        spec.check()?;
        caught(|| {
            let isa = self.isa.as_ref();
            let mut context = Context::for_function(emit(isa, spec, chains, body)?);
            let compiled = context.compile(isa, &mut ControlPlane::default());
            let code = compiled.map_err(|why| CompileError::Generator(why.inner.to_string()))?;
            without_calls(code)?;
            Ok(code.code_buffer().to_vec())
        })
    }
}
