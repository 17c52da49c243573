//! The order of a program's instructions.
//!
//! A body comes in the order in which its expression was written down, where each
//! instruction waits for the one before it: chains of fused multiply-adds, four
//! cycles each. Processors look ahead for others that do not wait, but only a few
//! hundred instructions; in a long body, which comes in several copies, they find more
//! of the same chain. So the order is made anew here, by list scheduling: the next
//! instruction is the one with the most still to come behind it, of those that need not
//! wait. That keeps more values alive than the order of an expression does, so where
//! registers run out, instructions come first that leave no more values than they found.

use std::cmp::Reverse;

use super::program::{Binary, Id, Leaf, Op, Program, Unary};

/// How many instructions are compared, of those whose operands were all emitted: the
/// first in the order of the program. With 32, batches of expressions take longer at 256
/// bits, where registers are few; with 8, they do at 512.
const WINDOW: usize = 16;

/// Registers that values cannot have, as the instruction at hand or a constant does.
const PASSING: usize = 4;

/// Cycles until the result of an instruction can be used, on recent processors of
/// either make, roughly.
fn latency(op: &Op) -> usize {
    match op {
        Op::Leaf(_) | Op::Carry(..) => 0,
        Op::Unary(Unary::Sqrt, _) => 20,
        Op::Binary(Binary::Div, ..) => 12,
        Op::Unary(Unary::ShiftLeft(_) | Unary::ShiftRight(_), _) => 1,
        Op::Binary(Binary::And | Binary::Xor | Binary::IntegerSub, ..) => 1,
        Op::Select(_) => 5,
        _ => 4,
    }
}

/// The instructions to emit, in their order, when each is emitted in so many copies and
/// their values have so many registers.
pub(super) fn schedule(program: &Program, copies: usize, registers: usize) -> Vec<Id> {
    let mut graph = Graph::new(program);
    let most = registers.saturating_sub(PASSING) / copies;
    let mut ready: Vec<Id> = program.instructions().filter(|&id| graph.waits(id) == 0).collect();
    let mut order = Vec::with_capacity(program.ops.len());
    let (mut now, mut alive) = (0, 0);
    let mut unread = Unread::new(program);
    while !ready.is_empty() {
        let full = alive >= most;
        let rank = |&(_, &id): &(usize, &Id)| {
            let more = if full { graph.growth(id).max(0) } else { 0 };
            let node = &graph.nodes[id as usize];
            (more, node.start.saturating_sub(now), Reverse(node.height))
        };
        let allowed = |&(_, &id): &(usize, &Id)| unread.allows(program.ops[id as usize]);
        // Of equals it is the first.
        let next = ready.iter().enumerate().filter(allowed).take(WINDOW).min_by_key(rank);
        // Nothing that reads a carried value waits for one to be carried over.
        let (place, &id) = next.expect("there is one at least");
        ready.remove(place);
        unread.read(program, id);
        alive = alive.saturating_add_signed(graph.growth(id));
        let start = now.max(graph.nodes[id as usize].start);
        now = start + copies;
        graph.emit(id, start + latency(&program.ops[id as usize]), |next| {
            let place = ready.partition_point(|&other| other < next);
            ready.insert(place, next);
        });
        order.push(id);
    }
    order
}

/// How many instructions are still to read each carried value, whose place that of the
/// next tap takes.
struct Unread(Vec<usize>);

impl Unread {
    fn new(program: &Program) -> Self {
        let mut unread = Self(Vec::new());
        for id in program.instructions() {
            for n in carried(program, id) {
                if unread.0.len() <= n {
                    unread.0.resize(n + 1, 0);
                }
                unread.0[n] += 1;
            }
        }
        unread
    }

    /// Whether an op may be emitted as far as carried values go.
    fn allows(&self, op: Op) -> bool {
        !matches!(op, Op::Carry(n, _) if self.0.get(n).is_some_and(|&unread| unread > 0))
    }

    /// Notes that an instruction is emitted.
    fn read(&mut self, program: &Program, id: Id) {
        for n in carried(program, id) {
            self.0[n] -= 1;
        }
    }
}

/// The numbers of the carried values that an instruction reads, with repetitions.
fn carried(program: &Program, id: Id) -> impl Iterator<Item = usize> + use<'_> {
    let operands = program.ops[id as usize].operands();
    operands.filter_map(|operand| match program.ops[operand as usize] {
        Op::Leaf(Leaf::Carried(n)) => Some(n),
        _ => None,
    })
}

/// Cycles from the start of each op to the end of the longest chain that it begins.
pub(super) fn heights(program: &Program) -> Vec<usize> {
    Graph::new(program).nodes.iter().map(|node| node.height).collect()
}

/// What is known of an op while instructions are put in order.
#[derive(Clone, Default)]
struct Node {
    /// Cycles from its start to the end of the longest chain that it begins.
    height: usize,
    /// When its operands are there.
    start: usize,
    /// Operands that are not emitted yet.
    waits: usize,
    /// Instructions that read it and are not emitted yet.
    readers: usize,
}

/// Instructions and who reads whom.
struct Graph<'a> {
    program: &'a Program,
    nodes: Vec<Node>,
    /// All ops' readers, those of an op together.
    readers: Vec<Id>,
    /// Where those of each op begin, and at last where all end.
    first: Vec<usize>,
}

impl<'a> Graph<'a> {
    fn new(program: &'a Program) -> Self {
        let count = program.ops.len();
        let nodes = vec![Node::default(); count];
        let mut graph = Self { program, nodes, readers: Vec::new(), first: vec![0; count + 1] };
        for id in program.instructions().rev() {
            let (operands, number) = graph.operands(id);
            let node = &mut graph.nodes[id as usize];
            node.height += latency(&program.ops[id as usize]);
            node.waits = number;
            let height = node.height;
            for &operand in &operands[..number] {
                let operand = &mut graph.nodes[operand as usize];
                operand.height = operand.height.max(height);
                operand.readers += 1;
            }
        }
        let mut end = 0;
        for (first, node) in graph.first.iter_mut().zip(&graph.nodes) {
            *first = end;
            end += node.readers;
        }
        graph.first[count] = end;
        let mut next = graph.first.clone();
        graph.readers = vec![0; end];
        for id in program.instructions() {
            let (operands, number) = graph.operands(id);
            for &operand in &operands[..number] {
                let place = &mut next[operand as usize];
                graph.readers[*place] = id;
                *place += 1;
            }
        }
        graph
    }

    fn is_instruction(&self, id: Id) -> bool {
        let id = id as usize;
        self.program.needed[id] && !matches!(self.program.ops[id], Op::Leaf(_))
    }

    /// The instructions among an op's operands, each once, and how many there are.
    fn operands(&self, id: Id) -> ([Id; 4], usize) {
        let (mut list, mut number) = ([0; 4], 0);
        for operand in self.program.ops[id as usize].operands() {
            if self.is_instruction(operand) && !list[..number].contains(&operand) {
                list[number] = operand;
                number += 1;
            }
        }
        (list, number)
    }

    fn waits(&self, id: Id) -> usize {
        self.nodes[id as usize].waits
    }

    /// How many more values are alive after an instruction than before it.
    fn growth(&self, id: Id) -> isize {
        let (operands, number) = self.operands(id);
        let last = |&&operand: &&Id| self.nodes[operand as usize].readers == 1;
        let dying = operands[..number].iter().filter(last).count();
        let made = usize::from(self.nodes[id as usize].readers > 0);
        made as isize - dying as isize
    }

    /// Notes that an instruction is emitted and its result there at `done`; tells which
    /// others wait no longer.
    fn emit(&mut self, id: Id, done: usize, mut ready: impl FnMut(Id)) {
        let (operands, number) = self.operands(id);
        for &operand in &operands[..number] {
            self.nodes[operand as usize].readers -= 1;
        }
        let readers = self.first[id as usize]..self.first[id as usize + 1];
        for &reader in &self.readers[readers] {
            let node = &mut self.nodes[reader as usize];
            node.start = node.start.max(done);
            node.waits -= 1;
            if node.waits == 0 {
                ready(reader);
            }
        }
    }
}
