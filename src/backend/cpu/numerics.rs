//! How accurate every operator is, measured: the tables of docs/NUMERICS.md.
//!
//! Results come from the interpreter's own loops, whose bits machine code has too.
//! They are compared with the f64 meanings of the operator table, and those with
//! CORE-MATH's correctly rounded functions. The ignored test measures everything and
//! writes the tables; the others measure samples and hold the tables to them:
//!
//! ```text
//! cargo test --release --lib numerics -- --ignored --nocapture
//! ```

use std::fmt::Write;
use std::path::PathBuf;
use std::sync::LazyLock;

use rayon::prelude::*;

use super::block::{Arg, Chunk, LANES, Program, Slots};
use super::paper::run;
use crate::expr::Op;
use crate::expr::builder::{Builder, LIMIT, Rules};
use crate::expr::elementary::suite::{Random, probes};
use crate::expr::function::{Budget, ulp};
use crate::expr::interval::Interval;
use crate::expr::op::Form;
use crate::expr::tape::{Input, Instr, Side, Tape, Value};

/// Points that are evaluated at once.
const POINTS: usize = 16 * LANES;

/// Components of the vectors: the widest there are.
const COMPONENTS: usize = 3;

/// Random points per operator, in the ordinary suite.
const SAMPLED: u64 = 1 << 18;

/// Random points per operator of several operands, for the tables.
const MANY: u64 = 1 << 27;

/// Operands of one point: of vectors, those at i before those at j.
type Point = [f32; 2 * COMPONENTS];

/// An operator's code.
struct Code {
    op: Op,
    form: Form,
    primitives: usize,
    program: Program,
    /// Which operand each of the program's inputs is.
    reads: Vec<usize>,
}

impl Code {
    fn of(op: Op) -> Self {
        Self::new(op, op.row().form)
    }

    /// What is made of it at [`Precision::Fast`](crate::plan::Precision), if that is
    /// something else.
    fn short(op: Op) -> Option<Self> {
        let form = op.row().form;
        let is_short = match form {
            Form::Unary(f) => f.short.is_some(),
            Form::Binary(f) => f.short.is_some(),
            Form::Vectors(_) => false,
        };
        is_short.then(|| Self::new(op, form.short()))
    }

    fn new(op: Op, form: Form) -> Self {
        let mut b = Builder::new(Rules::ALL);
        let input = |b: &mut Builder, k: usize, interval| {
            b.input(Input::PerPixel(k as u32, Side::I), interval)
        };
        let anything = Interval::new(-LIMIT, LIMIT);
        let unit = Interval::new(-1.0, 1.0);
        let result = match form {
            Form::Unary(f) => {
                let x = input(&mut b, 0, anything);
                (f.build)(&mut b, x)
            }
            Form::Binary(f) => {
                let [x, y] = [0, 1].map(|k| input(&mut b, k, anything));
                (f.build)(&mut b, x, y)
            }
            Form::Vectors(f) => {
                let pairs: [(Value, Value); COMPONENTS] = std::array::from_fn(|k| {
                    (input(&mut b, k, unit), input(&mut b, COMPONENTS + k, unit))
                });
                (f.build)(&mut b, &pairs)
            }
        };
        let tape: Tape = b.finish(&[result]);
        let primitive = |instr: &&Instr| matches!(instr, Instr::Prim(..));
        let primitives = tape.instrs().iter().filter(primitive).count();
        let program = Program::new(&tape);
        let read = |input: &Input| match *input {
            Input::PerPixel(k, _) => k as usize,
            Input::PerTap(_)
            | Input::Plane(..)
            | Input::Offset(_)
            | Input::Signal(..)
            | Input::Constant(_) => {
                unreachable!("none is made")
            }
        };
        let reads = program.inputs().iter().map(read).collect();
        Self { op, form, primitives, program, reads }
    }

    fn budget(&self) -> Budget {
        self.form.budget()
    }

    fn meaning(&self, point: &Point) -> f64 {
        let [x, y, ..] = point.map(f64::from);
        match self.form {
            Form::Unary(f) => (f.meaning)(x),
            Form::Binary(f) => (f.meaning)(x, y),
            Form::Vectors(f) => {
                let pair = |k: usize| (point[k].into(), point[COMPONENTS + k].into());
                (f.meaning)(&[0, 1, 2].map(pair))
            }
        }
    }

    /// Holds points to the budget, and says how far off they are at worst.
    fn check(&self, points: &[Point], slots: &mut Slots) -> Worst {
        let columns: Vec<Vec<Chunk>> = self
            .reads
            .iter()
            .map(|&k| {
                let chunk = |points: &[Point]| {
                    std::array::from_fn(|lane| points[lane.min(points.len() - 1)][k])
                };
                points.chunks(LANES).map(chunk).collect()
            })
            .collect();
        let inputs: Vec<Arg<'_>> = columns.iter().map(|column| Arg::Block(column)).collect();
        let chunks = points.len().div_ceil(LANES);
        run(&self.program, &inputs, slots, chunks);
        let result = self.program.result(0, &inputs, slots);
        let budget = self.budget();
        let mut worst = Worst::default();
        for (k, point) in points.iter().enumerate() {
            let got = match result {
                Arg::Block(block) => block[k / LANES][k % LANES],
                Arg::Splat(value) => value,
            };
            let exact = self.meaning(point);
            assert!(got.abs() <= LIMIT, "{}{point:?} = {got:e}", self.op.name());
            assert!(
                budget.allows(got, exact),
                "{}{point:?} = {got:e}, not {exact:e}",
                self.op.name()
            );
            worst.note(budget, (f64::from(got) - exact).abs(), exact);
        }
        worst
    }

    /// Checks the points that `point` gives for numbers below `count`.
    fn check_all(&self, count: u64, point: impl Fn(u64) -> Point + Sync) -> Worst {
        let blocks = count.div_ceil(POINTS as u64);
        let check = |slots: &mut Slots, block: u64| {
            let numbers = block * POINTS as u64..count.min((block + 1) * POINTS as u64);
            let points: Vec<Point> = numbers.map(&point).collect();
            self.check(&points, slots)
        };
        let worst = (0..blocks).into_par_iter().map_init(Slots::default, check);
        worst.reduce(Worst::default, Worst::or)
    }

    /// Every operand there is, if there is one operand; many, if there are more.
    fn measure(&self) -> (u64, Worst) {
        let (count, worst) = match self.form {
            Form::Unary(_) => {
                let magnitudes = u64::from(LIMIT.to_bits()) + 1;
                let every = |k: u64| {
                    let magnitude = f32::from_bits((k / 2) as u32);
                    point([if k.is_multiple_of(2) { magnitude } else { -magnitude }])
                };
                (2 * magnitudes, self.check_all(2 * magnitudes, every))
            }
            Form::Binary(_) | Form::Vectors(_) => (MANY, self.check_all(MANY, |k| self.random(k))),
        };
        (count + self.probes().len() as u64, worst.or(self.check_probes()))
    }

    /// A few of them, and the probes.
    fn sample(&self) -> Worst {
        self.check_all(SAMPLED, |k| self.random(k)).or(self.check_probes())
    }

    fn check_probes(&self) -> Worst {
        let probes = self.probes();
        self.check_all(probes.len() as u64, |k| probes[k as usize])
    }

    /// Points where functions break.
    fn probes(&self) -> Vec<Point> {
        let values = probes();
        match self.form {
            Form::Unary(_) => values.into_iter().map(|x| point([x])).collect(),
            Form::Binary(_) => {
                values.iter().flat_map(|&x| values.iter().map(move |&y| point([x, y]))).collect()
            }
            // Two of a kind, against zero and against each other.
            Form::Vectors(_) => {
                let inside = values.into_iter().filter(|x| x.abs() <= 1.0);
                inside
                    .flat_map(|x| [[x; 6], [x, x, x, 0.0, 0.0, 0.0], [x, 0.0, 0.0, 0.0, -x, 1.0]])
                    .collect()
            }
        }
    }

    /// The `k`-th random point.
    fn random(&self, k: u64) -> Point {
        let mut random = Random::stream(k);
        match (self.op, self.form) {
            (_, Form::Unary(_)) => point([random.any()]),
            // Random bit patterns seldom have a power that is neither 0 nor clamped: four of
            // five exponents are made so that the power's magnitude is any.
            (Op::Pow, _) if !k.is_multiple_of(5) => {
                let x = match k % 5 {
                    1 => random.any().abs(),
                    2 => 1.0 + random.between(-0.7, 0.7).powi(9) as f32,
                    3 => random.between(0.0, 4.0) as f32,
                    _ => random.between(0.7, 1.45) as f32,
                };
                let y = random.between(-130.0, 62.0) / f64::from(x).abs().log2();
                let x = x.copysign(random.any());
                point([x, y.clamp(-1e18, 1e18) as f32])
            }
            // Near each other, every other time, where differences and quotients are near
            // 0 and 1.
            (_, Form::Binary(_)) => {
                let (x, any) = (random.any(), random.any());
                let near = x * (1.0 + random.between(-1e-3, 1e-3) as f32);
                point([x, if k.is_multiple_of(2) { any } else { near.clamp(-LIMIT, LIMIT) }])
            }
            (_, Form::Vectors(_)) => {
                let mut point: Point = std::array::from_fn(|_| random.between(-1.0, 1.0) as f32);
                if k.is_multiple_of(2) {
                    let scale = random.between(-60.0, 0.0).exp2();
                    for c in 0..COMPONENTS {
                        let step = scale * f64::from(point[COMPONENTS + c]);
                        point[COMPONENTS + c] =
                            (f64::from(point[c]) + step).clamp(-1.0, 1.0) as f32;
                    }
                }
                point
            }
        }
    }
}

fn point<const N: usize>(operands: [f32; N]) -> Point {
    std::array::from_fn(|k| operands.get(k).copied().unwrap_or(0.0))
}

/// How far results are off, at worst.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    /// In units of the last place, where the absolute part of the budget is exceeded.
    ulp: f64,
    /// Where the relative part is.
    absolute: f64,
}

impl Worst {
    fn note(&mut self, budget: Budget, error: f64, exact: f64) {
        let ulps = error / ulp(exact);
        if error > budget.absolute {
            self.ulp = self.ulp.max(ulps);
        }
        if ulps > budget.ulp {
            self.absolute = self.absolute.max(error);
        }
    }

    fn or(self, other: Self) -> Self {
        Self { ulp: self.ulp.max(other.ulp), absolute: self.absolute.max(other.absolute) }
    }
}

/// What CORE-MATH gives for a meaning; none where the language departs from
/// mathematics, or `f32` from `f64`.
fn correctly_rounded(op: Op, x: f64, y: f64) -> Option<f64> {
    let turned = x.abs() <= 1e5;
    let exact = match op {
        Op::Sin => turned.then(|| core_math::sin(x)),
        Op::Cos => turned.then(|| core_math::cos(x)),
        Op::Tan => turned.then(|| core_math::tan(x)),
        Op::Sinc => (turned && x != 0.0).then(|| core_math::sinpi(x) / (std::f64::consts::PI * x)),
        Op::Exp => Some(core_math::exp(x)),
        Op::Asin => (x.abs() <= 1.0).then(|| core_math::asin(x)),
        Op::Acos => (x.abs() <= 1.0).then(|| core_math::acos(x)),
        Op::Atan => Some(core_math::atan(x)),
        Op::Log => (x >= f64::from(f32::MIN_POSITIVE)).then(|| core_math::log(x)),
        Op::Tanh => Some(core_math::tanh(x)),
        Op::Pow => (x >= f64::from(f32::MIN_POSITIVE)).then(|| core_math::pow(x, y)),
        _ => None,
    }?;
    let (least, most) = (f64::from(f32::MIN_POSITIVE), f64::from(LIMIT));
    (exact == 0.0 || (least..most).contains(&exact.abs())).then_some(exact)
}

/// How far a meaning is from correctly rounded, in units of the last place of `f32`;
/// none for those that need no elementary function.
fn meaning_error(code: &Code) -> Option<f64> {
    let errors = (0..SAMPLED).filter_map(|k| {
        let point = code.random(k);
        let exact = correctly_rounded(code.op, point[0].into(), point[1].into())?;
        Some((code.meaning(&point) - exact).abs() / ulp(exact))
    });
    errors.fold(None, |worst: Option<f64>, error| Some(worst.unwrap_or(0.0).max(error)))
}

static PATH: LazyLock<PathBuf> =
    LazyLock::new(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs/NUMERICS.md"));

/// Where the table of operators begins, and that of short functions.
const OPERATORS: &str = "<!-- operators: written by the test `backend::numerics` -->\n";
const SHORT: &str = "<!-- short functions: written by the test `backend::numerics` -->\n";
const END: &str = "<!-- end -->\n";

/// The code of every operator, in the order of the operator table.
fn operators() -> Vec<Code> {
    Op::ALL.iter().map(|&op| Code::of(op)).collect()
}

/// The short functions.
fn short_functions() -> Vec<Code> {
    Op::ALL.iter().filter_map(|&op| Code::short(op)).collect()
}

/// A row of the table.
#[derive(Debug)]
struct Row {
    primitives: usize,
    ulp: f64,
    absolute: f64,
}

/// A table in the document, by operator in the order of the operator table.
fn documented(begin: &str) -> Vec<(String, Row)> {
    let text = std::fs::read_to_string(&*PATH).expect("docs/NUMERICS.md");
    let (_, rest) = text.split_once(begin).expect("the table begins");
    let (table, _) = rest.split_once(END).expect("the table ends");
    let rows = table.lines().filter(|line| line.starts_with("| `"));
    rows.map(|line| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let figure = |cell: &str| cell.parse().unwrap_or(0.0);
        let primitives = cells[2].parse().expect("a number");
        let row = Row { primitives, ulp: figure(cells[4]), absolute: figure(cells[6]) };
        (cells[1].trim_matches('`').to_owned(), row)
    })
    .collect()
}

fn title(op: Op) -> String {
    let operands = match op.row().form {
        Form::Unary(_) => "(x)",
        Form::Binary(_) => "(x, y)",
        Form::Vectors(_) => "(a, b)",
    };
    format!("{}{operands}", op.name())
}

fn figure(x: f64) -> String {
    if x == 0.0 { "-".to_owned() } else { format!("{x:.1e}") }
}

#[test]
#[ignore = "takes ten minutes, and writes docs/NUMERICS.md"]
fn table_of_operators() {
    write(OPERATORS, &operators());
}

#[test]
#[ignore = "takes a minute, and writes docs/NUMERICS.md"]
fn table_of_short_functions() {
    write(SHORT, &short_functions());
}

/// Measures a table and writes it into the document.
fn write(begin: &str, rows: &[Code]) {
    let mut table = String::from(
        "| operator | primitives | points | ulp | budget | absolute | budget | meaning |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for code in rows {
        let (points, worst) = code.measure();
        let budget = code.budget();
        let meaning = meaning_error(code).map_or_else(|| "-".to_owned(), figure);
        writeln!(
            table,
            "| `{}` | {} | {points} | {:.3} | {} | {} | {} | {meaning} |",
            title(code.op),
            code.primitives,
            // Rounded up: the table says at most.
            (worst.ulp * 1e3).ceil() / 1e3,
            budget.ulp,
            figure(worst.absolute * 1.05),
            figure(budget.absolute),
        )
        .expect("a string takes anything");
        println!("{}", table.lines().last().unwrap_or_default());
    }
    let text = std::fs::read_to_string(&*PATH).expect("docs/NUMERICS.md");
    let (before, rest) = text.split_once(begin).expect("the table begins");
    let (_, after) = rest.split_once(END).expect("the table ends");
    std::fs::write(&*PATH, format!("{before}{begin}{table}{END}{after}")).expect("writable");
}

#[test]
fn the_documented_errors_hold_on_samples() {
    let measured = [(OPERATORS, operators()), (SHORT, short_functions())];
    for (begin, codes) in measured {
        hold(&codes, &documented(begin));
    }
}

/// Holds samples to a table.
fn hold(codes: &[Code], documented: &[(String, Row)]) {
    let titles: Vec<String> = codes.iter().map(|code| title(code.op)).collect();
    let listed: Vec<&String> = documented.iter().map(|(title, _)| title).collect();
    assert_eq!(listed, titles.iter().collect::<Vec<_>>(), "run the ignored test");
    for (code, (title, row)) in codes.iter().zip(documented) {
        let worst = code.sample();
        assert_eq!(code.primitives, row.primitives, "{title} changed: run the ignored test");
        assert!(worst.ulp <= row.ulp, "{title}: {worst:?}, but {row:?} is documented");
        assert!(worst.absolute <= row.absolute, "{title}: {worst:?}, but {row:?} is documented");
        // A table of what functions once were would allow too much.
        let exhaustive = matches!(code.form, Form::Unary(_)) && row.ulp > 0.0;
        assert!(
            !exhaustive || worst.ulp > 0.5 * row.ulp,
            "{title}: {worst:?} is far below {row:?}"
        );
    }
}

#[test]
fn meanings_are_correctly_rounded_functions() {
    let mut compared = 0;
    for &op in Op::ALL {
        if let Some(error) = meaning_error(&Code::of(op)) {
            compared += 1;
            // The power's goes through a logarithm: 1.9e-7.
            assert!(error < 1e-6, "{}: off by {error:e} ulp", op.name());
        }
    }
    assert_eq!(compared, 11);
}
