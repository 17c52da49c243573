//! The interpreter: the reference that every other back end is compared with.

use super::block::{
    Arg, BLOCK, Block as Sums, LANES, Program, Slots, accumulate, accumulate_magnitude,
};
use super::cpu::{CHANNELS, Frame, Rates, SumShape, Summer};
use super::{Agreement, Backend, BackendError, Executable, Filtered, Rect};
use crate::expr::tape::{Input, Side};
use crate::plan::Plan;
use crate::scene::Scene;

/// Interprets tapes over blocks of pixels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Interpreter;

struct Interpreted {
    plan: Plan,
    rates: Rates,
    pair: Pair,
}

/// The pair tape, ready to run.
struct Pair {
    program: Program,
    signed: bool,
}

#[derive(Default)]
struct Scratch {
    slots: Slots,
    /// The sums of the current row of the window.
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
        let pair = Pair { program: Program::new(plan.pair()), signed: plan.signed() };
        Ok(Box::new(Interpreted { plan: plan.clone(), rates: Rates::new(plan), pair }))
    }
}

impl Executable for Interpreted {
    fn run(&self, scene: &Scene, region: &[Rect]) -> Result<Vec<Filtered>, BackendError> {
        self.rates.run(&self.plan, &self.pair, scene, region)
    }
}

impl Summer for Pair {
    type Scratch = Scratch;

    fn sums(
        &self,
        frame: &Frame<'_>,
        strip: Rect,
        scratch: &mut Scratch,
        out: &mut Vec<f32>,
    ) -> Result<SumShape, BackendError> {
        let results = self.program.results() * (CHANNELS + usize::from(self.signed));
        let stride = strip.width.next_multiple_of(LANES);
        out.clear();
        out.resize(strip.height * results * stride, 0.0);
        // Wide strips are cut into equal blocks rather than full ones and a rest.
        let chunks = stride / LANES;
        let block = chunks.div_ceil(chunks.div_ceil(BLOCK));
        for row in 0..strip.height {
            for first in (0..chunks).step_by(block) {
                pulp::Arch::new().dispatch(Block {
                    pair: self,
                    frame,
                    x: strip.x + first * LANES,
                    y: strip.y + row,
                    chunks: block.min(chunks - first),
                    scratch,
                    sums: &mut out[row * results * stride + first * LANES..],
                    stride,
                });
            }
        }
        Ok(SumShape { results, stride })
    }
}

/// The sums of a run of pixels within a row; a type and not a closure for the
/// reason given in `cpu`.
struct Block<'a> {
    pair: &'a Pair,
    frame: &'a Frame<'a>,
    x: usize,
    y: usize,
    chunks: usize,
    scratch: &'a mut Scratch,
    /// Where the sums of the first result begin; the others' follow `stride`
    /// apart.
    sums: &'a mut [f32],
    stride: usize,
}

impl pulp::WithSimd for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { pair, frame, chunks, .. } = self;
        let Scratch { slots, partial } = self.scratch;
        let program = &pair.program;
        let weights = program.results();
        let results = weights * (CHANNELS + usize::from(pair.signed));
        let radius = frame.window.radius as usize;
        let dilation = frame.window.dilation as usize;
        let here = frame.layout.index(self.x, self.y);
        let mut inputs: Vec<Arg<'_>> = Vec::with_capacity(program.inputs().len());
        for v in 0..frame.window.diameter() {
            let Some(y) = (self.y + v * dilation).checked_sub(radius * dilation) else { continue };
            if y >= frame.layout.height() {
                break;
            }
            partial.resize(results * chunks);
            partial.chunks_mut().fill([0.0; LANES]);
            for u in 0..frame.window.diameter() {
                let there = frame.layout.index(self.x, y) + u * dilation - radius * dilation;
                let tap = (v * frame.window.diameter() + u) * frame.taps;
                inputs.clear();
                for input in program.inputs() {
                    inputs.push(match *input {
                        Input::Plane(plane, Side::I) => blocks(&frame.plane(plane)[here..]),
                        Input::Plane(plane, Side::J) => blocks(&frame.plane(plane)[there..]),
                        Input::PerPixel(k) => blocks(&frame.per_pixel[k as usize][here..]),
                        Input::PerTap(k) => Arg::Splat(frame.per_tap[tap + k as usize]),
                        Input::Offset(_) => unreachable!("offsets are read through the tap tape"),
                    });
                }
                program.run(&inputs, slots, chunks);
                let mut partial = partial.chunks_mut().chunks_exact_mut(chunks);
                for weight in 0..weights {
                    let w = program.result(weight, &inputs, slots);
                    for channel in frame.channels {
                        let sums = partial.next().expect("one run of sums per result");
                        accumulate(w, channel[there..].as_chunks().0, sums);
                    }
                    if pair.signed {
                        let one = frame.channels[CHANNELS - 1];
                        let sums = partial.next().expect("one run of sums per result");
                        accumulate_magnitude(w, one[there..].as_chunks().0, sums);
                    }
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
