//! Runs programs on the CPU: one executor walks the kernels, whatever code they are in.
//!
//! The image is cut into strips of rows, which are handed to threads. A strip is computed
//! in waves of some rows: in each, every kernel goes on as far as the next ones need it,
//! so that what was just written is read while it is still near the processor. A plane is
//! kept as a band of rows: those that a kernel still looks at, and those of the wave. So
//! memory does not grow with the image's height. A pixel's value depends on nothing but
//! its surroundings, so that strips, waves and threads change no bit.
//!
//! Rows lie like those of the scene's planes, so that one layout serves for both.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use super::band::Band;
use super::paper::per_tap;
use super::rows::{Add, Double, Halve, Mean, Trust};
use super::sums::{self, Frame, Owed, Summer, Sums};
use crate::backend::{BackendError, Executable, Filtered, Rect, Watch, holds, inside};
use crate::expr::Feature;
use crate::expr::feature::PlaneId;
use crate::expr::symbol::{Source, StagePlane};
use crate::filter::Grid;
use crate::plan::{
    BoxKernel, Edges, GatherKernel, Kernel, MapKernel, Output, PairLoop, Program, Read,
    ResampleKernel, SumKernel,
};
use crate::scene::plane::{Layout, Plane};
use crate::scene::{ColorScale, Scene};

/// Rows of a wave: enough that what kernels do per wave costs little, few enough that the
/// bands of a kernel stay near the processor.
const WAVE: usize = 8;

/// Results that a kernel makes before they are stored: so many as stay near the processor.
const RESULTS: usize = 1 << 15;

/// Strips are not made shorter than this: each also computes rows around it.
const SHORTEST: usize = 64;

/// Makes code of kernels.
pub(super) trait Engine {
    /// A map's code.
    type Map: Mapper;
    /// A gather's code.
    type Gather: Summer;

    /// Makes a map's code.
    fn map(&self, kernel: &MapKernel) -> Result<Self::Map, BackendError>;

    /// Makes the code of a loop over pairs.
    fn pairs(&self, pairs: &PairLoop, summed: Summed) -> Result<Self::Gather, BackendError>;
}

/// What a loop over pairs sums.
#[derive(Clone, Copy)]
pub(super) struct Summed {
    /// What is multiplied by weights, the constant one among them.
    pub(super) channels: usize,
    /// Results of the pair tape, by one end of the pair.
    pub(super) weights: usize,
    /// Whether magnitudes of weights are summed, too.
    pub(super) signed: bool,
    /// Whether the last weight and the last channel are summed with each other alone.
    pub(super) lone: bool,
}

impl Summed {
    fn by_gather(kernel: &GatherKernel) -> Self {
        let lone = kernel.variance.is_some();
        let more = usize::from(lone);
        let (channels, weights) = (kernel.channels.len() + more + 1, 1 + more);
        Self { channels, weights, signed: kernel.signed, lone }
    }

    /// Everything that the pair tape computes, times one.
    fn by_sum(kernel: &SumKernel) -> Self {
        Self { channels: 1, weights: kernel.writes.len(), signed: false, lone: false }
    }

    /// Sums per pixel.
    pub(super) fn results(self) -> usize {
        let lone = usize::from(self.lone);
        (self.weights - lone) * (self.channels - lone + usize::from(self.signed)) + lone
    }
}

/// Rows that a map computes.
#[derive(Clone, Copy)]
pub(super) struct MapBlock {
    /// How the rows of the inputs lie.
    pub(super) layout: Layout,
    /// How many there are.
    pub(super) rows: usize,
    /// Where a row's first pixel stands; at the start if there is one row.
    pub(super) pad: usize,
}

/// Computes a map.
pub(super) trait Mapper: Send + Sync {
    /// Memory that a thread keeps from one block to the next.
    type Scratch: Default + Send;

    /// Pixels that it handles at a time: rows of results are whole multiples of it.
    fn step(&self) -> usize;

    /// Computes rows of pixels. `inputs` has the rows of a plane that is 1 everywhere, and
    /// then of every plane that is read; `uniform` is what the uniform tape gave. `outputs`,
    /// zero before, is given row after row, and of each result after result.
    fn rows(
        &self,
        inputs: &[&[f32]],
        uniform: &[f32],
        block: MapBlock,
        scratch: &mut Self::Scratch,
        outputs: &mut [f32],
    ) -> Result<(), BackendError>;
}

enum Code<E: Engine> {
    Map(E::Map),
    Pairs(E::Gather, Sums),
    /// One way for all back ends.
    Own,
}

/// What a kernel computes before its first pixel: once, or per tap.
struct Table {
    tape: super::block::Program,
    offsets: Vec<[i32; 2]>,
}

impl Table {
    fn of(kernel: &Kernel) -> Option<Self> {
        let (tape, offsets) = match kernel {
            Kernel::Map(map) => (&map.uniform, vec![[0, 0]]),
            Kernel::Gather(GatherKernel { pairs, .. }) | Kernel::Sum(SumKernel { pairs, .. }) => {
                (&pairs.tap, pairs.runs.iter().flat_map(|run| run.offsets()).collect())
            }
            Kernel::Box(_) | Kernel::Resample(_) | Kernel::Transpose(_) | Kernel::Given(_) => {
                return None;
            }
        };
        Some(Self { tape: super::block::Program::new(tape), offsets })
    }
}

/// Who reads a plane.
struct Reader {
    /// Which kernel; `None` for who takes the result.
    kernel: Option<usize>,
    /// How many rows further up than its own it looks.
    above: usize,
}

/// A program in executable form.
pub(super) struct ProgramCode<E: Engine> {
    pub(super) program: Program,
    codes: Vec<Code<E>>,
    /// By kernel.
    tables: Vec<Option<Table>>,
    /// What the tables hold for the filter's own constants.
    values: Vec<Vec<f32>>,
    /// Where a plane stands among a strip's.
    places: BTreeMap<StagePlane, usize>,
    /// By place: the kernel that writes the plane, and those that read it.
    traffic: Vec<(usize, Vec<Reader>)>,
}

impl<E: Engine> ProgramCode<E> {
    pub(super) fn new(engine: &E, program: &Program) -> Result<Self, BackendError> {
        let codes = program.kernels.iter().map(|kernel| {
            Ok(match kernel {
                Kernel::Map(map) => Code::Map(engine.map(map)?),
                Kernel::Gather(kernel) => {
                    let summed = Summed::by_gather(kernel);
                    let code = engine.pairs(&kernel.pairs, summed)?;
                    Code::Pairs(code, Sums::of_pairs(&kernel.pairs, summed.results()))
                }
                Kernel::Sum(kernel) => {
                    let summed = Summed::by_sum(kernel);
                    let code = engine.pairs(&kernel.pairs, summed)?;
                    Code::Pairs(code, Sums::of_pairs(&kernel.pairs, summed.results()))
                }
                Kernel::Box(_) | Kernel::Resample(_) | Kernel::Transpose(_) | Kernel::Given(_) => {
                    Code::Own
                }
            })
        });
        let codes = codes.collect::<Result<_, BackendError>>()?;
        let places: BTreeMap<StagePlane, usize> =
            program.buffers.keys().enumerate().map(|(k, &plane)| (plane, k)).collect();
        let mut traffic: Vec<(usize, Vec<Reader>)> =
            places.iter().map(|_| (0, Vec::new())).collect();
        for (k, kernel) in program.kernels.iter().enumerate() {
            for plane in kernel.writes() {
                traffic[places[&plane]].0 = k;
            }
            for look in kernel.looks() {
                let reader = Reader { kernel: Some(k), above: look.above };
                traffic[places[&look.plane]].1.push(reader);
            }
        }
        for output in program.output {
            if let Output::Plane(plane) = output {
                traffic[places[&plane]].1.push(Reader { kernel: None, above: 0 });
            }
        }
        let tables: Vec<Option<Table>> = program.kernels.iter().map(Table::of).collect();
        let values = Vec::new();
        let mut code = Self { program: program.clone(), codes, tables, values, places, traffic };
        code.values = code.values(&program.filter.constants.values());
        Ok(code)
    }

    /// Checks that a scene is what the program was made for.
    pub(super) fn accepts(&self, scene: &Scene) -> Result<(), BackendError> {
        holds(&self.program.facts, scene)?;
        if scene.normalization().color_scale != ColorScale::Linear {
            return Err(BackendError::ColorScale);
        }
        let (reach, pad) = (self.program.reach, scene.layout().pad());
        if reach > pad {
            return Err(BackendError::Padding { reach, pad });
        }
        Ok(())
    }

    /// What kernels compute before their first pixels, with these values of the constants.
    pub(super) fn values(&self, constants: &[f32]) -> Vec<Vec<f32>> {
        let values = self.tables.iter().map(|table| match table {
            Some(Table { tape, offsets }) => per_tap(tape, offsets, constants),
            None => Vec::new(),
        });
        values.collect()
    }

    /// The bands of all planes of an image, each on its grid.
    pub(super) fn bands(&self, layout: Layout) -> Vec<Band> {
        let band = |(plane, edges): (&StagePlane, &Edges)| {
            let (writer, _) = self.traffic[self.place(*plane)];
            Band::new(on_grid(layout, self.program.kernels[writer].grid()), *edges)
        };
        self.program.buffers.iter().map(band).collect()
    }
}

/// What a thread keeps from one strip to the next.
pub(super) struct Scratch<E: Engine> {
    maps: <E::Map as Mapper>::Scratch,
    gathers: sums::Scratch<<E::Gather as Summer>::Scratch>,
    outputs: Vec<f32>,
}

impl<E: Engine> Default for Scratch<E> {
    fn default() -> Self {
        Self { maps: Default::default(), gathers: Default::default(), outputs: Vec::new() }
    }
}

/// A strip under way.
pub(super) struct Strip<'a> {
    scene: &'a Scene,
    /// The part of the image that is filtered.
    rect: Rect,
    pub(super) bands: Vec<Band>,
    /// One everywhere, zero beside the image, on the full grid and on the half one.
    ones: [Band; 2],
    /// By kernel: what its rows owe to those below.
    owed: Vec<Owed>,
    /// Pixels whose weights could not be trusted, by stage.
    kept: Vec<usize>,
}

impl<'a> Strip<'a> {
    pub(super) fn new<E: Engine>(
        code: &ProgramCode<E>,
        scene: &'a Scene,
        rect: Rect,
        bands: Vec<Band>,
    ) -> Self {
        let zero = Edges { repeated: false, zero: true };
        let layout = scene.layout();
        Self {
            scene,
            rect,
            bands,
            ones: [Grid::Full, Grid::Half].map(|grid| Band::new(on_grid(layout, grid), zero)),
            owed: code.program.kernels.iter().map(|_| Owed::default()).collect(),
            kept: vec![0; code.program.filter.stages.len()],
        }
    }
}

impl Strip<'_> {
    /// How the rows of a grid lie.
    pub(super) fn layout(&self, grid: Grid) -> Layout {
        self.ones[usize::from(grid == Grid::Half)].layout
    }

    /// Rows of ones, as many as were made.
    fn ones(&self, grid: Grid) -> &[f32] {
        let ones = &self.ones[usize::from(grid == Grid::Half)];
        &ones.averaged()[ones.start(0)..]
    }

    /// Makes so many rows of ones, unless they are there.
    fn make_ones(&mut self, grid: Grid, rows: usize) {
        let ones = &mut self.ones[usize::from(grid == Grid::Half)];
        if rows > ones.room {
            ones.hold(0..rows);
            let row = vec![1.0; ones.layout.width()];
            (0..ones.room).for_each(|y| ones.write(y, &row));
        }
    }
}

/// How planes of a grid lie.
fn on_grid(layout: Layout, grid: Grid) -> Layout {
    match grid {
        Grid::Full => layout,
        Grid::Half => {
            Layout::new(grid.along(layout.width()), grid.along(layout.height()), layout.pad())
        }
    }
}

impl<E: Engine> Executable for ProgramCode<E>
where
    E::Map: Send + Sync,
    E::Gather: Send + Sync,
{
    fn run(&self, scene: &Scene, region: &[Rect]) -> Result<Vec<Filtered>, BackendError> {
        self.run_watched(scene, region, &|_| {})
    }

    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        self.accepts(scene)?;
        inside(scene, region)?;
        let threads = rayon::current_num_threads();
        let strips = region.iter().filter(|rect| rect.width > 0).flat_map(|&rect| {
            let height = rect.height.div_ceil(threads).max(SHORTEST);
            (0..rect.height).step_by(height).map(move |y| Rect {
                y: rect.y + y,
                height: height.min(rect.height - y),
                ..rect
            })
        });
        let strips: Vec<Rect> = strips.collect();
        let mut pixels = vec![[0.0; 3]; strips.iter().map(Rect::pixels).sum()];
        let mut rest = pixels.as_mut_slice();
        let parts = strips.iter().map(|rect| {
            let (part, after) = std::mem::take(&mut rest).split_at_mut(rect.pixels());
            rest = after;
            (*rect, part)
        });
        let parts: Vec<(Rect, &mut [[f32; 3]])> = parts.collect();
        let kept = parts
            .into_par_iter()
            .map_init(Scratch::<E>::default, |scratch, (rect, pixels)| {
                self.strip(scene, rect, pixels, scratch, watch)
            })
            .collect::<Result<Vec<Vec<usize>>, BackendError>>()?;
        let stages = 0..self.program.filter.stages.len();
        let kept = stages.map(|k| kept.iter().map(|strip| strip[k]).sum()).collect();
        Ok(vec![Filtered { pixels, kept }])
    }
}

impl<E: Engine> ProgramCode<E> {
    fn strip(
        &self,
        scene: &Scene,
        rect: Rect,
        mut pixels: &mut [[f32; 3]],
        scratch: &mut Scratch<E>,
        watch: &Watch<'_>,
    ) -> Result<Vec<usize>, BackendError> {
        let (layout, program) = (scene.layout(), &self.program);
        let height = layout.height();
        let rows = rect.y..rect.y + rect.height;
        let mut strip = Strip::new(self, scene, rect, self.bands(layout));
        let first = program.needed(rows.start..rows.start + 1, height);
        let mut done: Vec<usize> = first.into_iter().map(|rows| rows.start).collect();
        for top in rows.clone().step_by(WAVE) {
            let bottom = (top + WAVE).min(rows.end);
            let needed = program.needed(rows.start..bottom, height);
            for (band, (writer, readers)) in strip.bands.iter_mut().zip(&self.traffic) {
                let first = readers.iter().map(|reader| match reader.kernel {
                    None => top,
                    Some(k) => {
                        let rows = done[k]..needed[k].end.max(done[k]);
                        let stands = program.kernels[k].stands(rows, height);
                        stands.start.saturating_sub(reader.above)
                    }
                });
                // A wave may need no further row of a plane of half the resolution.
                let end = needed[*writer].end.max(done[*writer]);
                let first = first.min().unwrap_or(end).min(done[*writer]);
                band.hold(first..end.max(first + 1));
            }
            for k in 0..program.kernels.len() {
                let part = done[k]..needed[k].end;
                if !part.is_empty() {
                    done[k] = part.end;
                    self.rows(k, &self.values[k], part, &mut strip, scratch)?;
                }
            }
            let (wave, rest) = pixels.split_at_mut((bottom - top) * rect.width);
            pixels = rest;
            self.take(&strip, Rect { y: top, height: bottom - top, ..rect }, wave);
            watch(bottom - top);
        }
        Ok(strip.kept)
    }

    pub(super) fn place(&self, plane: StagePlane) -> usize {
        self.places[&plane]
    }

    /// Computes rows of a kernel, of which those that it reads are there. `values` is what it
    /// computed before its first pixel.
    pub(super) fn rows(
        &self,
        k: usize,
        values: &[f32],
        rows: Range<usize>,
        strip: &mut Strip<'_>,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        match (&self.program.kernels[k], &self.codes[k]) {
            (Kernel::Map(kernel), Code::Map(code)) => {
                self.map(kernel, (code, values), rows, strip, scratch)?;
            }
            (kernel @ (Kernel::Gather(_) | Kernel::Sum(_)), Code::Pairs(code, sums)) => {
                let mut owed = std::mem::take(&mut strip.owed[k]);
                let code = (code, sums, values);
                let width = strip.layout(kernel.grid()).width();
                let most = (RESULTS / (sums.results() * width)).max(1);
                for y in rows.clone().step_by(most) {
                    let rows = y..(y + most).min(rows.end);
                    match kernel {
                        Kernel::Gather(gather) => {
                            self.gather(gather, code, rows, strip, &mut owed, scratch)?;
                        }
                        Kernel::Sum(sum) => self.sum(sum, code, rows, strip, &mut owed, scratch)?,
                        _ => unreachable!("it is one of the two"),
                    }
                }
                strip.owed[k] = owed;
            }
            (Kernel::Box(kernel), _) => self.mean(kernel, rows, strip),
            (Kernel::Resample(kernel), _) => self.resample(kernel, rows, strip),
            (Kernel::Transpose(kernel), _) => self.transpose(kernel, strip),
            (Kernel::Given(_), _) => {}
            (Kernel::Map(_) | Kernel::Gather(_) | Kernel::Sum(_), _) => {
                unreachable!("codes stand in the order of their kernels")
            }
        }
        Ok(())
    }

    fn map(
        &self,
        kernel: &MapKernel,
        (code, uniform): (&E::Map, &[f32]),
        rows: Range<usize>,
        strip: &mut Strip<'_>,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        let layout = strip.layout(kernel.grid);
        let (width, stride, pad) = (layout.width(), layout.stride(), layout.pad());
        strip.make_ones(kernel.grid, rows.len());
        // Planes that are one number everywhere have no rows.
        let flat: Vec<Option<Vec<f32>>> = kernel
            .reads
            .iter()
            .map(|read| match read.source {
                Source::Feature(id) => match strip.scene.plane(id) {
                    Some(Plane::Constant(x)) => Some(vec![*x; stride * rows.len()]),
                    Some(Plane::Samples(_)) | None => None,
                },
                Source::Stage(_) => None,
            })
            .collect();
        // Rows whose surroundings lie inside of the image are computed in one go; what
        // stands beside the first pixel of all, or the last, is in no row.
        let shifts = || kernel.reads.iter().map(|read| read.shift);
        let beside = usize::from(shifts().any(|[dx, _]| dx != 0));
        let [above, below] = [-1, 1].map(|sign| {
            let far = shifts().map(|[_, dy]| (sign * i32::from(dy)).max(0)).max();
            far.unwrap_or(0) as usize
        });
        let middle = above + beside..layout.height().saturating_sub(below + beside);
        let results = width.next_multiple_of(code.step());
        let most = (RESULTS / (kernel.writes.len() * results)).max(1);
        let mut y = rows.start;
        while y < rows.end {
            let count = match middle.contains(&y) {
                true => (middle.end.min(rows.end) - y).min(most),
                false => 1,
            };
            // A single row begins with its first pixel, several with their padding: a plane
            // may end with the last one's.
            let skipped = if count == 1 { pad } else { 0 };
            let inputs = kernel.reads.iter().zip(&flat).map(|(read, flat)| {
                let Read { source, shift: [dx, dy] } = *read;
                let row = y.saturating_add_signed(dy.into()).min(layout.height() - 1);
                let beside = |start: usize| (start + skipped).wrapping_add_signed(dx.into());
                match (source, flat) {
                    (_, Some(flat)) => flat.as_slice(),
                    (Source::Feature(id), None) => {
                        let Some(Plane::Samples(samples)) = strip.scene.plane(id) else {
                            unreachable!("run() asked for every plane, and flat ones are apart")
                        };
                        &samples.as_slice()[beside(row * stride)..]
                    }
                    (Source::Stage(plane), None) => {
                        let band = &strip.bands[self.place(plane)];
                        &band.looked_at()[beside(band.start(row))..]
                    }
                }
            });
            let ones = &strip.ones(kernel.grid)[skipped..];
            let inputs: Vec<&[f32]> = std::iter::once(ones).chain(inputs).collect();
            let outputs = &mut scratch.outputs;
            outputs.clear();
            outputs.resize(count * kernel.writes.len() * results, 0.0);
            let block = MapBlock { layout, rows: count, pad: pad - skipped };
            code.rows(&inputs, uniform, block, &mut scratch.maps, outputs)?;
            let mut outputs = outputs.chunks_exact(results);
            for row in y..y + count {
                for (&plane, pixels) in kernel.writes.iter().zip(&mut outputs) {
                    strip.bands[self.place(plane)].write(row, &pixels[..width]);
                }
            }
            y += count;
        }
        Ok(())
    }

    fn gather(
        &self,
        kernel: &GatherKernel,
        (code, sums, per_tap): (&E::Gather, &Sums, &[f32]),
        rows: Range<usize>,
        strip: &mut Strip<'_>,
        owed: &mut Owed,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        let averaged = kernel.channels.iter().copied();
        let variance = kernel.variance.map(|(source, ..)| source);
        let (frame, rect) =
            self.frame(&kernel.pairs, kernel.grid, averaged, variance, &rows, strip)?;
        let width = rect.width;
        let shape = sums.add(code, &frame, per_tap, rect, Some(owed), &mut scratch.gathers)?;

        let results = sums.results();
        let made = scratch.gathers.sums();
        let count = kernel.channels.len();
        let step = kernel.grid.step();
        let mut means = vec![0.0f32; width];
        let mut trusted = vec![false; width];
        for y in rows.clone() {
            let result = |number: usize| {
                let start = ((y - rows.start) * results + number) * shape.stride + shape.first;
                &made[start..start + width]
            };
            let total = result(count);
            let magnitude = if kernel.signed { result(count + 1) } else { total };
            let trust = Trust { totals: total, magnitudes: magnitude, trusted: &mut trusted };
            pulp::Arch::new().dispatch(trust);
            let Rect { x, y: top, width, height } = strip.rect;
            if (top..top + height).contains(&(y * step)) {
                let columns = x.div_ceil(step)..(x + width).div_ceil(step);
                let untrusted = trusted[columns].iter().filter(|&&trusted| !trusted);
                strip.kept[kernel.stage] += untrusted.count();
            }
            let planes = kernel.channels.iter().zip(&kernel.writes).enumerate();
            let planes = planes.map(|(k, (&own, &(plane, range)))| (k, own, plane, range, false));
            let variance = kernel.variance.iter().map(|&(own, plane, range)| {
                (count + 1 + usize::from(kernel.signed), own, plane, range, true)
            });
            for (number, own, plane, range, squared) in planes.chain(variance) {
                let own = strip.bands[self.place(own)].pixels(y);
                let (sums, totals, trusted, means) =
                    (result(number), total, &trusted, &mut means[..]);
                let mean = Mean { sums, totals, squared, own, trusted, range, means };
                pulp::Arch::new().dispatch(mean);
                strip.bands[self.place(plane)].write(y, means);
            }
            if let Some(inverse) = kernel.inverse {
                for ((inverse, total), trusted) in means.iter_mut().zip(total).zip(&trusted) {
                    *inverse = if *trusted { 1.0 / total } else { 0.0 };
                }
                strip.bands[self.place(inverse)].write(y, &means);
            }
        }
        Ok(())
    }

    fn sum(
        &self,
        kernel: &SumKernel,
        (code, sums, per_tap): (&E::Gather, &Sums, &[f32]),
        rows: Range<usize>,
        strip: &mut Strip<'_>,
        owed: &mut Owed,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        let nothing = std::iter::empty();
        let (frame, rect) = self.frame(&kernel.pairs, kernel.grid, nothing, None, &rows, strip)?;
        let width = rect.width;
        let shape = sums.add(code, &frame, per_tap, rect, Some(owed), &mut scratch.gathers)?;
        let made = scratch.gathers.sums().chunks_exact(shape.stride);
        let ways = rows.flat_map(|y| kernel.writes.iter().map(move |&plane| (y, plane)));
        for ((y, plane), sums) in ways.zip(made) {
            strip.bands[self.place(plane)].write(y, &sums[shape.first..][..width]);
        }
        Ok(())
    }

    /// What a loop over pairs reads for some rows, and where those stand in it: the rows that
    /// its window reaches are an image of their own.
    fn frame<'f>(
        &self,
        pairs: &PairLoop,
        grid: Grid,
        averaged: impl Iterator<Item = StagePlane>,
        variance: Option<StagePlane>,
        rows: &Range<usize>,
        strip: &'f mut Strip<'_>,
    ) -> Result<(Frame<'f>, Rect), BackendError> {
        let whole = strip.layout(grid);
        let (width, stride) = (whole.width(), whole.stride());
        let top = rows.start.saturating_sub(pairs.reach);
        let layout = whole.with_height((rows.end + pairs.reach).min(whole.height()) - top);
        strip.make_ones(grid, layout.height());
        let strip: &'f Strip<'_> = strip;
        let window = top * stride..(top + layout.height()) * stride;
        let plane = |id: PlaneId| match strip.scene.plane(id) {
            Some(Plane::Samples(samples)) => {
                Ok((id, Cow::Borrowed(&samples.as_slice()[window.clone()])))
            }
            Some(Plane::Constant(x)) => Ok((id, Cow::Owned(vec![*x; layout.samples()]))),
            None => Err(BackendError::NotLoaded(id)),
        };
        let planes = pairs.planes().into_iter().map(plane).collect::<Result<_, _>>()?;
        let of_mean = |plane: StagePlane| {
            let band = &strip.bands[self.place(plane)];
            &band.averaged()[band.start(top)..]
        };
        let mut channels: Vec<&[f32]> = averaged.map(of_mean).collect();
        channels.push(strip.ones(grid));
        channels.extend(variance.map(of_mean));
        let signal = |&plane: &StagePlane| {
            let band = &strip.bands[self.place(plane)];
            &band.looked_at()[band.start(top)..]
        };
        let frame = Frame {
            layout,
            channels,
            planes,
            signals: pairs.reads.iter().map(signal).collect(),
            per_pixel: Vec::new(),
            per_tap: Vec::new(),
        };
        Ok((frame, Rect { x: 0, y: rows.start - top, width, height: rows.len() }))
    }

    fn mean(&self, kernel: &BoxKernel, rows: Range<usize>, strip: &mut Strip<'_>) {
        let layout = strip.layout(kernel.grid);
        let (width, height, pad) = (layout.width(), layout.height(), layout.pad());
        let (reach, step) = (kernel.window.reach() as usize, kernel.window.dilation as usize);
        let inside = |at: usize, end: usize| {
            let taps =
                (0..kernel.window.diameter()).map(move |k| (at + k * step).checked_sub(reach));
            taps.flatten().filter(move |&at| at < end)
        };
        let columns: Vec<f32> = (0..width).map(|x| inside(x, width).count() as f32).collect();
        let (mut sums, mut means) = (vec![0.0; width + 2 * reach], vec![0.0; width]);
        for y in rows {
            let count = inside(y, height).count() as f32;
            for (&channel, &(plane, range)) in kernel.channels.iter().zip(&kernel.writes) {
                let band = &strip.bands[self.place(channel)];
                sums.fill(0.0);
                for y in inside(y, height) {
                    let row = &band.averaged()[band.start(y) + pad - reach..];
                    pulp::Arch::new().dispatch(Add { to: &mut sums, from: row });
                }
                means.fill(0.0);
                for first in (0..kernel.window.diameter()).map(|k| k * step) {
                    pulp::Arch::new().dispatch(Add { to: &mut means, from: &sums[first..] });
                }
                for (mean, columns) in means.iter_mut().zip(&columns) {
                    *mean = (*mean / (columns * count)).clamp(range.lo, range.hi);
                }
                strip.bands[self.place(plane)].write(y, &means);
            }
        }
    }

    fn resample(&self, kernel: &ResampleKernel, rows: Range<usize>, strip: &mut Strip<'_>) {
        let layout = strip.layout(kernel.grid);
        let source = strip.layout(match kernel.grid {
            Grid::Full => Grid::Half,
            Grid::Half => Grid::Full,
        });
        let last = source.height() - 1;
        let mut pixels = vec![0.0f32; layout.width()];
        let mut between = vec![0.0f32; source.width() + 2];
        for y in rows {
            let row = |y: usize| match kernel.reads {
                Source::Stage(plane) => {
                    let band = &strip.bands[self.place(plane)];
                    Some(&band.looked_at()[band.start(y.min(last)) + source.pad() - 1..])
                }
                Source::Feature(id) => match strip.scene.plane(id) {
                    Some(Plane::Samples(samples)) => {
                        Some(&samples.as_slice()[source.index(0, y.min(last)) - 1..])
                    }
                    Some(Plane::Constant(_)) | None => None,
                },
            };
            match kernel.grid {
                Grid::Half => match kernel.reads {
                    // The middle of two pixels, also where there is one.
                    Source::Feature(PlaneId { feature: Feature::Pixel, component, .. }) => {
                        let y = strip.scene.top() / 2 + y;
                        for (x, pixel) in pixels.iter_mut().enumerate() {
                            *pixel = 2.0 * [x, y][usize::from(component)] as f32 + 0.5;
                        }
                    }
                    Source::Feature(id)
                        if matches!(strip.scene.plane(id), Some(Plane::Constant(_))) =>
                    {
                        let Some(&Plane::Constant(x)) = strip.scene.plane(id) else {
                            unreachable!()
                        };
                        pixels.fill(x);
                    }
                    Source::Feature(_) | Source::Stage(_) => {
                        let [upper, lower] = [2 * y, 2 * y + 1].map(|y| row(y).expect("samples"));
                        let (upper, lower, pixels) = (&upper[1..], &lower[1..], &mut pixels);
                        pulp::Arch::new().dispatch(Halve { upper, lower, pixels });
                    }
                },
                Grid::Full => {
                    // Pixels of half the resolution whose middles lie around this one's.
                    let nearest = y / 2;
                    let other = if y % 2 == 0 { nearest.saturating_sub(1) } else { nearest + 1 };
                    let [nearest, other] = [nearest, other].map(|y| row(y).expect("samples"));
                    let (between, pixels) = (&mut between, &mut pixels);
                    pulp::Arch::new().dispatch(Double { nearest, other, between, pixels });
                }
            }
            strip.bands[self.place(kernel.writes)].write(y, &pixels);
        }
    }

    /// Takes the colours of a wave, in the units of the file.
    fn take(&self, strip: &Strip<'_>, rect: Rect, pixels: &mut [[f32; 3]]) {
        let exposure = strip.scene.normalization().exposure;
        for (y, row) in (rect.y..).zip(pixels.chunks_exact_mut(rect.width)) {
            for (component, output) in self.program.output.into_iter().enumerate() {
                match output {
                    Output::Constant(x) => {
                        row.iter_mut().for_each(|pixel| pixel[component] = x * exposure);
                    }
                    Output::Plane(plane) => {
                        let samples = &strip.bands[self.place(plane)].pixels(y)[rect.x..];
                        let pixels = row.iter_mut().zip(samples);
                        pixels.for_each(|(pixel, x)| pixel[component] = x * exposure);
                    }
                }
            }
        }
    }
}
