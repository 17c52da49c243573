//! Two taps in flight: the second half of one beside the first half of the next.
//!
//! What a tap computes is one long chain in the main, a root of a sum of squares, its
//! logarithm, a power, an exponential, and while the processor waits for one result it
//! has too little else to do. So the loop over taps is pipelined (Lam, "Software
//! Pipelining: An Effective Scheduling Technique for VLIW Machines", PLDI 1988), in two
//! stages:
//!
//! ```text
//! first half of tap 0
//! for n in 1..count
//!     second half of tap n - 1, and among it the first half of tap n
//! second half of the last tap
//! ```
//!
//! What the halves have in common is carried over in scratch memory.

use rustc_hash::FxHashMap;

use super::program::{Id, Leaf, Op, Program};
use crate::lanes::Side;

/// A program in two stages.
pub(super) struct Pipeline {
    /// The first half.
    pub(super) first: Program,
    /// The second half, and among it the first half of the next tap.
    pub(super) both: Program,
    /// The second half.
    pub(super) last: Program,
    /// How many values are carried over.
    pub(super) carried: usize,
}

impl Pipeline {
    /// From a program and the heights of its ops ([`heights`](super::schedule::heights)).
    pub(super) fn new(program: &Program, heights: &[usize]) -> Self {
        let halves = Halves::new(program, heights);
        let [early, late] = [false, true].map(|late| {
            let ids = program.instructions().filter(|&id| halves.late[id as usize] == late);
            ids.collect::<Vec<Id>>()
        });
        let write = |early: &[Id], late: &[Id]| {
            let mut writer = Writer::new(program, &halves, !late.is_empty());
            // One among the other, so that both are well ahead of the order's choice.
            let (mut begun, mut ended) = (0, 0);
            while begun + ended < early.len() + late.len() {
                if begun * late.len() < ended * early.len() || ended == late.len() {
                    writer.begin(early[begun]);
                    begun += 1;
                } else {
                    writer.end(late[ended]);
                    ended += 1;
                }
            }
            Program::new(writer.ops)
        };
        Self {
            first: write(&early, &[]),
            both: write(&early, &late),
            last: write(&[], &late),
            carried: halves.carried.iter().flatten().count(),
        }
    }
}

/// Which instructions come in the second half, and what is carried over to it.
struct Halves {
    late: Vec<bool>,
    /// The numbers of the values that are carried.
    carried: Vec<Option<usize>>,
}

impl Halves {
    fn new(program: &Program, heights: &[usize]) -> Self {
        let cut = cut(program, heights);
        // The cursor of mirrored sums is that of the tap in its second half.
        let sum = |op: &Op| matches!(op, Op::Accumulate(..) | Op::Owe(..));
        let low = |(op, &height): (&Op, &usize)| sum(op) || height <= cut;
        let late: Vec<bool> = program.ops.iter().zip(heights).map(low).collect();
        let mut carried = vec![None; program.ops.len()];
        let mut count = 0;
        for id in program.instructions().filter(|&id| late[id as usize]) {
            for operand in program.ops[id as usize].operands() {
                let operand = operand as usize;
                let early = !late[operand] && !matches!(program.ops[operand], Op::Leaf(_));
                if early && carried[operand].is_none() {
                    carried[operand] = Some(count);
                    count += 1;
                }
            }
        }
        Self { late, carried }
    }
}

/// How many more values it is worth to carry over for a cut in the middle than for one at
/// an end, where the halves are as long as the whole. With 10, mirrored kernels and with 80
/// all take 3% longer on average.
const MIDDLE: usize = 30;

/// The height up to which instructions come in the second half: near half of that of
/// the highest, where few values are carried over.
fn cut(program: &Program, heights: &[usize]) -> usize {
    let highest = heights.iter().copied().max().unwrap_or(0);
    // Of each value, the lowest of its readers: where it is cut between, it is carried.
    let mut lowest: Vec<usize> = heights.to_vec();
    for id in program.instructions() {
        for operand in program.ops[id as usize].operands() {
            let lowest = &mut lowest[operand as usize];
            *lowest = (*lowest).min(heights[id as usize]);
        }
    }
    let mut begins = vec![0usize; highest + 2];
    let mut ends = vec![0usize; highest + 2];
    for id in program.instructions() {
        begins[lowest[id as usize]] += 1;
        ends[heights[id as usize]] += 1;
    }
    let mut carried = 0;
    let mut best = (usize::MAX, 0);
    for height in 0..=highest {
        carried = carried + begins[height] - ends[height];
        let away = (2 * height).abs_diff(highest);
        best = best.min((carried + MIDDLE * away / highest.max(1), height));
    }
    best.1
}

/// Writes down a half, or both.
struct Writer<'a> {
    program: &'a Program,
    halves: &'a Halves,
    /// Whether the first half is that of the next tap.
    ahead: bool,
    ops: Vec<Op>,
    leaves: FxHashMap<Leaf, Id>,
    /// What the instructions are called here.
    names: Vec<Id>,
}

impl<'a> Writer<'a> {
    fn new(program: &'a Program, halves: &'a Halves, ahead: bool) -> Self {
        let names = vec![0; program.ops.len()];
        Self { program, halves, ahead, ops: Vec::new(), leaves: FxHashMap::default(), names }
    }

    /// Writes down an instruction of the first half.
    fn begin(&mut self, id: Id) {
        let op =
            self.program.ops[id as usize].map(|operand| match self.program.ops[operand as usize] {
                Op::Leaf(Leaf::Plane(index, Side::J)) if self.ahead => {
                    self.leaf(Leaf::NextPlane(index))
                }
                Op::Leaf(Leaf::Tap(index)) if self.ahead => self.leaf(Leaf::NextTap(index)),
                Op::Leaf(leaf) => self.leaf(leaf),
                _ => self.names[operand as usize],
            });
        let name = self.push(op);
        self.names[id as usize] = name;
        if let Some(n) = self.halves.carried[id as usize] {
            self.push(Op::Carry(n, name));
        }
    }

    /// Writes down an instruction of the second half.
    fn end(&mut self, id: Id) {
        let op = self.program.ops[id as usize].map(|operand| {
            match (self.program.ops[operand as usize], self.halves.carried[operand as usize]) {
                (Op::Leaf(leaf), _) => self.leaf(leaf),
                (_, Some(n)) => self.leaf(Leaf::Carried(n)),
                _ => self.names[operand as usize],
            }
        });
        self.names[id as usize] = self.push(op);
    }

    fn push(&mut self, op: Op) -> Id {
        self.ops.push(op);
        // There are no more than twice as many as in the program.
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
}

#[cfg(test)]
mod tests {
    use super::super::program::{Binary, Recorder};
    use super::super::schedule::{heights, schedule};
    use super::*;
    use crate::lanes::Lanes;
    use crate::window::{Nest, WindowSpec};

    /// A chain of so many products by plane 1 at the neighbour.
    fn chain(length: usize) -> Program {
        let spec = WindowSpec {
            planes: 2,
            taps: 0,
            channels: 1,
            weights: 1,
            absolute: false,
            lone: false,
            mirrored: false,
        };
        let mut recorder = Recorder::new(spec);
        let mut value = recorder.plane(1, Side::I);
        for _ in 0..length {
            let factor = recorder.plane(1, Side::J);
            value = recorder.mul(value, factor);
        }
        let channel = recorder.plane(0, Side::J);
        recorder.accumulate(0, channel, value);
        recorder.finish().expect("planes 0 and 1 are there")
    }

    fn products(program: &Program) -> usize {
        let product = |op: &&Op| matches!(op, Op::Binary(Binary::Mul, ..));
        program.ops.iter().filter(product).count()
    }

    fn has(program: &Program, leaf: Leaf) -> bool {
        program.ops.iter().any(|op| matches!(op, Op::Leaf(found) if *found == leaf))
    }

    #[test]
    fn a_chain_is_cut_in_the_middle_and_one_value_carried_over() {
        let program = chain(20);
        let Pipeline { first, both, last, carried } = Pipeline::new(&program, &heights(&program));
        assert_eq!(carried, 1);
        assert_eq!(products(&both), 20);
        assert_eq!(products(&first) + products(&last), 20);
        assert!(products(&first).abs_diff(products(&last)) <= 2);
        let here = Leaf::Plane(1, Side::J);
        assert!(has(&first, here) && !has(&first, Leaf::NextPlane(1)));
        assert!(has(&both, here) && has(&both, Leaf::NextPlane(1)));
        assert!(has(&last, here) && !has(&last, Leaf::NextPlane(1)));
    }

    #[test]
    fn a_carried_value_is_read_before_the_next_takes_its_place() {
        let program = chain(20);
        let both = Pipeline::new(&program, &heights(&program)).both;
        let order = schedule(&both, 2, 30);
        let place = |wanted: &dyn Fn(&Op) -> bool| {
            order.iter().position(|&id| wanted(&both.ops[id as usize])).expect("it is there")
        };
        let reads = |op: &Op| {
            op.operands().any(|x| matches!(both.ops[x as usize], Op::Leaf(Leaf::Carried(0))))
        };
        assert!(place(&reads) < place(&|op| matches!(op, Op::Carry(0, _))));
    }

    #[test]
    fn sums_are_of_the_second_half_however_short_the_program() {
        let program = chain(0);
        let Pipeline { first, last, carried, .. } = Pipeline::new(&program, &heights(&program));
        assert_eq!((first.ops.len(), last.instructions().count(), carried), (0, 1, 0));
    }
}
