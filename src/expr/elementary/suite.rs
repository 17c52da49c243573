//! The suite that every function is held to, one line of test per function.
//!
//! It checks, on probes and on random bit patterns: the budget against the f64
//! meaning; closure (finite in, within ±[`LIMIT`] out, meaning included); that
//! [`Rules::NONE`] and [`Rules::ALL`] give the same bits (signs of zeros apart);
//! and, on random intervals, that the range encloses the results when guards
//! were dropped on the strength of the operand's interval.

use super::super::builder::{Builder, LIMIT, Rules};
use super::super::function::{Binary, Budget, Unary, ulp};
use super::super::interval::Interval;
use super::super::tape::{Input, Instr, Prim, Side, Tape, Value};

/// Lanes evaluated together.
const LANES: usize = 512;

/// One value per lane.
type Row = [f32; LANES];

const EVERYTHING: Interval = Interval { lo: -LIMIT, hi: LIMIT };

/// The tests of unary functions, as `name: CONSTANT`. Over every `f32` they are checked
/// by `backend::numerics`, which is fast enough for that.
macro_rules! conforms {
    ($($name:ident: $function:ident)*) => {
        $(#[test]
        fn $name() {
            $crate::expr::elementary::suite::check($function);
        })*
    };
}
pub(in crate::expr) use conforms;

/// Checks a unary function on probes and a million random bit patterns.
pub(in crate::expr) fn check(f: Unary) {
    let mut random = Random(1);
    let mut points = probes();
    points.extend((0..1 << 20).map(|_| random.any()));
    let worst = unary_blocks(f, points.chunks(LANES));
    println!("{worst}");
    for _ in 0..2000 {
        let interval = random.interval();
        let tape = unary_tape(f, Rules::ALL, interval);
        let range = (f.range)(interval);
        let points: Row = std::array::from_fn(|_| random.inside(interval));
        let narrow = Lanes::new(tape).run([&points, &points]);
        let wide = Lanes::new(unary_tape(f, Rules::NONE, EVERYTHING)).run([&points, &points]);
        for ((x, got), want) in points.into_iter().zip(narrow).zip(wide) {
            assert_eq!(got, want, "guards dropped on {interval:?} change f({x:e})");
            assert!(range.contains(got), "f({x:e}) = {got:e} is outside {range:?} on {interval:?}");
        }
    }
}

/// Checks a binary function on pairs of probes, on random pairs of bit patterns
/// and on the pairs that `pair` draws, then with either operand constant.
pub(in crate::expr) fn check_pairs(f: Binary, pair: impl Fn(&mut Random) -> (f32, f32)) {
    let mut random = Random(2);
    let probes = probes();
    let mut pairs: Vec<(f32, f32)> =
        probes.iter().flat_map(|&x| probes.iter().map(move |&y| (x, y))).collect();
    pairs.extend((0..1 << 19).map(|_| (random.any(), random.any())));
    pairs.extend((0..1 << 20).map(|_| pair(&mut random)));
    let [plain, simplified] =
        [Rules::NONE, Rules::ALL].map(|rules| binary_tape(f, rules, [EVERYTHING; 2]));
    println!("{}", binary_blocks(f, [plain, simplified], &pairs));

    let constants =
        [0.0, 1.0, 2.0, 3.0, 4.0, 0.5, -0.5, -1.0, -2.0, -3.0, 7.0, 1.5, 0.002, 0.3, 1e-18, 1e18];
    for c in constants {
        for first in [true, false] {
            let pairs: Vec<(f32, f32)> = (0..1 << 14)
                .map(|_| random.any())
                .chain(probes.iter().copied())
                .map(|v| if first { (c, v) } else { (v, c) })
                .collect();
            let tapes = [Rules::NONE, Rules::ALL].map(|rules| {
                let mut b = Builder::new(rules);
                let constant = b.constant(c);
                let free = b.input(Input::PerPixel(u32::from(first), Side::I), EVERYTHING);
                let (x, y) = if first { (constant, free) } else { (free, constant) };
                let result = (f.build)(&mut b, x, y);
                b.finish(&[result])
            });
            binary_blocks(f, tapes, &pairs);
        }
    }

    for _ in 0..2000 {
        let (a, c) = (random.interval(), random.interval());
        let range = (f.range)(a, c);
        let xs: Row = std::array::from_fn(|_| random.inside(a));
        let ys: Row = std::array::from_fn(|_| random.inside(c));
        let contracted = Lanes::new(binary_tape(f, Rules::ALL, [a, c])).run([&xs, &ys]);
        for (k, got) in contracted.into_iter().enumerate() {
            let at = (xs[k], ys[k]);
            let exact = (f.meaning)(at.0.into(), at.1.into());
            assert!(
                f.budget.allows(got, exact),
                "f{at:?} = {got:e}, not {exact:e}, on {a:?}, {c:?}"
            );
            assert!(range.contains(got), "f{at:?} = {got:e} is outside {range:?} on {a:?}, {c:?}");
        }
        let rules = Rules { contract: false, ..Rules::ALL };
        let narrow = Lanes::new(binary_tape(f, rules, [a, c])).run([&xs, &ys]);
        let wide = binary_tape(f, Rules::NONE, [a.single(), c.single()].map(known));
        let wide = Lanes::new(wide).run([&xs, &ys]);
        for (k, (got, want)) in narrow.into_iter().zip(wide).enumerate() {
            let at = (xs[k], ys[k]);
            assert_eq!(got, want, "guards dropped on {a:?}, {c:?} change f{at:?}");
            assert!(range.contains(got), "f{at:?} = {got:e} is outside {range:?} on {a:?}, {c:?}");
        }
    }
}

/// An operand's interval for a tape that may know no more than that it is constant.
fn known(single: Option<f32>) -> Interval {
    single.map_or(EVERYTHING, Interval::point)
}

fn unary_tape(f: Unary, rules: Rules, interval: Interval) -> Tape {
    let mut b = Builder::new(rules);
    let x = b.input(Input::PerPixel(0, Side::I), interval);
    let result = (f.build)(&mut b, x);
    b.finish(&[result])
}

fn binary_tape(f: Binary, rules: Rules, intervals: [Interval; 2]) -> Tape {
    let mut b = Builder::new(rules);
    let operand = |b: &mut Builder, k: usize| match intervals[k].single() {
        Some(c) => b.constant(c),
        None => b.input(Input::PerPixel(k as u32, Side::I), intervals[k]),
    };
    let (x, y) = (operand(&mut b, 0), operand(&mut b, 1));
    let result = (f.build)(&mut b, x, y);
    b.finish(&[result])
}

fn unary_blocks(f: Unary, blocks: impl Iterator<Item = impl AsRef<[f32]>>) -> Worst {
    let mut plain = Lanes::new(unary_tape(f, Rules::NONE, EVERYTHING));
    let mut simplified = Lanes::new(unary_tape(f, Rules::ALL, EVERYTHING));
    let mut worst = Worst { primitives: simplified.primitives(), ..Worst::default() };
    for block in blocks {
        let block = block.as_ref();
        let xs: Row = std::array::from_fn(|k| block[k.min(block.len() - 1)]);
        let (got, same) = (simplified.run([&xs, &xs]), plain.run([&xs, &xs]));
        for (k, x) in xs.into_iter().enumerate() {
            assert_eq!(got[k], same[k], "the rules change f({x:e})");
            let exact = (f.meaning)(x.into());
            worst.note(f.budget, got[k], exact);
            assert!(f.budget.allows(got[k], exact), "f({x:e}) = {:e}, not {exact:e}", got[k]);
        }
    }
    worst
}

fn binary_blocks(f: Binary, [plain, simplified]: [Tape; 2], pairs: &[(f32, f32)]) -> Worst {
    let (mut plain, mut simplified) = (Lanes::new(plain), Lanes::new(simplified));
    let mut worst = Worst { primitives: simplified.primitives(), ..Worst::default() };
    for block in pairs.chunks(LANES) {
        let at = |k: usize| block[k.min(block.len() - 1)];
        let (xs, ys): (Row, Row) =
            (std::array::from_fn(|k| at(k).0), std::array::from_fn(|k| at(k).1));
        let (got, same) = (simplified.run([&xs, &ys]), plain.run([&xs, &ys]));
        for k in 0..LANES {
            let (x, y) = at(k);
            assert_eq!(got[k], same[k], "the rules change f({x:e}, {y:e})");
            let exact = (f.meaning)(x.into(), y.into());
            worst.note(f.budget, got[k], exact);
            assert!(
                f.budget.allows(got[k], exact),
                "f({x:e}, {y:e}) = {:e}, not {exact:e}",
                got[k]
            );
        }
    }
    worst
}

/// What was measured: a row of the table in the module's documentation.
#[derive(Default)]
struct Worst {
    primitives: usize,
    /// In ulps, of the results that the absolute part of the budget does not cover.
    ulp: f64,
    /// Of all results.
    absolute: f64,
    lo: f32,
    hi: f32,
}

impl Worst {
    fn note(&mut self, budget: Budget, got: f32, exact: f64) {
        assert!(got.is_finite() && got.abs() <= LIMIT, "{got:e} is out of bounds");
        assert!(exact.abs() <= f64::from(LIMIT), "the meaning {exact:e} is out of bounds");
        let error = (f64::from(got) - exact).abs();
        self.absolute = self.absolute.max(error);
        if error > budget.absolute {
            self.ulp = self.ulp.max(error / ulp(exact));
        }
        self.lo = self.lo.min(got);
        self.hi = self.hi.max(got);
    }
}

impl std::fmt::Display for Worst {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} primitives, at most {:.3} ulp, {:.2e} absolute, in [{:e}, {:e}]",
            self.primitives, self.ulp, self.absolute, self.lo, self.hi
        )
    }
}

/// A tape and a row of lanes per instruction.
struct Lanes {
    tape: Tape,
    rows: Vec<Row>,
}

impl Lanes {
    fn new(tape: Tape) -> Self {
        let rows = tape
            .instrs()
            .iter()
            .map(|instr| match instr {
                Instr::Const(bits) => [f32::from_bits(*bits); LANES],
                Instr::Input(_) | Instr::Prim(..) => [0.0; LANES],
            })
            .collect();
        Self { tape, rows }
    }

    fn primitives(&self) -> usize {
        self.tape.instrs().iter().filter(|instr| matches!(instr, Instr::Prim(..))).count()
    }

    fn run(&mut self, inputs: [&Row; 2]) -> Row {
        for (k, instr) in self.tape.instrs().iter().enumerate() {
            let (earlier, later) = self.rows.split_at_mut(k);
            match *instr {
                Instr::Const(_) => {}
                Instr::Input(Input::PerPixel(which, _)) => later[0] = *inputs[which as usize],
                Instr::Input(_) => unreachable!("the suite's tapes read PerPixel values only"),
                Instr::Prim(prim, args) => apply(prim, earlier, args, &mut later[0]),
            }
        }
        self.rows[self.tape.results()[0].index()]
    }
}

/// One loop per primitive: the match is made once per row, not once per lane.
fn apply(prim: Prim, rows: &[Row], args: [Value; 4], out: &mut Row) {
    let [a, b, c, d] = args.map(|arg| &rows[arg.index()]);
    macro_rules! loops {
        ($($name:ident)*) => {
            match prim {
                $(Prim::$name => for k in 0..LANES {
                    out[k] = Prim::$name.eval([a[k], b[k], c[k], d[k]]);
                })*
            }
        };
    }
    loops!(Neg Abs Sqrt Round Exp2i Exponent Fraction Add Sub Mul Div Min Max Fma SelectLt);
}

/// Where functions break: zeros, subnormals, breakpoints and the domain's ends,
/// each with its neighbours, and integers; in both signs.
pub(crate) fn probes() -> Vec<f32> {
    use std::f32::consts::PI;
    let places = [0.0, f32::MIN_POSITIVE, 1e-18, 1e-9, 1e-4, 0.5, 1.0, 8.0 / 7.0, 10.0 / 7.0, 2.0];
    let turns = (1..=12).map(|k| k as f32 * (PI / 4.0));
    let ends = [41.446_53, 87.336_5, 87.682, 88.0, 103.97, 126.0, 127.5, 149.0, 1e5, 1e9, LIMIT];
    let integers = (3..=40).map(|k| k as f32).chain([8_388_607.0, 8_388_608.0, 16_777_217.0]);
    places
        .into_iter()
        .chain(turns)
        .chain(ends)
        .chain(integers)
        .flat_map(|x| [x.next_down().abs(), x, x.next_up()])
        .filter(|&x| x <= LIMIT)
        .flat_map(|x| [x, -x])
        .collect()
}

/// SplitMix64 (Steele, Lea, Flood 2014): the probes stay what they are whatever
/// crate of random numbers the project uses.
pub(crate) struct Random(u64);

impl Random {
    /// A stream of its own for a number: eight values, before the next one's begin.
    pub(crate) fn stream(k: u64) -> Self {
        Self(k.wrapping_mul(8).wrapping_mul(0x9e37_79b9_7f4a_7c15))
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [lo, hi).
    pub(crate) fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A bit pattern within ±[`LIMIT`], uniform over signs, exponents and
    /// significands.
    pub(crate) fn any(&mut self) -> f32 {
        let magnitude = self.bits() as u32 % (LIMIT.to_bits() + 1);
        let x = f32::from_bits(magnitude);
        if self.bits() & 1 == 0 { x } else { -x }
    }

    /// Half of the intervals lie near 1 in magnitude, where functions turn.
    fn interval(&mut self) -> Interval {
        let mut end = |near: bool| if near { self.between(-4.0, 4.0) as f32 } else { self.any() };
        let near = end(true) > 0.0;
        let (a, b) = (end(near), end(near));
        Interval::new(a.min(b), a.max(b))
    }

    fn inside(&mut self, interval: Interval) -> f32 {
        match self.bits() % 8 {
            0 => interval.lo,
            1 => interval.hi,
            2 | 3 => self.any().clamp(interval.lo, interval.hi),
            _ => {
                let x = self.between(interval.lo.into(), interval.hi.into()) as f32;
                x.clamp(interval.lo, interval.hi)
            }
        }
    }
}
