//! C99 of a program: a function per kernel of its schedule, and one that runs them over planes.
//!
//! Every kernel computes what the CPU executor does, value by value in the same order, so that
//! whole images equal the interpreter's bit for bit. It computes whole images, one kernel after
//! the other; planes stand where [`Program::places`] puts them.

mod code;
mod kernel;

use std::collections::BTreeMap;
use std::fmt::Write;

use askama::Template;

use super::weight::BIT_TRICKS;
use super::{COMPILING, declarator};
use crate::export::header;
use crate::export::names::Names;
use crate::export::program::ProgramSubject;
use crate::export::term::Term;
use crate::expr::symbol::StagePlane;
use crate::filter::stages;
use crate::plan::{Output, Places};

use code::Shared;

/// A program's code, and the header for who calls it.
pub(crate) struct Text {
    pub(crate) code: String,
    pub(crate) header: String,
}

#[derive(Template)]
#[template(path = "c/frame.c", escape = "none")]
struct FrameTemplate<'a> {
    name: &'a str,
    upper: &'a str,
    full: usize,
    half: usize,
    places: bool,
    means: bool,
    doubles: bool,
}

#[derive(Template)]
#[template(path = "c/filter.c", escape = "none")]
struct FilterTemplate<'a> {
    name: &'a str,
    upper: &'a str,
    /// The pointers among the inputs.
    images: Vec<String>,
    kernels: &'a [String],
    outputs: Vec<String>,
}

/// Writes kernels.
struct Writer<'a> {
    subject: &'a ProgramSubject<'a>,
    places: Places,
    shared: Shared<'a>,
    /// The prefix of macros.
    upper: String,
    /// What planes are called.
    called: BTreeMap<StagePlane, String>,
    /// The functions of the kernels so far, in order, and their texts.
    functions: Vec<String>,
    texts: Vec<String>,
    /// Which helpers kernels call.
    places_used: bool,
    means_used: bool,
    doubles_used: bool,
}

/// The files.
pub(crate) fn text(subject: &ProgramSubject<'_>) -> Text {
    let (program, name) = (&subject.program, subject.identifier.as_str());
    let trees = program.filter.stages.iter().flat_map(|stage| stage.trees());
    // The numbers that formulas write out.
    let literals = trees.flat_map(|tree| tree.symbols().iter().filter_map(|s| s.number()));
    let literals: Vec<f32> = literals.collect();
    let mut shared = Shared::new(name, &program.filter.constants, &literals);
    for taken in ["run", "inputs", "filter", "scratch", "full", "half", "at", "kept", "quarter"] {
        shared.names.unique(format!("{name}_{taken}"));
    }
    for (prim, _) in BIT_TRICKS {
        shared.names.unique(format!("{name}_{}", format!("{prim:?}").to_lowercase()));
    }
    let mut writer = Writer {
        subject,
        places: program.places(),
        shared,
        upper: name.to_ascii_uppercase(),
        called: called(subject),
        functions: Vec::new(),
        texts: Vec::new(),
        places_used: false,
        means_used: false,
        doubles_used: false,
    };
    for (k, kernel) in program.kernels.iter().enumerate() {
        writer.kernel(k, kernel);
    }
    let interface = writer.interface();
    Text { code: writer.code(&interface), header: writer.header(&interface) }
}

/// A name for every plane that kernels write.
fn called(subject: &ProgramSubject<'_>) -> BTreeMap<StagePlane, String> {
    let mut names = Names::default();
    let stages = subject.checked.stages();
    let planes = subject.program.kernels.iter().flat_map(|kernel| kernel.writes());
    planes
        .map(|plane| {
            let k = usize::from(plane.stage);
            let name = match stages.get(k) {
                Some(stage) if plane.component == stage.width => format!("{}_variance", stage.name),
                Some(stage) => format!("{}_{}", stage.name, plane.component),
                None => format!("inner{}_{}", k - stages.len(), plane.component),
            };
            (plane, names.unique(name))
        })
        .collect()
}

impl Writer<'_> {
    /// The stage that a plane belongs to, if the filter names it.
    fn stage(&self, plane: StagePlane) -> Option<&str> {
        let stages = self.subject.checked.stages();
        stages.get(usize::from(plane.stage)).map(|stage| stage.name.as_str())
    }

    fn terms(&self) -> Vec<Term> {
        Term::of_planes(&self.subject.program.inputs)
    }

    /// The declarations that the code and the header share.
    fn interface(&self) -> String {
        let name = self.shared.prefix;
        let mut text = format!(
            "#ifndef {0}_H\n#define {0}_H\n\n#include <stddef.h>\n\n\
             /* Images of width * height numbers each, row by row from the top left; and numbers\n   \
             for the whole image. */\nstruct {name}_inputs {{\n",
            self.upper
        );
        for term in self.terms().into_iter().filter(|term| term.is_image()) {
            let kind = if term.row().per_image { "float " } else { "const float *" };
            let _ = writeln!(text, "    {kind}{};", declarator(term));
        }
        let _ = write!(
            text,
            "    float exposure; /* the filtered colours are multiplied by it */\n}};\n\n\
             #ifdef __cplusplus\nextern \"C\" {{\n#endif\n\n\
             size_t {name}_scratch(size_t width, size_t height);\n\
             int {name}_filter(size_t width, size_t height, const struct {name}_inputs *in, \
             float *rgb, float *scratch);\n\n\
             #ifdef __cplusplus\n}}\n#endif\n\n#endif\n"
        );
        text
    }

    fn code(&self, interface: &str) -> String {
        let Self { subject, shared, .. } = self;
        let name = shared.prefix;
        let mut lines = header::program_lines(subject, declarator);
        lines.extend(COMPILING.iter().map(|&line| line.to_owned()));
        lines.push(
            "Threads: with -fopenmp. `scratch` is where planes stand between kernels.".to_owned(),
        );
        lines.extend([String::new(), "The stages:".to_owned()]);
        lines.extend(stages(&subject.checked).lines().map(str::to_owned));
        let mut text = commented(&lines);
        text.push('\n');
        text.push_str(interface);
        text.push_str("\n#include <math.h>\n#include <stdint.h>\n#include <string.h>\n");
        text.push_str(&shared.declarations());
        text.push('\n');
        let frame = FrameTemplate {
            name,
            upper: &self.upper,
            full: self.places.full,
            half: self.places.half,
            places: self.places_used,
            means: self.means_used,
            doubles: self.doubles_used,
        };
        text.push_str(&frame.render().expect("nothing fails that writes into a string"));
        text.push('\n');
        for (_, helper) in BIT_TRICKS.iter().filter(|(prim, _)| shared.calls(*prim)) {
            text.push('\n');
            text.push_str(&helper.replace("NAME", name));
        }
        for kernel in &self.texts {
            let _ = writeln!(text, "\n{kernel}");
        }
        let images =
            self.terms().into_iter().filter(|term| term.is_image() && !term.row().per_image);
        let images = images.flat_map(|term| match term.components() {
            1 => vec![term.field()],
            components => (0..components).map(|c| format!("{}[{c}]", term.field())).collect(),
        });
        let filter = FilterTemplate {
            name,
            upper: &self.upper,
            images: images.collect(),
            kernels: &self.functions,
            outputs: subject.program.outputs[0].iter().map(|output| self.output(output)).collect(),
        };
        let _ = writeln!(text, "\n{}", filter.render().expect("as above"));
        text
    }

    /// A component of the result at pixel i.
    fn output(&self, output: &Output) -> String {
        match *output {
            Output::Constant(x) => super::weight::constant(x),
            Output::Plane(plane) => {
                let place = self.places.of(plane);
                format!("{}_full(&run, {})[i]", self.shared.prefix, place.number)
            }
        }
    }

    fn header(&self, interface: &str) -> String {
        let mut lines = header::program_lines(self.subject, declarator);
        lines.push(String::new());
        let scratch = format!(
            "{0}_scratch says how many numbers `scratch` must have room for; {0}_filter writes R, G \
             and B of every pixel, one after another, into `rgb`, and returns 0. It returns 1, and \
             writes nothing, for an image that is empty or too large (of which {0}_scratch is 0), \
             and 2 if a pointer is null.",
            self.shared.prefix
        );
        header::fill(&mut lines, 0, &scratch);
        format!("{}\n{interface}", commented(&lines))
    }
}

/// Lines as a comment.
fn commented(lines: &[String]) -> String {
    let mut text = "/*\n".to_owned();
    for line in lines {
        // The filter's name may hold anything.
        let line = line.replace("*/", "* /").replace("/*", "/ *");
        let _ = writeln!(text, "{}", format!("   {line}").trim_end());
    }
    text + "*/\n"
}
