//! Which general register holds what, and how the scratch memory is laid out.
//!
//! | register  | holds                                                          |
//! |-----------|----------------------------------------------------------------|
//! | `rdi`     | the [`Call`](crate::call::Call)                                 |
//! | `rsi`     | the table of planes                                            |
//! | `r8`      | cursor of pixel i                                              |
//! | `r9`      | cursor of its neighbour j                                      |
//! | `r10`     | cursor of mirrored sums, or of the second neighbour, or a plane  |
//! | `r11`     | the scratch memory                                             |
//! | `rdx`     | cursor of the tap values                                       |
//! | `rcx`     | taps left                                                      |
//! | `rbx`     | from a tap to the next                                         |
//! | `r12`-`r14` | the planes that are read most                                |
//! | `r15`     | one more of them, or beside mirrored sums the second neighbour  |
//! | `rax`, `rbp` | an address for the instruction at hand: of a plane, of a mirrored sum |

use iced_x86::Register;

use super::encode::{Address, Vector};
use super::program::{Leaf, Op, Program};
use crate::width::Width;
use crate::window::WindowSpec;

pub(super) const CALL: Register = Register::RDI;
pub(super) const PLANES: Register = Register::RSI;
pub(super) const PIXEL: Register = Register::R8;
pub(super) const NEIGHBOUR: Register = Register::R9;
pub(super) const MIRROR: Register = Register::R10;
pub(super) const SCRATCH: Register = Register::R11;
pub(super) const TAP: Register = Register::RDX;
pub(super) const TAPS_LEFT: Register = Register::RCX;
pub(super) const STEP: Register = Register::RBX;
pub(super) const TEMPORARY: Register = Register::RAX;
pub(super) const SUM: Register = Register::RBP;

/// Registers that callers want back as they were.
pub(super) const SAVED: [Register; 6] =
    [Register::RBX, Register::RBP, Register::R12, Register::R13, Register::R14, Register::R15];

/// Words at the beginning of the scratch memory: what only outer loops need.
pub(super) const CHUNKS_LEFT: usize = 0;
pub(super) const RUNS_LEFT: usize = 8;
pub(super) const RUN: usize = 16;
pub(super) const OUT: usize = 24;
/// Vectors begin behind them, on a cache line.
const VECTORS: usize = 64;

/// Where everything lives that is not a passing value of the body.
pub(super) struct Frame {
    pub(super) spec: WindowSpec,
    pub(super) width: Width,
    /// Vectors of pixels side by side.
    pub(super) chains: usize,
    /// Taps at once, one or two. Two do not wait for one another, and partials in memory
    /// are fetched and stored half as often. An odd tap that is left over comes alone.
    pub(super) taps: usize,
    /// If the first half of a tap is computed among the second half of the one before
    /// ([`pipeline`](super::pipeline)): how many values are carried over.
    pub(super) carried: Option<usize>,
    /// Cursor of the neighbour of the second of two taps at once, or of the next tap.
    pub(super) second: Register,
    /// Planes whose addresses stay in registers.
    pub(super) bases: Vec<(usize, Register)>,
    /// Registers of the partial sums, result by result and in each chain by chain;
    /// none if they are in the scratch memory.
    pub(super) partials: Vec<Vector>,
}

/// Whether so many partial sums stay in registers: in half of them at most, as the
/// body needs some.
pub(super) fn carries(partials: usize, registers: u8) -> bool {
    partials <= usize::from(registers) / 2
}

impl Frame {
    pub(super) fn new(
        spec: WindowSpec,
        width: Width,
        chains: usize,
        registers: u8,
        program: &Program,
        carried: Option<usize>,
    ) -> Self {
        let count = spec.results() * chains;
        let first = usize::from(registers).saturating_sub(count);
        let partials: Vec<Vector> = match carries(count, registers) {
            true => (first as u8..registers).map(Vector).collect(),
            false => Vec::new(),
        };
        let stored = partials.is_empty();
        let taps = match chains {
            _ if spec.mirrored || carried.is_some() => 1,
            1 | 2 if stored => 2,
            2 if width == Width::Bits512 => 2,
            _ => 1,
        };
        let two = taps == 2 || carried.is_some();
        let second = if spec.mirrored { Register::R15 } else { MIRROR };
        let taken = |register| (register == MIRROR && spec.mirrored) || (register == second && two);
        let registers =
            [Register::R12, Register::R13, Register::R14, Register::R15, MIRROR].into_iter();
        let registers = registers.filter(|&register| !taken(register));
        let bases = bases(spec, program, registers);
        Self { spec, width, chains, taps, carried, second, bases, partials }
    }

    /// In how many copies each instruction is emitted that runs once per tap.
    pub(super) fn copies(&self) -> usize {
        self.chains * self.taps
    }

    /// Bytes that cursors move from chunk to chunk.
    pub(super) fn chunk_bytes(&self) -> usize {
        self.chains * self.width.bytes()
    }

    /// Where a partial lies that is in memory.
    pub(super) fn partial(&self, index: usize, chain: usize) -> Address {
        self.vector(index * self.chains + chain)
    }

    /// Where value number `index` lies that is carried over to the next tap.
    pub(super) fn carried(&self, index: usize, chain: usize) -> Address {
        self.vector(self.stored_partials() + index * self.chains + chain)
    }

    /// Where spilled value number `slot` lies.
    pub(super) fn slot(&self, slot: usize) -> Address {
        self.vector(self.stored() + slot)
    }

    /// Vectors in the scratch memory that have their places from the beginning.
    fn stored(&self) -> usize {
        self.stored_partials() + self.carried.unwrap_or(0) * self.chains
    }

    fn stored_partials(&self) -> usize {
        if self.partials.is_empty() { self.spec.results() * self.chains } else { 0 }
    }

    fn vector(&self, index: usize) -> Address {
        Address::new(SCRATCH, VECTORS + index * self.width.bytes())
    }

    /// Bytes of scratch memory that it takes with so many slots.
    pub(super) fn scratch_bytes(&self, slots: usize) -> usize {
        VECTORS + (self.stored() + slots) * self.width.bytes()
    }
}

/// Registers for the planes that are read most often.
fn bases(
    spec: WindowSpec,
    program: &Program,
    registers: impl Iterator<Item = Register>,
) -> Vec<(usize, Register)> {
    let mut uses = vec![0usize; spec.planes];
    for (op, _) in program.ops.iter().zip(&program.needed).filter(|(_, needed)| **needed) {
        for operand in op.operands() {
            if let Op::Leaf(Leaf::Plane(index, _)) = program.ops[operand as usize] {
                uses[index] += 1;
            }
        }
    }
    let mut order: Vec<usize> = (0..spec.planes).filter(|&plane| uses[plane] > 0).collect();
    order.sort_by_key(|&plane| std::cmp::Reverse(uses[plane]));
    order.into_iter().zip(registers).collect()
}
