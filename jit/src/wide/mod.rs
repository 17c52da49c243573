//! Wide machine code for x86-64: the lane interface on 256 and 512 bits.
//!
//! A body is written down first ([`program`]) and put in order ([`schedule`]), and
//! then emitted in one pass that gives out registers as it goes ([`body`]), into
//! the loops that every kernel has ([`loops`]). There is no intermediate language
//! below the program and no optimiser: folding and sharing are the business of
//! whoever writes the [`Body`], and what is left for a compiler to decide in
//! straight-line code is what lies in which register, and what is read from memory
//! in place.
//!
//! The instructions mean what [`Lanes`](crate::Lanes) says, to the bit, so that
//! kernels of all widths give the same results.

mod body;
mod encode;
mod frame;
mod loops;
mod program;
mod schedule;

use crate::compiler::Chains;
use crate::error::CompileError;
use crate::lanes::Body;
use crate::width::Width;
use crate::window::{self, WindowSpec};
use encode::Assembler;
use frame::Frame;
use program::{Leaf, Op, Program, Recorder};

/// Machine code, not yet executable.
pub(crate) struct Code {
    /// Constants, and the function behind them.
    pub(crate) bytes: Vec<u8>,
    /// Where the function begins.
    pub(crate) entry: usize,
    /// Bytes of scratch memory that it takes.
    pub(crate) scratch: usize,
    /// Pixels per step.
    pub(crate) step: usize,
}

/// Bodies with more instructions than this need more chains. A processor looks a few
/// hundred instructions ahead: in a short body it sees several taps, which do not depend
/// on one another, in a long one little more than the chain at hand. A short one does
/// better with the registers: they keep what belongs to pixel i.
///
/// Measured at 512 bits, two chains against one: 0.82 of the time for kan2017, 0.71 to
/// 0.91 for bred expressions, 1.13 for a cross-bilateral filter of 52 instructions. At
/// 256 bits, four against two: 0.77, 0.72 to 0.82 and 0.96.
const LONG: usize = 64;

/// Compiles one kernel of 256 or 512 bits.
pub(crate) fn compile<B: Body>(
    spec: WindowSpec,
    width: Width,
    chains: Option<Chains>,
    body: &B,
) -> Result<Code, CompileError> {
    let mut recorder = Recorder::new(spec, width);
    window::emit(&mut recorder, &spec, body)?;
    let program = recorder.finish()?;
    let chains = chains.unwrap_or_else(|| suitable(&spec, width, &program)).count();
    let constants = constants(&program);
    let mut asm = Assembler::new(width, &constants);
    let entry = asm.here();
    let frame = Frame::new(spec, width, chains, asm.registers(), &program);
    let registers = usize::from(asm.registers()) - frame.partials.len();
    let order = schedule::schedule(&program, frame.copies(), registers);
    let scratch = loops::emit(&mut asm, &frame, &program, &order, &constants);
    Ok(Code { bytes: asm.finish()?, entry, scratch, step: chains * width.lanes() })
}

/// How many chains suit a program.
fn suitable(spec: &WindowSpec, width: Width, program: &Program) -> Chains {
    let (few, many) = match width {
        Width::Bits512 => (Chains::One, Chains::Two),
        _ => (Chains::Two, Chains::Four),
    };
    let registers = Assembler::registers_of(width);
    let stored = !frame::carries(spec.results() * few.count(), registers);
    // Two taps at once do as well as twice the chains; and sixteen registers are too few
    // for several weights in four copies each.
    let enough = stored && (!spec.mirrored || width == Width::Bits256);
    if program.instructions() > LONG && !enough { many } else { few }
}

/// All constants of a program, each once and in order.
fn constants(program: &Program) -> Vec<u32> {
    let needed = program.ops.iter().zip(&program.needed).filter(|(_, needed)| **needed);
    let mut constants: Vec<u32> = needed
        .filter_map(|(op, _)| match *op {
            Op::Leaf(Leaf::Constant(bits)) => Some(bits),
            _ => None,
        })
        .collect();
    constants.sort_unstable();
    constants
}
