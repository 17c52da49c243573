//! What whoever pastes an export must know: the first lines of every text.
//!
//! The filter, its window, and for everything that its weight looks at what the
//! renderer must supply, in which units. All of it is read off the feature table
//! and off what `scene` says of its own scales.

use super::Subject;
use super::program::ProgramSubject;
use super::term::Term;
use crate::expr::builder::LIMIT;
use crate::expr::feature::{Feature, Quantity, Unit};
use crate::filter::StandIn;
use crate::scene::{derive, normalize};

/// Columns of a line, its comment marks not counted.
const WIDTH: usize = 76;

/// A comma and a blank that no line breaks at: operands stay together.
const JOINED: &str = ",\u{a0}";

/// The header: lines without comment marks, in which `called` names terms. The
/// filter's name stands among them escaped and quoted, so it holds no line break;
/// beyond that, a language must see to it that no line ends its comment.
pub(super) fn lines(subject: &Subject<'_>, called: impl Fn(Term) -> String) -> Vec<String> {
    let window = subject.plan.support();
    let diameter = window.diameter();
    let apart = match window.dilation {
        1 => String::new(),
        dilation => format!(", {dilation} pixels apart"),
    };
    // The name is not wrapped: it would not be the same with another blank in it.
    let mut lines = vec![format!("Filter {:?}, exported by Tamis.", subject.name), String::new()];
    lines.push("The weight of pixel j in the filtered colour of pixel i:".to_owned());
    lines.push(String::new());
    let weight = subject.weight.to_string().replace(", ", JOINED);
    fill(&mut lines, 4, &weight);
    lines.push(String::new());
    let farther = match window.radius < subject.plan.window().radius {
        true => " Those farther away that the filter names have no weight.",
        false => "",
    };
    let around = format!(
        "Pixel j is one of the {diameter} x {diameter} around pixel i{apart}, if the image has it.{farther}"
    );
    let averaged = "The colours that are averaged stay as they were rendered: linear R, G, B.";
    fill(&mut lines, 0, &format!("{around} {averaged}"));

    let terms = Term::of(&subject.plan);
    if terms.is_empty() {
        return lines;
    }
    lines.push(String::new());
    let limit = format!("finite, within +-{LIMIT:e}, gradients and variances not negative");
    let looks = format!("The weight looks at these numbers of a pixel ({limit}):");
    fill(&mut lines, 0, &looks);
    for &term in &terms {
        lines.push(String::new());
        lines.push(called(term));
        fill(&mut lines, 4, &described(term));
    }
    for definition in definitions(&terms) {
        lines.push(String::new());
        fill(&mut lines, 0, definition);
    }
    lines
}

/// The header of a program, likewise.
pub(super) fn program_lines(
    subject: &ProgramSubject<'_>,
    called: impl Fn(Term) -> String,
) -> Vec<String> {
    let program = &subject.program;
    let mut lines = vec![format!("Filter {:?}, exported by Tamis.", subject.name), String::new()];
    let stages = match program.filter.stages.len() {
        1 => "one stage".to_owned(),
        stages => format!("{stages} stages"),
    };
    let whole = format!(
        "A program of {stages}. A filtered pixel hangs on what lies up to {} pixels beside \
         it. Colours are linear R, G, B.",
        program.halo()
    );
    fill(&mut lines, 0, &whole);
    let terms = Term::of_planes(&program.inputs);
    let images: Vec<Term> = terms.iter().copied().filter(|term| term.is_image()).collect();
    if !images.is_empty() {
        lines.push(String::new());
        let limit = format!("finite, within +-{LIMIT:e}, gradients and variances not negative");
        let looks = format!("It looks at these numbers of pixels ({limit}):");
        fill(&mut lines, 0, &looks);
    }
    for term in images {
        lines.push(String::new());
        lines.push(called(term));
        let whole = if term.row().per_image { " One number for the whole image." } else { "" };
        fill(&mut lines, 4, &format!("{}{whole}", described(term)));
    }
    let light = Term { feature: Feature::Color, quantity: Quantity::Value };
    let with_light: Vec<Term> = terms.iter().copied().chain([light]).collect();
    for definition in definitions(&with_light) {
        lines.push(String::new());
        fill(&mut lines, 0, definition);
    }
    for (feature, stand_in) in subject.optional() {
        let what = match stand_in {
            StandIn::Constant(x) => x.to_string(),
            StandIn::Feature(other) => format!("`{}`", term_of(other)),
        };
        let name = term_of(feature);
        lines.push(String::new());
        let text = match subject.without.contains(&feature) {
            true => format!("Absent: `{name}`. Instead of it, the code has {what}."),
            false => format!(
                "A renderer without `{name}` exports with `--without {name}`: then {what} stands \
                 in for it."
            ),
        };
        fill(&mut lines, 0, &text);
    }
    lines
}

/// What programs call a feature.
fn term_of(feature: Feature) -> &'static str {
    Term { feature, quantity: Quantity::Value }.in_programs()
}

/// What a term is, and how it is brought into its unit.
fn described(term: Term) -> String {
    let row = term.row();
    let bounded = row.bounds.map_or_else(String::new, |[lo, hi]| {
        format!(" Clamp each component to [{lo},\u{a0}{hi}].")
    });
    let (values, squares) = match row.unit {
        Unit::Own => (&*bounded, ""),
        Unit::Place => (
            " Subtract the centre and divide by the extent; 0 where nothing is hit.",
            " Divide it by the square of the extent.",
        ),
        Unit::Length => (
            " Divide by the extent; 0 where nothing is hit.",
            " Divide it by the square of the extent.",
        ),
        Unit::Light => (" Divide by the exposure.", " Divide it by the square of the exposure."),
    };
    match term.quantity {
        Quantity::Value => format!("{}.{values}", capitalized(row.doc)),
        Quantity::Gradient => {
            let unit = match values {
                "" => String::new(),
                values => format!(" Of the values in their unit:{values}"),
            };
            format!("Gradient of `{}` ({}): {}.{unit}", row.name, row.doc, derive::GRADIENT)
        }
        Quantity::Variance => format!(
            "Variance of `{}` ({}): that of the pixel's mean, averaged over the components.{squares}",
            row.name, row.doc
        ),
    }
}

/// The scales that the terms are measured in, and where variances come from.
fn definitions(terms: &[Term]) -> impl Iterator<Item = &'static str> {
    let measured = |units: &[Unit]| terms.iter().any(|term| units.contains(&term.row().unit));
    let values = |term: &&Term| term.quantity != Quantity::Variance;
    let centered = terms.iter().filter(values).any(|term| term.row().unit == Unit::Place);
    let estimated = terms.iter().any(|term| term.quantity == Quantity::Variance);
    [
        (centered, normalize::CENTER),
        (measured(&[Unit::Place, Unit::Length]), normalize::EXTENT),
        (measured(&[Unit::Light]), normalize::EXPOSURE),
        (estimated, derive::ESTIMATE),
        (terms.iter().any(|term| term.feature == Feature::Grain), derive::GRAIN),
    ]
    .into_iter()
    .filter_map(|(told, definition)| told.then_some(definition))
}

fn capitalized(text: &str) -> String {
    let mut rest = text.chars();
    rest.next().map_or_else(String::new, |first| first.to_uppercase().chain(rest).collect())
}

/// Adds a text as lines that are indented and no longer than [`WIDTH`] where its
/// words allow that.
pub(super) fn fill(lines: &mut Vec<String>, indent: usize, text: &str) {
    let mut line = String::new();
    for word in text.split([' ', '\n']) {
        if !line.is_empty() && line.len() + 1 + word.len() > WIDTH {
            lines.push(std::mem::take(&mut line));
        }
        if line.is_empty() {
            line = " ".repeat(indent);
        } else {
            line.push(' ');
        }
        line.push_str(&word.replace(JOINED, ", "));
    }
    lines.push(line);
}
