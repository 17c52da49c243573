//! The comment on top: what to supply, as in every export, and how the kernel is
//! called, which nothing else says.
//!
//! Every line is a comment of its own. The filter's name stands escaped and quoted
//! in the middle of one: so no name holds what ends a line in any language, nor
//! the backslash at a line's end that would continue it.

use std::fmt::Write;

use super::valid::{Access, Valid};
use crate::backend::ACCURACY;
use crate::backend::FAST_ACCURACY;
use crate::backend::shader::{QUAD, Shader};
use crate::export::header::{self, fill};
use crate::export::term::Term;
use crate::export::{Shading, Subject};
use crate::expr::feature::PlaneId;
use crate::plan::Precision;

/// What is told to whoever calls a kernel.
pub(super) struct Caller<'a> {
    pub(super) subject: &'a Subject<'a>,
    pub(super) shader: &'a Shader,
    pub(super) valid: &'a Valid,
    pub(super) workgroup: [u32; 2],
    pub(super) precision: Precision,
}

impl Caller<'_> {
    /// The comment, for a language in which the kernel is called that.
    pub(super) fn comment(&self, language: Shading, kernel: &str) -> String {
        let mut lines = header::lines(self.subject, planes_of);
        let mut paragraphs = vec![self.call(kernel)];
        paragraphs.extend(self.buffers(language));
        paragraphs.push(self.regions());
        paragraphs.push(self.arithmetic(language));
        paragraphs.extend(remark(language).map(str::to_owned));
        for paragraph in paragraphs {
            lines.push(String::new());
            for (k, text) in paragraph.split('\n').enumerate() {
                fill(&mut lines, if k == 0 { 0 } else { 4 }, text);
            }
        }
        let mut text = String::new();
        for line in lines {
            let _ = writeln!(text, "{}", format!("// {line}").trim_end());
        }
        text
    }

    /// What the functions are, and how many invocations it takes.
    fn call(&self, kernel: &str) -> String {
        let [columns, rows] = self.workgroup;
        let offset = match self.subject.plan.tap().results() {
            [] => "",
            [_, ..] => ", where `Tap` leads from i to j in pixels to the right and down",
        };
        format!(
            "The function `weight` is w(i, j){offset}. The kernel `{kernel}` filters a pixel per \
             invocation, in workgroups of {columns} x {rows} x 1: dispatch ceil(size.x / \
             {columns}) x ceil(size.y / {rows}) x 1 of them. Its buffers, floats and integers of \
             32 bits:"
        )
    }

    /// A paragraph per buffer; lines after its first say what stands in it.
    fn buffers(&self, language: Shading) -> Vec<String> {
        let slot = |name| self.slot(language, name);
        let zero = match self.shader.text.contains("params.zero") {
            true => "0, of which the compiler must not know: `pinned` keeps roundings with it",
            false => "0, and not read",
        };
        let mut paragraphs = vec![format!(
            "{}: `params`, 8 integers\n\
             region.x, region.y: width and height of what `near` holds\n\
             origin.x, origin.y: column and row in it of the first pixel to be filtered\n\
             size.x, size.y: how many columns and rows of them there are\n\
             first: the position of the first of them in `result`\n\
             zero: {zero}",
            slot("params")
        )];
        let color = ["red", "green", "blue"].map(str::to_owned);
        let near = self.shader.near.iter().map(|plane| plane.identifier());
        let near: Vec<String> = color.into_iter().chain(near).collect();
        let own: Vec<String> = self.shader.own.iter().map(|plane| plane.identifier()).collect();
        for (name, channels, order) in [
            ("near", near, "per pixel of the region, row by row from the top left"),
            ("own", own, "per filtered pixel, in the order of `result`"),
        ] {
            if !channels.is_empty() {
                let floats = channels.len().next_multiple_of(QUAD);
                let quads = channels.chunks(QUAD).map(quad).collect::<String>();
                paragraphs
                    .push(format!("{}: `{name}`, {floats} floats {order}{quads}", slot(name)));
            }
        }
        paragraphs.push(format!(
            "{}: `result`, 4 floats per filtered pixel, row by row\n\
             filtered red, green, blue; and 0, or 1 where the weights sum to nothing that can be \
             trusted and the noisy colour was kept",
            slot("result")
        ));
        paragraphs
    }

    /// Where a buffer is bound, as a language says it.
    fn slot(&self, language: Shading, name: &str) -> String {
        let buffers = self.valid.buffers();
        let buffer = buffers.iter().find(|buffer| buffer.name == name).expect("kernels have it");
        let (group, number) = (buffer.binding.group, buffer.binding.binding);
        let (access, register) = match buffer.access {
            Access::Uniform => ("uniform", "b"),
            Access::Read => ("read-only storage", "t"),
            Access::Write => ("storage", "u"),
        };
        match language {
            Shading::Wgsl => format!("group {group}, binding {number}, {access}"),
            Shading::Glsl | Shading::Spirv => format!("set {group}, binding {number}, {access}"),
            Shading::Hlsl => format!("register {register}{number}"),
            Shading::Msl => format!("buffer {number}"),
        }
    }

    /// What the region is, for images that are filtered at once and in parts.
    fn regions(&self) -> String {
        let reach = self.subject.plan.support().reach();
        format!(
            "A whole image is one region: region and size are its width and height, origin and \
             first are 0. A part of an image needs a region with {reach} pixels more on every \
             side, if the image has them. No access is checked."
        )
    }

    /// What is assumed of the device, and what comes of it.
    fn arithmetic(&self, language: Shading) -> String {
        match self.precision {
            Precision::Standard => format!(
                "Exported with --precision standard: within {ACCURACY:e} of the exact colour, where \
                 weights have one sign, on devices that round +, -, *, /, sqrt and fma once, as \
                 IEEE 754 does.{}",
                condition(language)
            ),
            Precision::Fast => format!(
                "Exported with --precision fast: within {FAST_ACCURACY:e} of the exact colour, \
                 where weights have one sign. Devices may round, fuse and reorder as they like."
            ),
        }
    }
}

/// The line of a vector's components.
fn quad(channels: &[String]) -> String {
    let unused = std::iter::repeat_n("unused", QUAD - channels.len());
    let names: Vec<&str> = channels.iter().map(String::as_str).chain(unused).collect();
    format!("\n{}", names.join(", "))
}

/// What a term's numbers are called.
fn planes_of(term: Term) -> String {
    let planes = PlaneId::of(term.feature, term.quantity).map(PlaneId::identifier);
    planes.collect::<Vec<_>>().join(", ")
}

/// What is special to a language.
fn remark(language: Shading) -> Option<&'static str> {
    match language {
        Shading::Wgsl | Shading::Spirv => None,
        Shading::Glsl => Some(
            "For Vulkan or OpenGL 4.5. Buffers are called by their bindings here: `near` is \
             `_group_0_binding_1_cs`.",
        ),
        Shading::Hlsl => Some("For shader model 6.0: dxc -T cs_6_0 -E main."),
        Shading::Msl => Some(
            "For Metal 2.1. The last argument, `_buffer_sizes`, is not read and need not be bound.",
        ),
    }
}

/// What must be seen to in a language, so that arithmetic is as assumed.
fn condition(language: Shading) -> &'static str {
    match language {
        Shading::Wgsl | Shading::Glsl | Shading::Spirv => "",
        Shading::Hlsl => " Here fma is called mad, and must be fused.",
        Shading::Msl => " So compile without fast math (-fno-fast-math).",
    }
}
