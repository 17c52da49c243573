//! Filters as equations: a snippet for a document that loads amsmath.
//!
//! Equation 1 of the paper and the weight, a product on as many lines as it has
//! factors, followed by a sentence on every symbol. How an expression is typeset
//! is [`crate::expr::text`]'s business.

use std::fmt::Write;

use super::header::{self, fill};
use super::program::ProgramSubject;
use super::{Subject, term::Term};
use crate::expr::constants::{Layer, Param};
use crate::expr::feature::{Feature, Quantity};
use crate::expr::op::Op;
use crate::expr::symbol::Symbol;
use crate::expr::text::{Formula, Reads, latex_factors, latex_formula, latex_name};
use crate::expr::tree::Tree;
use crate::filter::{Gather, Grid, StageKind};

/// Equation 1, with the neighbourhood that the text explains.
const EQUATION_1: &str = r"\begin{equation}
  \hat{c}_i = \frac{\sum_{j \in \mathcal{N}(i)} c_j \, w(i, j)}
                   {\sum_{j \in \mathcal{N}(i)} w(i, j)}
\end{equation}
";

/// The snippet.
pub(super) fn text(subject: &Subject<'_>) -> String {
    let comments = header::lines(subject, |term| term.spelling().to_owned());
    let mut text = commented(comments, &[subject.weight]);
    text.push_str(EQUATION_1);
    text.push_str(&weight(subject.weight));
    let mut explained = Vec::new();
    fill(&mut explained, 0, &explanation(subject));
    for line in explained {
        let _ = writeln!(text, "{line}");
    }
    text
}

/// The comment on top, with what operators mean that trees use.
fn commented(mut comments: Vec<String>, trees: &[&Tree]) -> String {
    let used = |op: &Op| trees.iter().any(|tree| is_unusual(*op, tree));
    for op in Op::ALL.iter().copied().filter(used) {
        comments.push(String::new());
        let row = op.row();
        fill(&mut comments, 0, &format!("{}: {}; {}.", row.name, row.doc, row.edges));
    }
    comments.push(String::new());
    comments.push("For documents with \\usepackage{amsmath}.".to_owned());
    let mut text = String::new();
    for line in comments {
        let _ = writeln!(text, "{}", format!("% {line}").trim_end());
    }
    text
}

/// A program: an equation per stage, its layers as matrices, its constants in a line.
pub(super) fn program(subject: &ProgramSubject<'_>) -> String {
    let filter = subject.checked.filter();
    let comments = header::program_lines(subject, |term| term.in_programs().to_owned());
    let trees: Vec<&Tree> = filter.stages.iter().flat_map(|stage| stage.trees()).collect();
    let mut comments = comments;
    comments.push(String::new());
    fill(&mut comments, 0, "On as few pages as can be read (tamis-formula is one), with");
    comments.extend(PREAMBLE.iter().map(|line| format!("    {line}")));
    comments.push("before, and \\end{multicols} and \\end{document} behind.".to_owned());
    let mut text = commented(comments, &trees);
    let mut lines = Vec::new();
    fill(&mut lines, 0, PROGRAM);
    let mut rows: Vec<String> = Vec::new();
    let mut sums = 0;
    for (k, stage) in filter.stages.iter().enumerate() {
        let half = match stage.grid {
            Grid::Full => "",
            Grid::Half => r"^{\downarrow}",
        };
        let name = format!("{}{half}", latex_name(&stage.name));
        let mut typeset = |tree: &Tree, reads| {
            let formula = latex_formula(tree, &subject.checked.scope(k, reads), sums);
            sums += formula.sums.len();
            formula
        };
        match &stage.kind {
            StageKind::Map(value) => equation(&mut rows, &name, &typeset(value, Reads::Pixel)),
            StageKind::Gather(Gather { of, weight, window, variance }) => {
                let Formula { lines, sums } = typeset(of, Reads::Pixel);
                let apart = match window.dilation {
                    1 => String::new(),
                    dilation => format!(r",\, {dilation}"),
                };
                let mut of = lines.join(" ");
                if let Some(variance) = variance {
                    let variance = typeset(variance, Reads::Pixel);
                    equation(&mut rows, &format!(r"{name}\text{{: }}v"), &variance);
                    of.push_str(r",\, v");
                }
                let mean = format!(r"\mathcal{{M}}_{{{}{apart}}}\left({of}\right)", window.radius);
                equation(&mut rows, &name, &Formula { lines: vec![mean], sums });
                if weight.symbols() != [Symbol::constant(1.0)] {
                    equation(&mut rows, "w(i, j)", &typeset(weight, Reads::Pair));
                }
            }
        }
    }
    text.push_str(&lines.join("\n"));
    text.push_str("\n\\begingroup\\allowdisplaybreaks\n\\begin{align}\n  ");
    text.push_str(&rows.join(" \\\\\n  "));
    text.push_str("\n\\end{align}\n");
    for layer in &filter.constants.layers {
        text.push_str(&matrix(layer));
    }
    text.push_str("\\endgroup\n");
    text.push_str(&parameters(&filter.constants.params));
    text
}

/// A document for a program.
const PREAMBLE: &[&str] = &[
    r"\documentclass{article}",
    r"\usepackage{amsmath,multicol}",
    r"\usepackage[a3paper,margin=8mm]{geometry}",
    r"\setlength{\jot}{0pt}\setlength{\columnsep}{3mm}",
    r"\begin{document}",
    r"\begin{multicols}{2}\tiny\noindent",
];

/// What the equations of a program leave to the text.
const PROGRAM: &str = r"Every equation is a stage: a number, or several, at every pixel~$i$, made
of features and of earlier stages. The last one, times the exposure, is the filtered colour.
Functions act on every component; $x[k]$ is component~$k$ of~$x$, counted from~0, and
$x_{i+(u,v)}$ what stands $u$~columns to the right and $v$~rows below. An arrow marks stages of half
the resolution, which read means of two by two pixels and are read bilinearly.
$\mathcal{M}_{r,\,d}(s,\,v)_i = \sum_j s_j\, w(i, j) / \sum_j w(i, j)$ is the mean of~$s$ over the
$(2r+1) \times (2r+1)$ pixels, $d$~apart (1 unless given), around~$i$, by the weight of the next
equation (1 where there is none); its variance is $\sum_j v_j\, w(i, j)^2 / (\sum_j w(i, j))^2$.";

/// Adds the rows of an equation, of which only the last of each is numbered.
fn equation(rows: &mut Vec<String>, name: &str, formula: &Formula) {
    let mut add = |name: &str, lines: &[String]| {
        let last = lines.len() - 1;
        for (k, line) in lines.iter().enumerate() {
            let begin =
                if k == 0 { format!("{name} = {{}} & ") } else { r"& \quad {} ".to_owned() };
            let number = if k == last { "" } else { r" \notag" };
            rows.push(format!("{begin}{line}{number}"));
        }
    };
    add(name, &formula.lines);
    for (name, lines) in &formula.sums {
        add(&format!(r"\text{{where }}{name}"), lines);
    }
}

/// A layer as the matrix and the vector that it is made of.
fn matrix(layer: &Layer) -> String {
    let name = layer.name.replace('_', r"\_");
    let rows: Vec<String> = layer
        .weights
        .iter()
        .map(|row| row.iter().map(f32::to_string).collect::<Vec<_>>().join(" & "))
        .collect();
    let bias: Vec<String> = layer.bias.iter().map(f32::to_string).collect();
    // Environments for matrices end at ten columns.
    format!(
        "\\begin{{equation}}\n  \\operatorname{{{name}}}(x) = \\left(\\begin{{array}}{{*{{{}}}{{r}}}}\n    \
         {}\n  \\end{{array}}\\right) x + \\left(\\begin{{array}}{{r}}\n    {}\n  \
         \\end{{array}}\\right)\n\\end{{equation}}\n",
        layer.columns(),
        rows.join(" \\\\\n    "),
        bias.join(" \\\\ ")
    )
}

/// The constants of a program, as a sentence.
fn parameters(params: &[Param]) -> String {
    if params.is_empty() {
        return String::new();
    }
    let values: Vec<String> = params
        .iter()
        .map(|param| format!("${}={}$", latex_name(&param.name), param.value))
        .collect();
    let mut lines = Vec::new();
    fill(&mut lines, 0, &format!("The constants are {}.", values.join(", ")));
    lines.join("\n") + "\n"
}

/// Whether an operator occurs that has a meaning of its own here, and is typeset
/// by its name.
fn is_unusual(op: Op, weight: &Tree) -> bool {
    op.row().latex.contains(r"\operatorname") && weight.symbols().contains(&Symbol::Op(op))
}

/// w(i, j) = …
fn weight(tree: &Tree) -> String {
    let factors = latex_factors(tree);
    let body = match factors.as_slice() {
        [single] => format!("  w(i, j) = {single}\n"),
        [first, rest @ ..] => {
            let mut lines = format!("  \\begin{{split}}\n    w(i, j) = {{}} & {first}");
            for factor in rest {
                let _ = write!(lines, " \\\\\n    & {{}} \\cdot {factor}");
            }
            lines + "\n  \\end{split}\n"
        }
        [] => unreachable!("an expression has at least one factor"),
    };
    format!("\\begin{{equation}}\n{body}\\end{{equation}}\n")
}

/// What the symbols mean.
fn explanation(subject: &Subject<'_>) -> String {
    let window = subject.plan.window();
    let diameter = window.diameter();
    let apart = match window.dilation {
        1 => String::new(),
        dilation => format!(", {dilation} pixels apart,"),
    };
    let mut text = format!(
        "Here $c_j$ is the noisy colour of pixel~$j$, $\\hat{{c}}_i$ the filtered colour of \
         pixel~$i$, and $\\mathcal{{N}}(i)$ are the ${diameter} \\times {diameter}$ pixels{apart} \
         around~$i$."
    );
    let read = |feature, quantity| {
        let symbol = Symbol::of(feature, quantity);
        symbol.is_some_and(|symbol| subject.weight.symbols().contains(&symbol))
    };
    let terms = Feature::terms().filter(|&(feature, quantity)| read(feature, quantity));
    let described: Vec<String> = terms
        .map(|(feature, quantity)| {
            let term = Term { feature, quantity };
            let (name, doc) = (term.row().name, term.row().doc);
            let what = match quantity {
                Quantity::Value => doc.to_owned(),
                Quantity::Gradient => {
                    format!(r"magnitude of the gradient of each component of $\mathrm{{{name}}}$ ({doc})")
                }
                Quantity::Variance => format!(r"variance of $\mathrm{{{name}}}$ ({doc}), at pixel~$i$"),
            };
            format!(r"$\mathrm{{{}}}$: {what}", term.spelling())
        })
        .collect();
    if !described.is_empty() {
        let _ = write!(text, " Features of a pixel: {}.", described.join("; "));
    }
    text
}
