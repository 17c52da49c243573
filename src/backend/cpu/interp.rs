//! The interpreter: the reference that every other back end is compared with.

use super::block::{
    Arg, BLOCK, Block as Sums, Chunk, LANES, Program, Slots, accumulate, accumulate_magnitude,
};
use super::gradient::GradientCode;
use super::paper::{CHANNELS, Rates, run, tapes};
use super::program::{Engine, MapBlock, Mapper, ProgramCode, Summed};
use super::sums::{Frame, Summer, Taps};
use crate::backend::{
    Agreement, Backend, BackendError, Differentiable, Differentiator, Executable, Filtered, Rect,
    Watch,
};
use crate::expr::tape::{Input, Side};
use crate::plan::{Gradient, MapKernel, PairLoop, Plan, WindowPlan};
use crate::scene::Scene;

/// Interprets tapes over blocks of pixels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Interpreter;

struct Interpreted {
    plan: WindowPlan,
    rates: Rates,
    pair: Pair,
}

/// The pair tape, ready to run.
pub(super) struct Pair {
    program: Program,
    summed: Summed,
    mirrored: bool,
}

#[derive(Default)]
pub(super) struct Scratch {
    slots: Slots,
    /// The sums of the current run of taps.
    partial: Sums,
}

impl Backend for Interpreter {
    fn name(&self) -> &'static str {
        "interp"
    }

    fn agreement(&self) -> Agreement {
        Agreement::Bits
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        let plan = match plan {
            Plan::Window(plan) => plan,
            Plan::Program(program) => return Ok(Box::new(ProgramCode::new(self, program)?)),
        };
        let (weights, signed) = (plan.weights(), plan.signed());
        let pair = Pair {
            program: Program::new(&tapes(plan).pair),
            summed: Summed { channels: CHANNELS, weights, signed, lone: false },
            mirrored: plan.mirrored().is_some(),
        };
        Ok(Box::new(Interpreted { plan: (**plan).clone(), rates: Rates::new(plan), pair }))
    }
}

impl Differentiator for Interpreter {
    fn differentiate(&self, gradient: &Gradient) -> Result<Box<dyn Differentiable>, BackendError> {
        Ok(Box::new(GradientCode::new(self, gradient)?))
    }
}

impl Executable for Interpreted {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        self.rates.run(&self.plan, &self.pair, scene, region, watch)
    }
}

/// A map's tape, ready to run.
pub(super) struct Map {
    program: Program,
}

impl Engine for Interpreter {
    type Map = Map;
    type Gather = Pair;

    fn map(&self, kernel: &MapKernel) -> Result<Map, BackendError> {
        Ok(Map { program: Program::new(&kernel.tape) })
    }

    fn pairs(&self, pairs: &PairLoop, summed: Summed) -> Result<Pair, BackendError> {
        let PairLoop { mirrored, .. } = *pairs;
        Ok(Pair { program: Program::new(&pairs.pair), summed, mirrored })
    }
}

impl Mapper for Map {
    type Scratch = Slots;

    fn step(&self) -> usize {
        LANES
    }

    fn rows(
        &self,
        inputs: &[&[f32]],
        uniform: &[f32],
        block: MapBlock,
        slots: &mut Slots,
        outputs: &mut [f32],
    ) -> Result<(), BackendError> {
        let MapBlock { layout, rows, pad } = block;
        let (width, count) = (layout.width(), self.program.results());
        let stride = width.next_multiple_of(LANES);
        for (row, outputs) in outputs.chunks_exact_mut(count * stride).take(rows).enumerate() {
            for start in (0..width).step_by(BLOCK * LANES) {
                let chunks = (width - start).div_ceil(LANES).min(BLOCK);
                let at = row * layout.stride() + pad + start;
                let args: Vec<Arg<'_>> = self
                    .program
                    .inputs()
                    .iter()
                    .map(|input| match *input {
                        // The first input is the constant one.
                        Input::Signal(k, Side::I) => blocks(&inputs[1 + k as usize][at..]),
                        Input::PerTap(k) => Arg::Splat(uniform[k as usize]),
                        Input::Signal(_, Side::J)
                        | Input::Plane(..)
                        | Input::Offset(_)
                        | Input::PerPixel(..)
                        | Input::Constant(_) => unreachable!("maps read signals at i alone"),
                    })
                    .collect();
                run(&self.program, &args, slots, chunks);
                for k in 0..count {
                    let row = &mut outputs[k * stride + start..][..chunks * LANES];
                    match self.program.result(k, &args, slots) {
                        // Adding zero makes one zero of two, as sums of machine code do.
                        Arg::Block(block) => {
                            let values = block[..chunks].as_flattened();
                            row.iter_mut().zip(values).for_each(|(to, &x)| *to = x + 0.0);
                        }
                        Arg::Splat(x) => row.fill(x + 0.0),
                    }
                }
            }
        }
        Ok(())
    }
}

impl Pair {
    /// Adds every weight times every channel at `at` to its sum, in order.
    #[inline(always)]
    fn add_tap<'a, 'b>(
        &self,
        frame: &Frame<'_>,
        weight: impl Fn(usize) -> Arg<'a>,
        at: usize,
        mut sums: impl Iterator<Item = &'b mut [Chunk]>,
    ) {
        let mut next = || sums.next().expect("one run of sums per result");
        let Summed { channels, weights, signed, lone } = self.summed;
        let lone = usize::from(lone);
        let (common, apart) = frame.channels.split_at(channels - lone);
        for k in 0..weights - lone {
            let w = weight(k);
            for channel in common {
                accumulate(w, channel[at..].as_chunks().0, next());
            }
            if signed {
                let one = common[common.len() - 1];
                accumulate_magnitude(w, one[at..].as_chunks().0, next());
            }
        }
        for channel in apart {
            accumulate(weight(weights - 1), channel[at..].as_chunks().0, next());
        }
    }
}

impl Summer for Pair {
    type Scratch = Scratch;

    fn step(&self) -> usize {
        LANES
    }

    fn add(
        &self,
        frame: &Frame<'_>,
        taps: Taps<'_>,
        rect: Rect,
        scratch: &mut Scratch,
        sums: &mut [f32],
        owed: &mut [f32],
    ) -> Result<(), BackendError> {
        let stride = rect.width.next_multiple_of(LANES);
        // Wide strips are cut into equal blocks rather than full ones and a rest.
        let chunks = stride / LANES;
        let block = chunks.div_ceil(chunks.div_ceil(BLOCK));
        for row in 0..rect.height {
            for first in (0..chunks).step_by(block) {
                pulp::Arch::new().dispatch(Block {
                    pair: self,
                    frame,
                    taps,
                    x: rect.x + first * LANES,
                    y: rect.y + row,
                    chunks: block.min(chunks - first),
                    scratch,
                    sums: &mut sums[row * self.summed.results() * stride + first * LANES..],
                    stride,
                    owed,
                });
            }
        }
        Ok(())
    }
}

/// The sums of a run of pixels within a row; a type and not a closure for the
/// reason given in `cpu`.
struct Block<'a> {
    pair: &'a Pair,
    frame: &'a Frame<'a>,
    taps: Taps<'a>,
    x: usize,
    y: usize,
    chunks: usize,
    scratch: &'a mut Scratch,
    /// Where the sums of the first result begin; the others' follow `stride`
    /// apart.
    sums: &'a mut [f32],
    stride: usize,
    owed: &'a mut [f32],
}

impl pulp::WithSimd for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { pair, frame, chunks, .. } = self;
        let Scratch { slots, partial } = self.scratch;
        let (program, results) = (&pair.program, pair.summed.results());
        let layout = frame.layout;
        let here = layout.index(self.x, self.y);
        let per_tap = self.taps.per_tap;
        let mut tap = 0;
        let mut inputs: Vec<Arg<'_>> = Vec::with_capacity(program.inputs().len());
        for (index, run) in self.taps.runs.iter().enumerate() {
            let y = self.y.checked_add_signed(run.dy as isize).filter(|&y| y < layout.height());
            let Some(y) = y else {
                tap += run.count as usize * per_tap;
                continue;
            };
            partial.resize(results * chunks);
            partial.chunks_mut().fill([0.0; LANES]);
            for [dx, _] in run.offsets() {
                let there = layout.index(self.x, y).wrapping_add_signed(dx as isize);
                inputs.clear();
                for input in program.inputs() {
                    let at = |side| match side {
                        Side::I => here,
                        Side::J => there,
                    };
                    inputs.push(match *input {
                        Input::Plane(plane, side) => blocks(&frame.plane(plane)[at(side)..]),
                        Input::PerPixel(k, side) => {
                            blocks(&frame.per_pixel[k as usize][at(side)..])
                        }
                        Input::Signal(k, side) => blocks(&frame.signals[k as usize][at(side)..]),
                        Input::PerTap(k) => Arg::Splat(self.taps.values[tap + k as usize]),
                        Input::Offset(_) | Input::Constant(_) => {
                            unreachable!("they are read through the tap tape")
                        }
                    });
                }
                tap += per_tap;
                program.run(&inputs, slots, chunks);
                let weight = |k| program.result(k, &inputs, slots);
                pair.add_tap(frame, weight, there, partial.chunks_mut().chunks_exact_mut(chunks));
                if pair.mirrored {
                    // The padding of a row of what is owed is that of the planes.
                    let column = there - y * layout.stride();
                    let owed = self.owed[index * results * layout.stride()..]
                        .chunks_exact_mut(layout.stride())
                        .map(|row| row[column..][..chunks * LANES].as_chunks_mut().0);
                    pair.add_tap(frame, |k| weight(pair.summed.weights + k), here, owed);
                }
            }
            for (result, partial) in partial.chunks().chunks_exact(chunks).enumerate() {
                let sums = self.sums[result * self.stride..].as_chunks_mut::<LANES>().0;
                for (sum, partial) in sums.iter_mut().zip(partial) {
                    for lane in 0..LANES {
                        sum[lane] += partial[lane];
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn blocks(samples: &[f32]) -> Arg<'_> {
    Arg::Block(samples.as_chunks().0)
}
