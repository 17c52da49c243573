//! When values are needed.

use crate::lanes::Side;
use crate::wide::program::{Id, Leaf, Op, Program};

/// The number of a value: an op's in one of its copies.
pub(super) type Value = usize;

/// Where in the instruction stream: a position in the order, in one of the copies.
pub(super) type Place = usize;

/// The copies of every op: one for each chain of each of the taps at once.
#[derive(Clone, Copy)]
pub(super) struct Copies {
    pub(super) chains: usize,
    pub(super) taps: usize,
}

impl Copies {
    pub(super) fn count(self) -> usize {
        self.chains * self.taps
    }

    pub(super) fn copy(self, tap: usize, chain: usize) -> usize {
        tap * self.chains + chain
    }

    /// The value of an op in a copy. What several copies have in common is the value
    /// of the first of them.
    pub(super) fn value(self, program: &Program, id: Id, copy: usize) -> Value {
        let (tap, chain) = (copy / self.chains, copy % self.chains);
        let own = match program.ops[id as usize] {
            Op::Leaf(Leaf::Constant(_)) => 0,
            Op::Leaf(Leaf::Tap(_) | Leaf::NextTap(_)) => self.copy(tap, 0),
            Op::Leaf(Leaf::Plane(_, Side::I)) => chain,
            _ => copy,
        };
        id as usize * self.count() + own
    }
}

/// No further use.
pub(super) const NEVER: Place = usize::MAX;

/// The places where values are used.
pub(super) struct Uses {
    /// All values' places, those of a value together and in order.
    places: Vec<Place>,
    /// Of each value, the next of them and the end.
    rest: Vec<(usize, usize)>,
}

impl Uses {
    pub(super) fn new(program: &Program, order: &[Id], copies: Copies) -> Self {
        let values = program.ops.len() * copies.count();
        let mut counts = vec![0usize; values];
        for_each_use(program, order, copies, |value, _| counts[value] += 1);
        let mut rest = Vec::with_capacity(values);
        let mut end = 0;
        for count in counts {
            rest.push((end, end));
            end += count;
        }
        let mut places = vec![0; end];
        for_each_use(program, order, copies, |value, place| {
            places[rest[value].1] = place;
            rest[value].1 += 1;
        });
        Self { places, rest }
    }

    /// Where a value is used next.
    pub(super) fn next(&self, value: Value) -> Place {
        let (next, end) = self.rest[value];
        if next < end { self.places[next] } else { NEVER }
    }

    /// How often it is used from here on, before `place`.
    pub(super) fn before(&self, value: Value, place: Place) -> usize {
        let (next, end) = self.rest[value];
        self.places[next..end].iter().take_while(|&&use_| use_ < place).count()
    }

    pub(super) fn left(&self, value: Value) -> usize {
        let (next, end) = self.rest[value];
        end - next
    }

    /// Passes all uses up to `place`.
    pub(super) fn pass(&mut self, value: Value, place: Place) {
        let (next, end) = &mut self.rest[value];
        while *next < *end && self.places[*next] <= place {
            *next += 1;
        }
    }
}

fn for_each_use(
    program: &Program,
    order: &[Id],
    copies: Copies,
    mut each: impl FnMut(Value, Place),
) {
    for (position, &id) in order.iter().enumerate() {
        for copy in 0..copies.count() {
            for operand in program.ops[id as usize].operands() {
                each(copies.value(program, operand, copy), position * copies.count() + copy);
            }
        }
    }
}

/// The most values of the program's own that are alive at a time, in one copy.
pub(super) fn pressure(program: &Program, order: &[Id]) -> usize {
    let mut alive = vec![false; program.ops.len()];
    let (mut count, mut most) = (0usize, 0);
    for &id in order.iter().rev() {
        if alive[id as usize] {
            count -= 1;
        }
        for operand in program.ops[id as usize].operands() {
            let operand = operand as usize;
            if !alive[operand] && !matches!(program.ops[operand], Op::Leaf(_)) {
                alive[operand] = true;
                count += 1;
            }
        }
        most = most.max(count);
    }
    most
}
