//! [`Lanes`] on top of Cranelift's 128-bit vectors: four lanes per chain, `N`
//! chains side by side. The loops around them are in [`loops`].
//!
//! A kernel waits on latency more than on throughput, so every node is emitted
//! for all chains before the next node begins: neighbours in the instruction
//! stream do not depend on one another. Cranelift's optimiser would undo that
//! order, so it is off; folding and sharing are the business of whoever writes
//! the [`Body`](crate::Body).
//!
//! The instructions are picked for what they become:
//!
//! | method       | emitted as                           | instead of                    |
//! |--------------|--------------------------------------|-------------------------------|
//! | min, max     | `bitselect` on `fcmp`: one `vminps`  | `fmin`: 7-8 instructions      |
//! | select       | `bitselect` on `fcmp`: `vpblendvb`   | `bitselect` on any mask: 3    |
//! | neg, abs     | xor, and with a constant             | `fneg`, `fabs`: 3             |
//! | exp2i        | magic-number add and a shift         | `fcvt_to_sint_sat`: 7         |
//!
//! The x86-64 patterns need to see the comparison itself, which is why a mask is
//! nothing but the result of [`Lanes::lt`]. What an x86-64 processor without FMA or
//! SSE4.1 lacks is made in [`emulation`].

mod emulation;
mod loops;

use std::array;
use std::mem::offset_of;

use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::types::{F32, F32X4, I32X4, I64};
use cranelift_codegen::ir::{ConstantData, InstBuilder, MemFlagsData, Type, Value};
use cranelift_frontend::FunctionBuilder;

use crate::call::Call;
use crate::error::CompileError;
use crate::lanes::{Lanes, Side};
use crate::window::WindowSpec;
pub(crate) use emulation::Emulation;
use loops::{Cursors, Partials};

/// Lanes in a vector.
pub(crate) const LANES: usize = 4;

/// Bytes in a vector and in a float.
const VECTOR: i32 = 16;
const FLOAT: i32 = 4;

/// Addresses were checked before the call, but vectors start at any float.
const UNALIGNED: MemFlagsData = MemFlagsData::new().with_notrap();

/// One node: a vector for each of the `N` chains.
#[derive(Clone, Copy)]
pub(crate) struct Node<const N: usize>([Value; N]);

/// The result of a comparison, all ones or all zeros in every lane.
#[derive(Clone, Copy)]
pub(crate) struct Mask<const N: usize>([Value; N]);

/// Emits into one Cranelift function.
pub(crate) struct Assembler<'f, const N: usize> {
    builder: FunctionBuilder<'f>,
    spec: WindowSpec,
    emulation: Emulation,
    call: Value,
    planes: Value,
    at: Cursors,
    partials: Partials<N>,
    fault: Option<CompileError>,
}

impl<'f, const N: usize> Assembler<'f, N> {
    /// Opens the function, whose one parameter is the address of a [`Call`].
    pub(crate) fn new(
        mut builder: FunctionBuilder<'f>,
        spec: WindowSpec,
        emulation: Emulation,
    ) -> Self {
        let entry = builder.create_block();
        builder.append_block_params_for_function_params(entry);
        builder.switch_to_block(entry);
        let call = builder.block_params(entry)[0];
        let mut field = |offset| load_field(&mut builder, call, offset);
        let planes = field(offset_of!(Call, planes));
        let (pixel, out) = (field(offset_of!(Call, pixel)), field(offset_of!(Call, out)));
        // The loops over runs and taps set the others before anything reads them.
        let at = Cursors { pixel, neighbour: pixel, mirror: pixel, tap: out, out, run: out };
        let partials = Partials::new(&mut builder, spec.results());
        Self { builder, spec, emulation, call, planes, at, partials, fault: None }
    }

    /// Closes the function; reports the first plane or tap value that the body
    /// had no right to read.
    pub(crate) fn finish(mut self) -> Result<FunctionBuilder<'f>, CompileError> {
        self.builder.ins().return_(&[]);
        self.builder.seal_all_blocks();
        self.fault.map_or(Ok(self.builder), Err)
    }

    fn field(&mut self, offset: usize) -> Value {
        load_field(&mut self.builder, self.call, offset)
    }

    /// One instruction per chain, side by side.
    fn each(&mut self, mut emit: impl FnMut(&mut FunctionBuilder<'f>, usize) -> Value) -> Node<N> {
        Node(array::from_fn(|chain| emit(&mut self.builder, chain)))
    }

    /// `bits` in every lane, shared by all chains.
    fn splat(&mut self, ty: Type, bits: u32) -> Value {
        splat(&mut self.builder, ty, bits)
    }

    /// `x.mul_add(y, z)` in one chain.
    fn fused(&mut self, x: Value, y: Value, z: Value) -> Value {
        self.emulation.fma(&mut self.builder, x, y, z)
    }

    /// Remembers the first fault and stands in for the value.
    fn refuse(&mut self, fault: CompileError) -> Node<N> {
        self.fault.get_or_insert(fault);
        self.constant(0.0)
    }
}

fn load_field(builder: &mut FunctionBuilder<'_>, call: Value, offset: usize) -> Value {
    builder.ins().load(I64, MemFlagsData::trusted(), call, offset as i32)
}

fn splat(builder: &mut FunctionBuilder<'_>, ty: Type, bits: u32) -> Value {
    let bytes = bits.to_le_bytes().repeat(LANES);
    let handle = builder.func.dfg.constants.insert(ConstantData::from(bytes));
    builder.ins().vconst(ty, handle)
}

fn cast(builder: &mut FunctionBuilder<'_>, ty: Type, value: Value) -> Value {
    builder.ins().bitcast(ty, MemFlagsData::new(), value)
}

/// `if mask { a } else { b }`, in the form that becomes one instruction where
/// there is one.
fn choose(builder: &mut FunctionBuilder<'_>, mask: Value, a: Value, b: Value) -> Value {
    let mask = cast(builder, F32X4, mask);
    builder.ins().bitselect(mask, a, b)
}

impl<const N: usize> Lanes for Assembler<'_, N> {
    type F = Node<N>;
    type M = Mask<N>;

    fn constant(&mut self, value: f32) -> Node<N> {
        Node([self.splat(F32X4, value.to_bits()); N])
    }

    fn plane(&mut self, index: usize, side: Side) -> Node<N> {
        let planes = self.spec.planes;
        if index >= planes {
            return self.refuse(CompileError::Plane { index, planes });
        }
        let offset = match side {
            Side::I => self.at.pixel,
            Side::J => self.at.neighbour,
        };
        let entry = (index * size_of::<*const f32>()) as i32;
        let flags = MemFlagsData::trusted();
        let plane = self.builder.ins().load(I64, flags, self.planes, entry);
        let address = self.builder.ins().iadd(plane, offset);
        self.each(|b, chain| {
            let place = chain as i32 * VECTOR;
            b.ins().load(F32X4, UNALIGNED, address, place)
        })
    }

    fn tap(&mut self, index: usize) -> Node<N> {
        let taps = self.spec.taps;
        if index >= taps {
            return self.refuse(CompileError::Tap { index, taps });
        }
        let place = index as i32 * FLOAT;
        let value = self.builder.ins().load(F32, UNALIGNED, self.at.tap, place);
        Node([self.builder.ins().splat(F32X4, value); N])
    }

    fn neg(&mut self, x: Node<N>) -> Node<N> {
        let sign = self.splat(F32X4, 0x8000_0000);
        self.each(|b, k| b.ins().bxor(x.0[k], sign))
    }

    fn abs(&mut self, x: Node<N>) -> Node<N> {
        let magnitude = self.splat(F32X4, 0x7fff_ffff);
        self.each(|b, k| b.ins().band(x.0[k], magnitude))
    }

    fn sqrt(&mut self, x: Node<N>) -> Node<N> {
        self.each(|b, k| b.ins().sqrt(x.0[k]))
    }

    fn round(&mut self, x: Node<N>) -> Node<N> {
        let emulation = self.emulation;
        self.each(|b, k| emulation.round(b, x.0[k]))
    }

    fn exp2i(&mut self, x: Node<N>) -> Node<N> {
        let magic = self.constant(12_583_039.0);
        let biased = self.add(x, magic);
        self.each(|b, k| {
            let bits = cast(b, I32X4, biased.0[k]);
            let bits = b.ins().ishl_imm_u(bits, 23);
            cast(b, F32X4, bits)
        })
    }

    fn exponent(&mut self, x: Node<N>) -> Node<N> {
        let root = self.splat(I32X4, 0x3f35_04f4);
        self.each(|b, k| {
            let bits = cast(b, I32X4, x.0[k]);
            let above = b.ins().isub(bits, root);
            let exponent = b.ins().sshr_imm_u(above, 23);
            b.ins().fcvt_from_sint(F32X4, exponent)
        })
    }

    fn fraction(&mut self, x: Node<N>) -> Node<N> {
        let [root, mantissa, quarter] =
            [0x3f35_04f4, 0x007f_ffff, 0x3eb5_04f4].map(|bits| self.splat(I32X4, bits));
        self.each(|b, k| {
            let bits = cast(b, I32X4, x.0[k]);
            let above = b.ins().isub(bits, root);
            let rest = b.ins().band(above, mantissa);
            let bits = b.ins().iadd(rest, quarter);
            cast(b, F32X4, bits)
        })
    }

    fn add(&mut self, x: Node<N>, y: Node<N>) -> Node<N> {
        self.each(|b, k| b.ins().fadd(x.0[k], y.0[k]))
    }

    fn sub(&mut self, x: Node<N>, y: Node<N>) -> Node<N> {
        self.each(|b, k| b.ins().fsub(x.0[k], y.0[k]))
    }

    fn mul(&mut self, x: Node<N>, y: Node<N>) -> Node<N> {
        self.each(|b, k| b.ins().fmul(x.0[k], y.0[k]))
    }

    fn div(&mut self, x: Node<N>, y: Node<N>) -> Node<N> {
        self.each(|b, k| b.ins().fdiv(x.0[k], y.0[k]))
    }

    fn min(&mut self, x: Node<N>, y: Node<N>) -> Node<N> {
        self.each(|b, k| {
            let less = b.ins().fcmp(FloatCC::LessThan, x.0[k], y.0[k]);
            choose(b, less, x.0[k], y.0[k])
        })
    }

    fn max(&mut self, x: Node<N>, y: Node<N>) -> Node<N> {
        self.each(|b, k| {
            let greater = b.ins().fcmp(FloatCC::LessThan, y.0[k], x.0[k]);
            choose(b, greater, x.0[k], y.0[k])
        })
    }

    fn fma(&mut self, x: Node<N>, y: Node<N>, z: Node<N>) -> Node<N> {
        let emulation = self.emulation;
        self.each(|b, k| emulation.fma(b, x.0[k], y.0[k], z.0[k]))
    }

    fn lt(&mut self, x: Node<N>, y: Node<N>) -> Mask<N> {
        Mask(self.each(|b, k| b.ins().fcmp(FloatCC::LessThan, x.0[k], y.0[k])).0)
    }

    fn select(&mut self, mask: Mask<N>, x: Node<N>, y: Node<N>) -> Node<N> {
        self.each(|b, k| choose(b, mask.0[k], x.0[k], y.0[k]))
    }
}
