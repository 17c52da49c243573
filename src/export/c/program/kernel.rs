//! The kernels of a program as functions of C.

use std::collections::{BTreeMap, BTreeSet};

use askama::Template;

use super::Writer;
use super::code::Statements;
use crate::backend::{TRUSTED_SHARE, TRUSTED_SUM};
use crate::export::c::weight::constant;
use crate::export::names::Names;
use crate::expr::Feature;
use crate::expr::feature::{PlaneId, Quantity};
use crate::expr::interval::Interval;
use crate::expr::symbol::{Source, StagePlane};
use crate::expr::tape::{Axis, Input, Side};
use crate::filter::Grid;
use crate::plan::{
    BoxKernel, GatherKernel, Kernel, MapKernel, PairLoop, Place, Read, ResampleKernel, Run,
};

/// Names that the functions of all kernels use.
const LOCAL: &[&str] = &[
    "run",
    "size",
    "taps",
    "of_tap",
    "tap",
    "total",
    "magnitude",
    "part",
    "part_magnitude",
    "trusted",
    "count",
    "radius",
    "step",
    "rows",
    "columns",
    "row",
    "column",
    "sum",
];

#[derive(Template)]
#[template(path = "c/map.c", escape = "none")]
struct MapTemplate<'a> {
    doc: String,
    name: &'a str,
    upper: &'a str,
    function: &'a str,
    size: &'static str,
    pointers: Vec<String>,
    reads: Vec<String>,
    lines: Vec<String>,
    /// Where results go, and what they are.
    writes: Vec<(String, String)>,
}

/// A mean that a kernel makes.
struct Mean {
    /// What is averaged, by which weight, and where the mean goes.
    from: String,
    weight: String,
    to: String,
    /// Where sums down columns stand.
    columns: String,
    squared: bool,
    lo: String,
    hi: String,
}

#[derive(Template)]
#[template(path = "c/gather.c", escape = "none")]
struct GatherTemplate<'a> {
    doc: String,
    name: &'a str,
    upper: &'a str,
    function: &'a str,
    size: &'static str,
    pointers: Vec<String>,
    runs: &'a [Run],
    table: Vec<Vec<String>>,
    at_i: Vec<String>,
    at_j: Vec<String>,
    reads_j: bool,
    lines: Vec<String>,
    weight: String,
    means: Vec<Mean>,
    signed: bool,
    least: String,
    share: String,
}

#[derive(Template)]
#[template(path = "c/box.c", escape = "none")]
struct BoxTemplate<'a> {
    doc: String,
    upper: &'a str,
    name: &'a str,
    function: &'a str,
    size: &'static str,
    pointers: Vec<String>,
    radius: u32,
    step: u32,
    means: Vec<Mean>,
}

#[derive(Template)]
#[template(path = "c/resample.c", escape = "none")]
struct ResampleTemplate<'a> {
    doc: String,
    name: &'a str,
    upper: &'a str,
    function: &'a str,
    size: &'static str,
    pointers: Vec<String>,
    /// What follows from the pixel's place, or is one number for the whole image.
    value: Option<String>,
    is_half: bool,
    from: String,
    to: String,
}

/// The pointers of a function: by what they point at, their names and declarations.
struct Pointers {
    names: Names,
    from: BTreeMap<Source, String>,
    lines: Vec<String>,
}

impl Pointers {
    fn new() -> Self {
        Self { names: Names::with(LOCAL), from: BTreeMap::new(), lines: Vec::new() }
    }

    /// A pointer to what a kernel reads.
    fn from(&mut self, writer: &Writer<'_>, source: Source) -> String {
        if let Some(name) = self.from.get(&source) {
            return name.clone();
        }
        let name = self.names.unique(format!("from_{}", writer.called(source)));
        let place = match source {
            Source::Stage(plane) => writer.place(writer.places.of(plane)),
            Source::Feature(plane) => format!("run->in->{}", field(plane)),
        };
        self.lines.push(format!("const float *const {name} = {place}"));
        self.from.insert(source, name.clone());
        name
    }

    /// A pointer to where something goes.
    fn to(&mut self, writer: &Writer<'_>, called: &str, place: Place) -> String {
        let name = self.names.unique(format!("to_{called}"));
        self.lines.push(format!("float *const {name} = {}", writer.place(place)));
        name
    }
}

/// A plane's field of the inputs.
fn field(plane: PlaneId) -> String {
    let name = plane.feature.identifier(plane.quantity);
    match PlaneId::components(plane.feature, plane.quantity) {
        1 => name,
        _ => format!("{name}[{}]", plane.component),
    }
}

fn size(grid: Grid) -> &'static str {
    match grid {
        Grid::Full => "size",
        Grid::Half => "half_size",
    }
}

/// How the declaration of a local number is called for a place beside the pixel.
fn shifted(name: &str, [dx, dy]: [i8; 2]) -> String {
    let mut name = name.to_owned();
    for (by, less, more) in [(dx, "left", "right"), (dy, "up", "down")] {
        match by {
            0 => {}
            by if by < 0 => name += &format!("_{less}{}", by.unsigned_abs()),
            by => name += &format!("_{more}{by}"),
        }
    }
    name
}

impl Writer<'_> {
    /// Adds the function of a kernel.
    pub(super) fn kernel(&mut self, k: usize, kernel: &Kernel) {
        let text = match kernel {
            Kernel::Map(map) => self.map(map),
            Kernel::Gather(gather) => self.gather(gather),
            Kernel::Box(mean) => self.mean(mean, k),
            Kernel::Resample(resample) => self.resample(resample),
            Kernel::Sum(_) | Kernel::Transpose(_) | Kernel::Given(_) => {
                unreachable!("only gradients have adjoints")
            }
        };
        self.texts.push(text);
    }

    /// Where a plane stands.
    fn place(&self, place: Place) -> String {
        let grid = match place.grid {
            Grid::Full => "full",
            Grid::Half => "half",
        };
        format!("{}_{grid}(run, {})", self.shared.prefix, place.number)
    }

    /// What a plane is called.
    fn called(&self, source: Source) -> String {
        match source {
            Source::Stage(plane) => self.called[&plane].clone(),
            Source::Feature(plane) => plane.identifier(),
        }
    }

    /// An expression that reads a plane at a place of the image: pixel `at`, or where given
    /// so far beside (x, y).
    fn read(
        &mut self,
        pointers: &mut Pointers,
        source: Source,
        at: &str,
        shift: [i8; 2],
    ) -> String {
        let prefix = self.shared.prefix;
        if let Source::Feature(plane) = source {
            if plane.feature.row().per_image {
                return format!("run->in->{}", field(plane));
            }
            if (plane.feature, plane.quantity) == (Feature::Pixel, Quantity::Value) {
                let [axis, other] = [["x", "u"], ["y", "v"]][usize::from(plane.component)];
                let by = shift[usize::from(plane.component)];
                let last = format!("size[{}] - 1", plane.component);
                return match (at, by) {
                    ("j", _) => format!("(float){other}"),
                    (_, 0) => format!("(float){axis}"),
                    (_, by) if by < 0 => {
                        format!("(float)({axis} < {0} ? 0 : {axis} - {0})", by.unsigned_abs())
                    }
                    (_, by) => format!("(float)({axis} + {by} > {last} ? {last} : {axis} + {by})"),
                };
            }
        }
        let from = pointers.from(self, source);
        match shift {
            [0, 0] => format!("{from}[{at}]"),
            [dx, dy] => {
                self.places_used = true;
                let sum = |axis: &str, by: i8| match by {
                    0 => axis.to_owned(),
                    by if by < 0 => format!("{axis} - {}", by.unsigned_abs()),
                    by => format!("{axis} + {by}"),
                };
                format!("{from}[{prefix}_at(size, {}, {})]", sum("x", dx), sum("y", dy))
            }
        }
    }

    fn map(&mut self, kernel: &MapKernel) -> String {
        let function = self.function(&kernel.writes, "map");
        let mut pointers = Pointers::new();
        let mut reads = Vec::new();
        let mut names = Vec::new();
        for &Read { source, shift } in &kernel.reads {
            let value = self.read(&mut pointers, source, "i", shift);
            let name = pointers.names.unique(shifted(&self.called(source), shift));
            reads.push(format!("const float {name} = {value};"));
            names.push(name);
        }
        let to: Vec<String> = kernel
            .writes
            .iter()
            .map(|&plane| {
                let called = self.called[&plane].clone();
                pointers.to(self, &called, self.places.of(plane))
            })
            .collect();
        let wanted: Vec<String> =
            kernel.writes.iter().map(|plane| self.called[plane].clone()).collect();
        let input = |input| match input {
            Input::Signal(k, Side::I) => names[k as usize].clone(),
            Input::Signal(_, Side::J)
            | Input::Plane(..)
            | Input::Offset(_)
            | Input::PerPixel(..)
            | Input::PerTap(_)
            | Input::Constant(_) => {
                unreachable!("maps read signals at their pixel, and constants are known")
            }
        };
        let Statements { lines, results } =
            self.shared.statements(&kernel.tape, &mut pointers.names, input, &wanted);
        let template = MapTemplate {
            doc: self.doc("Values at every pixel", &kernel.writes, kernel.grid),
            name: self.shared.prefix,
            upper: &self.upper,
            function: &function,
            size: size(kernel.grid),
            pointers: pointers.lines,
            reads,
            lines,
            writes: to.into_iter().zip(results).collect(),
        };
        rendered(&template)
    }

    fn gather(&mut self, kernel: &GatherKernel) -> String {
        let PairLoop { tap, pair, runs, .. } = &kernel.pairs;
        let outputs: Vec<StagePlane> = Kernel::Gather(kernel.clone()).writes();
        let function = self.function(&outputs, "mean");
        let mut pointers = Pointers::new();
        let mut reads: BTreeMap<(Source, Side), String> = BTreeMap::new();
        let (mut at_i, mut at_j) = (Vec::new(), Vec::new());
        // Without taps, nothing is looked at.
        for input in pair.inputs().filter(|_| !runs.is_empty()) {
            let (source, side) = match input {
                Input::Plane(plane, side) => (Source::Feature(plane), side),
                Input::Signal(k, side) => (Source::Stage(kernel.pairs.reads[k as usize]), side),
                Input::PerTap(_) => continue,
                Input::Offset(_) | Input::PerPixel(..) | Input::Constant(_) => {
                    unreachable!("these are read through tables and maps, or known")
                }
            };
            if reads.contains_key(&(source, side)) {
                continue;
            }
            let (lines, letter) = match side {
                Side::I => (&mut at_i, "i"),
                Side::J => (&mut at_j, "j"),
            };
            let value = self.read(&mut pointers, source, letter, [0, 0]);
            let name = pointers.names.unique(format!("{}_{letter}", self.called(source)));
            lines.push(format!("const float {name} = {value};"));
            reads.insert((source, side), name);
        }
        let name_of = |source, side| reads[&(source, side)].clone();
        let input = |input| match input {
            Input::Plane(plane, side) => name_of(Source::Feature(plane), side),
            Input::Signal(k, side) => name_of(Source::Stage(kernel.pairs.reads[k as usize]), side),
            Input::PerTap(k) => format!("of_tap[tap][{k}]"),
            Input::Offset(_) | Input::PerPixel(..) | Input::Constant(_) => {
                unreachable!("found above")
            }
        };
        let statements = match runs.is_empty() {
            true => Statements { lines: Vec::new(), results: vec![String::new(); 2] },
            false => self.shared.statements(pair, &mut pointers.names, input, &[]),
        };
        let table: Vec<Vec<String>> = match tap.results() {
            [] => Vec::new(),
            [_, ..] => runs
                .iter()
                .flat_map(|run| run.offsets())
                .map(|[dx, dy]| {
                    let values = tap.eval(|input| match input {
                        Input::Offset(Axis::X) => dx as f32,
                        Input::Offset(Axis::Y) => dy as f32,
                        Input::Plane(..)
                        | Input::PerPixel(..)
                        | Input::PerTap(_)
                        | Input::Signal(..)
                        | Input::Constant(_) => unreachable!("tap tapes read offsets alone"),
                    });
                    values.into_iter().map(constant).collect()
                })
                .collect(),
        };
        let channels = kernel.channels.iter().zip(&kernel.writes);
        let channels = channels.map(|(&from, &(to, range))| (from, to, range, false));
        let variance = kernel.variance.iter().map(|&(from, to, range)| (from, to, range, true));
        let mut means = Vec::new();
        for (from, to, range, squared) in channels.chain(variance) {
            let weight = match squared {
                false => "w".to_owned(),
                true => statements.results[1].clone(),
            };
            means.push(self.mean_of(&mut pointers, (from, to, range), weight, squared));
        }
        let reads_j = !means.is_empty()
            || reads.keys().any(|&(source, side)| {
                let place =
                    matches!(source, Source::Feature(plane) if plane.feature == Feature::Pixel);
                side == Side::J && !place
            });
        let taps: usize = runs.iter().map(|run| run.count as usize).sum();
        let template = GatherTemplate {
            doc: self.doc(&format!("Means over {taps} pixels"), &outputs, kernel.grid),
            name: self.shared.prefix,
            upper: &self.upper,
            function: &function,
            size: size(kernel.grid),
            pointers: pointers.lines,
            runs,
            table,
            at_i,
            at_j,
            reads_j,
            lines: statements.lines,
            weight: statements.results[0].clone(),
            means,
            signed: kernel.signed,
            least: constant(TRUSTED_SUM),
            share: constant(TRUSTED_SHARE),
        };
        rendered(&template)
    }

    fn mean_of(
        &mut self,
        pointers: &mut Pointers,
        (from, to, range): (StagePlane, StagePlane, Interval),
        weight: String,
        squared: bool,
    ) -> Mean {
        self.means_used = true;
        let from = pointers.from(self, Source::Stage(from));
        let called = self.called[&to].clone();
        let to = pointers.to(self, &called, self.places.of(to));
        let (lo, hi) = (constant(range.lo), constant(range.hi));
        Mean { from, weight, to, columns: String::new(), squared, lo, hi }
    }

    fn mean(&mut self, kernel: &BoxKernel, k: usize) -> String {
        let outputs: Vec<StagePlane> = kernel.writes.iter().map(|&(plane, _)| plane).collect();
        let function = self.function(&outputs, "mean");
        let mut pointers = Pointers::new();
        let columns = self.places.columns(k).to_vec();
        let mut means = Vec::new();
        for ((&from, &(to, range)), place) in
            kernel.channels.iter().zip(&kernel.writes).zip(columns)
        {
            let columns = format!("columns_of_{}", self.called[&to]);
            let columns = pointers.to(self, &columns, place);
            let from = pointers.from(self, Source::Stage(from));
            let called = self.called[&to].clone();
            let to = pointers.to(self, &called, self.places.of(to));
            let (lo, hi) = (constant(range.lo), constant(range.hi));
            means.push(Mean { from, weight: String::new(), to, columns, squared: false, lo, hi });
        }
        let taps = kernel.window.taps();
        let template = BoxTemplate {
            doc: self.doc(
                &format!("Means by equal weights over {taps} pixels"),
                &outputs,
                kernel.grid,
            ),
            upper: &self.upper,
            name: self.shared.prefix,
            function: &function,
            size: size(kernel.grid),
            pointers: pointers.lines,
            radius: kernel.window.radius,
            step: kernel.window.dilation,
            means,
        };
        rendered(&template)
    }

    fn resample(&mut self, kernel: &ResampleKernel) -> String {
        let (is_half, what, doc) = match kernel.grid {
            Grid::Half => (true, "halve", "The means of two by two pixels"),
            Grid::Full => (false, "double", "What lies between pixels of half the resolution"),
        };
        let function = self.function(&[kernel.writes], what);
        let mut pointers = Pointers::new();
        let (mut value, mut from) = (None, String::new());
        match kernel.reads {
            // The middle of two pixels, also where there is one.
            Source::Feature(PlaneId { feature: Feature::Pixel, component, .. }) if is_half => {
                let axis = ["x", "y"][usize::from(component)];
                value = Some(format!("2.0f * (float){axis} + 0.5f"));
            }
            Source::Feature(plane) if plane.feature.row().per_image => {
                value = Some(format!("run->in->{}", field(plane)));
            }
            source => {
                from = pointers.from(self, source);
                self.places_used = true;
                self.doubles_used |= !is_half;
            }
        }
        let called = self.called[&kernel.writes].clone();
        let to = pointers.to(self, &called, self.places.of(kernel.writes));
        let template = ResampleTemplate {
            doc: format!("{doc}: of {}.", self.called(kernel.reads)),
            name: self.shared.prefix,
            upper: &self.upper,
            function: &function,
            size: size(kernel.grid),
            pointers: pointers.lines,
            value,
            is_half,
            from,
            to,
        };
        rendered(&template)
    }

    /// What a kernel computes, in a comment.
    fn doc(&self, what: &str, planes: &[StagePlane], grid: Grid) -> String {
        let mut stages: Vec<&str> = Vec::new();
        for plane in planes {
            let stage = self.stage(*plane).unwrap_or("what the next kernel takes per pixel");
            if !stages.contains(&stage) {
                stages.push(stage);
            }
        }
        let half = match grid {
            Grid::Full => "",
            Grid::Half => ", at half resolution",
        };
        let mut lines = Vec::new();
        crate::export::header::fill(
            &mut lines,
            3,
            &format!("{what}{half}: {}.", stages.join(", ")),
        );
        lines.join("\n").trim_start().to_owned()
    }

    /// The function of a kernel that writes these planes.
    fn function(&mut self, planes: &[StagePlane], what: &str) -> String {
        let named: BTreeSet<&str> = planes.iter().filter_map(|&plane| self.stage(plane)).collect();
        let last = planes.iter().rev().find_map(|&plane| self.stage(plane));
        let own = match (last, named.len()) {
            (Some(stage), 1) => stage.to_owned(),
            (Some(stage), _) => format!("to_{stage}"),
            (None, _) => planes.last().map_or_else(String::new, |plane| self.called[plane].clone()),
        };
        let name = self.shared.names.unique(format!("{}_{what}_{own}", self.shared.prefix));
        self.functions.push(name.clone());
        name
    }
}

fn rendered(template: &impl Template) -> String {
    template.render().expect("nothing fails that writes into a string")
}
