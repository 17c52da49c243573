//! Where values are: in registers, in slots of the scratch memory, or, if they are
//! leaves, where they can be read again.

use iced_x86::Register;

use super::Emitter;
use super::uses::{NEVER, Place, Value};
use crate::lanes::Side;
use crate::wide::encode::{Address, Operand, Vector};
use crate::wide::frame::{NEIGHBOUR, PIXEL, PLANES, TAP, TEMPORARY};
use crate::wide::program::{Leaf, Op};
use crate::width::Width;

/// A value in memory is worth a register if it is used three times within so
/// many ops; otherwise its uses read it from there.
const NEAR: usize = 24;

impl Emitter<'_> {
    pub(super) fn leaf(&self, value: Value) -> Leaf {
        match self.program.ops[value / self.copies.count()] {
            Op::Leaf(leaf) => leaf,
            op => unreachable!("{op:?} is no leaf"),
        }
    }

    pub(super) fn is_leaf(&self, value: Value) -> bool {
        matches!(self.program.ops[value / self.copies.count()], Op::Leaf(_))
    }

    /// Where a value that is in no register can be read. The address may need the
    /// temporary register, so it holds for the next instruction alone.
    pub(super) fn in_memory(&mut self, value: Value) -> Operand {
        if let Some(slot) = self.slot[value] {
            return Operand::Memory(self.frame.slot(slot));
        }
        let copy = value % self.copies.count();
        let (tap, chain) = (copy / self.copies.chains, copy % self.copies.chains);
        self.leaf_in_memory(self.leaf(value), tap, chain)
    }

    /// Where a leaf can be read, for one of the taps at once. As above, for the next
    /// instruction.
    pub(super) fn leaf_in_memory(&mut self, leaf: Leaf, tap: usize, chain: usize) -> Operand {
        match leaf {
            Leaf::Constant(bits) => {
                let index = self.constants.binary_search(&bits);
                self.asm.constant(index.expect("all constants are in the pool"))
            }
            Leaf::Tap(index) => self.tap(tap, index),
            Leaf::NextTap(index) => self.tap(1, index),
            Leaf::Plane(plane, Side::I) => self.plane(plane, PIXEL, chain),
            Leaf::Plane(plane, Side::J) if tap == 0 => self.plane(plane, NEIGHBOUR, chain),
            Leaf::Plane(plane, Side::J) | Leaf::NextPlane(plane) => {
                self.plane(plane, self.frame.second, chain)
            }
            Leaf::Carried(index) => Operand::Memory(self.frame.carried(index, chain)),
        }
    }

    /// A value of a tap, so many taps from the one at hand.
    fn tap(&self, tap: usize, index: usize) -> Operand {
        let index = tap * self.frame.spec.taps + index;
        Operand::Broadcast(Address::new(TAP, index * size_of::<f32>()))
    }

    /// A plane at a cursor.
    fn plane(&mut self, plane: usize, index: Register, chain: usize) -> Operand {
        let base = self.frame.bases.iter().find(|(index, _)| *index == plane);
        let base = base.map(|&(_, register)| register).unwrap_or_else(|| {
            let entry = Address::new(PLANES, plane * size_of::<*const f32>());
            if self.fetched.replace(plane) != Some(plane) {
                self.asm.fetch(TEMPORARY, entry);
            }
            TEMPORARY
        });
        let displacement = (chain * self.frame.width.bytes()) as i64;
        Operand::Memory(Address::At { base, index, displacement })
    }

    /// Whether instructions can read it from memory.
    pub(super) fn is_readable(&self, value: Value) -> bool {
        let spread = self.frame.width == Width::Bits512;
        let of_tap = || matches!(self.leaf(value), Leaf::Tap(_) | Leaf::NextTap(_));
        spread || !(self.is_leaf(value) && of_tap())
    }

    pub(super) fn hold(&mut self, value: Value, Vector(register): Vector) {
        self.holder[usize::from(register)] = Some(value);
        self.register[value] = Some(Vector(register));
    }

    pub(super) fn lock(&mut self, Vector(register): Vector) {
        self.locked[usize::from(register)] = true;
    }

    /// A register for a new value, which another one may have to leave.
    pub(super) fn take(&mut self) -> Vector {
        let registers = 0..self.holder.len();
        let open = |r: &usize| !self.fixed[*r] && !self.locked[*r];
        if let Some(free) = registers.clone().find(|r| open(r) && self.holder[*r].is_none()) {
            return Vector(free as u8);
        }
        let furthest = registers.filter(open).max_by_key(|&r| {
            let value = self.holder[r].expect("it is not free");
            // Of equals, those that need not be written.
            (self.uses.next(value), self.is_leaf(value) || self.slot[value].is_some())
        });
        let register = furthest.expect("an instruction locks fewer registers than there are");
        let value = self.holder[register].take().expect("it is not free");
        self.register[value] = None;
        let register = Vector(register as u8);
        if !self.is_leaf(value) && self.slot[value].is_none() && self.uses.next(value) != NEVER {
            let slot = self.free_slots.pop().unwrap_or_else(|| {
                self.slots += 1;
                self.slots - 1
            });
            self.slot[value] = Some(slot);
            self.asm.store(self.frame.slot(slot), register);
        }
        register
    }

    /// The value in a register that stays its own for this instruction.
    pub(super) fn held(&mut self, value: Value) -> Vector {
        let register = self.register[value].unwrap_or_else(|| {
            let register = self.take();
            let operand = self.in_memory(value);
            self.asm.load(register, operand);
            self.hold(value, register);
            register
        });
        self.lock(register);
        register
    }

    /// Whether an instruction at `place` should read a value from memory: it is
    /// there, and not worth a register.
    pub(super) fn stays_in_memory(&self, value: Value, place: Place) -> bool {
        if self.register[value].is_some() || !self.is_readable(value) {
            return false;
        }
        let near = place + 1 + NEAR * self.copies.count();
        let open = |r: usize| !self.fixed[r] && self.holder[r].is_none();
        let free = (0..self.holder.len()).any(open);
        !(free && self.uses.before(value, near) >= 2)
    }

    /// The value where it is, or where it should be.
    pub(super) fn operand(&mut self, value: Value, place: Place) -> Operand {
        match self.stays_in_memory(value, place) {
            true => self.in_memory(value),
            false => Operand::Register(self.held(value)),
        }
    }

    /// Whether nobody needs it after this instruction, so that its register can
    /// be overwritten.
    pub(super) fn dies(&self, value: Value) -> bool {
        let register = self.register[value];
        let own = register.is_some_and(|Vector(r)| !self.fixed[usize::from(r)]);
        own && self.uses.next(value) == NEVER
    }

    /// Gives back what a value had that nobody needs any more.
    pub(super) fn release(&mut self, value: Value) {
        if self.uses.next(value) != NEVER {
            return;
        }
        if let Some(Vector(register)) = self.register[value]
            && !self.fixed[usize::from(register)]
        {
            self.holder[usize::from(register)] = None;
            self.locked[usize::from(register)] = false;
            self.register[value] = None;
        }
        self.retired_slots.extend(self.slot[value].take());
    }

    /// Begins an instruction: notes that its operands are used, and keeps them where
    /// they are.
    pub(super) fn begin(&mut self, operands: &[Value], place: Place) {
        self.free_slots.append(&mut self.retired_slots);
        for &operand in operands {
            self.uses.pass(operand, place);
            if let Some(register) = self.register[operand] {
                self.lock(register);
            }
        }
    }
}
