//! Elementary functions, made of primitives alone.
//!
//! Every function here is straight-line code over [`Prim`](super::tape::Prim):
//! no call breaks a vector loop, and every back end that runs the primitives
//! gives the same bits. It is written with [`Builder`]'s exact methods only, so
//! no rule changes a result; where the operand's range decides a clamp or a
//! selection, the builder drops it, so that an exponential of what is never
//! positive, or an arc sine of what lies in [0, 1], costs less by itself.
//!
//! All functions are total: for finite operands within
//! ±[`LIMIT`](super::builder::LIMIT) they give a finite result within it, and so
//! do their meanings. Where mathematics has no value, each constant says which
//! one is taken.
//!
//! Polynomials are minimax fits (Remez), refitted while their coefficients were
//! rounded to `f32` one by one. They are evaluated by Horner's rule: it takes
//! the fewest primitives, and its latency is hidden because the machine code
//! interleaves several independent chains.
//!
//! # What they cost, and how far they are off
//!
//! Primitives for operands of which nothing is known; errors against the f64
//! meaning over **all** `f32` within ±1e18 (`pow`: over 10^8 random pairs, most of
//! them with results that are neither 0 nor clamped). Budgets are these figures,
//! rounded up. docs/NUMERICS.md has them for every operator.
//!
//! | function | primitives | worst ulp | budget |
//! |---|---|---|---|
//! | `exp` | 14 | 0.891 | 1 ulp, or 1.2e-38 where e^x is no normal number |
//! | `sin` | 18 | 1.800 | 2 ulp |
//! | `cos` | 19 | 2.014 | 2.1 ulp |
//! | `tan` | 19 | 3.155 | 3.2 ulp |
//! | `asin` | 18 | 2.364 | 2.5 ulp |
//! | `acos` | 19 | 1.274 | 1.5 ulp |
//! | `atan` | 18 | 1.976 | 2 ulp |
//! | `sqrt` | 2 | 0.500 | 0.5 ulp |
//! | `log` | 15 | 1.136 | 1.5 ulp |
//! | `tanh` | 15 | 5.554 | 6 ulp |
//! | `logistic` | 17 | 2.481 | 2.5 ulp |
//! | `pow` | 54 | 2.130 | 3.5 ulp, or 1.1e-19 for what subnormal bases give |
//!
//! An ignored test measures it again:
//!
//! ```text
//! cargo test --release --lib numerics -- --ignored --nocapture
//! ```

mod exp;
mod inverse;
mod log;
mod power;
mod sigmoid;
#[cfg(test)]
pub(crate) mod suite;
mod trig;

pub use exp::{EXP, SHORT_EXP};
pub use inverse::{ACOS, ASIN, ATAN};
pub use log::LOG;
pub use power::{POW, SHORT_POW, SQRT};
pub use sigmoid::{LOGISTIC, TANH};
pub use trig::{COS, SIN, TAN};

use super::builder::Builder;
use super::function::Budget;
use super::interval::Interval;
use super::tape::Value;

/// The polynomial with these coefficients, lowest power first.
pub(super) fn horner(b: &mut Builder, x: Value, coefficients: &[f32]) -> Value {
    let (&highest, rest) = coefficients.split_last().expect("a polynomial has a coefficient");
    let highest = b.constant(highest);
    rest.iter().rev().fold(highest, |sum, &c| {
        let c = b.constant(c);
        b.fma(sum, x, c)
    })
}

/// Encloses every result that the budget allows where the exact results lie
/// between `lo` and `hi`.
pub(super) fn enclosure(budget: Budget, lo: f64, hi: f64) -> Interval {
    // One ulp more: half for rounding the bounds, half for widening them.
    let relative = (budget.ulp + 1.0) * f64::from(f32::EPSILON);
    Interval::new(lo as f32, hi as f32).widened(relative as f32, budget.absolute as f32)
}

/// `magnitude`, or the least normal number where it is none.
pub(super) fn at_least_normal(b: &mut Builder, magnitude: Value) -> Value {
    let smallest = b.constant(f32::MIN_POSITIVE);
    b.max(magnitude, smallest)
}

/// e, h and f with x = 2^e (1 + f) for positive normal x, 1 + f in [sqrt(1/2), sqrt(2)),
/// and h = f / 2. Both differences are exact.
pub(super) fn split(b: &mut Builder, x: Value) -> [Value; 3] {
    let e = b.exponent(x);
    let fraction = b.fraction(x);
    let half = b.constant(0.5);
    let h = b.sub(fraction, half);
    [e, h, b.add(h, h)]
}

#[cfg(test)]
mod tests {
    use super::super::builder::{LIMIT, Rules};
    use super::super::function::{Binary, Unary};
    use super::super::tape::{Input, Instr, Prim, Side, Tape};
    use super::*;

    suite::conforms!(exp: EXP short_exp: SHORT_EXP sin: SIN cos: COS tan: TAN asin: ASIN acos: ACOS atan: ATAN sqrt: SQRT log: LOG tanh: TANH logistic: LOGISTIC);

    /// Random bit patterns seldom have a power that is neither 0 nor clamped:
    /// these exponents make one that is spread evenly over all magnitudes.
    #[test]
    fn pow() {
        suite::check_pairs(POW, any_power);
    }

    #[test]
    fn short_pow() {
        suite::check_pairs(SHORT_POW, any_power);
    }

    fn any_power(random: &mut suite::Random) -> (f32, f32) {
        let x = match random.between(0.0, 4.0) as u8 {
            0 => random.any(),
            1 => random.between(-4.0, 4.0) as f32,
            2 => 1.0 + random.between(-0.7, 0.7).powi(9) as f32,
            _ => random.between(0.7, 1.45) as f32,
        };
        let y = random.between(-130.0, 62.0) / f64::from(x).abs().log2();
        (x, y.clamp(-1e18, 1e18) as f32)
    }

    /// One result of a function of constants.
    fn value(f: Binary, x: f32, y: f32) -> f32 {
        let mut b = Builder::new(Rules::ALL);
        let (x, y) = (b.constant(x), b.constant(y));
        let result = (f.build)(&mut b, x, y);
        b.finish(&[result]).eval(|_| unreachable!("nothing is read"))[0]
    }

    #[test]
    fn pow_is_defined_where_mathematics_is_not() {
        let cases = [
            (0.0, 0.0, 1.0),
            (-5.0, 0.0, 1.0),
            (0.0, 0.002, 0.0),
            (0.0, -0.5, LIMIT),
            (0.0, -1.0, LIMIT),
            (1e-40, 0.25, 0.0),
            (-2.0, 3.0, -8.0),
            (-2.0, 5.0, -32.0),
            (-2.0, 6.0, 64.0),
            (-2.0, -1.0, -0.5),
            (-4.0, 0.5, 2.0),
            (-16.0, 0.25, 2.0),
            (10.0, 30.0, LIMIT),
            (-10.0, 31.0, -LIMIT),
            (0.5, 200.0, 0.0),
            (1.0, 1e18, 1.0),
            (-1.0, 16_777_217.0, 1.0),
        ];
        for (x, y, want) in cases {
            assert_eq!(value(POW, x, y), want, "pow({x}, {y})");
            let exact = (POW.meaning)(x.into(), y.into());
            assert!(POW.budget.allows(want, exact), "pow({x}, {y}) means {exact:e}");
        }
    }

    /// From 127/126 on, exponents make 0 of what the logarithm says of 0 and of subnormals;
    /// below, there is a selection, of as much as the exponent makes 0 of.
    #[test]
    fn the_power_of_zero_is_zero_however_it_is_made() {
        for (f, y) in [POW, SHORT_POW]
            .into_iter()
            .flat_map(|f| [2e-18, 0.002, 0.9, 1.007, 1.008, 1.5, 1e18].map(|y| (f, y)))
        {
            let mut b = Builder::new(Rules::ALL);
            let x = b.input(Input::PerPixel(0, Side::I), Interval::new(0.0, LIMIT));
            let y = b.constant(y);
            let power = (f.build)(&mut b, x, y);
            let tape = b.finish(&[power]);
            for x in [0.0, -0.0, 1e-45, 4.8e-39, 5e-39, 1.17e-38] {
                assert_eq!(tape.eval(|_| x), [0.0], "{x:e} to the power of {:?}", tape.instrs());
            }
        }
    }

    /// A power of what is a square root, or of any value if `of_root` is false, as a tape.
    fn constant_power(f: Binary, y: f32, of_root: bool, rules: Rules) -> Tape {
        let mut b = Builder::new(rules);
        let x = b.input(Input::PerPixel(0, Side::I), Interval::new(0.0, LIMIT));
        let base = if of_root { b.sqrt(x) } else { x };
        let exponent = b.constant(y);
        let power = (f.build)(&mut b, base, exponent);
        b.finish(&[power])
    }

    /// Exponents up to 2.5 need the logarithm in one part, others in two: both ways keep the
    /// budget, for bases of all magnitudes and close to 1.
    #[test]
    fn powers_with_constant_exponents() {
        let mut random = suite::Random::stream(8);
        let mut exponents =
            vec![1e-18, 2e-18, 0.002, 0.5_f32.next_up(), 1.0_f32.next_down(), 1.0_f32.next_up()];
        exponents.extend([1.008_f32.next_down(), 1.008]);
        exponents.extend([2.0_f32.next_up(), 2.5, 2.5_f32.next_up(), 3.0_f32.next_up(), 5.0]);
        exponents.extend((0..150).map(|_| random.between(0.0, 2.5) as f32));
        for y in exponents.iter().flat_map(|&y| [y, -y]) {
            let [tape, plain] =
                [Rules::ALL, Rules::NONE].map(|rules| constant_power(POW, y, false, rules));
            let bases = (0..1 << 12).map(|k| match k % 2 {
                0 => random.between(-126.0, 59.7).exp2() as f32,
                _ => random.between(-2.0, 2.0).exp2() as f32,
            });
            let special = [0.0, 1.17e-38, f32::MIN_POSITIVE, 1.2e-38, 2.3e-38, 1.0, LIMIT];
            for x in bases.chain(special).collect::<Vec<_>>() {
                let got = tape.eval(|_| x)[0];
                assert_eq!(got, plain.eval(|_| x)[0], "{x:e}^{y}, with all rules and with none");
                let exact = (POW.meaning)(x.into(), y.into());
                assert!(POW.budget.allows(got, exact), "{x:e}^{y} is {exact:e}, not {got:e}");
            }
        }
    }

    /// Powers of distances are powers of their squares, where what counts as 0 then is
    /// negligible.
    #[test]
    fn powers_of_roots_take_no_root() {
        let mut random = suite::Random::stream(7);
        let special = [0.0, 1e-45, 1.17e-38, f32::MIN_POSITIVE, 1.0, 2.5e-37, LIMIT];
        let random = (0..1 << 14).map(|_| random.between(-126.0, 59.0).exp2() as f32);
        let squares: Vec<f32> = special.into_iter().chain(random).collect();
        let cases = [
            (0.7, true),
            (0.99, true),
            (1.001, false),
            (1.5, false),
            (2.02, false),
            (3.7, false),
            (4.1, false),
        ];
        for (f, (y, takes_root)) in
            [POW, SHORT_POW].into_iter().flat_map(|f| cases.map(|case| (f, case)))
        {
            let tape = constant_power(f, y, true, Rules::ALL);
            let root = |instr: &Instr| matches!(instr, Instr::Prim(Prim::Sqrt, _));
            assert_eq!(tape.instrs().iter().any(root), takes_root, "to the power of {y}");
            for &square in &squares {
                let got = tape.eval(|_| square)[0];
                let exact = (f.meaning)(f64::from(square).sqrt(), y.into());
                assert!(
                    f.budget.allows(got, exact),
                    "{got:e}, not {exact:e}, for the root of {square:e} to the power of {y}"
                );
                assert!(square > 0.0 || got == 0.0, "{got:e} for 0 to the power of {y}");
            }
        }
    }

    /// A power of two needs no logarithm: y log2 c is a product by constants.
    #[test]
    fn a_constant_base_leaves_only_the_exponential() {
        let everything = Interval::new(-LIMIT, LIMIT);
        let primitives = |base: f32| {
            let mut b = Builder::new(Rules::ALL);
            let base = b.constant(base);
            let y = b.input(Input::PerPixel(0, Side::I), everything);
            let power = (POW.build)(&mut b, base, y);
            let tape = b.finish(&[power]);
            tape.instrs().iter().filter(|i| !i.operands().is_empty()).count()
        };
        assert_eq!((primitives(2.0), primitives(0.3)), (13, 20));
    }

    #[test]
    fn meanings_have_their_known_values() {
        let near = |f: Unary, x: f64, want: f64| {
            let got = (f.meaning)(x);
            assert!(
                (got - want).abs() <= 1e-15 * want.abs().max(1.0),
                "f({x}) = {got}, not {want}"
            );
        };
        near(EXP, 0.0, 1.0);
        near(SIN, 0.5, 0.479_425_538_604_203);
        near(COS, 0.0, 1.0);
        near(TAN, 1.0, 1.557_407_724_654_902_2);
        near(ASIN, 2.0, std::f64::consts::FRAC_PI_2);
        near(ACOS, -1.0, std::f64::consts::PI);
        near(ATAN, 1.0, std::f64::consts::FRAC_PI_4);
        near(SQRT, -1.0, 0.0);
        near(LOG, std::f64::consts::E, 1.0);
        near(LOG, 0.0, -87.336_544_750_553_1);
        near(LOG, -5.0, (LOG.meaning)(0.0));
        near(TANH, 0.5, 0.462_117_157_260_009_76);
        near(LOGISTIC, 0.0, 0.5);
        near(LOGISTIC, -1e9, 1e-18);
        near(SIN, 1e9, (SIN.meaning)(1e5));
    }
}
