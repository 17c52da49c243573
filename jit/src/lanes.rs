//! The assembler interface: one method per instruction, on typed handles.
//!
//! [`Lanes`] is what a [`Body`] is written against and what a code generator
//! implements. A handle `F` stands for the same value in every lane of every
//! interleaved chain; each lane is one output pixel *i*, paired with its
//! neighbour *j* for the tap at hand. Lanes never talk to one another, so the
//! meaning of a method is the meaning in one lane: an exact `f32 -> f32`
//! function, given in its doc comment as Rust. Any other evaluator that follows
//! those lines gets the same bits; [`Scalar`](crate::Scalar) is one.
//!
//! Everything is IEEE 754 single precision, rounded to nearest even, with
//! subnormals kept and signed zeros as the standard has them. What is not promised
//! is the sign and the payload of a NaN (`y - x` may stand for `-x + y`), nor then what
//! [`exp2i`](Lanes::exp2i), [`exponent`](Lanes::exponent) and
//! [`fraction`](Lanes::fraction), which read bits, make of one.

/// Which pixel of the pair a plane is read at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// The output pixel *i*.
    I,
    /// Its neighbour *j*, which is *i* moved by the current tap.
    J,
}

/// Emits straight-line `f32` code, one instruction per method.
pub trait Lanes {
    /// The value of one node, in all lanes of all chains.
    type F: Copy;
    /// A truth value per lane.
    type M: Copy;

    /// `value` in every lane.
    ///
    /// Best emitted right before its use, and once for several uses that are
    /// close: one load serves all chains, but a constant kept over a long body
    /// takes a register from it.
    fn constant(&mut self, value: f32) -> Self::F;

    /// The value of plane number `index` at one pixel of the pair.
    fn plane(&mut self, index: usize, side: Side) -> Self::F;

    /// The `index`-th uniform value of the current tap, in every lane.
    fn tap(&mut self, index: usize) -> Self::F;

    /// `-x`: the sign bit flipped, whatever `x` is.
    fn neg(&mut self, x: Self::F) -> Self::F;

    /// `x.abs()`: the sign bit cleared, whatever `x` is.
    fn abs(&mut self, x: Self::F) -> Self::F;

    /// `x.sqrt()`, correctly rounded; `-0.0` stays `-0.0`.
    fn sqrt(&mut self, x: Self::F) -> Self::F;

    /// `x.round_ties_even()`; the sign of a zero result is that of `x`.
    fn round(&mut self, x: Self::F) -> Self::F;

    /// 2 to the power `x`, for whole `x` in `-127..=127`, where -127 gives `+0.0`:
    /// `f32::from_bits((x + 12_583_039.0).to_bits() << 23)`.
    ///
    /// The constant is 1.5 × 2²³ + 127. Adding it leaves the biased exponent in
    /// the low bits of the sum. The formula is also what any other `x` gets.
    fn exp2i(&mut self, x: Self::F) -> Self::F;

    /// The integer nearest to log2 x, for positive normal `x`:
    /// `(x.to_bits().wrapping_sub(0x3f35_04f4) as i32 >> 23) as f32`.
    ///
    /// The constant has the bits of the least number above √½. The formula is also what
    /// any other `x` gets.
    fn exponent(&mut self, x: Self::F) -> Self::F;

    /// `x` over two to the power `exponent(x) + 1`, for positive normal `x`:
    /// `f32::from_bits((x.to_bits().wrapping_sub(0x3f35_04f4) & 0x007f_ffff) + 0x3eb5_04f4)`.
    ///
    /// The last constant has the bits of the least number above √⅛. The result is between that
    /// and √½, for any other `x` too.
    fn fraction(&mut self, x: Self::F) -> Self::F;

    /// `x + y`.
    fn add(&mut self, x: Self::F, y: Self::F) -> Self::F;

    /// `x - y`.
    fn sub(&mut self, x: Self::F, y: Self::F) -> Self::F;

    /// `x * y`.
    fn mul(&mut self, x: Self::F, y: Self::F) -> Self::F;

    /// `x / y`.
    fn div(&mut self, x: Self::F, y: Self::F) -> Self::F;

    /// `if x < y { x } else { y }`: `y` for a NaN, and for zeros of either sign.
    fn min(&mut self, x: Self::F, y: Self::F) -> Self::F;

    /// `if x > y { x } else { y }`: `y` for a NaN, and for zeros of either sign.
    fn max(&mut self, x: Self::F, y: Self::F) -> Self::F;

    /// `x.mul_add(y, z)`: `x * y + z` with a single rounding.
    fn fma(&mut self, x: Self::F, y: Self::F, z: Self::F) -> Self::F;

    /// `x < y`, which is false for a NaN.
    fn lt(&mut self, x: Self::F, y: Self::F) -> Self::M;

    /// `if mask { x } else { y }`, bits untouched.
    fn select(&mut self, mask: Self::M, x: Self::F, y: Self::F) -> Self::F;
}

/// The straight-line program inside the loops: the weights of one pair (i, j).
///
/// It is a trait and not a closure so that one program serves every code
/// generator, and so that a handle can never be carried from one compilation
/// into another: its type is known only inside `emit`.
pub trait Body {
    /// Emits the program once and returns as many weights as the
    /// [`WindowSpec`](crate::WindowSpec) asks for, in their order.
    ///
    /// Nothing is shared or folded behind the caller's back: what is asked for
    /// twice is emitted twice.
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F>;
}
