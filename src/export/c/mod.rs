//! C99: the weight function and a kernel around it, for one processor.
//!
//! Every primitive has one expression of C that gives the same bits under IEEE
//! 754, as long as the compiler neither contracts nor reassociates. The kernel
//! sums in the order that [`crate::backend`] states, so whole images equal the
//! interpreter's bit for bit. Taps outside of the image are skipped: they would
//! add zeros.
//!
//! All names start with the filter's, so that several exports may stand in one
//! file. The text is also C++.

mod kernel;
pub(super) mod program;
mod weight;

use std::fmt::Write;

use super::{Subject, header, term::Term};
use crate::expr::tape::{Axis, Input, Side, Tape};

use weight::axis_of;

/// How to compile it.
const COMPILING: &[&str] = &[
    "",
    "C99. For the same bits as Tamis compile with -ffp-contract=off, which gcc's",
    "-std=c99 implies, and without -ffast-math. For speed compile with",
    "-march=native or -mfma: elsewhere on x86, fmaf is a slow library call.",
];

/// The file.
pub(super) fn text(subject: &Subject<'_>) -> String {
    let source = Source::of(subject);
    let mut text = source.comment();
    text.push_str(&source.includes());
    text.push_str(&source.structs());
    for (_, helper) in source.bit_tricks() {
        text.push('\n');
        text.push_str(&helper.replace("NAME", source.name));
    }
    text.push_str(&source.weight());
    text.push_str(&source.kernel());
    text
}

/// What is written, and what of it the weight reads: no more than that is
/// declared, as compilers warn of what is not used.
struct Source<'a> {
    subject: &'a Subject<'a>,
    name: &'a str,
    tape: &'a Tape,
    terms: Vec<Term>,
    reads_i: bool,
    reads_j: bool,
    reads_dx: bool,
    reads_dy: bool,
}

impl<'a> Source<'a> {
    fn of(subject: &'a Subject<'a>) -> Self {
        let tape = subject.plan.pair();
        let reads_side =
            |side| tape.inputs().any(|input| matches!(input, Input::Plane(_, s) if s == side));
        let reads_axis = |axis| tape.inputs().any(|input| axis_of(subject, input) == Some(axis));
        Self {
            subject,
            name: &subject.identifier,
            tape,
            terms: Term::of(&subject.plan),
            reads_i: reads_side(Side::I),
            reads_j: reads_side(Side::J),
            reads_dx: reads_axis(Axis::X),
            reads_dy: reads_axis(Axis::Y),
        }
    }

    fn comment(&self) -> String {
        let mut text = "/*\n".to_owned();
        for line in header::lines(self.subject, declarator)
            .iter()
            .map(String::as_str)
            .chain(COMPILING.iter().copied())
        {
            // The filter's name may hold anything.
            let line = line.replace("*/", "* /").replace("/*", "/ *");
            let _ = writeln!(text, "{}", format!("   {line}").trim_end());
        }
        text + "*/\n\n"
    }

    fn includes(&self) -> String {
        let bits = self.bit_tricks().next().is_some();
        let mut headers = vec!["math.h", "stddef.h"];
        if bits {
            headers.extend(["stdint.h", "string.h"]);
        }
        headers.iter().map(|header| format!("#include <{header}>\n")).collect()
    }

    fn structs(&self) -> String {
        let name = self.name;
        let mut text = String::new();
        if !self.terms.is_empty() {
            let _ = writeln!(
                text,
                "\n/* What the weight looks at of a pixel. */\nstruct {name}_features {{"
            );
            for &term in &self.terms {
                let _ = writeln!(text, "    float {};", declarator(term));
            }
            text.push_str("};\n");
        }
        let _ = writeln!(
            text,
            "\n/* Images of width * height numbers each, row by row from the top left. */\n\
             struct {name}_images {{\n    int width;\n    int height;\n    \
             const float *noisy[3]; /* linear R, G, B: what is averaged */"
        );
        for term in self.images() {
            let _ = writeln!(text, "    const float *{};", declarator(term));
        }
        text + "};\n"
    }

    /// The terms that images are supplied for.
    fn images(&self) -> impl Iterator<Item = Term> {
        self.terms.iter().copied().filter(|term| term.is_image())
    }

    /// The terms that follow from a pixel's place.
    fn places(&self) -> impl Iterator<Item = Term> {
        self.terms.iter().copied().filter(|term| !term.is_image())
    }
}

/// A field's name with its number of components.
fn declarator(term: Term) -> String {
    match term.components() {
        1 => term.field(),
        components => format!("{}[{components}]", term.field()),
    }
}

/// Those of some texts that there is a reason for.
fn list<const N: usize>(texts: [(bool, &str); N]) -> String {
    let wanted = texts.into_iter().filter_map(|(wanted, text)| wanted.then_some(text));
    wanted.collect::<Vec<_>>().join(", ")
}
