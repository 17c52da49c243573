//! The body of the loops: registers given out ([`values`]) and instructions chosen, in
//! one pass over the program.
//!
//! Every op is emitted for all chains, and for both of two taps at once, before the
//! next one begins, so that neighbours in the instruction stream do not depend on one
//! another. When a register is needed and none is free, the value goes whose next use
//! is furthest away, which is the best choice for straight-line code (Belady 1966);
//! leaves are only forgotten, as they can be read again. What is read from memory once
//! or twice is an operand of the instruction that needs it. Registers that are left
//! over hold leaves for the whole loop.

mod uses;
mod values;

use std::cmp::Reverse;
use std::mem::offset_of;

use super::encode::{Address, Assembler, Fused, Operand, Predicate, Vector};
use super::frame::{CALL, Frame, MIRROR, SUM};
use super::program::{Binary, Id, Leaf, Op, Program, Signs};
use crate::call::Call;
use crate::lanes::Side;
use uses::{Copies, Place, Uses, Value, pressure};

/// A program with the order of its instructions.
pub(super) struct Block {
    pub(super) program: Program,
    pub(super) order: Vec<Id>,
}

/// A leaf that has a register of its own, in one of the chains.
#[derive(Clone, Copy)]
pub(super) struct Pin {
    leaf: Leaf,
    chain: usize,
    register: Vector,
}

/// Registers beside the program's own values that an instruction may take: a selection
/// between four leaves takes one for each, for its mask and for its result.
const PASSING: usize = 6;

/// Gives registers to a program's values and emits it.
pub(super) struct Emitter<'a> {
    asm: &'a mut Assembler,
    frame: &'a Frame,
    copies: Copies,
    program: &'a Program,
    /// The ops to emit.
    order: &'a [Id],
    /// The constants in the order of the pool.
    constants: &'a [u32],
    uses: Uses,
    /// What each register holds.
    holder: Vec<Option<Value>>,
    /// Registers that are not to be given out.
    fixed: Vec<bool>,
    /// Registers of the operands of the instruction at hand.
    locked: Vec<bool>,
    /// Where each value is: in a register, in a slot, in both, or (leaves) in neither.
    register: Vec<Option<Vector>>,
    slot: Vec<Option<usize>>,
    free_slots: Vec<usize>,
    /// Free too, but the instruction at hand may still read them.
    retired_slots: Vec<usize>,
    slots: usize,
    /// The plane whose address is in the temporary register.
    fetched: Option<usize>,
}

impl<'a> Emitter<'a> {
    /// For so many taps at once, one or as many as the frame says.
    pub(super) fn new(
        asm: &'a mut Assembler,
        frame: &'a Frame,
        taps: usize,
        Block { program, order }: &'a Block,
        constants: &'a [u32],
    ) -> Self {
        let copies = Copies { chains: frame.chains, taps };
        let values = program.ops.len() * copies.count();
        let registers = usize::from(asm.registers());
        let mut emitter = Self {
            asm,
            frame,
            copies,
            program,
            order,
            constants,
            uses: Uses::new(program, order, copies),
            holder: vec![None; registers],
            fixed: vec![false; registers],
            locked: vec![false; registers],
            register: vec![None; values],
            slot: vec![None; values],
            free_slots: Vec::new(),
            retired_slots: Vec::new(),
            slots: 0,
            fetched: None,
        };
        for &Vector(partial) in &frame.partials {
            emitter.fixed[usize::from(partial)] = true;
        }
        emitter
    }

    /// Chooses registers that no value will need, for the leaves that are read most.
    pub(super) fn choose_pins(&self) -> Vec<Pin> {
        let needed = pressure(self.program, self.order) * self.copies.count() + PASSING;
        let spare = (self.holder.len() - self.frame.partials.len()).saturating_sub(needed);
        let uses = |&(leaf, chain): &(Id, usize)| {
            self.uses.left(self.copies.value(self.program, leaf, chain))
        };
        let mut leaves: Vec<(Id, usize)> = Vec::new();
        for (op, leaf) in self.program.ops.iter().zip(0..) {
            match op {
                Op::Leaf(Leaf::Constant(_)) => leaves.push((leaf, 0)),
                Op::Leaf(Leaf::Plane(_, Side::I)) => {
                    leaves.extend((0..self.copies.chains).map(|chain| (leaf, chain)));
                }
                _ => {}
            }
        }
        leaves.retain(|leaf| uses(leaf) > 0);
        leaves.sort_by_key(|leaf| Reverse(uses(leaf)));
        let free = (0..self.holder.len()).filter(|&r| !self.fixed[r]).take(spare);
        let pin = |((id, chain), register): ((Id, usize), usize)| Pin {
            leaf: self.leaf(id as usize * self.copies.count()),
            chain,
            register: Vector(register as u8),
        };
        leaves.into_iter().zip(free).map(pin).collect()
    }

    /// Leaves pinned ones where they are.
    pub(super) fn keep(&mut self, pins: &[Pin]) {
        for (op, id) in self.program.ops.iter().zip(0..) {
            let Op::Leaf(leaf) = op else { continue };
            for pin in pins.iter().filter(|pin| pin.leaf == *leaf) {
                let value = self.copies.value(self.program, id, pin.chain);
                self.register[value] = Some(pin.register);
            }
        }
        for &Pin { register: Vector(register), .. } in pins {
            self.fixed[usize::from(register)] = true;
        }
    }

    /// Loads the pinned leaves that are the same for all pixels, or those that are not.
    pub(super) fn load_pinned(&mut self, pins: &[Pin], uniform: bool) {
        for &Pin { leaf, chain, register } in pins {
            if matches!(leaf, Leaf::Constant(_)) == uniform {
                let operand = self.leaf_in_memory(leaf, 0, chain);
                self.asm.load(register, operand);
            }
        }
    }

    /// The assembler, for what stands around the body.
    pub(super) fn asm(&mut self) -> &mut Assembler {
        self.asm
    }

    /// A register that holds nothing before and after the program.
    pub(super) fn passing(&self) -> Vector {
        let open = self.fixed.iter().position(|fixed| !fixed);
        Vector(open.expect("some registers are left to the program") as u8)
    }

    /// Emits the program; returns how many slots of scratch memory it takes.
    pub(super) fn run(&mut self) -> usize {
        for (position, &id) in self.order.iter().enumerate() {
            match self.program.ops[id as usize] {
                Op::Accumulate(index, channel, weight) if self.frame.partials.is_empty() => {
                    for chain in 0..self.copies.chains {
                        self.accumulate_in_memory(index, channel, weight, position, chain);
                    }
                }
                op => {
                    for copy in 0..self.copies.count() {
                        self.emit(id, op, position, copy);
                    }
                }
            }
        }
        self.slots
    }

    /// Emits an op in one copy.
    fn emit(&mut self, id: Id, op: Op, position: usize, copy: usize) {
        let place = position * self.copies.count() + copy;
        let result = id as usize * self.copies.count() + copy;
        let value_of = |id| self.copies.value(self.program, id, copy);
        let operands: Vec<Value> = op.operands().map(value_of).collect();
        self.locked.fill(false);
        self.begin(&operands, place);
        match op {
            Op::Leaf(_) => {}
            Op::Unary(op, _) => {
                let x = match self.asm.unary_takes_memory(op) {
                    true => self.operand(operands[0], place),
                    false => Operand::Register(self.held(operands[0])),
                };
                self.release(operands[0]);
                let to = self.take();
                self.asm.unary(op, to, x);
                self.hold(result, to);
            }
            Op::Binary(op, ..) => {
                let to = self.binary(op, operands[0], operands[1], place);
                self.hold(result, to);
            }
            Op::Fma(signs, ..) => {
                let to = self.fma(signs, operands[0], operands[1], operands[2], place);
                self.hold(result, to);
            }
            Op::Select(_) => {
                let to = self.select(&operands, place);
                self.hold(result, to);
            }
            Op::Accumulate(index, ..) => {
                let factor = self.held(operands[1]);
                let channel = self.operand(operands[0], place);
                let chain = copy % self.copies.chains;
                let partial = self.frame.partials[index * self.copies.chains + chain];
                self.asm.fused(Fused::Order231, Signs::Plus, partial, factor, channel);
            }
            Op::Owe(index, ..) => self.owe(index, operands[0], operands[1], copy),
            Op::Carry(index, _) => {
                let value = self.held(operands[0]);
                self.asm.store(self.frame.carried(index, copy), value);
            }
        }
        for operand in operands {
            self.release(operand);
        }
    }

    fn binary(&mut self, op: Binary, x: Value, y: Value, place: Place) -> Vector {
        let exchange = op.commutes()
            && self.register[y].is_some()
            && self.register[x].is_none()
            && self.is_readable(x);
        let (x, y) = if exchange { (y, x) } else { (x, y) };
        let first = self.held(x);
        let second = self.operand(y, place);
        self.release(x);
        self.release(y);
        let to = self.take();
        self.asm.binary(op, to, first, second);
        to
    }

    fn fma(&mut self, signs: Signs, x: Value, y: Value, z: Value, place: Place) -> Vector {
        // At most one operand stays in memory, and only if it is there once.
        let single = |value: Value| [x, y, z].iter().filter(|&&other| other == value).count() == 1;
        let memory = [z, y, x].into_iter().find(|&v| single(v) && self.stays_in_memory(v, place));
        for value in [x, y, z] {
            if Some(value) != memory {
                self.held(value);
            }
        }
        // x and y may be exchanged, so that only y or z is in memory.
        let (x, y) = if memory == Some(x) { (y, x) } else { (x, y) };
        let register = |emitter: &Self, value: Value| {
            emitter.register[value].expect("it is held, and nothing was taken since")
        };
        let overwritten = |emitter: &Self, value: Value| {
            (Some(value) != memory && emitter.dies(value)).then(|| register(emitter, value))
        };
        let [x_dies, y_dies, z_dies] = [x, y, z].map(|value| overwritten(self, value));
        let factor = register(self, x);
        let to = if memory == Some(z) {
            match (x_dies, y_dies) {
                (Some(to), _) => {
                    let (other, last) = (register(self, y), self.in_memory(z));
                    self.asm.fused(Fused::Order213, signs, to, other, last);
                    to
                }
                (None, Some(to)) => {
                    let last = self.in_memory(z);
                    self.asm.fused(Fused::Order213, signs, to, factor, last);
                    to
                }
                (None, None) => {
                    let other = Operand::Register(register(self, y));
                    let to = self.take();
                    let sum = self.in_memory(z);
                    self.asm.load(to, sum);
                    self.asm.fused(Fused::Order231, signs, to, factor, other);
                    to
                }
            }
        } else {
            let sum = register(self, z);
            let last = match memory == Some(y) {
                true => self.in_memory(y),
                false => Operand::Register(register(self, y)),
            };
            match (z_dies, x_dies, y_dies) {
                (Some(to), _, _) => {
                    self.asm.fused(Fused::Order231, signs, to, factor, last);
                    to
                }
                (None, Some(to), _) => {
                    self.asm.fused(Fused::Order132, signs, to, sum, last);
                    to
                }
                (None, None, Some(to)) => {
                    self.asm.fused(Fused::Order213, signs, to, factor, Operand::Register(sum));
                    to
                }
                (None, None, None) => {
                    let to = self.take();
                    self.asm.load(to, last);
                    self.asm.fused(Fused::Order213, signs, to, factor, Operand::Register(sum));
                    to
                }
            }
        };
        // The result's register may have been an operand's.
        for value in [x, y, z] {
            self.release(value);
        }
        to
    }

    fn select(&mut self, operands: &[Value], place: Place) -> Vector {
        let &[a, b, x, y] = operands else { unreachable!("a selection has four operands") };
        // The value for lanes in which the comparison fails has to be in a
        // register, so the comparison is turned round if that saves reading it.
        let inverted = self.register[y].is_none()
            && self.register[x].is_some()
            && self.stays_in_memory(y, place);
        let (chosen, other) = if inverted { (y, x) } else { (x, y) };
        let other_register = self.held(other);
        let turned = self.register[a].is_none()
            && self.register[b].is_some()
            && self.stays_in_memory(a, place);
        let (first, second) = if turned { (b, a) } else { (a, b) };
        let predicate = match (turned, inverted) {
            (false, false) => Predicate::Less,
            (false, true) => Predicate::NotLess,
            (true, false) => Predicate::Greater,
            (true, true) => Predicate::NotGreater,
        };
        let first = self.held(first);
        let second_operand = self.operand(second, place);
        // Only 256-bit code needs a register for the mask, but one to spare does
        // no harm. Taking it writes at most a slot, which needs no temporary.
        let mask = self.take();
        self.lock(mask);
        self.asm.compare(predicate, mask, first, second_operand);
        let chosen_operand = self.operand(chosen, place);
        for &value in operands {
            self.release(value);
        }
        let to = self.take();
        self.asm.blend(to, mask, chosen_operand, other_register);
        to
    }

    /// Adds to a partial in memory what all taps at once add to it, in their order.
    fn accumulate_in_memory(
        &mut self,
        index: usize,
        channel: Id,
        weight: Id,
        position: usize,
        chain: usize,
    ) {
        let partial = self.frame.partial(index, chain);
        self.locked.fill(false);
        let to = self.take();
        self.asm.load(to, Operand::Memory(partial));
        for tap in 0..self.copies.taps {
            self.locked.fill(false);
            self.lock(to);
            let copy = self.copies.copy(tap, chain);
            let place = position * self.copies.count() + copy;
            let operands = [channel, weight].map(|id| self.copies.value(self.program, id, copy));
            self.begin(&operands, place);
            let factor = self.held(operands[1]);
            let channel = self.operand(operands[0], place);
            self.asm.fused(Fused::Order231, Signs::Plus, to, factor, channel);
            for operand in operands {
                self.release(operand);
            }
        }
        self.asm.store(partial, to);
    }

    /// Adds to a mirrored sum. Mirrored kernels compute one tap at once.
    fn owe(&mut self, index: usize, channel: Value, weight: Value, chain: usize) {
        if chain == 0 && index > 0 {
            let stride = Address::new(CALL, offset_of!(Call, mirror_stride));
            self.asm.multiply(SUM, stride, index);
            self.asm.increase(SUM, MIRROR);
        }
        let base = if index == 0 { MIRROR } else { SUM };
        let sum = Address::new(base, chain * self.frame.width.bytes());
        let (factor, channel) = (self.held(weight), self.held(channel));
        let to = self.take();
        self.asm.load(to, Operand::Memory(sum));
        self.asm.fused(Fused::Order231, Signs::Plus, to, factor, Operand::Register(channel));
        self.asm.store(sum, to);
    }
}
