//! `tamis language`: what expressions are made of, read off the tables.

use clap::Args;

use super::error::Error;
use crate::expr::op::{Op, Sort, Syntax};
use crate::expr::symbol::Variadic;
use crate::expr::{Feature, Quantity};
use crate::plan::PASSES;
use crate::report::{Align, Format, Table};

const EXAMPLES: &str = "\
Examples:
  tamis language
  tamis language --markdown > LANGUAGE.md";

/// Explain the operators and features of expressions.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Language {
    /// Print Markdown
    #[arg(long)]
    markdown: bool,
}

impl Language {
    pub(super) fn run(&self) -> Result<String, Error> {
        let format = if self.markdown { Format::Markdown } else { Format::Plain };
        let heading = |title: &str| match format {
            Format::Markdown => format!("\n## {title}\n\n"),
            Format::Plain => format!("\n{title}\n\n"),
        };
        let intro = "The weight of pixel j in the filtered colour of pixel i is an expression. \
                     A vector function\ntakes its first operand at pixel i and its second at \
                     pixel j: `distance2(normal, normal)`.\nVariances are read at pixel i. Every \
                     operator gives a finite number for all operands.\n";
        Ok([
            intro.to_owned(),
            heading("Operators"),
            operators(format).render(format),
            heading("Features"),
            features(format).render(format),
            heading("Numbers"),
            "Decimals (`0.05`, `1e-3`) and `pi`. `#` starts a comment.\n".to_owned(),
            heading("Formulas of programs"),
            PROGRAMS.to_owned(),
            functions().render(format),
            heading("Passes (denoise --without PASS)"),
            passes().render(format),
        ]
        .concat())
    }
}

const PROGRAMS: &str = "\
The stages of a program (filter files of version 2) are maps and gathers. Their formulas also
have names of earlier stages, of constants and of layers; every operator works on vectors,
component by component, and a number stands for as many components as are wanted.
`x[2]` is a component, counted from 0. In weights, `x[i]` and `x[j]` are looked at at either
pixel (what names neither is at pixel i, and the second operand of a vector function at j),
`offset` is how far j is from i, and `s.variance` the variance of a gather's mean. In maps,
`x[1, -2]` is a column to the right and two rows above; beyond the image its edge stands in.

";

fn functions() -> Table {
    let mut table = Table::new(["function", "meaning"].map(|name| (name, Align::Left)));
    for function in Variadic::ALL {
        table.row([function.name(), function.doc()]);
    }
    table.row(["layer(x)", "W x + b, with the constants of the layer that has this name"]);
    table
}

/// Adds a row, in cells that a terminal has room for.
fn add<const N: usize>(table: &mut Table, cells: [String; N], format: Format) {
    match format {
        Format::Plain => table.wrapped_row(cells, 44),
        Format::Markdown => table.row(cells),
    }
}

fn operators(format: Format) -> Table {
    let columns = ["written", "meaning", "outside of the textbook domain", "error at most"];
    let mut table = Table::new(columns.map(|name| (name, Align::Left)));
    for &op in Op::ALL {
        let row = op.row();
        let operand = |k: usize| match op.operands()[k] {
            Sort::Scalar => ["x", "y"][k],
            Sort::Vector => ["a", "b"][k],
        };
        let operands: Vec<&str> = (0..op.arity()).map(operand).collect();
        let written = match row.syntax {
            Syntax::Call => format!("{}({})", row.name, operands.join(", ")),
            Syntax::Prefix => format!("{}{}", row.name, operands.join(" ")),
            Syntax::Infix(_) => operands.join(&format!(" {} ", row.name)),
        };
        let budget = op.budget();
        let error = match (budget.ulp, budget.absolute) {
            (ulp, 0.0) => format!("{ulp} ulp"),
            (0.0, absolute) => format!("{absolute:.1e}"),
            (ulp, absolute) => format!("{ulp} ulp or {absolute:.1e}"),
        };
        add(&mut table, [written, row.doc.to_owned(), row.edges.to_owned(), error], format);
    }
    table
}

fn features(format: Format) -> Table {
    let columns = ["feature", "gradient", "variance", "width", "channels", "meaning"];
    let mut table = Table::new(columns.map(|name| (name, Align::Left)));
    for feature in Feature::ALL {
        let spelling = |quantity| feature.spelling(quantity).unwrap_or("-").to_owned();
        let [value, gradient, variance] = Quantity::ALL.map(spelling);
        let row = feature.row();
        let channels = match row.channels {
            [] => "-".to_owned(),
            channels => channels.join(" "),
        };
        let width = row.width.to_string();
        add(&mut table, [value, gradient, variance, width, channels, row.doc.to_owned()], format);
    }
    table
}

fn passes() -> Table {
    let columns = ["pass", "what it does", "results with and without it"];
    let mut table = Table::new(columns.map(|name| (name, Align::Left)));
    for pass in PASSES {
        let exact = if pass.exact { "the same bits" } else { "agree within rounding" };
        table.row([pass.name, pass.doc, exact]);
    }
    table
}
