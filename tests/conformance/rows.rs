//! Every row of the operator table on the GPU, held to its budget: the exact one,
//! or, within the row's bounds, that of fast shaders.
//!
//! WGSL lets a device take subnormal numbers for zero, so a result may also be
//! that of operands with their subnormals flushed, and be flushed itself.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tamis::backend::gpu::{Gpu, Options};
use tamis::backend::shader::wgsl::Arithmetic;
use tamis::expr::Op;
use tamis::expr::builder::{Builder, LIMIT, Rules};
use tamis::expr::function::{Budget, ulp};
use tamis::expr::interval::Interval;
use tamis::expr::op::Form;
use tamis::expr::tape::{Input, Side};
use tamis::plan::Precision;

pub(crate) const CASES: &[(&str, fn())] = &[
    ("gpu::rows_standard", || drop(standard())),
    ("gpu::rows_of_a_poor_device", || drop(poor())),
    ("gpu::rows_fast", || drop(fast())),
];

/// Cases that write documents:
/// `cargo test --release --test conformance long::rows -- --ignored`
pub(crate) const LONG: &[(&str, fn())] = &[("long::rows::table", table)];

const SAMPLES: usize = 1 << 18;

fn standard() -> Vec<Worst> {
    rows(Precision::Standard, None)
}

/// With nothing relied upon but what WGSL guarantees, whatever this device does.
fn poor() -> Vec<Worst> {
    rows(Precision::Standard, Some(Arithmetic::WGSL))
}

fn fast() -> Vec<Worst> {
    rows(Precision::Fast, None)
}

/// How far an operator's results are off, at worst: in units of the last place those that
/// are further off than the absolute part of the budget.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    ulp: f64,
    budget: f64,
}

const BEGIN: &str = "<!-- shaders: written by the test `long::rows::table` -->\n";
const END: &str = "<!-- end -->\n";

/// Writes the figures of this machine's GPU into docs/NUMERICS.md.
fn table() {
    let gpu = Gpu::open(&Options::default()).expect("a GPU");
    let mut table = format!(
        "{}, {SAMPLES} points for each operator, ulp:\n\n| operator | `standard` | budget | relying \
         on WGSL alone | `fast` | budget |\n|---|---:|---:|---:|---:|---:|\n",
        gpu.adapter_name()
    );
    let measured = standard().into_iter().zip(poor()).zip(fast());
    for (&op, ((standard, poor), fast)) in Op::ALL.iter().zip(measured) {
        let figures = [standard.ulp, standard.budget, poor.ulp, fast.ulp, fast.budget];
        let cells = figures.map(|x| format!("{:.2}", (x * 100.0).ceil() / 100.0));
        let line = format!("| {} | {} |\n", op.name().replace('|', "\\|"), cells.join(" | "));
        table.push_str(&line);
    }
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/NUMERICS.md");
    let text = std::fs::read_to_string(&path).expect("docs/NUMERICS.md");
    let (before, rest) = text.split_once(BEGIN).expect("the table begins");
    let (_, after) = rest.split_once(END).expect("the table ends");
    std::fs::write(&path, format!("{before}{BEGIN}{table}{END}{after}")).expect("writable");
}

fn rows(precision: Precision, arithmetic: Option<Arithmetic>) -> Vec<Worst> {
    let gpu = Gpu::open(&Options { precision, arithmetic, ..Options::default() }).expect("a GPU");
    let (mut failures, mut all) = (Vec::new(), Vec::new());
    for &op in Op::ALL {
        let fast = precision == Precision::Fast;
        let form = if fast { op.row().form.short() } else { op.row().form };
        let (operands, budget, within) = match form {
            Form::Unary(f) if fast => (1, f.fast.budget, f.fast.within),
            Form::Unary(f) => (1, f.budget, LIMIT),
            Form::Binary(f) if fast => (2, f.fast.budget, f.fast.within),
            Form::Binary(f) => (2, f.budget, LIMIT),
            // Three components at i and three at j; budgets are for unit vectors.
            Form::Vectors(f) => (6, f.budget, 1.0),
        };
        let mut b = Builder::new(Rules::ALL);
        let range = Interval::new(-within, within);
        let inputs: Vec<_> =
            (0..operands).map(|k| b.input(Input::PerPixel(k as u32, Side::I), range)).collect();
        let result = match form {
            Form::Unary(f) => (f.build)(&mut b, inputs[0]),
            Form::Binary(f) => (f.build)(&mut b, inputs[0], inputs[1]),
            Form::Vectors(f) => {
                let pairs: Vec<_> = (0..3).map(|k| (inputs[k], inputs[k + 3])).collect();
                (f.build)(&mut b, &pairs)
            }
        };
        let tape = b.finish(&[result]);
        let columns = samples(op, operands, within);
        let slices: Vec<&[f32]> = columns.iter().map(Vec::as_slice).collect();
        let got = gpu.evaluate(&tape, &slices).expect("evaluates").swap_remove(0);
        let (mut wrong, mut example) = (0, None);
        let mut worst = Worst { ulp: 0.0, budget: budget.ulp };
        for (k, &got) in got.iter().enumerate() {
            let row: Vec<f32> = columns.iter().map(|column| column[k]).collect();
            let exact = meaning(op, &row);
            let flushed: Vec<f32> = row.iter().map(|&x| flush(x)).collect();
            let flushed = meaning(op, &flushed);
            let right = allows(budget, got, exact) || allows(budget, got, flushed);
            let off = |exact: f64| (f64::from(got) - exact).abs();
            let nearest = if off(flushed) < off(exact) { flushed } else { exact };
            if right && off(nearest) > budget.absolute && !vanishes(got, nearest) {
                worst.ulp = worst.ulp.max(off(nearest) / ulp(nearest));
            }
            if !right {
                wrong += 1;
                example.get_or_insert_with(|| format!("{row:?} = {got:e}, not {exact:e}"));
            }
        }
        if let Some(example) = example {
            failures.push(format!("{op:?}: {wrong} of {SAMPLES} wrong, as {example}"));
        }
        all.push(worst);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    all
}

fn flush(x: f32) -> f32 {
    if x.is_subnormal() { 0.0 } else { x }
}

fn allows(budget: Budget, got: f32, exact: f64) -> bool {
    budget.allows(got, exact) || vanishes(got, exact)
}

/// Whether a subnormal result was taken for zero.
fn vanishes(got: f32, exact: f64) -> bool {
    exact.abs() < f64::from(f32::MIN_POSITIVE) && got == 0.0
}

fn meaning(op: Op, row: &[f32]) -> f64 {
    let row: Vec<f64> = row.iter().map(|&x| f64::from(x)).collect();
    match op.row().form {
        Form::Unary(f) => (f.meaning)(row[0]),
        Form::Binary(f) => (f.meaning)(row[0], row[1]),
        Form::Vectors(f) => (f.meaning)(&[(row[0], row[3]), (row[1], row[4]), (row[2], row[5])]),
    }
}

/// Columns of operands: bit patterns of all magnitudes, numbers near one, integers
/// and their neighbours, zeros; for a power also exponents that make moderate ones.
fn samples(op: Op, operands: usize, within: f32) -> Vec<Vec<f32>> {
    let mut rng = ChaCha8Rng::seed_from_u64(op as u64);
    let mut number = |k: usize| -> f32 {
        let x = match k % 4 {
            0 => f32::from_bits(rng.random_range(0..=within.to_bits())),
            1 => rng.random_range(0.0..within.min(4.0)),
            2 => rng.random_range(0.0..within.min(100.0)),
            _ => {
                let whole = rng.random_range(0..=(within.min(40.0) as i32)) as f32;
                [whole.next_down().abs(), whole, whole.next_up().min(within)][k / 4 % 3]
            }
        };
        if rng.random() { x } else { -x }
    };
    let mut columns: Vec<Vec<f32>> = (0..operands)
        .map(|column| (0..SAMPLES).map(|k| number(k + column * (k / 7))).collect())
        .collect();
    if op == Op::Pow {
        for k in (0..SAMPLES).step_by(2) {
            let x = columns[0][k];
            let y = rng.random_range(-130.0..62.0) / f64::from(x).abs().log2();
            if y.is_finite() {
                columns[1][k] = (y as f32).clamp(-within, within);
            }
        }
    }
    columns
}
