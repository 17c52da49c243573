//! Plans as compute shaders: the weights of one window in a kernel that does Equation 1, and
//! programs as several kernels ([`program`]).
//!
//! The kernel of a window reads what stands at pixel j from one storage buffer, `near`: the
//! colour and the planes that the pair tape reads there, and nothing else. What
//! is read at pixel i alone stands in `own`, what depends on the offset alone in
//! `taps`. With the uniforms and the result that makes five bindings whatever
//! the filter reads, and four storage buffers of the eight that WebGPU grants.
//!
//! What depends on pixel i alone is computed once per invocation, before its
//! loop over the window.

pub mod program;
pub mod wgsl;

use std::collections::BTreeSet;

use askama::Template;

use crate::backend::{TRUSTED_SHARE, TRUSTED_SUM};
use crate::expr::feature::PlaneId;
use crate::expr::tape::{Axis, Input, Instr, Side, Tape};
use crate::plan::WindowPlan;
use wgsl::{Dialect, Statements, functions, statements};

/// How a kernel reads `near`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Loads {
    /// One plane after the other, one number at a time.
    Planar,
    /// Channels of a pixel side by side, four at a time.
    #[default]
    Packed,
    /// The same, through a strip in workgroup memory per row of the window.
    Tiled,
}

impl Loads {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Planar, Self::Packed, Self::Tiled];

    /// What benches call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Planar => "planar",
            Self::Packed => "packed",
            Self::Tiled => "tiled",
        }
    }

    fn is_planar(&self) -> bool {
        *self == Self::Planar
    }

    fn is_tiled(&self) -> bool {
        *self == Self::Tiled
    }

    /// Columns and rows of a workgroup. A strip wants to be long: it is shared
    /// along its rows.
    pub fn workgroup(self) -> [u32; 2] {
        match self {
            Self::Planar | Self::Packed => [8, 8],
            Self::Tiled => [32, 2],
        }
    }
}

/// What a kernel is written for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Style {
    /// How its arithmetic is written.
    pub dialect: Dialect,
    /// How it reads.
    pub loads: Loads,
    /// Whether what depends on the offset alone is read from a table (or else
    /// computed for every pair).
    pub tap_table: bool,
}

/// A plan as a compute shader.
#[derive(Clone, Debug)]
pub struct Shader {
    /// The WGSL.
    pub text: String,
    /// The planes in `near`, after the three channels of the colour.
    pub near: Vec<PlaneId>,
    /// The planes in `own`.
    pub own: Vec<PlaneId>,
    /// Four-component vectors per tap in `taps`; 0 if there is no such binding.
    pub tap_quads: usize,
    /// Bytes of workgroup memory.
    pub workgroup_bytes: usize,
}

/// Channels of the colour in `near`, before its planes.
pub(in crate::backend) const COLOR: usize = 3;

/// Components of a vector.
pub(crate) const QUAD: usize = 4;

impl Shader {
    /// Writes the kernel of a plan.
    pub fn new(plan: &WindowPlan, style: Style) -> Self {
        let at = |side| {
            let inputs = plan.pair().inputs().chain(plan.pixel().inputs());
            let planes = inputs.filter_map(move |input| match input {
                Input::Plane(plane, s) if s == side => Some(plane),
                Input::Plane(..)
                | Input::Offset(_)
                | Input::PerPixel(..)
                | Input::PerTap(_)
                | Input::Signal(..)
                | Input::Constant(_) => None,
            });
            planes.collect::<BTreeSet<PlaneId>>()
        };
        let (i, j) = (at(Side::I), at(Side::J));
        let near: Vec<PlaneId> = j.iter().copied().collect();
        let own: Vec<PlaneId> = i.difference(&j).copied().collect();
        let near_quads = (COLOR + near.len()).div_ceil(QUAD);
        let own_quads = own.len().div_ceil(QUAD);
        let tap = tap_fields(plan.tap());
        let taps = tap.len();
        let tap_quads = if style.tap_table { taps.div_ceil(QUAD) } else { 0 };
        let channels = Channels { loads: style.loads, near: &near, own: &own, near_quads };

        let read = |plane: PlaneId, side: Side| match side {
            Side::I => format!("i.{}", plane.identifier()),
            Side::J => format!("j.{}", plane.identifier()),
        };
        let tape = |tape: &Tape| {
            statements(tape, style.dialect, |input| match input {
                Input::Plane(plane, side) => read(plane, side),
                Input::Offset(Axis::X) => "offset.x".to_owned(),
                Input::Offset(Axis::Y) => "offset.y".to_owned(),
                Input::PerPixel(k, Side::I) => format!("per_pixel.v{k}"),
                Input::PerPixel(_, Side::J) => {
                    unreachable!("only mirrored tapes look at pixel j through per-pixel values")
                }
                Input::PerTap(k) => format!("tap.{}", tap[k as usize]),
                Input::Signal(..) | Input::Constant(_) => {
                    unreachable!("only programs have stages and named constants")
                }
            })
        };
        let Statements { lines: pixel_lines, results: pixel_results } = tape(plan.pixel());
        let Statements { lines: pair_lines, results: pair_results } = tape(plan.pair());
        let Statements { lines: tap_lines, results: tap_results } = tape(plan.tap());
        let mut written = pixel_lines.clone() + &pair_lines;
        if !style.tap_table {
            written += &tap_lines;
        }

        let weights = pair_results.len();
        let per_pixel = numbered(pixel_results.len());
        let (at_i, at_j) = (fields(&i), fields(&j));
        let given = [
            ("i", "AtI", at_i.is_empty()),
            ("j", "AtJ", at_j.is_empty()),
            ("per_pixel", "PerPixel", per_pixel.is_empty()),
            ("tap", "Tap", tap.is_empty()),
        ];
        let given = || given.iter().filter(|(_, _, is_empty)| !is_empty);
        let signature: Vec<String> =
            given().map(|(name, kind, _)| format!("{name}: {kind}")).collect();
        let arguments: Vec<&str> = given().map(|(name, _, _)| *name).collect();

        let reach = plan.support().reach() as usize;
        let workgroup = style.loads.workgroup();
        let columns = workgroup[0] as usize + 2 * reach;
        let strip = columns * workgroup[1] as usize;
        let kernel = FilterTemplate {
            loads: style.loads,
            near_doc: channels.near_doc(),
            own_doc: channels.own_doc(),
            near_quads,
            own_quads,
            tap_table: style.tap_table && taps > 0,
            tap_quads,
            weights,
            radius: plan.support().radius,
            dilation: plan.window().dilation,
            columns,
            strip,
            functions: functions(&written, style.dialect),
            at_i,
            at_j,
            tap,
            per_pixel,
            tap_lines,
            tap_results: tap_results.join(", "),
            pixel_lines,
            pixel_results: pixel_results.join(", "),
            signature: signature.join(", "),
            arguments: arguments.join(", "),
            weight_type: match weights {
                1 => "f32".to_owned(),
                several => format!("array<f32, {several}>"),
            },
            pair_lines,
            pair_results: match weights {
                1 => pair_results[0].clone(),
                several => format!("array<f32, {several}>({})", pair_results.join(", ")),
            },
            trusted_sum: format!("{TRUSTED_SUM:?}f"),
            trusted_share: format!("{TRUSTED_SHARE:?}f"),
            workgroup,
            read_i: channels.read_i(&i),
            i_values: channels.values_i(&i),
            color_i: channels.color("i", "here"),
            read_j: channels.read_j(),
            j_values: channels.values_j(),
            color_j: channels.color("j", "there"),
            tap_values: (0..taps).map(|k| component("t", k)).collect::<Vec<_>>().join(", "),
            signed: plan.signed(),
        };
        let text = kernel.render().expect("writing to a string cannot fail");
        let workgroup_bytes = if style.loads.is_tiled() { strip * near_quads * 16 } else { 0 };
        Self { text, near, own, tap_quads, workgroup_bytes }
    }

    /// Four-component vectors per pixel in `near`.
    pub(in crate::backend) fn near_quads(&self) -> usize {
        (COLOR + self.near.len()).div_ceil(QUAD)
    }

    /// Four-component vectors per pixel in `own`.
    pub(in crate::backend) fn own_quads(&self) -> usize {
        self.own.len().div_ceil(QUAD)
    }
}

/// The template's slots.
#[derive(Template)]
#[template(path = "filter.wgsl", escape = "none")]
struct FilterTemplate {
    loads: Loads,
    near_doc: Vec<String>,
    own_doc: Vec<String>,
    near_quads: usize,
    own_quads: usize,
    tap_table: bool,
    tap_quads: usize,
    weights: usize,
    radius: u32,
    dilation: u32,
    columns: usize,
    strip: usize,
    functions: String,
    at_i: Vec<String>,
    at_j: Vec<String>,
    tap: Vec<String>,
    per_pixel: Vec<String>,
    tap_lines: String,
    tap_results: String,
    pixel_lines: String,
    pixel_results: String,
    signature: String,
    arguments: String,
    weight_type: String,
    pair_lines: String,
    pair_results: String,
    trusted_sum: String,
    trusted_share: String,
    workgroup: [u32; 2],
    read_i: String,
    i_values: String,
    color_i: String,
    read_j: String,
    j_values: String,
    color_j: String,
    tap_values: String,
    signed: bool,
}

impl FilterTemplate {
    /// One of the weights that `w` holds.
    fn element(&self, k: &usize) -> String {
        match self.weights {
            1 => "w".to_owned(),
            _ => format!("w[{k}]"),
        }
    }
}

/// Where the channels of a pixel stand.
struct Channels<'a> {
    loads: Loads,
    near: &'a [PlaneId],
    own: &'a [PlaneId],
    near_quads: usize,
}

impl Channels<'_> {
    /// What `near` holds, for readers of the shader.
    fn near_doc(&self) -> Vec<String> {
        let planes = self.near.iter().map(|plane| plane.identifier());
        let names: Vec<String> =
            ["red", "green", "blue"].map(str::to_owned).into_iter().chain(planes).collect();
        let order = match self.loads {
            Loads::Planar => {
                "What is read at every pixel of the window, one plane after the other:"
            }
            Loads::Packed | Loads::Tiled => {
                "What is read at every pixel of the window, pixel by pixel, row by row:"
            }
        };
        std::iter::once(order.to_owned()).chain(lines_of(&names)).collect()
    }

    fn own_doc(&self) -> Vec<String> {
        let names: Vec<String> = self.own.iter().map(|plane| plane.identifier()).collect();
        let order = "What is read at the filtered pixels alone, in the order of `result`:";
        std::iter::once(order.to_owned()).chain(lines_of(&names)).collect()
    }

    /// A channel of `near` at the pixel called `side` (`i` or `j`).
    fn near(&self, side: &str, place: &str, channel: usize) -> String {
        match self.loads {
            Loads::Planar => format!("near[{channel}u * plane + {place}]"),
            Loads::Packed | Loads::Tiled => component(side, channel),
        }
    }

    fn color(&self, side: &str, place: &str) -> String {
        match self.loads {
            Loads::Planar => {
                let channels = [0, 1, 2].map(|channel| self.near(side, place, channel));
                format!("vec3<f32>({})", channels.join(", "))
            }
            Loads::Packed | Loads::Tiled => format!("{side}0.xyz"),
        }
    }

    fn read_i(&self, planes: &BTreeSet<PlaneId>) -> String {
        let mut lines = Vec::new();
        if !self.loads.is_planar() {
            let used: BTreeSet<usize> = std::iter::once(0)
                .chain(planes.iter().filter_map(|plane| self.channel(*plane)).map(|c| c / QUAD))
                .collect();
            let quads = self.near_quads;
            lines.extend(used.iter().map(|q| format!("let i{q} = near[here * {quads}u + {q}u];")));
        }
        let quads = self.own.len().div_ceil(QUAD);
        lines.extend((0..quads).map(|q| format!("let o{q} = own[index * {quads}u + {q}u];")));
        lines.join("\n")
    }

    fn values_i(&self, planes: &BTreeSet<PlaneId>) -> String {
        let value = |plane: &PlaneId| match self.channel(*plane) {
            Some(channel) => self.near("i", "here", channel),
            None => {
                let at = self.own.iter().position(|other| other == plane);
                component("o", at.expect("what is not read at j is read at i alone"))
            }
        };
        planes.iter().map(value).collect::<Vec<_>>().join(", ")
    }

    fn read_j(&self) -> String {
        let quads = self.near_quads;
        let line = |q| match self.loads {
            Loads::Planar => None,
            Loads::Packed => Some(format!("let j{q} = near[there * {quads}u + {q}u];")),
            Loads::Tiled => Some(format!("let j{q} = strip[there * {quads}u + {q}u];")),
        };
        (0..quads).filter_map(line).collect::<Vec<_>>().join("\n")
    }

    fn values_j(&self) -> String {
        let channels = (0..self.near.len()).map(|k| self.near("j", "there", COLOR + k));
        channels.collect::<Vec<_>>().join(", ")
    }

    fn channel(&self, plane: PlaneId) -> Option<usize> {
        Some(COLOR + self.near.iter().position(|other| *other == plane)?)
    }
}

/// The k-th of the numbers in the vectors `name0`, `name1`, …
fn component(name: &str, k: usize) -> String {
    format!("{name}{}.{}", k / QUAD, ["x", "y", "z", "w"][k % QUAD])
}

/// The fields of a tap. The offsets themselves are called so, the first time:
/// plans that share nothing have them several times.
fn tap_fields(tape: &Tape) -> Vec<String> {
    let mut fields: Vec<String> = Vec::new();
    for (k, result) in tape.results().iter().enumerate() {
        let name = match tape.instr(*result) {
            Instr::Input(Input::Offset(Axis::X)) => Some("dx"),
            Instr::Input(Input::Offset(Axis::Y)) => Some("dy"),
            Instr::Input(_) | Instr::Const(_) | Instr::Prim(..) => None,
        };
        let name = name.map(str::to_owned).filter(|name| !fields.contains(name));
        fields.push(name.unwrap_or_else(|| format!("v{k}")));
    }
    fields
}

fn numbered(count: usize) -> Vec<String> {
    (0..count).map(|k| format!("v{k}")).collect()
}

fn fields(planes: &BTreeSet<PlaneId>) -> Vec<String> {
    planes.iter().map(|plane| plane.identifier()).collect()
}

/// Names, a few to the line.
fn lines_of(names: &[String]) -> impl Iterator<Item = String> + '_ {
    names.chunks(QUAD).map(|names| format!("    {}", names.join(", ")))
}
