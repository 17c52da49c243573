//! Tapes as WGSL: one `let` per value, one match over the primitives.
//!
//! This writes tapes; `shader` puts them into kernels. A tape is written value by
//! value, never as nested expressions: compilers of shading languages give up on
//! deep nesting, not on long functions.
//!
//! # What WGSL leaves open, and what is done about it
//!
//! The language lets a compiler contract `a * b + c`, reassociate sums, round a
//! quotient to 2.5 units in the last place and a square root to about 3, compute
//! `fma` with two roundings, flush subnormal numbers, and assume that there are
//! no infinities and no NaNs. A filter does not care, but for a few roundings
//! that the elementary functions rely on; the tape says which
//! ([`Tape::is_pinned`]). [`Precision::Standard`] makes sure of those:
//!
//! * A pinned value passes through `pinned()`, an exclusive or of its bits with a
//!   zero that the compiler cannot know (it comes from a uniform).
//! * A pinned fused multiply-add, a quotient and a square root are the built-ins
//!   where the device was *measured* to round them once ([`Arithmetic`]), and
//!   otherwise are made of other operations.
//!
//! There is no test for NaN anywhere: tapes guard with `min` and `max`, so that
//! none arises. Infinities arise in sums alone, and are found by their bits.
//!
//! # Which function is whose
//!
//! | row | `exact` | `fast` |
//! |---|---|---|
//! | `exp` | polynomial, 1 ulp | built-in `exp2`, which WGSL guarantees to 3 + 2 abs(x) ulp |
//! | `pow` | polynomials in two parts, 3.5 ulp | built-in `exp2` and `log2`: good enough up to exponents of 16 |
//! | `sin` `cos` `tan` `sinc` | polynomial | polynomial: WGSL guarantees `sin` to 2^-11 within ±pi only, nothing beyond |
//! | `asin` `acos` `atan` | polynomial | polynomial: WGSL guarantees 4096 ulp |
//! | `sqrt`, `/` | rounded once | built-in |
//! | all others | their primitives | their primitives, contracted as the compiler likes |
//!
//! `fast` takes 0.4 to 1.1 of the time of `standard` on llvmpipe
//! (`benches/RESULTS.md`), and its budgets stand in the rows ([`Fast`]).
//!
//! [`Fast`]: crate::expr::function::Fast

use std::fmt::Write;

use crate::expr::tape::{EXP2I_MAGIC, Input, Instr, Native, Prim, Tape, Value};
use crate::plan::Precision;

/// What a device rounds correctly, beyond what WGSL asks of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Arithmetic {
    /// `fma(a, b, c)` is rounded once.
    pub fused: bool,
    /// `a / b` is correctly rounded.
    pub quotients: bool,
    /// `sqrt(a)` is correctly rounded.
    pub roots: bool,
}

impl Arithmetic {
    /// Everything as in IEEE 754.
    pub const IEEE: Self = Self { fused: true, quotients: true, roots: true };
    /// No more than WGSL guarantees.
    pub const WGSL: Self = Self { fused: false, quotients: false, roots: false };
}

/// How tapes are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Dialect {
    /// How much accuracy is kept.
    pub precision: Precision,
    /// What can be relied upon to keep it.
    pub arithmetic: Arithmetic,
}

/// A tape in WGSL.
pub(in crate::backend) struct Statements {
    /// One statement per line.
    pub(in crate::backend) lines: String,
    /// The results: names of values, or literals.
    pub(in crate::backend) results: Vec<String>,
}

/// Writes a tape; `input` gives the expression that reads an input. The
/// functions of [`functions`] must be in scope.
pub(in crate::backend) fn statements(
    tape: &Tape,
    dialect: Dialect,
    input: impl Fn(Input) -> String,
) -> Statements {
    let writer = Writer { tape, dialect };
    let needed = writer.needed();
    let mut lines = String::new();
    let mut names: Vec<Operand> = Vec::with_capacity(tape.instrs().len());
    for (value, instr) in tape.iter() {
        let name = match *instr {
            Instr::Const(bits) => Operand::Literal(f32::from_bits(bits)),
            Instr::Input(_) | Instr::Prim(..) if !needed[value.index()] => Operand::Unused,
            Instr::Input(which) => Operand::Input(input(which)),
            Instr::Prim(prim, args) => {
                let args = args.map(|arg| &names[arg.index()]);
                match constant(prim, &args) {
                    Some(x) => Operand::Literal(x),
                    None => {
                        let expression = writer.expression(value, prim, args, &names);
                        writer.bind(&mut lines, value, &expression)
                    }
                }
            }
        };
        names.push(name);
    }
    lines.truncate(lines.trim_end().len());
    let results = tape.results().iter().map(|r| names[r.index()].to_string()).collect();
    Statements { lines, results }
}

/// A value as statements refer to it.
#[derive(Clone)]
enum Operand {
    Literal(f32),
    Input(String),
    Name(Value),
    Unused,
}

impl std::fmt::Display for Operand {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            // A sign before a literal is an operator in WGSL, and `a--1f` no expression.
            Self::Literal(x) if x.is_sign_negative() => write!(f, "({x:?}f)"),
            Self::Literal(x) => write!(f, "{x:?}f"),
            Self::Input(text) => f.write_str(text),
            Self::Name(value) => write!(f, "v{}", value.index()),
            Self::Unused => unreachable!("an operand of what is needed is needed"),
        }
    }
}

/// The value of a primitive of constants. WGSL evaluates such expressions while
/// it compiles and refuses what overflows; tapes made without folding have them.
fn constant(prim: Prim, args: &[&Operand; 4]) -> Option<f32> {
    let mut constants = [0.0; 4];
    for (constant, arg) in constants.iter_mut().zip(&args[..prim.arity()]) {
        match arg {
            Operand::Literal(x) => *constant = *x,
            Operand::Input(_) | Operand::Name(_) | Operand::Unused => return None,
        }
    }
    let x = prim.eval(constants);
    Some(x.clamp(f32::MIN, f32::MAX))
}

struct Writer<'a> {
    tape: &'a Tape,
    dialect: Dialect,
}

impl Writer<'_> {
    /// The built-in function that stands for a value, where one may.
    fn native(&self, value: Value) -> Option<(Native, Value)> {
        match self.dialect.precision {
            Precision::Standard => None,
            Precision::Fast => self.tape.native(value),
        }
    }

    fn is_pinned(&self, value: Value) -> bool {
        match self.dialect.precision {
            Precision::Standard => self.tape.is_pinned(value),
            Precision::Fast => false,
        }
    }

    /// What the results need, given that built-in functions stand for what they are.
    fn needed(&self) -> Vec<bool> {
        let mut needed = vec![false; self.tape.instrs().len()];
        for r in self.tape.results() {
            needed[r.index()] = true;
        }
        for (value, instr) in self.tape.iter().collect::<Vec<_>>().into_iter().rev() {
            if needed[value.index()] {
                match self.native(value) {
                    Some((_, x)) => needed[x.index()] = true,
                    None => instr.operands().iter().for_each(|a| needed[a.index()] = true),
                }
            }
        }
        needed
    }

    fn bind(&self, lines: &mut String, value: Value, expression: &str) -> Operand {
        let name = Operand::Name(value);
        let _ = writeln!(lines, "let {name} = {expression};");
        name
    }

    fn expression(
        &self,
        value: Value,
        prim: Prim,
        args: [&Operand; 4],
        names: &[Operand],
    ) -> String {
        if let Some((function, x)) = self.native(value) {
            let x = &names[x.index()];
            return match function {
                // What is no normal number is 0 in tapes, whatever a device makes of it.
                Native::Exp2 => format!("select(0f, exp2({x}), {x} >= -126f)"),
                Native::Log2 => format!("log2({x})"),
            };
        }
        let Dialect { precision, arithmetic } = self.dialect;
        match (prim, args) {
            (Prim::Fma, [a, b, c, _]) if self.is_pinned(value) => format!("fused({a}, {b}, {c})"),
            (Prim::Sqrt, [a, ..]) if precision == Precision::Standard && !arithmetic.roots => {
                format!("root({a})")
            }
            (Prim::Div, [a, b, ..])
                if precision == Precision::Standard && !arithmetic.quotients =>
            {
                format!("quotient({a}, {b})")
            }
            _ if self.is_pinned(value) => format!("pinned({})", primitive(prim, args)),
            _ => primitive(prim, args),
        }
    }
}

fn primitive(prim: Prim, [a, b, c, d]: [&Operand; 4]) -> String {
    match prim {
        Prim::Neg => format!("-{a}"),
        Prim::Abs => format!("abs({a})"),
        Prim::Sqrt => format!("sqrt({a})"),
        Prim::Round => format!("round({a})"),
        Prim::Exp2i => format!("bitcast<f32>(bitcast<u32>({a} + {EXP2I_MAGIC:?}f) << 23u)"),
        Prim::Exponent => format!("f32(bitcast<i32>(bitcast<u32>({a}) - 0x3f3504f4u) >> 23u)"),
        Prim::Fraction => {
            format!("bitcast<f32>(((bitcast<u32>({a}) - 0x3f3504f4u) & 0x007fffffu) + 0x3eb504f4u)")
        }
        Prim::Add => format!("{a} + {b}"),
        Prim::Sub => format!("{a} - {b}"),
        Prim::Mul => format!("{a} * {b}"),
        Prim::Div => format!("{a} / {b}"),
        Prim::Min => format!("min({a}, {b})"),
        Prim::Max => format!("max({a}, {b})"),
        Prim::Fma => format!("fma({a}, {b}, {c})"),
        Prim::SelectLt => format!("select({d}, {c}, {a} < {b})"),
    }
}

/// The functions that the statements in `body` call and WGSL does not have.
/// `pinned` reads a zero from the uniform `params`.
pub(in crate::backend) fn functions(body: &str, dialect: Dialect) -> String {
    let mut text = String::new();
    // Earlier functions call later ones only.
    let mut called = |name: &str, source: &str| {
        if body.contains(&format!("{name}(")) || text.contains(&format!("{name}(")) {
            text.push_str(source);
        }
    };
    called("root", ROOT);
    called("quotient", QUOTIENT);
    called("fused", if dialect.arithmetic.fused { FUSED } else { SPLIT });
    called("pinned", PINNED);
    text
}

const PINNED: &str = "
// The same number, out of the compiler's sight: its rounding is relied upon.
fn pinned(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ params.zero);
}
";

const FUSED: &str = "
// a * b + c, rounded once.
fn fused(a: f32, b: f32, c: f32) -> f32 {
    return pinned(fma(a, b, c));
}
";

const SPLIT: &str = "
// a * b + c in twice the precision (Dekker's product, Knuth's sum), rounded at
// the end: this device's fma rounds the product.
fn fused(a: f32, b: f32, c: f32) -> f32 {
    let product = pinned(a * b);
    let a_split = pinned(a * 4097f);
    let a_high = pinned(a_split - pinned(a_split - a));
    let a_low = pinned(a - a_high);
    let b_split = pinned(b * 4097f);
    let b_high = pinned(b_split - pinned(b_split - b));
    let b_low = pinned(b - b_high);
    let high = pinned(pinned(a_high * b_high) - product);
    let middle = pinned(pinned(high + pinned(a_high * b_low)) + pinned(a_low * b_high));
    let product_rest = pinned(middle + pinned(a_low * b_low));
    let sum = pinned(product + c);
    let of_c = pinned(sum - product);
    let of_product = pinned(sum - of_c);
    let sum_rest = pinned(pinned(product - of_product) + pinned(c - of_c));
    return pinned(sum + pinned(sum_rest + product_rest));
}
";

const QUOTIENT: &str = "
// a / b with one step of Newton's method: this device's quotients are off.
fn quotient(a: f32, b: f32) -> f32 {
    // By 2^64, where what a quotient leaves over would be subnormal.
    let small = abs(a) < 1e-20f;
    let raised = a * select(1f, 1.8446744e19f, small);
    let q = pinned(raised / b);
    // Larger ones are clamped by whatever divides, and would overflow in between.
    let moderate = clamp(q, -1e19f, 1e19f);
    let rest = fused(-moderate, b, raised);
    let corrected = select(q, fma(rest, 1f / b, q), q == moderate);
    return corrected * select(1f, 5.421011e-20f, small);
}
";

const ROOT: &str = "
// sqrt(x) with one step of Newton's method, then the neighbour that it should have
// been, if it is not (Tuckerman's test): this device's roots are off.
fn root(x: f32) -> f32 {
    // By 2^64, where what a root leaves over would be subnormal.
    let small = x < 1e-20f;
    let raised = x * select(1f, 1.8446744e19f, small);
    let s = pinned(sqrt(raised));
    let rest = fused(-s, s, raised);
    let near = max(fma(rest, 0.5f / max(s, 1e-20f), s), 1e-20f);
    let below = bitcast<f32>(bitcast<u32>(near) - 1u);
    let above = bitcast<f32>(bitcast<u32>(near) + 1u);
    let not_too_large = select(near, below, fused(-near, below, raised) <= 0f);
    let correct = select(not_too_large, above, fused(-near, above, raised) > 0f);
    return select(0f, correct * select(1f, 2.3283064e-10f, small), s > 0f);
}
";
