//! Runs programs on the CPU: one executor walks the kernels, whatever code they are in.
//!
//! The image is cut into strips of rows, which are handed to threads. A strip is computed
//! in waves of some rows: in each, every kernel goes on as far as the next ones need it,
//! so that what was just written is read while it is still near the processor. A pixel's
//! value depends on nothing but its surroundings, so that strips, waves and threads change
//! no bit.
//!
//! Planes of a strip lie like those of the scene, so that one layout serves for both: the
//! rows of the strip, as many rows above and below as the kernels look at, and no row that
//! the image does not have.

use std::borrow::Cow;
use std::collections::BTreeMap;

use rayon::prelude::*;

use super::cpu::{Frame, Sums, per_tap};
use super::{BackendError, Executable, Filtered, Rect, TRUSTED_SHARE, TRUSTED_SUM, holds, inside};
use crate::expr::tape::Input;
use crate::expr::tree::{Source, StagePlane};
use crate::plan::{Edges, GatherKernel, Kernel, MapKernel, Output, Program, Read};
use crate::scene::plane::{Layout, Lines, Plane};
use crate::scene::{ColorScale, Scene};

use super::cpu::Summer;

/// Rows of a wave: enough that what kernels do per wave costs nothing.
const WAVE: usize = 32;

/// Makes code of kernels.
pub(super) trait Engine {
    /// A map's code.
    type Map: Mapper;
    /// A gather's code.
    type Gather: Summer;

    /// Makes a map's code.
    fn map(&self, kernel: &MapKernel) -> Result<Self::Map, BackendError>;

    /// Makes a gather's code.
    fn gather(&self, kernel: &GatherKernel) -> Result<Self::Gather, BackendError>;
}

/// Computes a map.
pub(super) trait Mapper: Send + Sync {
    /// Memory that a thread keeps from one row to the next.
    type Scratch: Default + Send;

    /// Computes a row of pixels. Of every plane that is read, and of one that is 1
    /// everywhere, `inputs` has the row from its first pixel on, and slack behind the last.
    /// `outputs` is given result after result, `stride` values apart.
    fn row(
        &self,
        inputs: &[&[f32]],
        width: usize,
        scratch: &mut Self::Scratch,
        outputs: &mut Vec<f32>,
    ) -> Result<usize, BackendError>;
}

enum Code<E: Engine> {
    Map(E::Map),
    Gather { code: E::Gather, sums: Sums, per_tap: Vec<f32> },
}

/// A program in executable form.
pub(super) struct Compiled<E: Engine> {
    program: Program,
    codes: Vec<Code<E>>,
    /// Where a plane stands among a strip's.
    places: BTreeMap<StagePlane, usize>,
}

impl<E: Engine> Compiled<E> {
    pub(super) fn new(engine: &E, program: &Program) -> Result<Self, BackendError> {
        let codes = program.kernels.iter().map(|kernel| {
            Ok(match kernel {
                Kernel::Map(map) => Code::Map(engine.map(map)?),
                Kernel::Gather(gather) => {
                    let offsets: Vec<[i32; 2]> =
                        gather.runs.iter().flat_map(|run| run.offsets()).collect();
                    Code::Gather {
                        code: engine.gather(gather)?,
                        sums: Sums::of_kernel(gather),
                        per_tap: per_tap(&super::block::Program::new(&gather.tap), &offsets),
                    }
                }
            })
        });
        let codes = codes.collect::<Result<_, BackendError>>()?;
        let places = program.buffers.keys().enumerate().map(|(k, &plane)| (plane, k)).collect();
        Ok(Self { program: program.clone(), codes, places })
    }
}

/// A plane of a strip.
#[derive(Default)]
struct Stored {
    /// With the image's edge repeated beside it.
    repeated: Option<Lines>,
    /// With zeros beside it.
    zero: Option<Lines>,
}

impl Stored {
    /// Writes a row of pixels.
    fn write(&mut self, layout: Layout, row: usize, pixels: &[f32]) {
        let (start, pad) = (row * layout.stride(), layout.pad());
        if let Some(plane) = &mut self.repeated {
            let row = &mut plane[start..start + layout.stride()];
            row[..pad].fill(pixels[0]);
            row[pad..pad + pixels.len()].copy_from_slice(pixels);
            row[pad + pixels.len()..].fill(pixels[pixels.len() - 1]);
        }
        if let Some(plane) = &mut self.zero {
            plane[start + pad..][..pixels.len()].copy_from_slice(pixels);
        }
    }

    /// The samples, by whichever edges there are: pixels are the same.
    fn samples(&self) -> &[f32] {
        self.repeated.as_ref().or(self.zero.as_ref()).expect("a stored plane has samples")
    }

    /// The samples for whoever looks at them.
    fn looked_at(&self) -> &[f32] {
        self.repeated.as_ref().expect("the schedule says who looks at what")
    }

    /// The samples for whoever averages them.
    fn averaged(&self) -> &[f32] {
        self.zero.as_ref().expect("the schedule says who averages what")
    }
}

/// What a thread keeps from one strip to the next.
struct Scratch<E: Engine> {
    maps: <E::Map as Mapper>::Scratch,
    gathers: super::cpu::Scratch<<E::Gather as Summer>::Scratch>,
    outputs: Vec<f32>,
}

impl<E: Engine> Default for Scratch<E> {
    fn default() -> Self {
        Self { maps: Default::default(), gathers: Default::default(), outputs: Vec::new() }
    }
}

/// A strip under way.
struct Strip<'a> {
    scene: &'a Scene,
    /// The rows of the image that the result needs.
    rows: std::ops::Range<usize>,
    /// Which row of the image the planes' first row is.
    origin: usize,
    layout: Layout,
    planes: Vec<Stored>,
    kept: usize,
}

impl<E: Engine> Executable for Compiled<E>
where
    E::Map: Send + Sync,
    E::Gather: Send + Sync,
{
    fn run(&self, scene: &Scene, region: &[Rect]) -> Result<Vec<Filtered>, BackendError> {
        holds(&self.program.facts, scene)?;
        inside(scene, region)?;
        if scene.normalization().color_scale != ColorScale::Linear {
            return Err(BackendError::ColorScale);
        }
        let pad = scene.layout().pad();
        if self.program.reach > pad {
            return Err(BackendError::Padding { reach: self.program.reach, pad });
        }
        let threads = rayon::current_num_threads();
        let strips = region.iter().filter(|rect| rect.width > 0).flat_map(|&rect| {
            let height = rect.height.div_ceil(threads).max(WAVE);
            (0..rect.height).step_by(height).map(move |y| Rect {
                y: rect.y + y,
                height: height.min(rect.height - y),
                ..rect
            })
        });
        let strips: Vec<Rect> = strips.collect();
        let parts: Vec<Filtered> = strips
            .par_iter()
            .map_init(Scratch::<E>::default, |scratch, &rect| self.strip(scene, rect, scratch))
            .collect::<Result<_, BackendError>>()?;
        let mut whole = Filtered::default();
        for part in parts {
            whole.pixels.extend(part.pixels);
            whole.kept += part.kept;
        }
        Ok(vec![whole])
    }
}

impl<E: Engine> Compiled<E> {
    fn strip(
        &self,
        scene: &Scene,
        rect: Rect,
        scratch: &mut Scratch<E>,
    ) -> Result<Filtered, BackendError> {
        let (height, program) = (scene.layout().height(), &self.program);
        let halo = program.kernels.iter().map(Kernel::halo).max().unwrap_or(0);
        // A gather reads beyond the rows that it computes.
        let most = halo + program.reach;
        let origin = rect.y.saturating_sub(most);
        let end = (rect.y + rect.height + most).min(height);
        let layout = scene.layout().with_height(end - origin);
        let lines = |wanted: bool| wanted.then(|| Lines::zeros(layout.samples()));
        let plane = |&Edges { repeated, zero }: &Edges| {
            // What nobody looks at or averages is written all the same.
            let repeated = lines(repeated || !zero);
            Stored { repeated, zero: lines(zero) }
        };
        let planes = program.buffers.values().map(plane).collect();
        let rows = rect.y..rect.y + rect.height;
        let mut strip = Strip { scene, rows: rows.clone(), origin, layout, planes, kept: 0 };

        let mut done: Vec<usize> =
            program.kernels.iter().map(|kernel| rect.y.saturating_sub(kernel.halo())).collect();
        for wave in rows.clone().step_by(WAVE) {
            let bottom = (wave + WAVE).min(rows.end);
            for ((kernel, code), done) in program.kernels.iter().zip(&self.codes).zip(&mut done) {
                let next = (bottom + kernel.halo()).min(height);
                match (kernel, code) {
                    (Kernel::Map(kernel), Code::Map(code)) => {
                        self.map(kernel, code, *done..next, &mut strip, scratch)?;
                    }
                    (Kernel::Gather(kernel), Code::Gather { code, sums, per_tap }) => {
                        let part = *done..next;
                        self.gather(kernel, (code, sums, per_tap), part, &mut strip, scratch)?;
                    }
                    (Kernel::Map(_), Code::Gather { .. }) | (Kernel::Gather(_), Code::Map(_)) => {
                        unreachable!("codes stand in the order of their kernels")
                    }
                }
                *done = next;
            }
        }
        Ok(self.result(&strip, rect))
    }

    fn place(&self, plane: StagePlane) -> usize {
        self.places[&plane]
    }

    fn map(
        &self,
        kernel: &MapKernel,
        code: &E::Map,
        rows: std::ops::Range<usize>,
        strip: &mut Strip<'_>,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        let (layout, scene) = (strip.layout, strip.scene);
        let width = layout.width();
        // Planes that are one number everywhere have no rows.
        let flat: Vec<Option<Vec<f32>>> = kernel
            .reads
            .iter()
            .map(|read| match read.source {
                Source::Feature(id) => match scene.plane(id) {
                    Some(Plane::Constant(x)) => Some(vec![*x; layout.stride()]),
                    Some(Plane::Samples(_)) | None => None,
                },
                Source::Stage(_) => None,
            })
            .collect();
        for y in rows {
            let last = scene.layout().height() - 1;
            let row = |&Read { source, shift: [dx, dy] }: &Read, flat: &'_ Option<Vec<f32>>| {
                let row = y.saturating_add_signed(dy.into()).min(last);
                let start = |row: usize| {
                    (row * layout.stride() + layout.pad()).wrapping_add_signed(dx.into())
                };
                match (source, flat) {
                    (_, Some(_)) => None,
                    (Source::Feature(id), None) => {
                        let Some(Plane::Samples(samples)) = scene.plane(id) else {
                            unreachable!("run() asked for every plane, and flat ones are apart")
                        };
                        Some(&samples.as_slice()[start(row)..])
                    }
                    (Source::Stage(plane), None) => {
                        let place = self.place(plane);
                        Some(&strip.planes[place].looked_at()[start(row - strip.origin)..])
                    }
                }
            };
            let ones = &scene.ones().as_slice()[y * layout.stride() + layout.pad()..];
            let mut inputs: Vec<&[f32]> = Vec::with_capacity(kernel.reads.len() + 1);
            inputs.push(ones);
            for (read, flat) in kernel.reads.iter().zip(&flat) {
                inputs.push(match row(read, flat) {
                    Some(samples) => samples,
                    None => flat.as_deref().expect("what has no rows is flat"),
                });
            }
            let outputs = &mut scratch.outputs;
            let stride = code.row(&inputs, width, &mut scratch.maps, outputs)?;
            for (&plane, pixels) in kernel.writes.iter().zip(outputs.chunks_exact(stride)) {
                let place = self.place(plane);
                strip.planes[place].write(layout, y - strip.origin, &pixels[..width]);
            }
        }
        Ok(())
    }

    fn gather(
        &self,
        kernel: &GatherKernel,
        (code, sums, per_tap): (&E::Gather, &Sums, &[f32]),
        rows: std::ops::Range<usize>,
        strip: &mut Strip<'_>,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        let (layout, scene, origin) = (strip.layout, strip.scene, strip.origin);
        let width = layout.width();
        let window = origin * layout.stride()..(origin + layout.height()) * layout.stride();
        let features = kernel.pair.inputs().filter_map(|input| match input {
            Input::Plane(id, _) => Some(id),
            Input::Offset(_) | Input::PerPixel(..) | Input::PerTap(_) | Input::Signal(..) => None,
        });
        let mut planes: Vec<(crate::expr::PlaneId, Cow<'_, [f32]>)> = Vec::new();
        for id in features {
            if planes.iter().any(|(known, _)| *known == id) {
                continue;
            }
            planes.push((
                id,
                match scene.plane(id) {
                    Some(Plane::Samples(samples)) => {
                        Cow::Borrowed(&samples.as_slice()[window.clone()])
                    }
                    Some(Plane::Constant(x)) => Cow::Owned(vec![*x; layout.samples()]),
                    None => return Err(BackendError::NotLoaded(id)),
                },
            ));
        }
        let variance = kernel.variance.iter().map(|(source, ..)| source);
        let averaged = kernel.channels.iter().chain(variance);
        let averaged: Vec<usize> = averaged.map(|&plane| self.place(plane)).collect();
        let mut channels: Vec<&[f32]> =
            averaged.iter().map(|&place| strip.planes[place].averaged()).collect();
        channels.push(&scene.ones().as_slice()[window]);
        let signals = kernel.reads.iter().map(|&plane| strip.planes[self.place(plane)].looked_at());
        let frame = Frame {
            layout,
            channels,
            planes,
            signals: signals.collect(),
            per_pixel: Vec::new(),
            per_tap: Vec::new(),
        };
        let rect = Rect { x: 0, y: rows.start - origin, width, height: rows.len() };
        let shape = sums.add(code, &frame, per_tap, rect, &mut scratch.gathers)?;

        let results = sums.results();
        let made = scratch.gathers.sums();
        let count = kernel.channels.len();
        let per_weight = averaged.len() + 1 + usize::from(kernel.signed);
        let mut means = vec![vec![0.0f32; width]; count + 1];
        for row in 0..rect.height {
            let result = |number: usize| {
                let start = (row * results + number) * shape.stride + shape.first;
                &made[start..start + width]
            };
            let total = result(averaged.len());
            let magnitude = if kernel.signed { result(averaged.len() + 1) } else { total };
            let own = |channel: usize| {
                let samples = strip.planes[averaged[channel]].samples();
                &samples[layout.index(0, rect.y + row)..][..width]
            };
            let trusted = |k: usize| {
                let sum = total[k].abs();
                sum >= TRUSTED_SUM.max(TRUSTED_SHARE * magnitude[k]) && sum.is_finite()
            };
            for (channel, (_, range)) in kernel.writes.iter().enumerate() {
                let (sum, own) = (result(channel), own(channel));
                for (k, mean) in means[channel].iter_mut().enumerate() {
                    let value = sum[k] / total[k];
                    let kept = !trusted(k) || !value.is_finite();
                    *mean = if kept { own[k] } else { value.clamp(range.lo, range.hi) };
                }
            }
            if let Some((.., range)) = &kernel.variance {
                let (sum, own) = (result(per_weight + count), own(count));
                for (k, mean) in means[count].iter_mut().enumerate() {
                    let value = sum[k] / total[k] / total[k];
                    let kept = !trusted(k) || !value.is_finite();
                    *mean = if kept { own[k] } else { value.clamp(range.lo, range.hi) };
                }
            }
            if strip.rows.contains(&(origin + rect.y + row)) {
                strip.kept += (0..width).filter(|&k| !trusted(k)).count();
            }
            let variance = kernel.variance.iter().map(|&(_, plane, _)| plane);
            let targets = kernel.writes.iter().map(|&(plane, _)| plane).chain(variance);
            for (target, mean) in targets.zip(&means) {
                let place = self.place(target);
                strip.planes[place].write(layout, rect.y + row, mean);
            }
        }
        Ok(())
    }

    /// The colours of a strip, in the units of the file.
    fn result(&self, strip: &Strip<'_>, rect: Rect) -> Filtered {
        let exposure = strip.scene.normalization().exposure;
        let channels = self.program.output.map(|output| match output {
            Output::Constant(x) => Err(x),
            Output::Plane(plane) => Ok(strip.planes[self.place(plane)].samples()),
        });
        let mut pixels = Vec::with_capacity(rect.pixels());
        for y in rect.y..rect.y + rect.height {
            for x in rect.x..rect.x + rect.width {
                let at = strip.layout.index(x, y - strip.origin);
                pixels.push(channels.map(|channel| match channel {
                    Ok(samples) => samples[at] * exposure,
                    Err(x) => x * exposure,
                }));
            }
        }
        Filtered { pixels, kept: strip.kept }
    }
}
