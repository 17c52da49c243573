//! What the CPU back ends share: inputs gathered, rows handed to threads, sums
//! turned into colours. They differ only in how the sums of a strip are made.

use std::borrow::Cow;

use rayon::prelude::*;

use super::block::{Arg, BLOCK, LANES, Program, Slots};
use super::sums::{Frame, Scratch, SumShape, Summer, Sums};
use super::uniform::Changes;
use crate::backend::{
    BackendError, Filtered, Rect, TRUSTED_SHARE, TRUSTED_SUM, Watch, color_at, holds, inside, tell,
};
use crate::expr::tape::{Axis, Input, Side};
use crate::plan::{Tapes, WindowPlan};
use crate::scene::Scene;
use crate::scene::plane::{Lines, Plane, Samples};

/// Rows of a strip: enough work that handing it out costs nothing, few enough
/// that two cores are still both busy at the end of a small image.
const STRIP: usize = 4;

/// Strips per thread of a mirrored plan, if there are others to balance the work with.
/// Such strips should be tall: each also computes what the rows above it owe to it.
const TALL_STRIPS: usize = 2;

/// Channels that weights are multiplied with: R, G, B and the constant one.
pub(super) const CHANNELS: usize = 4;

/// The tapes that CPU back ends run: the mirrored ones where there are any.
pub(super) fn tapes(plan: &WindowPlan) -> &Tapes {
    plan.mirrored().unwrap_or(plan.tapes())
}

/// The parts of a plan that run once per tap and once per pixel. Both CPU back
/// ends interpret them: they are a 441st of the work, and compiling them would
/// cost more than it saves.
pub(super) struct Rates {
    sums: Sums,
    tap: Program,
    pixel: Program,
    weights: usize,
    uniform: bool,
}

/// A part of a strip whose sums were made.
#[derive(Clone, Copy)]
struct Stretch<'a> {
    rect: Rect,
    strip: Rect,
    /// If pixels of uniform windows are to be left as they are: where they are.
    changes: Option<&'a Changes>,
}

impl Rates {
    pub(super) fn new(plan: &WindowPlan) -> Self {
        let tapes = tapes(plan);
        Self {
            sums: Sums::of_plan(plan),
            tap: Program::new(&tapes.tap),
            pixel: Program::new(&tapes.pixel),
            weights: plan.weights(),
            uniform: plan.skips_uniform(),
        }
    }

    /// Runs a plan whose pair tape `summer` runs.
    pub(super) fn run<S: Summer>(
        &self,
        plan: &WindowPlan,
        summer: &S,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        holds(plan.facts(), scene)?;
        inside(scene, region)?;
        let strips = self.strips(region);
        let frame = self.gather(plan, scene, &strips)?;
        let changes = if self.uniform { Changes::of(scene, self.sums.reach) } else { None };
        let parts: Vec<Vec<Filtered>> = strips
            .par_iter()
            .map_init(Scratch::<S::Scratch>::default, |scratch, &strip| {
                let noisy = Filtered { pixels: colors(scene, strip), kept: vec![0] };
                let mut filtered = vec![noisy; self.weights];
                let stretches = match &changes {
                    Some(changes) => changes.stretches(strip),
                    None => vec![strip],
                };
                for stretch in stretches {
                    let per_tap = &frame.per_tap;
                    let shape = self.sums.add(summer, &frame, per_tap, stretch, None, scratch)?;
                    let stretch = Stretch { rect: stretch, strip, changes: changes.as_ref() };
                    for (weight, filtered) in filtered.iter_mut().enumerate() {
                        self.resolve(stretch, weight, shape, scratch.sums(), filtered);
                    }
                }
                tell(watch, strip.height)?;
                Ok(filtered)
            })
            .collect::<Result<_, BackendError>>()?;
        let mut filtered = vec![Filtered { pixels: Vec::new(), kept: vec![0] }; self.weights];
        for part in parts {
            for (whole, part) in filtered.iter_mut().zip(part) {
                whole.pixels.extend(part.pixels);
                whole.kept[0] += part.kept[0];
            }
        }
        Ok(filtered)
    }

    fn gather<'a>(
        &self,
        plan: &WindowPlan,
        scene: &'a Scene,
        strips: &[Rect],
    ) -> Result<Frame<'a>, BackendError> {
        let layout = scene.layout();
        if self.sums.reach > layout.pad() {
            return Err(BackendError::Padding { reach: self.sums.reach, pad: layout.pad() });
        }
        let mut planes = Vec::new();
        for id in plan.planes() {
            let samples = match scene.plane(id) {
                None => return Err(BackendError::NotLoaded(id)),
                Some(Plane::Samples(samples)) => Cow::Borrowed(samples.as_slice()),
                // A plan for several scenes reads planes that are constant in
                // this one.
                Some(Plane::Constant(x)) => Cow::Owned(vec![*x; layout.samples()]),
            };
            planes.push((id, samples));
        }
        let offsets: Vec<[i32; 2]> = self.sums.runs.iter().flat_map(|run| run.offsets()).collect();
        let mut frame = Frame {
            layout,
            channels: channels(scene).to_vec(),
            planes,
            signals: Vec::new(),
            per_pixel: Vec::new(),
            per_tap: per_tap(&self.tap, &offsets, &[]),
        };
        frame.per_pixel = self.per_pixel(&frame, strips);
        Ok(frame)
    }

    /// Cuts rectangles into strips of rows, which are handed to threads.
    fn strips(&self, region: &[Rect]) -> Vec<Rect> {
        let mut strips = Vec::new();
        for &rect in region.iter().filter(|rect| rect.width > 0) {
            let height = match self.sums.mirrored {
                true => {
                    let parts = match rayon::current_num_threads() {
                        1 => 1,
                        threads => TALL_STRIPS * threads,
                    };
                    rect.height.div_ceil(parts).max(2 * self.sums.reach).max(STRIP)
                }
                false => STRIP,
            };
            strips.extend((0..rect.height).step_by(height).map(|y| Rect {
                y: rect.y + y,
                height: height.min(rect.height - y),
                ..rect
            }));
        }
        strips
    }

    /// Evaluates the pixel tape where the pair tape will read it: at the strips'
    /// pixels; for a mirrored plan on whole padded rows, those that reach the
    /// strips among them, because it reads it at pixel j too.
    fn per_pixel(&self, frame: &Frame<'_>, strips: &[Rect]) -> Vec<Lines> {
        let (layout, values) = (frame.layout, self.pixel.results());
        let mut planes: Vec<Lines> = (0..values).map(|_| Lines::zeros(layout.samples())).collect();
        if values == 0 {
            return planes;
        }
        let rows: Vec<(usize, usize)> = match self.sums.mirrored {
            true => {
                let mut read = vec![false; layout.height()];
                for strip in strips {
                    let bottom = (strip.y + strip.height + self.sums.reach).min(layout.height());
                    read[strip.y.saturating_sub(self.sums.reach)..bottom].fill(true);
                }
                let rows = read.iter().enumerate().filter(|&(_, &read)| read);
                rows.map(|(y, _)| (y * layout.stride(), layout.stride())).collect()
            }
            false => strips
                .iter()
                .flat_map(|strip| {
                    let rows = strip.y..strip.y + strip.height;
                    rows.map(|y| (layout.index(strip.x, y), strip.width))
                })
                .collect(),
        };
        let blocks: Vec<(usize, usize, Vec<f32>)> = rows
            .par_iter()
            .flat_map_iter(|&(start, length)| {
                let cut = (0..length).step_by(BLOCK * LANES);
                cut.map(move |at| (start + at, (length - at).min(BLOCK * LANES)))
            })
            .map_init(Slots::default, |slots, (start, width)| {
                let chunks = width.div_ceil(LANES);
                let inputs: Vec<Arg<'_>> = self
                    .pixel
                    .inputs()
                    .iter()
                    .map(|input| match *input {
                        Input::Plane(plane, Side::I) => {
                            Arg::Block(frame.plane(plane)[start..].as_chunks().0)
                        }
                        Input::Plane(_, Side::J)
                        | Input::Offset(_)
                        | Input::PerPixel(..)
                        | Input::Signal(..)
                        | Input::Constant(_)
                        | Input::PerTap(_) => {
                            unreachable!("the pixel tape reads planes at i only")
                        }
                    })
                    .collect();
                run(&self.pixel, &inputs, slots, chunks);
                let mut block = vec![0.0; values * width];
                for value in 0..values {
                    copy(self.pixel.result(value, &inputs, slots), width, |k, x| {
                        block[value * width + k] = x;
                    });
                }
                (start, width, block)
            })
            .collect();
        for (start, width, block) in blocks {
            for (plane, values) in planes.iter_mut().zip(block.chunks_exact(width)) {
                plane[start..start + width].copy_from_slice(values);
            }
        }
        planes
    }

    /// Turns the sums of a stretch into colours: Equation 1, guarded. `filtered`
    /// holds the noisy colours of the strip that it is a part of.
    fn resolve(
        &self,
        Stretch { rect, strip, changes }: Stretch<'_>,
        weight: usize,
        shape: SumShape,
        sums: &[f32],
        filtered: &mut Filtered,
    ) {
        let per_weight = self.sums.results / self.weights;
        let signed = per_weight > CHANNELS;
        for row in 0..rect.height {
            let result = |channel: usize| {
                let index = row * shape.results + weight * per_weight + channel;
                &sums[index * shape.stride + shape.first..][..rect.width]
            };
            let [r, g, b, total] = [0, 1, 2, 3].map(result);
            let magnitude = if signed { result(CHANNELS) } else { total };
            let uniform = |k: usize| {
                changes.is_some_and(|changes| changes.is_uniform(rect.x + k, rect.y + row))
            };
            let pixels = &mut filtered.pixels[row * strip.width + rect.x - strip.x..];
            for (k, pixel) in pixels[..rect.width].iter_mut().enumerate() {
                // Which pixels were computed beside others is nobody's business.
                if uniform(k) {
                    continue;
                }
                let trusted = total[k].abs() >= TRUSTED_SUM.max(TRUSTED_SHARE * magnitude[k]);
                let mean = [r[k] / total[k], g[k] / total[k], b[k] / total[k]];
                if trusted && mean.iter().all(|x| x.is_finite()) {
                    *pixel = mean;
                } else {
                    filtered.kept[0] += 1;
                }
            }
        }
    }
}

/// The noisy colours of a rectangle, row by row.
fn colors(scene: &Scene, rect: Rect) -> Vec<[f32; 3]> {
    let rows = rect.y..rect.y + rect.height;
    let pixels = rows.flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| (x, y)));
    pixels.map(|(x, y)| color_at(scene, x, y)).collect()
}

fn channels(scene: &Scene) -> [&[f32]; CHANNELS] {
    let [r, g, b] = scene.color();
    [r, g, b, scene.ones()].map(Samples::as_slice)
}

/// The tap tape's results for every offset of the support, row by row from the top,
/// left to right: those of the first tap, then of the second, …
#[cfg(feature = "gpu")]
pub(in crate::backend) fn dense_taps(plan: &WindowPlan) -> Vec<f32> {
    let window = plan.support();
    let along = || {
        let [radius, dilation] = [window.radius, window.dilation].map(|x| x as i32);
        (-radius..=radius).map(move |k| k * dilation)
    };
    let offsets: Vec<[i32; 2]> = along().flat_map(|dy| along().map(move |dx| [dx, dy])).collect();
    per_tap(&Program::new(plan.tap()), &offsets, &[])
}

/// Evaluates the tap tape on offsets: the results of the first tap, then of the
/// second, …
pub(super) fn per_tap(tape: &Program, offsets: &[[i32; 2]], constants: &[f32]) -> Vec<f32> {
    let (taps, values) = (offsets.len(), tape.results());
    if values == 0 || taps == 0 {
        return Vec::new();
    }
    let chunks = taps.div_ceil(LANES);
    let along = |axis: usize| -> Vec<f32> {
        (0..chunks * LANES).map(|k| offsets[k.min(taps - 1)][axis] as f32).collect()
    };
    let (x, y) = (along(0), along(1));
    let inputs: Vec<Arg<'_>> = tape
        .inputs()
        .iter()
        .map(|input| match input {
            Input::Offset(Axis::X) => Arg::Block(x.as_chunks().0),
            Input::Offset(Axis::Y) => Arg::Block(y.as_chunks().0),
            Input::Constant(k) => Arg::Splat(constants[*k as usize]),
            Input::Plane(..) | Input::PerPixel(..) | Input::PerTap(_) | Input::Signal(..) => {
                unreachable!("tap tapes read offsets and named constants alone")
            }
        })
        .collect();
    let mut slots = Slots::default();
    run(tape, &inputs, &mut slots, chunks);
    let mut table = vec![0.0; taps * values];
    for value in 0..values {
        copy(tape.result(value, &inputs, &slots), taps, |k, x| {
            table[k * values + value] = x;
        });
    }
    table
}

/// A run of a program, compiled for the host's vector units.
///
/// It takes a type of its own, not a closure: only a method can be told to be
/// inlined into the code that has those units enabled, and arithmetic that is
/// not is twenty times slower (`mul_add` is then a library call).
struct Dispatch<'a> {
    program: &'a Program,
    inputs: &'a [Arg<'a>],
    slots: &'a mut Slots,
    chunks: usize,
}

impl pulp::WithSimd for Dispatch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.program.run(self.inputs, self.slots, self.chunks);
    }
}

/// Runs a program on some chunks.
pub(super) fn run(program: &Program, inputs: &[Arg<'_>], slots: &mut Slots, chunks: usize) {
    pulp::Arch::new().dispatch(Dispatch { program, inputs, slots, chunks });
}

fn copy(from: Arg<'_>, count: usize, mut to: impl FnMut(usize, f32)) {
    for k in 0..count {
        to(
            k,
            match from {
                Arg::Block(block) => block[k / LANES][k % LANES],
                Arg::Splat(x) => x,
            },
        );
    }
}
