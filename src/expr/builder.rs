//! Builds tapes, simplifying as it goes.
//!
//! Rows of the operator table and the elementary functions are written against
//! this type, one method per primitive. Every simplification here is one that
//! leaves each value's bits alone (the sign of a zero excepted, which no
//! operator looks at), so that back ends that run the same tape agree whether
//! or not it was simplified. The one exception stands apart: [`Builder::sum`],
//! [`Builder::difference`], [`Builder::product`] and [`Builder::quotient`] are
//! the *language's* arithmetic, which the `contract` rule may round less often
//! (a fused multiply-add, a reciprocal constant). The exact methods
//! [`Builder::add`] … [`Builder::div`] never change, so that compensated
//! arithmetic in the elementary functions stays what it is.

use rustc_hash::FxHashMap;

use super::interval::Interval;
use super::tape::{Input, Instr, Native, Prim, Tape, Value};

/// No operator returns more than this in magnitude. The product of two such
/// values, and the quotient of one by [`DIVISOR_MIN`], are still finite in
/// `f32`, so one clamp behind an operator is enough.
pub const LIMIT: f32 = 1e18;

/// Divisors are kept at least this far from zero.
pub const DIVISOR_MIN: f32 = 1e-18;

/// Which simplifications a builder makes. Each can be turned off by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rules {
    /// Constant folding and algebraic identities that keep every bit.
    pub fold: bool,
    /// Equal instructions are made once.
    pub share: bool,
    /// Guards and selections that the operands' ranges decide are dropped.
    pub ranges: bool,
    /// The language's own arithmetic may be rounded less often than written.
    pub contract: bool,
    /// The logarithm of what was made as a power of two is its exponent.
    pub merge: bool,
}

impl Rules {
    /// Everything on.
    pub const ALL: Self =
        Self { fold: true, share: true, ranges: true, contract: true, merge: true };
    /// Everything off: the tape says literally what the rows say.
    pub const NONE: Self =
        Self { fold: false, share: false, ranges: false, contract: false, merge: false };
}

/// Builds one tape.
#[derive(Clone)]
pub struct Builder {
    tape: Tape,
    made: FxHashMap<Instr, Value>,
    exponents: FxHashMap<Value, [Value; 2]>,
    rules: Rules,
}

impl Builder {
    /// An empty tape under construction.
    pub fn new(rules: Rules) -> Self {
        Self {
            tape: Tape::default(),
            made: FxHashMap::default(),
            exponents: FxHashMap::default(),
            rules,
        }
    }

    /// The finished tape, with everything that the results do not need dropped.
    pub fn finish(self, results: &[Value]) -> Tape {
        self.tape.finish(results)
    }

    /// The rules in force.
    pub fn rules(&self) -> Rules {
        self.rules
    }

    /// What is known of a value.
    pub fn range(&self, value: Value) -> Interval {
        self.tape.range(value)
    }

    /// How a value is made.
    pub(crate) fn instr(&self, value: Value) -> Instr {
        self.tape.instr(value)
    }

    /// The value's constant, if it is one.
    pub fn constant_of(&self, value: Value) -> Option<f32> {
        match self.tape.instr(value) {
            Instr::Const(bits) => Some(f32::from_bits(bits)),
            Instr::Input(_) | Instr::Prim(..) => None,
        }
    }

    /// Adds knowledge about a value that its instruction alone does not show,
    /// such as that a polynomial is a sine. It must hold for the *rounded* value.
    pub fn assume(&mut self, value: Value, range: Interval) {
        let known = self.tape.range(value).intersect(range);
        self.tape.set_range(value, known);
    }

    /// Says that later values rely on the rounding of this one; see
    /// [`Tape::is_pinned`]. Returns the value.
    pub fn pin(&mut self, value: Value) -> Value {
        self.tape.pin(value);
        value
    }

    /// Says that the value is a function of `x` that shading languages have built
    /// in; see [`Tape::native`]. Nothing is noted of constants.
    pub fn stands_for(&mut self, value: Value, function: Native, x: Value) {
        if self.constant_of(value).is_none() && x < value {
            self.tape.set_native(value, function, x);
        }
    }

    /// Notes that a value was made as 2^(high + low).
    pub fn set_exponent(&mut self, value: Value, high: Value, low: Value) {
        self.exponents.insert(value, [high, low]);
    }

    /// The two parts of the exponent that a value was made with as a power of two.
    pub fn exponent_of(&self, value: Value) -> Option<[Value; 2]> {
        if self.rules.merge { self.exponents.get(&value).copied() } else { None }
    }

    /// A constant.
    pub fn constant(&mut self, x: f32) -> Value {
        self.make(Instr::Const(x.to_bits()), Interval::point(x))
    }

    /// An input whose values lie in `range`.
    pub fn input(&mut self, input: Input, range: Interval) -> Value {
        if self.rules.ranges
            && let Some(x) = range.single()
        {
            return self.constant(x);
        }
        self.make(Instr::Input(input), range)
    }

    /// `-a`
    pub fn neg(&mut self, a: Value) -> Value {
        if self.rules.fold
            && let Instr::Prim(Prim::Neg, [inner, ..]) = self.tape.instr(a)
        {
            return inner;
        }
        self.apply(Prim::Neg, &[a])
    }

    /// `|a|`
    pub fn abs(&mut self, a: Value) -> Value {
        if self.rules.ranges && self.range(a).lo >= 0.0 {
            return a;
        }
        if self.rules.fold {
            match self.tape.instr(a) {
                Instr::Prim(Prim::Neg, [inner, ..]) => return self.abs(inner),
                // |a - b| and |b - a| are one value.
                Instr::Prim(Prim::Sub, [x, y, ..]) if x > y => {
                    let swapped = self.sub(y, x);
                    return self.apply(Prim::Abs, &[swapped]);
                }
                Instr::Const(_) | Instr::Input(_) | Instr::Prim(..) => {}
            }
        }
        self.apply(Prim::Abs, &[a])
    }

    /// Square root; the caller guards against negative operands.
    pub fn sqrt(&mut self, a: Value) -> Value {
        self.apply(Prim::Sqrt, &[a])
    }

    /// The nearest integer, ties to even.
    pub fn round(&mut self, a: Value) -> Value {
        self.apply(Prim::Round, &[a])
    }

    /// 2^a for an integer a in [-127, 127].
    pub fn exp2i(&mut self, a: Value) -> Value {
        self.apply(Prim::Exp2i, &[a])
    }

    /// The integer nearest to log2 a, for a positive normal number.
    pub fn exponent(&mut self, a: Value) -> Value {
        self.apply(Prim::Exponent, &[a])
    }

    /// What `a` is two to the power `exponent(a) + 1` times.
    pub fn fraction(&mut self, a: Value) -> Value {
        self.apply(Prim::Fraction, &[a])
    }

    /// `a + b`, rounded once.
    pub fn add(&mut self, a: Value, b: Value) -> Value {
        if self.rules.fold {
            if self.is(a, 0.0) {
                return b;
            }
            if self.is(b, 0.0) {
                return a;
            }
            if let Some(inner) = self.negated(b) {
                return self.sub(a, inner);
            }
            if let Some(inner) = self.negated(a) {
                return self.sub(b, inner);
            }
        }
        let (a, b) = self.ordered(a, b);
        self.apply(Prim::Add, &[a, b])
    }

    /// `a - b`, rounded once.
    pub fn sub(&mut self, a: Value, b: Value) -> Value {
        if self.rules.fold {
            if a == b {
                return self.constant(0.0);
            }
            if self.is(b, 0.0) {
                return a;
            }
            if self.is(a, 0.0) {
                return self.neg(b);
            }
            if let Some(inner) = self.negated(b) {
                return self.add(a, inner);
            }
        }
        self.apply(Prim::Sub, &[a, b])
    }

    /// `a * b`, rounded once.
    pub fn mul(&mut self, a: Value, b: Value) -> Value {
        if self.rules.fold {
            for (x, y) in [(a, b), (b, a)] {
                if self.is(x, 1.0) {
                    return y;
                }
                if self.is(x, -1.0) {
                    return self.neg(y);
                }
                // Only what is known to be finite vanishes.
                if self.is(x, 0.0) && self.range(y).within(f32::MAX) {
                    return self.constant(0.0);
                }
            }
            // Signs move outwards, or into a constant: rounding is symmetric.
            match (self.negated(a), self.negated(b)) {
                (Some(x), Some(y)) => return self.mul(x, y),
                (Some(x), None) => return self.mul_negated(x, b),
                (None, Some(y)) => return self.mul_negated(y, a),
                (None, None) => {}
            }
        }
        let (a, b) = self.ordered(a, b);
        self.apply(Prim::Mul, &[a, b])
    }

    /// `-(x * y)`, with the sign in the constant where there is one.
    fn mul_negated(&mut self, x: Value, y: Value) -> Value {
        if let Some(c) = self.constant_of(y) {
            let c = self.constant(-c);
            return self.mul(x, c);
        }
        let product = self.mul(x, y);
        self.neg(product)
    }

    /// `a / b`, rounded once; the caller guards against zero.
    pub fn div(&mut self, a: Value, b: Value) -> Value {
        if self.rules.fold {
            if self.is(a, 0.0) && !self.range(b).contains(0.0) {
                return a;
            }
            if let Some(c) = self.constant_of(b)
                && is_power_of_two(c)
            {
                let reciprocal = self.constant(1.0 / c);
                return self.mul(a, reciprocal);
            }
            if let (Some(x), Some(y)) = (self.negated(a), self.negated(b)) {
                return self.div(x, y);
            }
        }
        self.apply(Prim::Div, &[a, b])
    }

    /// `if a < b { a } else { b }`
    pub fn min(&mut self, a: Value, b: Value) -> Value {
        if self.rules.ranges {
            if self.range(a).hi <= self.range(b).lo {
                return a;
            }
            if self.range(b).hi <= self.range(a).lo {
                return b;
            }
        }
        if self.rules.fold {
            if a == b {
                return a;
            }
            if let Some(inner) = self.bounded_less(Prim::Min, a, b, |own, new| new < own) {
                return self.min(inner, b);
            }
        }
        self.apply(Prim::Min, &[a, b])
    }

    /// `if a > b { a } else { b }`
    pub fn max(&mut self, a: Value, b: Value) -> Value {
        if self.rules.ranges {
            if self.range(a).lo >= self.range(b).hi {
                return a;
            }
            if self.range(b).lo >= self.range(a).hi {
                return b;
            }
        }
        if self.rules.fold {
            if a == b {
                return a;
            }
            if let Some(inner) = self.bounded_less(Prim::Max, a, b, |own, new| new > own) {
                return self.max(inner, b);
            }
        }
        self.apply(Prim::Max, &[a, b])
    }

    /// What `a` bounds, if `a` is a minimum or maximum with a constant and the constant
    /// `b` is a tighter bound of the same kind.
    fn bounded_less(
        &self,
        prim: Prim,
        a: Value,
        b: Value,
        tighter: impl Fn(f32, f32) -> bool,
    ) -> Option<Value> {
        let Instr::Prim(made, [inner, own, ..]) = self.tape.instr(a) else { return None };
        let (own, new) = (self.constant_of(own)?, self.constant_of(b)?);
        (made == prim && tighter(own, new)).then_some(inner)
    }

    /// `a * b + c`, rounded once.
    pub fn fma(&mut self, a: Value, b: Value, c: Value) -> Value {
        if self.rules.fold {
            if self.is(c, 0.0) {
                return self.mul(a, b);
            }
            for (x, y) in [(a, b), (b, a)] {
                if self.is(x, 1.0) {
                    return self.add(y, c);
                }
                if self.is(x, 0.0) && self.range(y).within(f32::MAX) {
                    return c;
                }
                if let (Some(inner), Some(k)) = (self.negated(x), self.constant_of(y)) {
                    let k = self.constant(-k);
                    return self.fma(inner, k, c);
                }
            }
        }
        let (a, b) = self.ordered(a, b);
        self.apply(Prim::Fma, &[a, b, c])
    }

    /// `if a < b { c } else { d }`
    pub fn select_lt(&mut self, a: Value, b: Value, c: Value, d: Value) -> Value {
        if self.rules.ranges {
            if self.range(a).hi < self.range(b).lo {
                return c;
            }
            if self.range(a).lo >= self.range(b).hi {
                return d;
            }
        }
        if self.rules.fold && c == d {
            return c;
        }
        self.apply(Prim::SelectLt, &[a, b, c, d])
    }

    /// `if a < b { c } else { d }` against a constant threshold.
    pub fn select_below(&mut self, a: Value, threshold: f32, c: Value, d: Value) -> Value {
        let threshold = self.constant(threshold);
        self.select_lt(a, threshold, c, d)
    }

    /// Clamps into `[lo, hi]`.
    pub fn clamp(&mut self, a: Value, lo: f32, hi: f32) -> Value {
        let (lo, hi) = (self.constant(lo), self.constant(hi));
        let raised = self.max(a, lo);
        self.min(raised, hi)
    }

    /// Clamps into ±[`LIMIT`]: what keeps every operator total.
    pub fn limited(&mut self, a: Value) -> Value {
        self.clamp(a, -LIMIT, LIMIT)
    }

    /// The language's `a + b`: contracted to a fused multiply-add where one
    /// operand is a product.
    pub fn sum(&mut self, a: Value, b: Value) -> Value {
        if self.rules.contract {
            for (x, y) in [(a, b), (b, a)] {
                if let Instr::Prim(Prim::Mul, [p, q, ..]) = self.tape.instr(x) {
                    return self.fma(p, q, y);
                }
            }
        }
        self.add(a, b)
    }

    /// The language's `a - b`: contracted where the product has a constant to
    /// carry the sign.
    pub fn difference(&mut self, a: Value, b: Value) -> Value {
        if self.rules.contract {
            if let Instr::Prim(Prim::Mul, [p, q, ..]) = self.tape.instr(b) {
                for (x, y) in [(p, q), (q, p)] {
                    if let Some(c) = self.constant_of(x) {
                        let c = self.constant(-c);
                        return self.fma(y, c, a);
                    }
                }
            }
            if let Some(inner) = self.negated(b) {
                return self.sum(a, inner);
            }
        }
        self.sub(a, b)
    }

    /// The language's `a * b`: constants meet, and the square of a square root
    /// is its operand.
    pub fn product(&mut self, a: Value, b: Value) -> Value {
        if self.rules.contract {
            if a == b
                && let Some(s) = self.square_of(a)
            {
                return s;
            }
            for (x, y) in [(a, b), (b, a)] {
                let (Some(c), Instr::Prim(Prim::Mul, [p, q, ..])) =
                    (self.constant_of(x), self.tape.instr(y))
                else {
                    continue;
                };
                for (k, other) in [(p, q), (q, p)] {
                    if let Some(k) = self.constant_of(k)
                        && (c * k).is_normal()
                    {
                        let both = self.constant(c * k);
                        return self.mul(other, both);
                    }
                }
            }
        }
        self.mul(a, b)
    }

    /// The language's `a / b`: a constant divisor becomes its reciprocal.
    pub fn quotient(&mut self, a: Value, b: Value) -> Value {
        if self.rules.contract
            && let Some(c) = self.constant_of(b)
            && (1.0 / c).is_normal()
        {
            let reciprocal = self.constant(1.0 / c);
            return self.product(a, reciprocal);
        }
        self.div(a, b)
    }

    /// What a value is the square root of, if it was made as one.
    pub fn square_of(&self, value: Value) -> Option<Value> {
        match self.tape.instr(value) {
            Instr::Prim(Prim::Sqrt, [square, ..]) => Some(square),
            Instr::Const(_) | Instr::Input(_) | Instr::Prim(..) => None,
        }
    }

    fn is(&self, value: Value, x: f32) -> bool {
        self.constant_of(value) == Some(x)
    }

    fn negated(&self, value: Value) -> Option<Value> {
        match self.tape.instr(value) {
            Instr::Prim(Prim::Neg, [inner, ..]) => Some(inner),
            Instr::Const(_) | Instr::Input(_) | Instr::Prim(..) => None,
        }
    }

    /// Commutative operands in one order, so that `a + b` and `b + a` are shared.
    fn ordered(&self, a: Value, b: Value) -> (Value, Value) {
        if self.rules.share && b < a { (b, a) } else { (a, b) }
    }

    fn apply(&mut self, prim: Prim, operands: &[Value]) -> Value {
        debug_assert_eq!(operands.len(), prim.arity(), "{prim:?}");
        let mut args = [operands[0]; 4];
        args[..operands.len()].copy_from_slice(operands);
        if self.rules.fold {
            let mut constants = [0.0; 4];
            let known = operands
                .iter()
                .zip(&mut constants)
                .all(|(&v, slot)| self.constant_of(v).map(|x| *slot = x).is_some());
            if known {
                let x = prim.eval(constants);
                if x.is_finite() {
                    return self.constant(x);
                }
            }
        }
        let range = prim.range(args.map(|a| self.range(a)), args[0] == args[1]);
        self.make(Instr::Prim(prim, args), range)
    }

    fn make(&mut self, instr: Instr, range: Interval) -> Value {
        if self.rules.share
            && let Some(&value) = self.made.get(&instr)
        {
            return value;
        }
        let value = self.tape.push(instr, range);
        if self.rules.share {
            self.made.insert(instr, value);
        }
        value
    }
}

fn is_power_of_two(c: f32) -> bool {
    c.is_normal() && c.to_bits() & 0x007f_ffff == 0 && (1.0 / c).is_normal()
}

#[cfg(test)]
mod tests {
    use super::super::tape::{Input, Side};
    use super::*;

    /// Clamps of clamps, as of sums that go into exponentials.
    #[test]
    fn of_two_bounds_the_tighter_remains() {
        let primitives = |build: &dyn Fn(&mut Builder, Value) -> Value| {
            let mut b = Builder::new(Rules::ALL);
            let x = b.input(Input::PerPixel(0, Side::I), Interval::new(-LIMIT, LIMIT));
            let result = build(&mut b, x);
            let tape = b.finish(&[result]);
            tape.instrs().iter().filter(|instr| matches!(instr, Instr::Prim(..))).count()
        };
        let max = |b: &mut Builder, x, bound| {
            let bound = b.constant(bound);
            b.max(x, bound)
        };
        let min = |b: &mut Builder, x, bound| {
            let bound = b.constant(bound);
            b.min(x, bound)
        };
        let bounds = |bound: fn(&mut Builder, Value, f32) -> Value, first, second| {
            primitives(&|b, x| {
                let x = bound(b, x, first);
                bound(b, x, second)
            })
        };
        assert_eq!([bounds(max, -5.0, -3.0), bounds(max, -3.0, -5.0)], [1, 1]);
        assert_eq!([bounds(min, 5.0, 3.0), bounds(min, 3.0, 5.0)], [1, 1]);
        assert_eq!(primitives(&|b, x| b.clamp(x, -3.0, 3.0)), 2);
    }
}
