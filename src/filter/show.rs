//! A filter as a person would write it.

use std::fmt::Write;

use super::file::formula;
use super::{Checked, Filter, Grid, StageKind, StandIn};
use crate::expr::feature::Feature;
use crate::expr::text::Reads;

/// Lines longer than this are broken at operators.
const WIDTH: usize = 96;

/// What a filter computes, stage by stage, its constants, what it reads and what stands in
/// for what a file lacks.
pub fn show(checked: &Checked<'_>) -> String {
    let filter = checked.filter();
    let mut text = String::new();
    let _ = writeln!(text, "reads");
    for (feature, stand_in) in reads(checked) {
        let doc = feature.row().doc;
        let stand_in = match stand_in {
            None => String::new(),
            Some(StandIn::Constant(x)) => format!("; {x} where a file lacks it"),
            Some(StandIn::Feature(other)) => {
                format!("; `{}` where a file lacks it", other.term())
            }
        };
        let _ = writeln!(text, "  {}: {doc}{stand_in}", feature.term());
    }
    let _ = write!(text, "\nstages\n{}", stages(checked));
    constants(&mut text, filter);
    text
}

/// What a filter computes, a stage after another.
pub fn stages(checked: &Checked<'_>) -> String {
    let filter = checked.filter();
    let mut text = String::new();
    for (k, stage) in filter.stages.iter().enumerate() {
        match &stage.kind {
            StageKind::Map(value) => {
                let value = formula(checked, k, value, Reads::Pixel);
                line(&mut text, 2, &format!("{} = {value}", stage.name));
                if stage.grid == Grid::Half {
                    line(&mut text, 6, "at half resolution");
                }
            }
            StageKind::Gather(gather) => {
                let of = formula(checked, k, &gather.of, Reads::Pixel);
                let taps = gather.window.diameter();
                let apart = match gather.window.dilation {
                    1 => String::new(),
                    dilation => format!(", {dilation} pixels apart"),
                };
                line(&mut text, 2, &format!("{} = mean of {of}", stage.name));
                let weight = formula(checked, k, &gather.weight, Reads::Pair);
                let half = match stage.grid {
                    Grid::Full => "",
                    Grid::Half => ", at half resolution",
                };
                line(&mut text, 6, &format!("over {taps}x{taps} pixels{apart}{half}"));
                line(&mut text, 6, &format!("by {weight}"));
                if let Some(variance) = &gather.variance {
                    let variance = formula(checked, k, variance, Reads::Pixel);
                    line(&mut text, 6, &format!("with the variance of {variance}"));
                }
            }
        }
    }
    text
}

/// The features that a filter reads, with what stands in for each.
pub fn reads(checked: &Checked<'_>) -> Vec<(Feature, Option<StandIn>)> {
    let needs = checked.needs();
    let mut features: Vec<Feature> =
        needs.named().into_iter().flatten().map(|plane| plane.feature).collect();
    features.push(Feature::Color);
    features.sort_unstable();
    features.dedup();
    features.into_iter().map(|feature| (feature, checked.stand_in(feature))).collect()
}

fn constants(text: &mut String, filter: &Filter) {
    if !filter.constants.params.is_empty() {
        let _ = writeln!(text, "\nconstants");
        for param in &filter.constants.params {
            let _ = writeln!(text, "  {} = {}", param.name, param.value);
        }
    }
    if !filter.constants.layers.is_empty() {
        let _ = writeln!(text, "\nlayers");
        for layer in &filter.constants.layers {
            let (rows, columns) = (layer.rows(), layer.columns());
            let _ =
                writeln!(text, "  {}: {columns} -> {rows}, weights {rows}x{columns}", layer.name);
        }
    }
}

/// Writes a formula, broken before operators where it is too long.
fn line(text: &mut String, indent: usize, formula: &str) {
    let mut column = indent;
    let _ = write!(text, "{:indent$}", "");
    for (k, word) in formula.split_whitespace().enumerate() {
        let length = word.chars().count();
        if k > 0 && column + 1 + length > WIDTH {
            let hanging = indent + 4;
            let _ = write!(text, "\n{:hanging$}", "");
            column = hanging;
        } else if k > 0 {
            text.push(' ');
            column += 1;
        }
        text.push_str(word);
        column += length;
    }
    text.push('\n');
}
