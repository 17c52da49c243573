//! Prints what kernels cost: time per pixel pair and time to compile, for every
//! width that the host has and every number of chains.
//!
//! `cargo run --release -p tamis-jit --example throughput`

use std::time::{Duration, Instant};

use tamis_jit::{
    Body, Border, Chains, Compiler, CpuFeatures, Job, Lanes, Layout, Rect, Run, Side, Width,
    WindowSpec,
};

const SIZE: usize = 64;
const RADIUS: usize = 8;
const ROUNDS: usize = 60;

/// Channels to sum: a colour and the constant 1.
const CHANNELS: usize = 4;
const FEATURES: usize = 5;

/// The same weight everywhere.
struct Uniform;

impl Body for Uniform {
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
        vec![lanes.tap(0)]
    }
}

/// exp(tap - Σ scale × (feature_i - feature_j)²), flushed to zero at the far end.
struct CrossBilateral;

impl Body for CrossBilateral {
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
        let mut exponent = lanes.tap(0);
        for feature in CHANNELS..CHANNELS + FEATURES {
            let (i, j) = (lanes.plane(feature, Side::I), lanes.plane(feature, Side::J));
            let difference = lanes.sub(i, j);
            let scale = lanes.constant(-0.5 * feature as f32);
            let scaled = lanes.mul(difference, scale);
            exponent = lanes.fma(scaled, difference, exponent);
        }
        let exp = Exp::new(lanes);
        vec![exp.emit(lanes, exponent)]
    }
}

/// The exponential, by a polynomial on ± ln 2 / 2 and a scaling. Its constants
/// are emitted once for all its uses.
struct Exp<F> {
    floor: F,
    log2e: F,
    high: F,
    low: F,
    polynomial: [F; 7],
}

impl<F: Copy> Exp<F> {
    fn new<L: Lanes<F = F>>(lanes: &mut L) -> Self {
        Self {
            floor: lanes.constant(-87.0),
            log2e: lanes.constant(std::f32::consts::LOG2_E),
            high: lanes.constant(-0.693_145_75),
            low: lanes.constant(-1.428_606_8e-6),
            polynomial: [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0]
                .map(|coefficient| lanes.constant(coefficient)),
        }
    }

    fn emit<L: Lanes<F = F>>(&self, lanes: &mut L, x: F) -> F {
        let x = lanes.max(x, self.floor);
        let scaled = lanes.mul(x, self.log2e);
        let whole = lanes.round(scaled);
        let rest = lanes.fma(whole, self.high, x);
        let rest = lanes.fma(whole, self.low, rest);
        let [first, others @ ..] = self.polynomial;
        let mut sum = first;
        for coefficient in others {
            sum = lanes.fma(sum, rest, coefficient);
        }
        let power = lanes.exp2i(whole);
        lanes.mul(sum, power)
    }
}

/// Sixteen cross-bilateral weights of different widths, over shared distances.
struct Batch;

impl Body for Batch {
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
        let (i, j) = (lanes.plane(CHANNELS, Side::I), lanes.plane(CHANNELS, Side::J));
        let difference = lanes.sub(i, j);
        let squared = lanes.mul(difference, difference);
        let exp = Exp::new(lanes);
        (1..=16)
            .map(|n| {
                let (scale, spatial) = (lanes.constant(-0.1 * n as f32), lanes.tap(0));
                let exponent = lanes.fma(squared, scale, spatial);
                exp.emit(lanes, exponent)
            })
            .collect()
    }
}

/// The least disturbed of several rounds.
fn best(times: Vec<Duration>) -> Duration {
    times.into_iter().min().unwrap_or_default()
}

fn measure<B: Body>(
    name: &str,
    body: &B,
    weights: usize,
) -> Result<(), Box<dyn std::error::Error>> {
    let layout = Layout::new(SIZE, SIZE, RADIUS);
    let planes: Vec<Vec<f32>> = (0..CHANNELS + FEATURES)
        .map(|plane| {
            let border = if plane < CHANNELS { Border::Zero } else { Border::Replicate };
            layout.plane(border, |x, y| ((x * 7 + y * 13 + plane) % 31) as f32 / 31.0)
        })
        .collect();
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let runs = Run::square(RADIUS);
    let taps = vec![-0.5; runs.len() * runs.len()];
    let spec = WindowSpec {
        planes: planes.len(),
        taps: 1,
        channels: CHANNELS,
        weights,
        absolute: false,
        lone: false,
        mirrored: false,
    };
    let job = Job { layout, planes: &planes, runs: &runs, taps: &taps, rect: Rect::all(&layout) };
    let pairs = (SIZE * SIZE * taps.len() * weights) as f64;

    let widths = Width::ALL.into_iter().filter(|&width| CpuFeatures::of_host().allow(width));
    for (width, chains) in widths.flat_map(|width| Chains::ALL.map(|chains| (width, chains))) {
        let compiler = Compiler::with_width(width)?;
        let compile = (0..ROUNDS)
            .map(|_| {
                let start = Instant::now();
                compiler.compile(spec, Some(chains), body).map(|_| start.elapsed())
            })
            .collect::<Result<Vec<_>, _>>()?;
        let kernel = compiler.compile(spec, Some(chains), body)?;
        let mut out = vec![0.0; kernel.output_shape(&job.rect).len()];
        let run = (0..ROUNDS)
            .map(|_| {
                let start = Instant::now();
                kernel.run(&job, &mut out, &mut []).map(|_| start.elapsed())
            })
            .collect::<Result<Vec<_>, _>>()?;
        println!(
            "{name:<16} {width} {chains:<5?} {:7.3} ns/pair  {:7.3} ms to compile  {:6} bytes",
            best(run).as_secs_f64() * 1e9 / pairs,
            best(compile).as_secs_f64() * 1e3,
            kernel.code_bytes(),
        );
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("{SIZE} x {SIZE} pixels, radius {RADIUS}, {CHANNELS} channels");
    measure("box", &Uniform, 1)?;
    measure("cross-bilateral", &CrossBilateral, 1)?;
    measure("batch of 16", &Batch, 16)
}
