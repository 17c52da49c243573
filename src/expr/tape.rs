//! Straight-line code over primitives: what every back end consumes.
//!
//! A [`Tape`] is a list of instructions in static single assignment form, with
//! one or several results. Three kinds of instruction exist: a constant, an
//! input, and a [`Prim`] applied to earlier values. [`Prim::eval`] *is* the
//! meaning of a primitive; interpreter, machine code and shader must give the
//! same `f32`.
//!
//! There are no masks: the only conditional is the four-operand
//! [`Prim::SelectLt`], so that every value is a number and no back end needs a
//! second type.
//!
//! Tapes are made by a [`Builder`](super::builder::Builder), which follows the
//! [`Interval`] of every value and simplifies while it builds.

use rustc_hash::FxHashMap;

use super::feature::PlaneId;
use super::interval::Interval;

/// Which end of the pair (i, j) an input is read at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Side {
    /// The pixel being filtered.
    I,
    /// The neighbour that contributes.
    J,
}

impl Side {
    /// The other end.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::I => Self::J,
            Self::J => Self::I,
        }
    }
}

/// An image axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Axis {
    /// Columns, growing to the right.
    X,
    /// Rows, growing downwards.
    Y,
}

/// What a tape can read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Input {
    /// A feature plane, at pixel i or j.
    Plane(PlaneId, Side),
    /// The offset from i to j along an axis, in pixels: j - i.
    Offset(Axis),
    /// The k-th value that was computed beforehand for every pixel, at pixel i or j.
    PerPixel(u32, Side),
    /// The k-th value that was computed beforehand for this offset.
    PerTap(u32),
    /// The k-th of the planes that a program's kernel reads, at pixel i or j.
    Signal(u32, Side),
    /// The k-th number of a program's [`Constants`](super::constants::Constants), where its
    /// value is given when the code runs.
    Constant(u32),
}

/// A primitive operation on `f32`. No primitive traps; operands out of the
/// stated domain give what IEEE 754 says, and rows of the operator table guard
/// against them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Prim {
    /// `-a`
    Neg,
    /// `|a|`
    Abs,
    /// Square root, correctly rounded; NaN below zero.
    Sqrt,
    /// The nearest integer, ties to even.
    Round,
    /// 2^a for an integer a in [-127, 127]; 2^-127 is flushed to 0.
    Exp2i,
    /// The integer nearest to log2 a, for a positive normal number.
    Exponent,
    /// a over two to the power `Exponent(a) + 1`, for a positive normal number; for
    /// others too a number between √⅛ and √½.
    Fraction,
    /// `a + b`
    Add,
    /// `a - b`
    Sub,
    /// `a * b`
    Mul,
    /// `a / b`, correctly rounded.
    Div,
    /// `if a < b { a } else { b }`
    Min,
    /// `if a > b { a } else { b }`
    Max,
    /// `a * b + c`, rounded once.
    Fma,
    /// `if a < b { c } else { d }`
    SelectLt,
}

/// 1.5 * 2^23 + 127: adding it to a small integer leaves `integer + 127` in the
/// low bits of the sum, which is how [`Prim::Exp2i`] builds an exponent.
pub const EXP2I_MAGIC: f32 = 12_583_039.0;

/// The bits of the least numbers above √½ and √⅛: [`Prim::Exponent`] and [`Prim::Fraction`]
/// cut binades there, so that the logarithm of what is left is nearest to zero.
pub const ROOTS: [u32; 2] = [0x3f35_04f4, 0x3eb5_04f4];

impl Prim {
    /// Every primitive.
    pub const ALL: [Self; 15] = [
        Self::Neg,
        Self::Abs,
        Self::Sqrt,
        Self::Round,
        Self::Exp2i,
        Self::Exponent,
        Self::Fraction,
        Self::Add,
        Self::Sub,
        Self::Mul,
        Self::Div,
        Self::Min,
        Self::Max,
        Self::Fma,
        Self::SelectLt,
    ];

    /// Number of operands.
    pub fn arity(self) -> usize {
        match self {
            Self::Neg
            | Self::Abs
            | Self::Sqrt
            | Self::Round
            | Self::Exp2i
            | Self::Exponent
            | Self::Fraction => 1,
            Self::Add | Self::Sub | Self::Mul | Self::Div | Self::Min | Self::Max => 2,
            Self::Fma => 3,
            Self::SelectLt => 4,
        }
    }

    /// The meaning; operands beyond the arity are ignored.
    #[inline(always)]
    pub fn eval(self, [a, b, c, d]: [f32; 4]) -> f32 {
        match self {
            Self::Neg => -a,
            Self::Abs => a.abs(),
            Self::Sqrt => a.sqrt(),
            Self::Round => a.round_ties_even(),
            Self::Exp2i => f32::from_bits((a + EXP2I_MAGIC).to_bits() << 23),
            Self::Exponent => (a.to_bits().wrapping_sub(ROOTS[0]) as i32 >> 23) as f32,
            Self::Fraction => {
                f32::from_bits((a.to_bits().wrapping_sub(ROOTS[0]) & 0x007f_ffff) + ROOTS[1])
            }
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul => a * b,
            Self::Div => a / b,
            Self::Min => {
                if a < b {
                    a
                } else {
                    b
                }
            }
            Self::Max => {
                if a > b {
                    a
                } else {
                    b
                }
            }
            Self::Fma => a.mul_add(b, c),
            Self::SelectLt => {
                if a < b {
                    c
                } else {
                    d
                }
            }
        }
    }

    /// An enclosure of the result, given enclosures of the operands. `same`
    /// says that the first two operands are one value.
    pub fn range(self, [a, b, c, d]: [Interval; 4], same: bool) -> Interval {
        match self {
            Self::Neg => -a,
            Self::Abs => a.abs(),
            Self::Sqrt if a.lo >= 0.0 => a.increasing(f32::sqrt),
            Self::Sqrt => Interval::ENTIRE,
            Self::Round => a.increasing(f32::round_ties_even),
            Self::Exp2i if a.within(127.0) => {
                a.increasing(|x| Self::Exp2i.eval([x, 0.0, 0.0, 0.0]))
            }
            Self::Exp2i => Interval::ENTIRE,
            Self::Exponent if a.lo > 0.0 => {
                a.increasing(|x| Self::Exponent.eval([x, 0.0, 0.0, 0.0]))
            }
            Self::Exponent => Interval::new(-256.0, 255.0),
            Self::Fraction => Interval::new(f32::from_bits(ROOTS[1]), f32::from_bits(ROOTS[0] - 1)),
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul if same => a.square(),
            Self::Mul => a * b,
            Self::Div => a / b,
            Self::Min => Interval::new(a.lo.min(b.lo), a.hi.min(b.hi)),
            Self::Max => Interval::new(a.lo.max(b.lo), a.hi.max(b.hi)),
            Self::Fma if same => {
                let m = a.abs();
                Interval::new(m.lo.mul_add(m.lo, c.lo), m.hi.mul_add(m.hi, c.hi))
            }
            Self::Fma => a.fma(b, c),
            Self::SelectLt if a.hi < b.lo => c,
            Self::SelectLt if a.lo >= b.hi => d,
            Self::SelectLt => c.hull(d),
        }
    }
}

/// A value of a tape: the index of the instruction that makes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Value(u32);

impl Value {
    /// The index of the instruction that makes the value.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// One instruction. Constants are kept by their bits, so that equality and
/// hashing are exact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Instr {
    /// The bits of a constant.
    Const(u32),
    /// Something read from outside.
    Input(Input),
    /// A primitive; operands beyond its arity repeat the first one.
    Prim(Prim, [Value; 4]),
}

impl Instr {
    /// The operands, in order; none for constants and inputs.
    pub fn operands(&self) -> &[Value] {
        match self {
            Self::Const(_) | Self::Input(_) => &[],
            Self::Prim(prim, args) => &args[..prim.arity()],
        }
    }

    /// The same instruction on other operands.
    #[must_use]
    pub fn renamed(&self, rename: impl Fn(Value) -> Value) -> Self {
        match *self {
            leaf @ (Self::Const(_) | Self::Input(_)) => leaf,
            Self::Prim(prim, args) => {
                let mut new = [rename(args[0]); 4];
                for (new, &old) in new.iter_mut().zip(self.operands()).skip(1) {
                    *new = rename(old);
                }
                Self::Prim(prim, new)
            }
        }
    }
}

/// A function that shading languages have built in, and that is made of
/// primitives here because the built-in one is less accurate. A shader may use
/// it where speed is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Native {
    /// 2^x; 0 where that is no normal number.
    Exp2,
    /// log2 x, for positive x.
    Log2,
}

/// What is known of a value beside the instruction that makes it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Known {
    range: Interval,
    pinned: bool,
    native: Option<(Native, Value)>,
}

/// Straight-line code with one or several results. Every operand stands before
/// the instruction that uses it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tape {
    instrs: Vec<Instr>,
    known: Vec<Known>,
    results: Vec<Value>,
}

impl Tape {
    /// The instructions, operands first.
    pub fn instrs(&self) -> &[Instr] {
        &self.instrs
    }

    /// Every value with the instruction that makes it, operands first.
    pub fn iter(&self) -> impl Iterator<Item = (Value, &Instr)> {
        self.instrs.iter().enumerate().map(|(k, instr)| (Value(k as u32), instr))
    }

    /// The values that the tape is evaluated for.
    pub fn results(&self) -> &[Value] {
        &self.results
    }

    /// What is known of a value.
    pub fn range(&self, value: Value) -> Interval {
        self.known[value.index()].range
    }

    /// Whether later values rely on the rounding of this one: it is the high part
    /// of a number in two parts, say, or leaves a remainder that is computed. A
    /// compiler that contracts or reassociates must be kept away from it, and a
    /// fused multiply-add must really round once.
    pub fn is_pinned(&self, value: Value) -> bool {
        self.known[value.index()].pinned
    }

    /// The built-in function of an earlier value that this value approximates
    /// (better than the built-in does), if it is one.
    pub fn native(&self, value: Value) -> Option<(Native, Value)> {
        self.known[value.index()].native
    }

    /// The instruction that makes a value.
    pub fn instr(&self, value: Value) -> Instr {
        self.instrs[value.index()]
    }

    /// The inputs that the tape reads, in order of first use.
    pub fn inputs(&self) -> impl Iterator<Item = Input> + '_ {
        self.instrs.iter().filter_map(|instr| match *instr {
            Instr::Input(input) => Some(input),
            Instr::Const(_) | Instr::Prim(..) => None,
        })
    }

    /// Evaluates the tape once, on scalars: the definition that the faster back
    /// ends are held to. Returns the results in order.
    pub fn eval(&self, mut input: impl FnMut(Input) -> f32) -> Vec<f32> {
        let mut values: Vec<f32> = Vec::with_capacity(self.instrs.len());
        for instr in &self.instrs {
            values.push(match *instr {
                Instr::Const(bits) => f32::from_bits(bits),
                Instr::Input(which) => input(which),
                Instr::Prim(prim, args) => prim.eval(args.map(|a| values[a.index()])),
            });
        }
        self.results.iter().map(|r| values[r.index()]).collect()
    }

    pub(crate) fn push(&mut self, instr: Instr, range: Interval) -> Value {
        let value = Value(u32::try_from(self.instrs.len()).expect("a tape fits in 32 bits"));
        self.instrs.push(instr);
        self.known.push(Known { range, pinned: false, native: None });
        value
    }

    /// Appends an instruction of another tape with all that is known of its value.
    /// `rename` gives the new values of earlier ones, if they are here.
    pub(crate) fn push_from(
        &mut self,
        other: &Self,
        value: Value,
        rename: impl Fn(Value) -> Option<Value>,
    ) -> Value {
        let new = |v| rename(v).expect("operands come before what uses them");
        let known = other.known[value.index()];
        let copy = self.push(other.instr(value).renamed(new), known.range);
        let native = known.native.and_then(|(function, x)| Some((function, rename(x)?)));
        self.known[copy.index()] = Known { native, ..known };
        copy
    }

    pub(crate) fn set_range(&mut self, value: Value, range: Interval) {
        self.known[value.index()].range = range;
    }

    pub(crate) fn pin(&mut self, value: Value) {
        self.known[value.index()].pinned = true;
    }

    pub(crate) fn set_native(&mut self, value: Value, function: Native, x: Value) {
        self.known[value.index()].native = Some((function, x));
    }

    /// The same tape on other inputs.
    pub(crate) fn with_inputs(&self, mut rename: impl FnMut(Input) -> Input) -> Self {
        let mut renamed = self.clone();
        for instr in &mut renamed.instrs {
            if let Instr::Input(input) = instr {
                *input = rename(*input);
            }
        }
        renamed
    }

    /// Two tapes as one, with the first one's results before the second one's. `share` says
    /// whether equal instructions become one; `given` says which result of the first an
    /// input of the second is.
    pub(crate) fn joined(
        first: &Self,
        second: &Self,
        share: bool,
        given: impl Fn(Input) -> Option<usize>,
    ) -> Self {
        let mut both = Self::default();
        let mut made: FxHashMap<Instr, Value> = FxHashMap::default();
        let mut results = Vec::with_capacity(first.results.len() + second.results.len());
        for (tape, second) in [(first, false), (second, true)] {
            let mut renamed: Vec<Option<Value>> = Vec::with_capacity(tape.instrs.len());
            for (value, instr) in tape.iter() {
                let known = match *instr {
                    Instr::Input(input) if second => given(input).map(|k| results[k]),
                    Instr::Input(_) | Instr::Const(_) | Instr::Prim(..) => None,
                };
                let new = |v: Value| renamed[v.index()].expect("operands come first");
                let instr = instr.renamed(new);
                let known = known.or_else(|| made.get(&instr).copied().filter(|_| share));
                let copy =
                    known.unwrap_or_else(|| both.push_from(tape, value, |v| renamed[v.index()]));
                made.insert(instr, copy);
                renamed.push(Some(copy));
            }
            let new = |r: &Value| renamed[r.index()].expect("results are values");
            results.extend(tape.results.iter().map(new));
        }
        both.results = results;
        both
    }

    /// Keeps only what the given results need.
    pub(crate) fn finish(self, results: &[Value]) -> Self {
        let mut needed = vec![false; self.instrs.len()];
        for r in results {
            needed[r.index()] = true;
        }
        for k in (0..self.instrs.len()).rev() {
            if needed[k] {
                for a in self.instrs[k].operands() {
                    needed[a.index()] = true;
                }
            }
        }
        let mut kept = Self::default();
        let mut renamed = vec![None; self.instrs.len()];
        for (value, _) in self.iter().filter(|(value, _)| needed[value.index()]) {
            renamed[value.index()] = Some(kept.push_from(&self, value, |v| renamed[v.index()]));
        }
        let new = |r: &Value| renamed[r.index()].expect("results are needed");
        kept.results = results.iter().map(new).collect();
        kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponent_and_fraction_make_the_number() {
        let [root, _] = ROOTS;
        let around_roots = (1..255).flat_map(|e| {
            let root = (root & 0x007f_ffff) | (e << 23);
            [root - 1, root]
        });
        let normal = f32::MIN_POSITIVE.to_bits()..=f32::MAX.to_bits();
        for bits in normal.step_by(9973).chain(around_roots) {
            let x = f32::from_bits(bits);
            let [e, fraction] = [Prim::Exponent, Prim::Fraction]
                .map(|prim| f64::from(prim.eval([x, 0.0, 0.0, 0.0])));
            assert_eq!(e, f64::from(x).log2().round(), "{x:e}");
            assert_eq!(fraction * (e + 1.0).exp2(), f64::from(x), "{x:e}");
            let range = Prim::Fraction.range([Interval::point(x); 4], false);
            assert!(range.contains(fraction as f32), "{x:e}");
        }
    }
}
