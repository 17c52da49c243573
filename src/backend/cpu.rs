//! What the CPU back ends share: inputs gathered, rows handed to threads, sums
//! turned into colours. They differ only in how the sums of a strip are made.

use rayon::prelude::*;

use super::block::{Arg, BLOCK, LANES, Program, Slots};
use super::{BackendError, Filtered, Rect, TRUSTED_SHARE, TRUSTED_SUM, color_at, inside};
use crate::expr::PlaneId;
use crate::expr::tape::{Axis, Input, Side};
use crate::plan::{Plan, Window};
use crate::scene::Scene;
use crate::scene::plane::{Layout, Plane, Samples};

/// Rows of a strip: enough work that handing it out costs nothing, few enough
/// that two cores are still both busy at the end of a small image.
const STRIP: usize = 4;

/// Channels that weights are multiplied with: R, G, B and the constant one.
pub(super) const CHANNELS: usize = 4;

/// The parts of a plan that run once per tap and once per pixel. Both CPU back
/// ends interpret them: they are a 441st of the work, and compiling them would
/// cost more than it saves.
pub(super) struct Rates {
    window: Window,
    tap: Program,
    pixel: Program,
    signed: bool,
}

/// How a strip's sums lie in their buffer: `results` runs of `stride` values
/// per row, of which the first `width` count.
#[derive(Clone, Copy)]
pub(super) struct SumShape {
    pub(super) results: usize,
    pub(super) stride: usize,
}

/// All that the pair tape reads.
pub(super) struct Frame<'a> {
    pub(super) layout: Layout,
    pub(super) window: Window,
    /// R, G, B, one: zero outside of the image.
    pub(super) channels: [&'a [f32]; CHANNELS],
    /// Sources of the planes that the pair tape reads, by plane.
    planes: Vec<(PlaneId, std::borrow::Cow<'a, [f32]>)>,
    /// The pixel tape's results, each a padded plane.
    pub(super) per_pixel: Vec<Vec<f32>>,
    /// The tap tape's results: those of the first tap, then of the second, …
    pub(super) per_tap: Vec<f32>,
    pub(super) taps: usize,
}

impl Frame<'_> {
    /// The padded samples of a plane.
    pub(super) fn plane(&self, plane: PlaneId) -> &[f32] {
        let found = self.planes.iter().find(|(id, _)| *id == plane);
        &found.expect("gather() took every plane of the plan").1
    }
}

/// Makes the sums of a strip.
pub(super) trait Summer: Sync {
    /// Memory that a thread keeps from one strip to the next.
    type Scratch: Default + Send;

    /// For every row of the strip, every weight and every channel: Σ w·channel;
    /// then, if the plan is signed, Σ |w|.
    fn sums(
        &self,
        frame: &Frame<'_>,
        strip: Rect,
        scratch: &mut Self::Scratch,
        out: &mut Vec<f32>,
    ) -> Result<SumShape, BackendError>;
}

impl Rates {
    pub(super) fn new(plan: &Plan) -> Self {
        Self {
            window: plan.window(),
            tap: Program::new(plan.tap()),
            pixel: Program::new(plan.pixel()),
            signed: plan.signed(),
        }
    }

    /// Runs a plan whose pair tape `summer` runs.
    pub(super) fn run(
        &self,
        plan: &Plan,
        summer: &impl Summer,
        scene: &Scene,
        region: &[Rect],
    ) -> Result<Vec<Filtered>, BackendError> {
        let strips = strips(scene, region)?;
        let frame = self.gather(plan, scene, &strips)?;
        let weights = plan.pair().results().len();
        let parts: Vec<Vec<Filtered>> = strips
            .par_iter()
            .map_init(Default::default, |(scratch, sums), &strip| {
                let shape = summer.sums(&frame, strip, scratch, sums)?;
                Ok((0..weights)
                    .map(|weight| self.resolve(scene, strip, weight, shape, sums))
                    .collect())
            })
            .collect::<Result<_, BackendError>>()?;
        let mut filtered = vec![Filtered::default(); weights];
        for part in parts {
            for (whole, part) in filtered.iter_mut().zip(part) {
                whole.pixels.extend(part.pixels);
                whole.kept += part.kept;
            }
        }
        Ok(filtered)
    }

    fn gather<'a>(
        &self,
        plan: &Plan,
        scene: &'a Scene,
        strips: &[Rect],
    ) -> Result<Frame<'a>, BackendError> {
        let layout = scene.layout();
        let reach = self.window.reach() as usize;
        if reach > layout.pad() {
            return Err(BackendError::Padding { reach, pad: layout.pad() });
        }
        let mut planes = Vec::new();
        for id in plan.planes() {
            let samples = match scene.plane(id) {
                None => return Err(BackendError::NotLoaded(id)),
                Some(Plane::Samples(samples)) => std::borrow::Cow::Borrowed(samples.as_slice()),
                // A plan for several scenes reads planes that are constant in
                // this one.
                Some(Plane::Constant(x)) => std::borrow::Cow::Owned(vec![*x; layout.samples()]),
            };
            planes.push((id, samples));
        }
        let mut frame = Frame {
            layout,
            window: self.window,
            channels: channels(scene),
            planes,
            per_pixel: Vec::new(),
            per_tap: self.per_tap(),
            taps: self.tap.results(),
        };
        frame.per_pixel = self.per_pixel(&frame, strips);
        Ok(frame)
    }

    /// Evaluates the tap tape on every offset of the window: the results of the
    /// first tap, then of the second, …
    pub(super) fn per_tap(&self) -> Vec<f32> {
        let (taps, values) = (self.window.taps(), self.tap.results());
        if values == 0 {
            return Vec::new();
        }
        let chunks = taps.div_ceil(LANES);
        let offset =
            |index: usize| index as f32 * self.window.dilation as f32 - self.window.reach() as f32;
        let coordinates = |along: fn(usize, usize) -> usize| -> Vec<f32> {
            let diameter = self.window.diameter();
            (0..chunks * LANES).map(|k| offset(along(k.min(taps - 1), diameter))).collect()
        };
        let x = coordinates(|k, diameter| k % diameter);
        let y = coordinates(|k, diameter| k / diameter);
        let inputs: Vec<Arg<'_>> = self
            .tap
            .inputs()
            .iter()
            .map(|input| match input {
                Input::Offset(Axis::X) => Arg::Block(x.as_chunks().0),
                Input::Offset(Axis::Y) => Arg::Block(y.as_chunks().0),
                Input::Plane(..) | Input::PerPixel(_) | Input::PerTap(_) => {
                    unreachable!("the tap tape reads offsets only")
                }
            })
            .collect();
        let mut slots = Slots::default();
        run(&self.tap, &inputs, &mut slots, chunks);
        let mut table = vec![0.0; taps * values];
        for value in 0..values {
            copy(self.tap.result(value, &inputs, &slots), taps, |k, x| {
                table[k * values + value] = x;
            });
        }
        table
    }

    /// Evaluates the pixel tape on the strips' pixels.
    fn per_pixel(&self, frame: &Frame<'_>, strips: &[Rect]) -> Vec<Vec<f32>> {
        let (layout, values) = (frame.layout, self.pixel.results());
        let mut planes = vec![vec![0.0; layout.samples()]; values];
        if values == 0 {
            return planes;
        }
        let blocks: Vec<(usize, usize, Vec<f32>)> = strips
            .par_iter()
            .flat_map_iter(|strip| {
                (strip.y..strip.y + strip.height).flat_map(move |y| {
                    (strip.x..strip.x + strip.width)
                        .step_by(BLOCK * LANES)
                        .map(move |x| (x, y, (strip.x + strip.width - x).min(BLOCK * LANES)))
                })
            })
            .map_init(Slots::default, |slots, (x, y, width)| {
                let chunks = width.div_ceil(LANES);
                let start = layout.index(x, y);
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
                        | Input::PerPixel(_)
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

    /// Turns sums into colours: Equation 1, guarded.
    fn resolve(
        &self,
        scene: &Scene,
        strip: Rect,
        weight: usize,
        shape: SumShape,
        sums: &[f32],
    ) -> Filtered {
        let per_weight = CHANNELS + usize::from(self.signed);
        let mut filtered = Filtered { pixels: Vec::with_capacity(strip.pixels()), kept: 0 };
        for row in 0..strip.height {
            let result = |channel: usize| {
                let index = row * shape.results + weight * per_weight + channel;
                &sums[index * shape.stride..][..strip.width]
            };
            let [r, g, b, total] = [0, 1, 2, 3].map(result);
            let magnitude = if self.signed { result(CHANNELS) } else { total };
            for k in 0..strip.width {
                let trusted = total[k].abs() >= TRUSTED_SUM.max(TRUSTED_SHARE * magnitude[k]);
                let mean = [r[k] / total[k], g[k] / total[k], b[k] / total[k]];
                if trusted && mean.iter().all(|x| x.is_finite()) {
                    filtered.pixels.push(mean);
                } else {
                    filtered.kept += 1;
                    filtered.pixels.push(color_at(scene, strip.x + k, strip.y + row));
                }
            }
        }
        filtered
    }
}

fn channels(scene: &Scene) -> [&[f32]; CHANNELS] {
    let [r, g, b] = scene.color();
    [r, g, b, scene.ones()].map(Samples::as_slice)
}

/// Cuts rectangles into strips of a few rows.
fn strips(scene: &Scene, region: &[Rect]) -> Result<Vec<Rect>, BackendError> {
    inside(scene, region)?;
    let mut strips = Vec::new();
    for &rect in region {
        if rect.width > 0 {
            strips.extend((0..rect.height).step_by(STRIP).map(|y| Rect {
                y: rect.y + y,
                height: STRIP.min(rect.height - y),
                ..rect
            }));
        }
    }
    Ok(strips)
}

/// Runs a program once, compiled for the host's vector units.
///
/// It takes a type of its own, not a closure: only a method can be told to be
/// inlined into the code that has those units enabled, and arithmetic that is
/// not is twenty times slower (`mul_add` is then a library call).
struct Run<'a> {
    program: &'a Program,
    inputs: &'a [Arg<'a>],
    slots: &'a mut Slots,
    chunks: usize,
}

impl pulp::WithSimd for Run<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.program.run(self.inputs, self.slots, self.chunks);
    }
}

fn run(program: &Program, inputs: &[Arg<'_>], slots: &mut Slots, chunks: usize) {
    pulp::Arch::new().dispatch(Run { program, inputs, slots, chunks });
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
