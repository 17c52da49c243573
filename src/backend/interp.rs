//! The interpreter: the reference that every other back end is compared with.

use super::block::{Arg, BLOCK, Chunk, LANES, Program, Slots, accumulate, accumulate_magnitude};
use super::cpu::{CHANNELS, Frame, Rates, SumShape, Summer, vectorized};
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
    partial: Vec<Chunk>,
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
        vectorized(|| {
            for row in 0..strip.height {
                let sums = &mut out[row * results * stride..][..results * stride];
                for first in (0..chunks).step_by(block) {
                    let place = Place {
                        x: strip.x + first * LANES,
                        y: strip.y + row,
                        chunks: block.min(chunks - first),
                    };
                    self.block(frame, place, scratch, |result, partial| {
                        let start = result * stride + first * LANES;
                        let sums = sums[start..].as_chunks_mut::<LANES>().0;
                        for (sum, partial) in sums.iter_mut().zip(partial) {
                            for lane in 0..LANES {
                                sum[lane] += partial[lane];
                            }
                        }
                    });
                }
            }
        });
        Ok(SumShape { results, stride })
    }
}

/// A run of pixels within a row.
#[derive(Clone, Copy)]
struct Place {
    x: usize,
    y: usize,
    chunks: usize,
}

impl Pair {
    /// Sums over the window of every pixel of a block, handing the partial sums
    /// of each of the window's rows to `add`.
    #[inline(always)]
    fn block(
        &self,
        frame: &Frame<'_>,
        at: Place,
        scratch: &mut Scratch,
        mut add: impl FnMut(usize, &[Chunk]),
    ) {
        let weights = self.program.results();
        let results = weights * (CHANNELS + usize::from(self.signed));
        let radius = frame.window.radius as usize;
        let dilation = frame.window.dilation as usize;
        let here = frame.layout.index(at.x, at.y);
        let mut inputs: Vec<Arg<'_>> = Vec::with_capacity(self.program.inputs().len());
        for v in 0..frame.window.diameter() {
            let Some(y) = (at.y + v * dilation).checked_sub(radius * dilation) else { continue };
            if y >= frame.layout.height() {
                break;
            }
            scratch.partial.clear();
            scratch.partial.resize(results * at.chunks, [0.0; LANES]);
            for u in 0..frame.window.diameter() {
                let there = frame.layout.index(at.x, y) + u * dilation - radius * dilation;
                let tap = (v * frame.window.diameter() + u) * frame.taps;
                inputs.clear();
                inputs.extend(self.program.inputs().iter().map(|input| match *input {
                    Input::Plane(plane, Side::I) => blocks(&frame.plane(plane)[here..]),
                    Input::Plane(plane, Side::J) => blocks(&frame.plane(plane)[there..]),
                    Input::PerPixel(k) => blocks(&frame.per_pixel[k as usize][here..]),
                    Input::PerTap(k) => Arg::Splat(frame.per_tap[tap + k as usize]),
                    Input::Offset(_) => unreachable!("offsets are read through the tap tape"),
                }));
                self.program.run(&inputs, &mut scratch.slots, at.chunks);
                let mut partial = scratch.partial.chunks_exact_mut(at.chunks);
                for weight in 0..weights {
                    let w = self.program.result(weight, &inputs, &scratch.slots);
                    for channel in frame.channels {
                        let sums = partial.next().expect("one run of sums per result");
                        accumulate(w, channel[there..].as_chunks().0, sums);
                    }
                    if self.signed {
                        let one = frame.channels[CHANNELS - 1];
                        let sums = partial.next().expect("one run of sums per result");
                        accumulate_magnitude(w, one[there..].as_chunks().0, sums);
                    }
                }
            }
            for (result, partial) in scratch.partial.chunks_exact(at.chunks).enumerate() {
                add(result, partial);
            }
        }
    }
}

#[inline(always)]
fn blocks(samples: &[f32]) -> Arg<'_> {
    Arg::Block(samples.as_chunks().0)
}
