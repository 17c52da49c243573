//! What a body asks for, written down: straight-line code in single-assignment
//! form. [`Recorder`] implements the lane interface; nothing is encoded yet, so
//! that registers can be given out knowing when each value is needed next.

use rustc_hash::FxHashMap;

use crate::error::CompileError;
use crate::lanes::{Lanes, Side};
use crate::window::{Nest, WindowSpec};

/// The number of an [`Op`], which is also the name of its value.
pub(super) type Id = u32;

/// What lies in memory and can be read again at any time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Leaf {
    /// These bits in every lane.
    Constant(u32),
    Plane(usize, Side),
    Tap(usize),
    /// A plane at the neighbour of the next tap.
    NextPlane(usize),
    /// A value of the next tap.
    NextTap(usize),
    /// What [`Op::Carry`] of this number left while the tap was the next one.
    Carried(usize),
}

/// Instructions of one operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unary {
    Sqrt,
    Round,
    /// From a signed integer.
    Convert,
    ShiftLeft(u8),
    /// Of a signed integer.
    ShiftRight(u8),
}

/// Instructions of two operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Binary {
    Add,
    Sub,
    Mul,
    Div,
    Min,
    Max,
    And,
    Xor,
    /// Of integers.
    IntegerSub,
}

impl Binary {
    /// Whether the operands can change places. Minimum and maximum cannot: which
    /// one they return for zeros and NaN depends on the order.
    pub(super) fn commutes(self) -> bool {
        matches!(self, Self::Add | Self::Mul | Self::And | Self::Xor)
    }
}

/// What a multiply-add negates before it adds, which costs nothing and rounds nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Signs {
    /// x × y + z
    Plus,
    /// x × y - z
    Minus,
    /// -(x × y) + z
    NegatedPlus,
    /// -(x × y) - z
    NegatedMinus,
}

impl Signs {
    fn new(product: bool, addend: bool) -> Self {
        match (product, addend) {
            (false, false) => Self::Plus,
            (false, true) => Self::Minus,
            (true, false) => Self::NegatedPlus,
            (true, true) => Self::NegatedMinus,
        }
    }
}

/// The bits of -0.0, which negate by exclusive or.
const SIGN: u32 = 0x8000_0000;

/// One instruction.
#[derive(Clone, Copy, Debug)]
pub(super) enum Op {
    Leaf(Leaf),
    Unary(Unary, Id),
    Binary(Binary, Id, Id),
    /// ±(x × y) ± z, rounded once.
    Fma(Signs, Id, Id, Id),
    /// `if a < b { x } else { y }` for `[a, b, x, y]`.
    Select([Id; 4]),
    /// Partial number n += channel × weight, rounded once.
    Accumulate(usize, Id, Id),
    /// Mirrored sum number n of the neighbour += channel × weight, rounded once.
    Owe(usize, Id, Id),
    /// Leaves a value of the next tap for its turn.
    Carry(usize, Id),
}

impl Op {
    /// Its operands, with repetitions.
    pub(super) fn operands(&self) -> impl Iterator<Item = Id> + use<> {
        let (list, count) = match *self {
            Self::Leaf(_) => ([0; 4], 0),
            Self::Unary(_, x) | Self::Carry(_, x) => ([x, 0, 0, 0], 1),
            Self::Binary(_, x, y) => ([x, y, 0, 0], 2),
            Self::Fma(_, x, y, z) => ([x, y, z, 0], 3),
            Self::Select(list) => (list, 4),
            Self::Accumulate(_, x, y) | Self::Owe(_, x, y) => ([x, y, 0, 0], 2),
        };
        list.into_iter().take(count)
    }

    /// The same op of other values.
    pub(super) fn map(self, mut to: impl FnMut(Id) -> Id) -> Self {
        match self {
            Self::Leaf(_) => self,
            Self::Unary(op, x) => Self::Unary(op, to(x)),
            Self::Binary(op, x, y) => Self::Binary(op, to(x), to(y)),
            Self::Fma(signs, x, y, z) => Self::Fma(signs, to(x), to(y), to(z)),
            Self::Select(list) => Self::Select(list.map(to)),
            Self::Accumulate(n, x, y) => Self::Accumulate(n, to(x), to(y)),
            Self::Owe(n, x, y) => Self::Owe(n, to(x), to(y)),
            Self::Carry(n, x) => Self::Carry(n, to(x)),
        }
    }
}

/// What runs once per tap.
#[derive(Debug)]
pub(super) struct Program {
    pub(super) ops: Vec<Op>,
    /// Which ops are needed for a sum; the others are not emitted.
    pub(super) needed: Vec<bool>,
}

impl Program {
    /// Of these ops, as far as something comes of them.
    pub(super) fn new(ops: Vec<Op>) -> Self {
        let mut needed = vec![false; ops.len()];
        for (k, op) in ops.iter().enumerate().rev() {
            needed[k] |= matches!(op, Op::Accumulate(..) | Op::Owe(..) | Op::Carry(..));
            if needed[k] {
                for operand in op.operands() {
                    needed[operand as usize] = true;
                }
            }
        }
        Self { ops, needed }
    }

    /// The ops that become instructions, in their order.
    pub(super) fn instructions(&self) -> impl DoubleEndedIterator<Item = Id> + use<'_> {
        let needed = (0..self.ops.len()).filter(|&id| self.needed[id]);
        needed.filter(|&id| !matches!(self.ops[id], Op::Leaf(_))).map(|id| id as Id)
    }
}

/// Writes down what a body asks for.
pub(super) struct Recorder {
    spec: WindowSpec,
    ops: Vec<Op>,
    leaves: FxHashMap<Leaf, Id>,
    /// What [`above`](Self::above) gave.
    above: FxHashMap<Id, Id>,
    fault: Option<CompileError>,
}

/// The result of a comparison: its operands. Selecting compares once more, which
/// costs what keeping masks would.
#[derive(Clone, Copy)]
pub(super) struct Less(Id, Id);

impl Recorder {
    pub(super) fn new(spec: WindowSpec) -> Self {
        let (leaves, above) = (FxHashMap::default(), FxHashMap::default());
        Self { spec, ops: Vec::new(), leaves, above, fault: None }
    }

    /// What was asked for, or the first thing that the body had no right to.
    pub(super) fn finish(self) -> Result<Program, CompileError> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        Ok(Program::new(self.ops))
    }

    fn push(&mut self, op: Op) -> Id {
        self.ops.push(op);
        // A body of four billion instructions does not fit into memory.
        (self.ops.len() - 1) as Id
    }

    fn leaf(&mut self, leaf: Leaf) -> Id {
        if let Some(&id) = self.leaves.get(&leaf) {
            return id;
        }
        let id = self.push(Op::Leaf(leaf));
        self.leaves.insert(leaf, id);
        id
    }

    fn bits(&mut self, bits: u32) -> Id {
        self.leaf(Leaf::Constant(bits))
    }

    /// What a value is the negative of, or itself; and which of the two.
    fn unsigned(&self, value: Id) -> (Id, bool) {
        let constant = |id: Id| match self.ops[id as usize] {
            Op::Leaf(Leaf::Constant(bits)) => Some(bits),
            _ => None,
        };
        match self.ops[value as usize] {
            Op::Binary(Binary::Xor, x, sign) if constant(sign) == Some(SIGN) => (x, true),
            _ => (value, false),
        }
    }

    /// How far the bits of a value are above those of √½: what its exponent and its fraction
    /// are both made of.
    fn above(&mut self, x: Id) -> Id {
        if let Some(&above) = self.above.get(&x) {
            return above;
        }
        let root = self.bits(0x3f35_04f4);
        let above = self.push(Op::Binary(Binary::IntegerSub, x, root));
        self.above.insert(x, above);
        above
    }

    /// Remembers the first fault and stands in for the value.
    fn refuse(&mut self, fault: CompileError) -> Id {
        self.fault.get_or_insert(fault);
        self.bits(0)
    }
}

impl Lanes for Recorder {
    type F = Id;
    type M = Less;

    fn constant(&mut self, value: f32) -> Id {
        self.bits(value.to_bits())
    }

    fn plane(&mut self, index: usize, side: Side) -> Id {
        let planes = self.spec.planes;
        if index >= planes {
            return self.refuse(CompileError::Plane { index, planes });
        }
        self.leaf(Leaf::Plane(index, side))
    }

    fn tap(&mut self, index: usize) -> Id {
        let taps = self.spec.taps;
        if index >= taps {
            return self.refuse(CompileError::Tap { index, taps });
        }
        self.leaf(Leaf::Tap(index))
    }

    fn neg(&mut self, x: Id) -> Id {
        let sign = self.bits(SIGN);
        self.push(Op::Binary(Binary::Xor, x, sign))
    }

    fn abs(&mut self, x: Id) -> Id {
        let magnitude = self.bits(0x7fff_ffff);
        self.push(Op::Binary(Binary::And, x, magnitude))
    }

    fn sqrt(&mut self, x: Id) -> Id {
        self.push(Op::Unary(Unary::Sqrt, x))
    }

    fn round(&mut self, x: Id) -> Id {
        self.push(Op::Unary(Unary::Round, x))
    }

    fn exp2i(&mut self, x: Id) -> Id {
        let magic = self.constant(12_583_039.0);
        let biased = self.add(x, magic);
        self.push(Op::Unary(Unary::ShiftLeft(23), biased))
    }

    fn exponent(&mut self, x: Id) -> Id {
        let above = self.above(x);
        let exponent = self.push(Op::Unary(Unary::ShiftRight(23), above));
        self.push(Op::Unary(Unary::Convert, exponent))
    }

    fn fraction(&mut self, x: Id) -> Id {
        let above = self.above(x);
        let mantissa = self.bits(0x007f_ffff);
        let rest = self.push(Op::Binary(Binary::And, above, mantissa));
        let minus_root = self.bits(0x3eb5_04f4_u32.wrapping_neg());
        self.push(Op::Binary(Binary::IntegerSub, rest, minus_root))
    }

    fn add(&mut self, x: Id, y: Id) -> Id {
        let op = match (self.unsigned(x), self.unsigned(y)) {
            (_, (y, true)) => Op::Binary(Binary::Sub, x, y),
            ((x, true), _) => Op::Binary(Binary::Sub, y, x),
            _ => Op::Binary(Binary::Add, x, y),
        };
        self.push(op)
    }

    fn sub(&mut self, x: Id, y: Id) -> Id {
        let op = match self.unsigned(y) {
            (y, true) => Op::Binary(Binary::Add, x, y),
            _ => Op::Binary(Binary::Sub, x, y),
        };
        self.push(op)
    }

    fn mul(&mut self, x: Id, y: Id) -> Id {
        self.push(Op::Binary(Binary::Mul, x, y))
    }

    fn div(&mut self, x: Id, y: Id) -> Id {
        self.push(Op::Binary(Binary::Div, x, y))
    }

    fn min(&mut self, x: Id, y: Id) -> Id {
        self.push(Op::Binary(Binary::Min, x, y))
    }

    fn max(&mut self, x: Id, y: Id) -> Id {
        self.push(Op::Binary(Binary::Max, x, y))
    }

    fn fma(&mut self, x: Id, y: Id, z: Id) -> Id {
        let [(x, x_negated), (y, y_negated), (z, z_negated)] = [x, y, z].map(|v| self.unsigned(v));
        self.push(Op::Fma(Signs::new(x_negated != y_negated, z_negated), x, y, z))
    }

    fn lt(&mut self, x: Id, y: Id) -> Less {
        Less(x, y)
    }

    fn select(&mut self, Less(a, b): Less, x: Id, y: Id) -> Id {
        self.push(Op::Select([a, b, x, y]))
    }
}

/// There is one nest for all bodies ([`loops`](super::loops)), so that only what
/// happens per tap has to be written down.
impl Nest for Recorder {
    fn for_chunks(&mut self, body: impl FnOnce(&mut Self)) {
        body(self);
    }

    fn for_runs(&mut self, body: impl FnOnce(&mut Self)) {
        body(self);
    }

    fn for_taps(&mut self, body: impl FnOnce(&mut Self)) {
        body(self);
    }

    fn accumulate(&mut self, index: usize, channel: Id, weight: Id) {
        self.push(Op::Accumulate(index, channel, weight));
    }

    fn accumulate_mirrored(&mut self, index: usize, channel: Id, weight: Id) {
        self.push(Op::Owe(index, channel, weight));
    }

    /// The loops add every partial to the result of its number.
    fn partial(&mut self, index: usize) -> Id {
        index as Id
    }

    fn add_to_result(&mut self, index: usize, value: Id) {
        debug_assert_eq!(index, value as usize, "the loops add partials to results");
    }
}
