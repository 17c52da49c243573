//! The loops of a kernel, and where its partial sums live while they run.

use std::array;
use std::mem::offset_of;

use cranelift_codegen::ir::types::{F32X4, I64};
use cranelift_codegen::ir::{BlockArg, InstBuilder, StackSlotData, StackSlotKind, Value};
use cranelift_frontend::FunctionBuilder;

use super::{Assembler, LANES, Node, UNALIGNED, VECTOR, load_field};
use crate::call::{Call, RunCall};
use crate::lanes::Lanes;
use crate::window::Nest;

/// Where the loops stand; see the table in [`call`](crate::call).
#[derive(Clone, Copy)]
pub(super) struct Cursors {
    pub(super) pixel: Value,
    pub(super) neighbour: Value,
    pub(super) mirror: Value,
    pub(super) tap: Value,
    pub(super) out: Value,
    /// The address of the [`RunCall`] at hand.
    pub(super) run: Value,
}

/// Vectors of partial sums that stay in registers: half of those that x86-64 has,
/// as the body needs some too.
///
/// With more, the allocator moves each of them from stack slot to stack slot in
/// every round. Measured, stored against carried: 4 and 8 vectors around a body
/// of one instruction take 1.8 and 1.7 times as long; 16 around one or around an
/// exponential 1.04 and 0.96; a batch of 64 to 256 runs no slower and compiles
/// in 0.63 to 0.4 of the time.
const CARRIED: usize = 8;

/// The partial sums of a run of taps.
pub(super) enum Partials<const N: usize> {
    /// Values that the loop passes from one tap to the next.
    Carried(Vec<Node<N>>),
    /// Memory on the stack, at this address.
    Stored(Value),
}

impl<const N: usize> Partials<N> {
    /// Chooses, and makes room, for `count` partials.
    pub(super) fn new(builder: &mut FunctionBuilder<'_>, count: usize) -> Self {
        if count * N <= CARRIED {
            return Self::Carried(Vec::new());
        }
        let bytes = (count * N) as u32 * VECTOR as u32;
        let slot = StackSlotData::new(StackSlotKind::ExplicitSlot, bytes, 4);
        let slot = builder.create_sized_stack_slot(slot);
        Self::Stored(builder.ins().stack_addr(I64, slot, 0))
    }

    /// The values for the loop to pass on.
    fn carried(&self) -> Vec<Value> {
        match self {
            Self::Carried(nodes) => nodes.iter().flat_map(|node| node.0).collect(),
            Self::Stored(_) => Vec::new(),
        }
    }

    /// Takes up the values that the loop passed on.
    fn set_carried(&mut self, values: &[Value]) {
        if let Self::Carried(nodes) = self {
            *nodes = values
                .chunks_exact(N)
                .map(|chunk| Node(array::from_fn(|chain| chunk[chain])))
                .collect();
        }
    }
}

/// Where a stored partial lies.
fn place<const N: usize>(index: usize, chain: usize) -> i32 {
    (index * N + chain) as i32 * VECTOR
}

impl<const N: usize> Assembler<'_, N> {
    /// Emits a loop that runs `count` times, at least once, and passes `carried`
    /// from one round to the next.
    fn repeat(
        &mut self,
        count: Value,
        carried: &[Value],
        body: impl FnOnce(&mut Self, &[Value]) -> Vec<Value>,
    ) {
        let [head, exit] = array::from_fn(|_| self.builder.create_block());
        let mut start = vec![BlockArg::Value(count)];
        self.builder.append_block_param(head, I64);
        for &value in carried {
            let ty = self.builder.func.dfg.value_type(value);
            self.builder.append_block_param(head, ty);
            start.push(BlockArg::Value(value));
        }
        self.builder.ins().jump(head, &start);
        self.builder.switch_to_block(head);

        let params = self.builder.block_params(head).to_vec();
        let next = body(self, &params[1..]);

        let left = self.builder.ins().iadd_imm_s(params[0], -1);
        let again: Vec<_> =
            [left].iter().chain(&next).map(|&value| BlockArg::Value(value)).collect();
        self.builder.ins().brif(left, head, &again, exit, &[]);
        self.builder.switch_to_block(exit);
    }

    /// `cursor` moved by a constant number of bytes.
    fn advance(&mut self, cursor: Value, bytes: usize) -> Value {
        self.builder.ins().iadd_imm_u(cursor, bytes as i64)
    }

    /// A field of the run at hand.
    fn run_field(&mut self, offset: usize) -> Value {
        load_field(&mut self.builder, self.at.run, offset)
    }

    /// `cursor` moved by a number of bytes from the run at hand.
    fn advance_by_run(&mut self, cursor: Value, offset: usize) -> Value {
        let bytes = self.run_field(offset);
        self.builder.ins().iadd(cursor, bytes)
    }

    /// The address of a result of the chunk at hand.
    fn result(&mut self, index: usize) -> Value {
        self.strided(self.at.out, index, offset_of!(Call, out_stride))
    }

    /// The address of a mirrored sum of the neighbour at hand.
    fn mirrored(&mut self, index: usize) -> Value {
        self.strided(self.at.mirror, index, offset_of!(Call, mirror_stride))
    }

    /// `base` moved by `index` times a field of the [`Call`].
    fn strided(&mut self, base: Value, index: usize, stride: usize) -> Value {
        if index == 0 {
            return base;
        }
        let stride = self.field(stride);
        let offset = self.builder.ins().imul_imm_u(stride, index as i64);
        self.builder.ins().iadd(base, offset)
    }

    /// Sets all partials to +0.0.
    fn clear_partials(&mut self) {
        let zero = self.constant(0.0);
        let count = self.spec.results();
        match &mut self.partials {
            Partials::Carried(nodes) => *nodes = vec![zero; count],
            &mut Partials::Stored(base) => {
                for (index, chain) in (0..count).flat_map(|n| (0..N).map(move |k| (n, k))) {
                    let (value, place) = (zero.0[chain], place::<N>(index, chain));
                    self.builder.ins().store(UNALIGNED, value, base, place);
                }
            }
        }
    }
}

/// Every loop puts its cursors back where it found them.
impl<const N: usize> Nest for Assembler<'_, N> {
    fn for_chunks(&mut self, body: impl FnOnce(&mut Self)) {
        let start = self.at;
        let step = N * LANES * size_of::<f32>();
        let count = self.field(offset_of!(Call, chunks));
        self.repeat(count, &[start.pixel, start.out], |asm, at| {
            asm.at = Cursors { pixel: at[0], out: at[1], ..start };
            body(asm);
            at.iter().map(|&cursor| asm.advance(cursor, step)).collect()
        });
        self.at = start;
    }

    fn for_runs(&mut self, body: impl FnOnce(&mut Self)) {
        let start = self.at;
        let count = self.field(offset_of!(Call, run_count));
        let first = self.field(offset_of!(Call, runs));
        self.repeat(count, &[first], |asm, at| {
            asm.at.run = at[0];
            asm.at.neighbour = asm.advance_by_run(start.pixel, offset_of!(RunCall, neighbour));
            asm.at.tap = asm.run_field(offset_of!(RunCall, taps));
            if asm.spec.mirrored {
                asm.at.mirror = asm.advance_by_run(start.pixel, offset_of!(RunCall, mirror));
            }
            body(asm);
            vec![asm.advance(at[0], size_of::<RunCall>())]
        });
        self.at = start;
    }

    fn for_taps(&mut self, body: impl FnOnce(&mut Self)) {
        let run = self.at;
        let tap_bytes = self.spec.taps * size_of::<f32>();
        let count = self.run_field(offset_of!(RunCall, count));
        let mut carried = vec![run.neighbour, run.tap];
        // Where there is none, it need not be carried along.
        carried.extend(self.spec.mirrored.then_some(run.mirror));
        let cursors = carried.len();
        self.clear_partials();
        carried.extend(self.partials.carried());
        self.repeat(count, &carried, |asm, at| {
            asm.at.neighbour = at[0];
            asm.at.tap = at[1];
            if asm.spec.mirrored {
                asm.at.mirror = at[2];
            }
            asm.partials.set_carried(&at[cursors..]);
            body(asm);
            let step = offset_of!(RunCall, step);
            let mut next = vec![asm.advance_by_run(at[0], step), asm.advance(at[1], tap_bytes)];
            if asm.spec.mirrored {
                next.push(asm.advance_by_run(at[2], step));
            }
            next.extend(asm.partials.carried());
            next
        });
        self.at = run;
    }

    fn accumulate(&mut self, index: usize, channel: Node<N>, weight: Node<N>) {
        // The channel comes first because x86-64 overwrites the first factor,
        // and the channel is what is needed least afterwards.
        match &mut self.partials {
            Partials::Carried(nodes) => {
                let builder = &mut self.builder;
                for (k, p) in nodes[index].0.iter_mut().enumerate() {
                    *p = self.emulation.fma(builder, channel.0[k], weight.0[k], *p);
                }
            }
            &mut Partials::Stored(base) => {
                for k in 0..N {
                    let (flags, place) = (UNALIGNED, place::<N>(index, k));
                    let p = self.builder.ins().load(F32X4, flags, base, place);
                    let p = self.fused(channel.0[k], weight.0[k], p);
                    self.builder.ins().store(flags, p, base, place);
                }
            }
        }
    }

    fn accumulate_mirrored(&mut self, index: usize, channel: Node<N>, weight: Node<N>) {
        let address = self.mirrored(index);
        for k in 0..N {
            let place = k as i32 * VECTOR;
            let sum = self.builder.ins().load(F32X4, UNALIGNED, address, place);
            let sum = self.fused(channel.0[k], weight.0[k], sum);
            self.builder.ins().store(UNALIGNED, sum, address, place);
        }
    }

    fn partial(&mut self, index: usize) -> Node<N> {
        match &self.partials {
            Partials::Carried(nodes) => nodes[index],
            &Partials::Stored(base) => self.each(|b, k| {
                let place = place::<N>(index, k);
                b.ins().load(F32X4, UNALIGNED, base, place)
            }),
        }
    }

    fn add_to_result(&mut self, index: usize, value: Node<N>) {
        let address = self.result(index);
        for (k, &value) in value.0.iter().enumerate() {
            let place = k as i32 * VECTOR;
            let sum = self.builder.ins().load(F32X4, UNALIGNED, address, place);
            let sum = self.builder.ins().fadd(sum, value);
            self.builder.ins().store(UNALIGNED, sum, address, place);
        }
    }
}
