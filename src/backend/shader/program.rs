//! Programs as compute shaders, one per kernel of the schedule.
//!
//! All kernels share their bindings: the features, a table of what depends on offsets alone,
//! and one buffer of planes, which is used again as soon as nobody reads what stands there
//! ([`Places`]). So a filter may have any number of stages, and needs five of the eight storage
//! buffers that WebGPU grants. Constants are literals: the compiler sees which are what.
//!
//! Every kernel computes all pixels of a region. Beside it the edge is repeated, or nothing
//! counts, as beside the image: who computes a part of an image gives a region that reaches
//! [`Program::halo`] pixels farther, or to the image's end.

use std::collections::{BTreeMap, BTreeSet};

use askama::Template;

use super::lines_of;
use super::wgsl::{Dialect, Statements, functions, statements};
use crate::backend::{TRUSTED_SHARE, TRUSTED_SUM};
use crate::expr::Feature;
use crate::expr::feature::PlaneId;
use crate::expr::interval::Interval;
use crate::expr::symbol::{Source, StagePlane};
use crate::expr::tape::{Axis, Input, Side};
use crate::filter::Grid;
use crate::plan::{
    BoxKernel, GatherKernel, Kernel, MapKernel, Output, PairLoop, Place, Places, Program,
    ResampleKernel,
};

/// Columns and rows of a workgroup.
pub const WORKGROUP: [u32; 2] = [8, 8];

/// Taps whose products are summed before they are added to the others'.
const RUN: usize = 16;

/// A kernel as a function of a shader.
#[derive(Clone, Debug)]
pub struct KernelShader {
    /// What it is called.
    pub name: String,
    /// The function.
    text: String,
    /// Over which pixels of a region it runs; `None` over those of the result.
    pub grid: Option<Grid>,
    /// About how many operations it takes per pixel.
    pub work: u64,
    /// Numbers per pixel of the planes that it reads and writes, each plane once.
    pub traffic: f64,
}

/// A program as compute shaders.
#[derive(Clone, Debug)]
pub struct ProgramShader {
    /// What the functions share.
    header: String,
    dialect: Dialect,
    /// The functions, in the order in which they run. The last writes the result.
    pub kernels: Vec<KernelShader>,
    /// The planes in `features`.
    pub features: Vec<PlaneId>,
    /// What `taps` holds: of each tap what a kernel reads of it.
    pub taps: Vec<f32>,
    /// Planes on the full grid that are held at a time.
    pub full: usize,
    /// Planes on the half grid.
    pub half: usize,
    /// How many stages the filter has, and so numbers in `kept`.
    pub stages: usize,
    /// How many pictures it gives; a pixel's stand side by side in `result`.
    pub results: usize,
    /// How far beside the pixels that are wanted a region reaches.
    pub halo: usize,
}

impl ProgramShader {
    /// Writes the kernels of a program.
    pub fn new(program: &Program, dialect: Dialect) -> Self {
        let features: Vec<PlaneId> = program.inputs.iter().copied().collect();
        let places = program.places();
        let mut writer = Writer { places: &places, features: &features, dialect, taps: Vec::new() };
        let mut kernels: Vec<KernelShader> = Vec::new();
        let mut k = 0;
        for together in program.kernels.chunk_by(runs_with) {
            match &together[0] {
                Kernel::Map(map) => kernels.push(writer.map(map, format!("map_{k}"))),
                Kernel::Gather(gather) => {
                    kernels.push(writer.gather(gather, format!("gather_{k}")));
                }
                Kernel::Box(mean) => kernels.extend(writer.mean(mean, k)),
                Kernel::Resample(first) => {
                    let planes = together.iter().filter_map(|kernel| match kernel {
                        Kernel::Resample(resample) => Some(resample),
                        _ => None,
                    });
                    let name = format!("resample_{k}");
                    kernels.push(writer.resample(first.grid, planes, name));
                }
                Kernel::Sum(_) | Kernel::Transpose(_) | Kernel::Given(_) => {
                    unreachable!("only gradients have adjoints")
                }
            }
            k += together.len();
        }
        kernels.push(writer.take(&program.outputs));
        let taps = writer.taps;
        let names: Vec<String> = features.iter().map(|plane| plane.identifier()).collect();
        let (full, half) = (places.full, places.half);
        let header = HeaderTemplate { features_doc: lines_of(&names).collect(), full, half };
        Self {
            header: rendered(&header),
            dialect,
            kernels,
            features,
            taps,
            full,
            half,
            stages: program.filter.stages.len(),
            results: program.outputs.len(),
            halo: program.halo(),
        }
    }

    /// A shader of one kernel.
    pub fn module(&self, kernel: &KernelShader) -> String {
        self.text(std::slice::from_ref(kernel))
    }

    /// A shader of all of them.
    pub fn whole(&self) -> String {
        self.text(&self.kernels)
    }

    fn text(&self, kernels: &[KernelShader]) -> String {
        let bodies: Vec<&str> = kernels.iter().map(|kernel| kernel.text.as_str()).collect();
        let bodies = bodies.join("\n");
        format!("{}{}\n{bodies}", self.header, functions(&bodies, self.dialect))
    }
}

#[derive(Template)]
#[template(path = "program/header.wgsl", escape = "none")]
struct HeaderTemplate {
    features_doc: Vec<String>,
    full: usize,
    half: usize,
}

#[derive(Template)]
#[template(path = "program/map.wgsl", escape = "none")]
struct MapTemplate {
    workgroup: [u32; 2],
    name: String,
    size: &'static str,
    reads: Vec<String>,
    lines: String,
    writes: Vec<(String, String)>,
}

/// Where a mean is made of, where it goes, and what it is kept within.
type Channel = (String, String, String, String);

#[derive(Template)]
#[template(path = "program/gather.wgsl", escape = "none")]
struct GatherTemplate {
    workgroup: [u32; 2],
    name: String,
    size: &'static str,
    /// What is read at either pixel: a name, and the plane without the pixel.
    at_i: Vec<(String, String)>,
    at_j: Vec<(String, String)>,
    first_tap: usize,
    last_tap: usize,
    /// Numbers per tap, and per run of taps.
    stride: usize,
    run: usize,
    lines: String,
    weight: String,
    channels: Vec<Channel>,
    variance: Option<Variance>,
    signed: bool,
    /// How many sums there are, and which is the weights'.
    sums: usize,
    total: usize,
    trusted_sum: String,
    trusted_share: String,
    step: usize,
    stages: Vec<usize>,
}

struct Variance {
    weight: String,
    from: String,
    to: String,
    lo: String,
    hi: String,
}

#[derive(Template)]
#[template(path = "program/box.wgsl", escape = "none")]
struct BoxTemplate {
    workgroup: [u32; 2],
    name: String,
    size: &'static str,
    rows: bool,
    channels: Vec<Channel>,
    radius: u32,
    dilation: u32,
}

#[derive(Template)]
#[template(path = "program/resample.wgsl", escape = "none")]
struct ResampleTemplate {
    workgroup: [u32; 2],
    name: String,
    size: &'static str,
    is_half: bool,
    planes: Vec<Resampled>,
}

/// A plane on its way to the other grid.
struct Resampled {
    /// Of the feature that is a pixel's place: along which axis.
    pixel: Option<&'static str>,
    from: String,
    to: String,
}

#[derive(Template)]
#[template(path = "program/take.wgsl", escape = "none")]
struct TakeTemplate {
    workgroup: [u32; 2],
    name: String,
    /// Red, green and blue of every picture.
    pictures: Vec<[String; 3]>,
}

struct Writer<'a> {
    places: &'a Places,
    features: &'a [PlaneId],
    dialect: Dialect,
    taps: Vec<f32>,
}

impl Writer<'_> {
    /// Where a plane begins.
    fn start(place: Place) -> String {
        match place {
            Place { grid: Grid::Full, number } => format!("full({number}u)"),
            Place { grid: Grid::Half, number } => format!("half({number}u)"),
        }
    }

    /// Where a plane begins that a kernel writes.
    fn to(&self, plane: StagePlane) -> String {
        Self::start(self.places.of(plane))
    }

    /// The beginning of an expression that reads a plane; the pixel's place and a bracket
    /// follow.
    fn from(&self, source: Source) -> String {
        match source {
            Source::Stage(plane) => format!("planes[{}", self.to(plane)),
            Source::Feature(plane) => {
                let number = self.features.iter().position(|other| *other == plane);
                let number = number.expect("inputs are all features that kernels read");
                format!("features[full({number}u)")
            }
        }
    }

    fn map(&self, kernel: &MapKernel, name: String) -> KernelShader {
        let read = |k: usize| {
            let read = kernel.reads[k];
            let from = self.from(read.source);
            match read.shift {
                [0, 0] => format!("{from} + place]"),
                [dx, dy] => format!("{from} + place_of(at + vec2<i32>({dx}, {dy}), size)]"),
            }
        };
        let tape = statements(&kernel.tape, self.dialect, |input| match input {
            Input::Signal(k, Side::I) => format!("r{k}"),
            Input::Signal(_, Side::J)
            | Input::Plane(..)
            | Input::Offset(_)
            | Input::PerPixel(..)
            | Input::PerTap(_)
            | Input::Constant(_) => {
                unreachable!("maps read signals at their pixel, and constants are known")
            }
        });
        let Statements { lines, results } = tape;
        let writes = kernel.writes.iter().map(|&plane| self.to(plane)).zip(results).collect();
        let template = MapTemplate {
            workgroup: WORKGROUP,
            name: name.clone(),
            size: size(kernel.grid),
            reads: (0..kernel.reads.len()).map(read).collect(),
            lines,
            writes,
        };
        let work = (kernel.tape.instrs().len() + kernel.reads.len()) as u64;
        let sources: BTreeSet<Source> = kernel.reads.iter().map(|read| read.source).collect();
        let traffic = (sources.len() + kernel.writes.len()) as f64;
        KernelShader { name, text: rendered(&template), grid: Some(kernel.grid), work, traffic }
    }

    fn gather(&mut self, kernel: &GatherKernel, name: String) -> KernelShader {
        let squared = kernel.variance.is_some();
        let weights = 1 + usize::from(squared);
        // A mirrored tape goes on with what the weight is for the pixels exchanged.
        let pair = kernel.pairs.pair.clone().finish(&kernel.pairs.pair.results()[..weights]);
        let (first_tap, stride) = self.tabulate(&kernel.pairs);
        let last_tap = self.taps.len();

        let mut reads: BTreeMap<(Source, Side), String> = BTreeMap::new();
        for input in pair.inputs() {
            let (source, side) = match input {
                Input::Plane(plane, side) => (Source::Feature(plane), side),
                Input::Signal(k, side) => (Source::Stage(kernel.pairs.reads[k as usize]), side),
                Input::PerTap(_) | Input::Offset(_) => continue,
                Input::PerPixel(..) | Input::Constant(_) => {
                    unreachable!("what is computed per pixel is a map's, and constants are known")
                }
            };
            let number = reads.len();
            let pixel = if side == Side::I { 'i' } else { 'j' };
            reads.entry((source, side)).or_insert_with(|| format!("at_{pixel}_{number}"));
        }
        let name_of = |source, side| reads[&(source, side)].clone();
        let Statements { lines, results } = statements(&pair, self.dialect, |input| match input {
            Input::Plane(plane, side) => name_of(Source::Feature(plane), side),
            Input::Signal(k, side) => name_of(Source::Stage(kernel.pairs.reads[k as usize]), side),
            Input::PerTap(k) => format!("taps[tap + {}u]", k + 2),
            Input::Offset(Axis::X) => "taps[tap]".to_owned(),
            Input::Offset(Axis::Y) => "taps[tap + 1u]".to_owned(),
            Input::PerPixel(..) | Input::Constant(_) => unreachable!("found above"),
        });
        let at = |wanted: Side| {
            let here = reads.iter().filter(|((_, side), _)| *side == wanted);
            here.map(|((source, _), name)| (name.clone(), self.from(*source))).collect()
        };
        let channel = |from: StagePlane, to: StagePlane, range: Interval| {
            let Interval { lo, hi } = range;
            (self.from(Source::Stage(from)), self.to(to), literal(lo), literal(hi))
        };
        let ways = kernel.channels.iter().zip(&kernel.writes);
        let variance = kernel.variance.map(|(from, to, range)| {
            let (from, to, lo, hi) = channel(from, to, range);
            Variance { weight: results[1].clone(), from, to, lo, hi }
        });
        let total = kernel.channels.len();
        let template = GatherTemplate {
            workgroup: WORKGROUP,
            name: name.clone(),
            size: size(kernel.grid),
            at_i: at(Side::I),
            at_j: at(Side::J),
            first_tap,
            last_tap,
            stride,
            run: RUN * stride,
            lines,
            weight: results[0].clone(),
            channels: ways.map(|(&from, &(to, range))| channel(from, to, range)).collect(),
            variance,
            signed: kernel.signed,
            sums: total + 1 + usize::from(kernel.signed) + usize::from(squared),
            total,
            trusted_sum: literal(TRUSTED_SUM),
            trusted_share: literal(TRUSTED_SHARE),
            step: kernel.grid.step(),
            stages: kernel.stages.clone(),
        };
        let taps = ((last_tap - first_tap) / stride) as u64;
        let work = taps * (pair.instrs().len() + total + 4) as u64;
        let averaged =
            kernel.channels.iter().copied().chain(kernel.variance.map(|(from, ..)| from));
        let sources: BTreeSet<Source> = reads.keys().map(|(source, _)| *source).collect();
        let written = total + usize::from(squared);
        let traffic = sources.iter().copied().chain(averaged.map(Source::Stage));
        let traffic = (traffic.collect::<BTreeSet<Source>>().len() + written) as f64;
        KernelShader { name, text: rendered(&template), grid: Some(kernel.grid), work, traffic }
    }

    /// Adds the taps of a loop over pairs to the table. Returns where they begin, and how many
    /// numbers each has.
    fn tabulate(&mut self, pairs: &PairLoop) -> (usize, usize) {
        let offsets: Vec<[i32; 2]> = match pairs.mirrored {
            false => pairs.runs.iter().flat_map(|run| run.offsets()).collect(),
            true => {
                // The other half lies opposite.
                let half = pairs.runs.iter().flat_map(|run| run.offsets());
                let both = half.flat_map(|[dx, dy]| [[dx, dy], [-dx, -dy]]);
                let both: BTreeSet<[i32; 2]> = both.map(|[dx, dy]| [dy, dx]).collect();
                both.into_iter().map(|[dy, dx]| [dx, dy]).collect()
            }
        };
        let start = self.taps.len();
        for offset in offsets {
            let [dx, dy] = offset.map(|along| along as f32);
            self.taps.extend([dx, dy]);
            self.taps.extend(pairs.tap.eval(|input| match input {
                Input::Offset(Axis::X) => dx,
                Input::Offset(Axis::Y) => dy,
                Input::Plane(..)
                | Input::PerPixel(..)
                | Input::PerTap(_)
                | Input::Signal(..)
                | Input::Constant(_) => unreachable!("tap tapes read offsets alone"),
            }));
        }
        (start, pairs.tap.results().len() + 2)
    }

    fn mean(&self, kernel: &BoxKernel, k: usize) -> [KernelShader; 2] {
        let columns = self.places.columns(k);
        let whole = || (literal(f32::MIN), literal(f32::MAX));
        let down = kernel.channels.iter().zip(columns).map(|(&from, &to)| {
            let (lo, hi) = whole();
            (self.from(Source::Stage(from)), Self::start(to), lo, hi)
        });
        let along = columns.iter().zip(&kernel.writes).map(|(&from, &(to, range))| {
            let from = format!("planes[{}", Self::start(from));
            (from, self.to(to), literal(range.lo), literal(range.hi))
        });
        let taps = kernel.window.diameter() as u64;
        let work = taps * (2 + kernel.channels.len()) as u64;
        let kernel_of = |name: String, rows: bool, channels: Vec<Channel>| {
            let template = BoxTemplate {
                workgroup: WORKGROUP,
                name: name.clone(),
                size: size(kernel.grid),
                rows,
                channels,
                radius: kernel.window.radius,
                dilation: kernel.window.dilation,
            };
            let traffic = 2.0 * kernel.channels.len() as f64;
            KernelShader { name, text: rendered(&template), grid: Some(kernel.grid), work, traffic }
        };
        [
            kernel_of(format!("columns_{k}"), false, down.collect()),
            kernel_of(format!("rows_{k}"), true, along.collect()),
        ]
    }

    fn resample<'k>(
        &self,
        grid: Grid,
        planes: impl Iterator<Item = &'k ResampleKernel>,
        name: String,
    ) -> KernelShader {
        let plane = |kernel: &ResampleKernel| {
            let pixel = match kernel.reads {
                Source::Feature(PlaneId { feature: Feature::Pixel, component, .. })
                    if grid == Grid::Half =>
                {
                    Some(["x", "y"][usize::from(component)])
                }
                Source::Feature(_) | Source::Stage(_) => None,
            };
            Resampled { pixel, from: self.from(kernel.reads), to: self.to(kernel.writes) }
        };
        let planes: Vec<Resampled> = planes.map(plane).collect();
        let work = 8 * planes.len() as u64;
        // A pixel of half the resolution stands for four.
        let per_plane = if grid == Grid::Half { 5.0 } else { 1.25 };
        let traffic = per_plane * planes.len() as f64;
        let is_half = grid == Grid::Half;
        let template = ResampleTemplate {
            workgroup: WORKGROUP,
            name: name.clone(),
            size: size(grid),
            is_half,
            planes,
        };
        KernelShader { name, text: rendered(&template), grid: Some(grid), work, traffic }
    }

    fn take(&self, outputs: &[[Output; 3]]) -> KernelShader {
        let component = |output: Output| match output {
            Output::Plane(plane) => format!("planes[{} + place]", self.to(plane)),
            Output::Constant(x) => literal(x),
        };
        let pictures = outputs.iter().map(|output| output.map(component)).collect();
        let name = "take".to_owned();
        let template = TakeTemplate { workgroup: WORKGROUP, name: name.clone(), pictures };
        let count = outputs.len();
        let (work, traffic) = (8 * count as u64, 7.0 * count as f64);
        KernelShader { name, text: rendered(&template), grid: None, work, traffic }
    }
}

/// Whether one dispatch does the work of two kernels that follow each other. Planes that go to
/// the same grid come from the other, so none of them waits for another.
fn runs_with(kernel: &Kernel, next: &Kernel) -> bool {
    match (kernel, next) {
        (Kernel::Resample(kernel), Kernel::Resample(next)) => kernel.grid == next.grid,
        _ => false,
    }
}

fn rendered(template: &impl Template) -> String {
    template.render().expect("writing to a string cannot fail")
}

fn size(grid: Grid) -> &'static str {
    match grid {
        Grid::Full => "size",
        Grid::Half => "half_size",
    }
}

fn literal(x: f32) -> String {
    format!("{x:?}f")
}
