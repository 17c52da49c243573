//! Filters as equations: a snippet for a document that loads amsmath.
//!
//! Equation 1 of the paper and the weight, a product on as many lines as it has
//! factors, followed by a sentence on every symbol. How an expression is typeset
//! is [`crate::expr::text`]'s business.

use std::fmt::Write;

use super::header::{self, fill};
use super::{Subject, term::Term};
use crate::expr::feature::{Feature, Quantity};
use crate::expr::op::Op;
use crate::expr::symbol::Symbol;
use crate::expr::text::latex_factors;
use crate::expr::tree::Tree;

/// Equation 1, with the neighbourhood that the text explains.
const EQUATION_1: &str = r"\begin{equation}
  \hat{c}_i = \frac{\sum_{j \in \mathcal{N}(i)} c_j \, w(i, j)}
                   {\sum_{j \in \mathcal{N}(i)} w(i, j)}
\end{equation}
";

/// The snippet.
pub(super) fn text(subject: &Subject<'_>) -> String {
    let mut comments = header::lines(subject, |term| term.spelling().to_owned());
    for op in Op::ALL.iter().copied().filter(|&op| is_unusual(op, subject.weight)) {
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

    text.push_str(EQUATION_1);
    text.push_str(&weight(subject.weight));
    let mut explained = Vec::new();
    fill(&mut explained, 0, &explanation(subject));
    for line in explained {
        let _ = writeln!(text, "{line}");
    }
    text
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
