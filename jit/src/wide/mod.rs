//! Wide machine code for x86-64: the lane interface on 256 and 512 bits.
//!
//! A body is written down first ([`program`]), cut in two where that pays
//! ([`pipeline`]), and put in order ([`schedule`]), and then emitted in one pass that
//! gives out registers as it goes ([`body`]), into the loops that every kernel has
//! ([`loops`]). There is no intermediate language below the program and no optimiser:
//! folding and sharing are the business of whoever writes the [`Body`], and what is left
//! for a compiler to decide in straight-line code is what lies in which register, and
//! what is read from memory in place.
//!
//! The instructions mean what [`Lanes`](crate::Lanes) says, to the bit, so that
//! kernels of all widths give the same results.

mod body;
mod encode;
mod frame;
mod loops;
mod pipeline;
mod program;
mod schedule;

use crate::compiler::Chains;
use crate::error::CompileError;
use crate::lanes::Body;
use crate::width::Width;
use crate::window::{self, WindowSpec};
use body::Block;
use encode::Assembler;
use frame::Frame;
use loops::Taps;
use pipeline::Pipeline;
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

/// So do those with a chain of instructions that takes more cycles than this, however few
/// they are: a power and an exponential take 170.
///
/// Measured at 512 and at 256 bits: 0.78 to 0.84 of the time for bred expressions of 56 to
/// 58 instructions, but 1.00 to 1.06 for the cross-bilateral filter, whose chain takes 90.
const SLOW: usize = 128;

/// Compiles one kernel of 256 or 512 bits.
pub(crate) fn compile<B: Body>(
    spec: WindowSpec,
    width: Width,
    chains: Option<Chains>,
    body: &B,
) -> Result<Code, CompileError> {
    let mut recorder = Recorder::new(spec);
    window::emit(&mut recorder, &spec, body)?;
    let program = recorder.finish()?;
    let heights = schedule::heights(&program);
    let chains = chains.unwrap_or_else(|| suitable(&spec, width, &program, &heights)).count();
    let constants = constants(&program);
    let mut asm = Assembler::new(width, &constants);
    let entry = asm.here();
    let pipeline = pipelined(&spec, width, chains, &program, &heights);
    let carried = pipeline.as_ref().map(|pipeline| pipeline.carried);
    let frame = Frame::new(spec, width, chains, asm.registers(), &program, carried);
    let registers = usize::from(asm.registers()) - frame.partials.len();
    let block = |program: Program| {
        let order = schedule::schedule(&program, frame.copies(), registers);
        Block { program, order }
    };
    let taps = match pipeline {
        None => Taps::Whole(block(program)),
        Some(Pipeline { first, both, last, .. }) => {
            Taps::Halves { first: block(first), both: block(both), last: block(last) }
        }
    };
    let scratch = loops::emit(&mut asm, &frame, &taps, &constants);
    Ok(Code { bytes: asm.finish()?, entry, scratch, step: chains * width.lanes() })
}

/// The numbers of chains to choose from.
fn few_or_many(width: Width) -> (Chains, Chains) {
    match width {
        Width::Bits512 => (Chains::One, Chains::Two),
        _ => (Chains::Two, Chains::Four),
    }
}

/// How many chains suit a program.
fn suitable(spec: &WindowSpec, width: Width, program: &Program, heights: &[usize]) -> Chains {
    let (few, many) = few_or_many(width);
    let registers = Assembler::registers_of(width);
    let stored = !frame::carries(spec.results() * few.count(), registers);
    // Two taps at once do as well as twice the chains; and sixteen registers are too few
    // for several weights in four copies each.
    let enough = stored && (!spec.mirrored || width == Width::Bits256);
    let long = program.instructions().count() > LONG || longest(heights) > SLOW;
    if long && !enough { many } else { few }
}

/// The program in two halves, if that pays: where it has many chains already, and they
/// still wait, as the longest of its chains of instructions is a large part of it.
///
/// Measured at 512 bits, against two taps at once or one: 0.91 to 0.98 of the time for
/// bred expressions, 0.94 for kan2017, and for batches, which have enough to do, 1.00 to
/// 1.16. At 256 bits, 0.80 to 0.93; with mirrored sums, for whose loads and stores
/// registers are too few, 1.00 to 1.22.
fn pipelined(
    spec: &WindowSpec,
    width: Width,
    chains: usize,
    program: &Program,
    heights: &[usize],
) -> Option<Pipeline> {
    let (_, many) = few_or_many(width);
    let stored = !frame::carries(spec.results() * chains, Assembler::registers_of(width));
    if chains < many.count() || stored || (spec.mirrored && width != Width::Bits512) {
        return None;
    }
    // In cycles, both: four to the instruction, one to be issued.
    let pays = 4 * program.instructions().count() <= 5 * longest(heights);
    pays.then(|| Pipeline::new(program, heights))
}

/// The cycles of the longest chain of instructions.
fn longest(heights: &[usize]) -> usize {
    heights.iter().copied().max().unwrap_or(0)
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
