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

mod kernels;

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use super::band::Band;
use super::paper::per_tap;
use super::sums::{self, Owed, Summer, Sums};
use crate::backend::{BackendError, Executable, Filtered, Rect, Watch, holds, inside, tell};
use crate::expr::symbol::StagePlane;
use crate::filter::Grid;
use crate::plan::{Edges, GatherKernel, Kernel, MapKernel, Output, PairLoop, Program, SumKernel};
use crate::scene::plane::Layout;
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
        for &output in program.outputs.iter().flatten() {
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

/// Takes so many pixels off the front of each picture.
fn split_off<'p>(pictures: &mut [&'p mut [[f32; 3]]], count: usize) -> Vec<&'p mut [[f32; 3]]> {
    let front = |rest: &mut &'p mut [[f32; 3]]| {
        let (front, after) = std::mem::take(rest).split_at_mut(count);
        *rest = after;
        front
    };
    pictures.iter_mut().map(front).collect()
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
        let count: usize = strips.iter().map(Rect::pixels).sum();
        let mut pictures = vec![vec![[0.0; 3]; count]; self.program.outputs.len()];
        let mut rest: Vec<&mut [[f32; 3]]> = pictures.iter_mut().map(Vec::as_mut_slice).collect();
        let parts: Vec<(Rect, Vec<&mut [[f32; 3]]>)> =
            strips.iter().map(|rect| (*rect, split_off(&mut rest, rect.pixels()))).collect();
        let kept = parts
            .into_par_iter()
            .map_init(Scratch::<E>::default, |scratch, (rect, pictures)| {
                self.strip(scene, rect, pictures, scratch, watch)
            })
            .collect::<Result<Vec<Vec<usize>>, BackendError>>()?;
        let stages = 0..self.program.filter.stages.len();
        let kept: Vec<usize> = stages.map(|k| kept.iter().map(|strip| strip[k]).sum()).collect();
        let filtered = |pixels| Filtered { pixels, kept: kept.clone() };
        Ok(pictures.into_iter().map(filtered).collect())
    }
}

impl<E: Engine> ProgramCode<E> {
    fn strip(
        &self,
        scene: &Scene,
        rect: Rect,
        mut pictures: Vec<&mut [[f32; 3]]>,
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
            let rows = Rect { y: top, height: bottom - top, ..rect };
            for (picture, pixels) in split_off(&mut pictures, rows.pixels()).into_iter().enumerate()
            {
                self.take(&strip, picture, rows, pixels);
            }
            tell(watch, bottom - top)?;
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

    /// Takes a picture's colours of a wave, in the units of the file.
    fn take(&self, strip: &Strip<'_>, picture: usize, rect: Rect, pixels: &mut [[f32; 3]]) {
        let exposure = strip.scene.normalization().exposure;
        for (y, row) in (rect.y..).zip(pixels.chunks_exact_mut(rect.width)) {
            for (component, output) in self.program.outputs[picture].into_iter().enumerate() {
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
