//! Instructions that an x86-64 processor may lack, made of those that every one has
//! (SSE2): the same bits by a longer way.
//!
//! Left to itself, Cranelift would call the C library for them, lane by lane: a
//! call saves every register, and what it rounds to is the library's business.

use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::types::{F32X4, F64X2, I8X16, I64X2};
use cranelift_codegen::ir::{ConstantData, Endianness, InstBuilder, MemFlagsData, Value};
use cranelift_codegen::isa::TargetIsa;
use cranelift_frontend::FunctionBuilder;

use super::{cast, choose, splat};

/// Which instructions are emulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Emulation {
    fma: bool,
    round: bool,
}

impl Emulation {
    /// What `isa` lacks.
    pub(crate) fn of(isa: &dyn TargetIsa) -> Self {
        let lacks = |name: &str| {
            isa.isa_flags().iter().any(|flag| flag.name == name && flag.as_bool() == Some(false))
        };
        // Other instruction sets have no such flags, and lack nothing.
        Self { fma: lacks("has_fma") || lacks("has_avx"), round: lacks("has_sse41") }
    }

    /// The names of what is emulated, for messages.
    pub(crate) fn names(self) -> Vec<&'static str> {
        let names = [(self.fma, "fused multiply-add"), (self.round, "rounding")];
        names.into_iter().filter_map(|(emulated, name)| emulated.then_some(name)).collect()
    }

    /// `x.mul_add(y, z)`.
    pub(super) fn fma(
        self,
        builder: &mut FunctionBuilder<'_>,
        x: Value,
        y: Value,
        z: Value,
    ) -> Value {
        if !self.fma {
            return builder.ins().fma(x, y, z);
        }
        let low = halves_fma(builder, [x, y, z]);
        let [x, y, z] = [x, y, z].map(|value| upper(builder, value));
        let high = halves_fma(builder, [x, y, z]);
        pack(builder, low, high)
    }

    /// `x.round_ties_even()`.
    pub(super) fn round(self, builder: &mut FunctionBuilder<'_>, x: Value) -> Value {
        if !self.round {
            return builder.ins().nearest(x);
        }
        // Numbers from 2²³ on are whole. So adding it to a smaller one rounds that, and
        // taking it away again is exact. The sign comes last, which keeps that of zero.
        let [sign, rest] = [0x8000_0000, 0x7fff_ffff].map(|bits| splat(builder, F32X4, bits));
        let whole = splat(builder, F32X4, 8_388_608.0f32.to_bits());
        let sign = builder.ins().band(x, sign);
        let size = builder.ins().band(x, rest);
        let shifted = builder.ins().fadd(size, whole);
        let rounded = builder.ins().fsub(shifted, whole);
        let fractional = builder.ins().fcmp(FloatCC::LessThan, size, whole);
        let rounded = choose(builder, fractional, rounded, size);
        builder.ins().bor(rounded, sign)
    }
}

/// `x * y + z` of the two lower lanes, rounded once, in the lower lanes; zeros in the
/// upper ones.
///
/// In f64 the product is exact, but the sum may be rounded, and rounding the rounded
/// sum to f32 would round a tie that was none. So the sum is *rounded to odd*: where
/// it is not exact, the one of its two neighbours is taken whose last bit is set. Such
/// a number is never a tie of a format with two bits less, and lies on the same side of
/// each as the exact sum, so the second rounding does what a single one would (Boldo
/// and Melquiond, 2008). Numbers of f32, subnormal ones too, and their products are far
/// inside the range of f64, so nothing overflows or underflows before that rounding.
fn halves_fma(builder: &mut FunctionBuilder<'_>, operands: [Value; 3]) -> Value {
    let [x, y, z] = operands.map(|value| builder.ins().fvpromote_low(value));
    let product = builder.ins().fmul(x, y);
    // Knuth's TwoSum: `sum` + `error` is exactly the product + z.
    let sum = builder.ins().fadd(product, z);
    let z_part = builder.ins().fsub(sum, product);
    let product_part = builder.ins().fsub(sum, z_part);
    let product_error = builder.ins().fsub(product, product_part);
    let z_error = builder.ins().fsub(z, z_part);
    let error = builder.ins().fadd(product_error, z_error);

    // The error of an infinite sum is no number, and so not more than zero: such a sum
    // stays as it is, and one that is no number stays none.
    let [zero, size] = [0, i64::MAX].map(|bits| {
        let bytes = ConstantData::from(bits.to_le_bytes().repeat(2));
        let handle = builder.func.dfg.constants.insert(bytes);
        builder.ins().vconst(F64X2, handle)
    });
    let size = builder.ins().band(error, size);
    let inexact = builder.ins().fcmp(FloatCC::LessThan, zero, size);
    // Cutting the exact sum off and setting the last bit rounds it to odd. Cut off it
    // is the rounded sum, or the number before that if the error has the other sign.
    let [sum, error] = [sum, error].map(|value| cast(builder, I64X2, value));
    let opposed = builder.ins().bxor(sum, error);
    let opposed = builder.ins().band(opposed, inexact);
    let excess = builder.ins().ushr_imm_u(opposed, 63);
    let odd = builder.ins().ushr_imm_u(inexact, 63);
    let cut = builder.ins().isub(sum, excess);
    let sum = builder.ins().bor(cut, odd);
    let sum = cast(builder, F64X2, sum);
    builder.ins().fvdemote(sum)
}

/// The upper two lanes in place of the lower two.
fn upper(builder: &mut FunctionBuilder<'_>, value: Value) -> Value {
    shuffle(builder, [value, value], [8, 8])
}

/// The lower two lanes of both.
fn pack(builder: &mut FunctionBuilder<'_>, low: Value, high: Value) -> Value {
    shuffle(builder, [low, high], [0, 16])
}

/// Eight bytes from each of two places in the bytes of both values.
fn shuffle(builder: &mut FunctionBuilder<'_>, values: [Value; 2], from: [u8; 2]) -> Value {
    // Where lanes change their size, a cast has to say in which order their bytes are.
    let flags = MemFlagsData::new().with_endianness(Endianness::Little);
    let [a, b] = values.map(|value| builder.ins().bitcast(I8X16, flags, value));
    let bytes: Vec<u8> = from.into_iter().flat_map(|first| first..first + 8).collect();
    let mask = builder.func.dfg.immediates.push(ConstantData::from(bytes));
    let shuffled = builder.ins().shuffle(a, b, mask);
    builder.ins().bitcast(F32X4, flags, shuffled)
}
