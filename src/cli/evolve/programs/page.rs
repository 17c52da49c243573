//! What a search for programs found, for people: tables, a page, a chart.

use super::CHART;
use crate::cli::evolve::{parameters, record};
use crate::evolve::programs::{Finalist, Outcome, Row, Settings};
use crate::filter::stages;
use crate::image::Metrics;
use crate::report::chart::{Chart, Point, Series};
use crate::report::{Align, Format, ScoreTable, Table, Total, number};

/// Rows of the table that shows the run's course.
const COURSE: usize = 12;

/// The result and the front as a table.
pub(super) fn front(outcome: &Outcome) -> Table {
    let mut table = Table::new([
        ("program", Align::Left),
        ("score", Align::Right),
        ("validation", Align::Right),
        ("RelMSE (trimmed)", Align::Right),
        ("ns/pixel", Align::Right),
        ("nodes", Align::Right),
        ("stages", Align::Right),
        ("from exact", Align::Right),
    ]);
    let rows = outcome.front.iter().zip(1..).map(|(f, k)| (format!("front-{k:02}"), f));
    for (name, finalist) in rows.chain([("best".to_owned(), &outcome.best)]) {
        let judged = &finalist.judged;
        let dash = || "-".to_owned();
        let errors = |[_, rel_mse, trimmed]: [f64; 3]| {
            format!("{} ({})", number::error(rel_mse), number::error(trimmed))
        };
        table.row([
            name,
            format!("{:.4}", judged.error),
            finalist.validation.map_or_else(dash, |[score, ..]| format!("{score:.4}")),
            finalist.validation.map_or_else(dash, errors),
            format!("{:.0}", judged.cost),
            judged.genome.size().to_string(),
            judged.genome.filter().stages.len().to_string(),
            finalist.difference.map_or_else(dash, number::difference),
        ]);
    }
    table
}

/// The summary of a run, for people: one Markdown page.
pub(super) fn summary(
    settings: &Settings,
    outcome: &Outcome,
    scores: Option<&ScoreTable>,
) -> String {
    let best = &outcome.best;
    let filter = best.judged.genome.filter();
    let checked = filter.check().expect("genomes make sense");
    let mut page = format!(
        "# A bred program\n\nSeed {}, from `{}`. The search {} after generation {} of {}; it judged \
         {} programs and gave up {}.\n\n",
        settings.seed,
        settings.initial,
        record::ending(outcome.ending),
        outcome.history.last().map_or(0, |row| row.generation),
        settings.generations,
        outcome.judged,
        outcome.dropped,
    );
    page += &format!("```text\n{}```\n\n", stages(&checked));
    page += "## The front\n\nPrograms of which none is better by score, predicted time and size at \
             once, the fastest first, and the result. RelMSE is of the validation scenes.\n\n";
    page += &front(outcome).render(Format::Markdown);
    page += &format!("\n![Predicted time against score]({CHART})\n");
    if let Some(scores) = scores {
        page += "\n## Beside other filters\n\nGeometric means over the scenes that nothing was bred \
                 on (the training scenes, if there are none).\n\n";
        page += &rivals(scores).render(Format::Markdown);
    }
    page += "\n## Course\n\n";
    page += &course(&outcome.history).render(Format::Markdown);
    page += "\n## Parameters\n\n";
    page += &parameters::table(settings, "`").render(Format::Markdown);
    page
}

/// Some rows of the run's course, the first and the last among them.
pub(super) fn course(rows: &[Row]) -> Table {
    let names = ["generation", "best", "median", "validation", "RelMSE", "ns/pixel", "nodes"];
    let mut table = Table::new(names.map(|name| (name, Align::Right)));
    let step = rows.len().div_ceil(COURSE).max(1);
    let shown = rows.iter().enumerate().filter(|(k, _)| k % step == 0 || k + 1 == rows.len());
    let cell = |x: f64, text: String| if x.is_nan() { "-".to_owned() } else { text };
    for (_, row) in shown {
        table.row([
            row.generation.to_string(),
            format!("{:.4}", row.best),
            format!("{:.4}", row.median),
            cell(row.validation, format!("{:.4}", row.validation)),
            cell(row.rel_mse, number::error(row.rel_mse)),
            format!("{:.0}", row.cost),
            row.size.to_string(),
        ]);
    }
    table
}

/// The RelMSE on the validation scenes, or where there are none the loss on the training scenes.
pub(super) fn error(finalist: &Finalist) -> f64 {
    match finalist.validation {
        Some([_, rel_mse, _]) => rel_mse,
        None => finalist.judged.error.exp(),
    }
}

/// Predicted time against the error on the validation scenes, or where there are none on the
/// training scenes.
pub(super) fn chart(outcome: &Outcome) -> String {
    let validated = outcome.best.validation.is_some();
    let point = |finalist: &Finalist, label: String| Point {
        x: finalist.judged.cost,
        y: error(finalist),
        title: format!(
            "{label}: {:.0} ns per pixel, {}",
            finalist.judged.cost,
            number::error(error(finalist))
        ),
        label,
    };
    // Each on its own, so that nothing joins them: files in front/ are in the order of time alone.
    let series = |name: &str, point| Series {
        color: name.to_owned(),
        shape: name.to_owned(),
        points: vec![point],
    };
    let front = outcome.front.iter().zip(1..);
    let front = front.map(|(f, k): (_, usize)| series("front", point(f, k.to_string())));
    let best = series("best", point(&outcome.best, "best".to_owned()));
    Chart {
        title: "Bred programs".to_owned(),
        subtitle: match validated {
            true => "Geometric means over the validation scenes".to_owned(),
            false => "Scores on the training scenes".to_owned(),
        },
        x: "predicted nanoseconds per pixel".to_owned(),
        y: if validated { "RelMSE" } else { "loss" }.to_owned(),
        series: front.chain([best]).collect(),
        colors: "programs".to_owned(),
        shapes: "programs".to_owned(),
        labels: "Numbers at marks: files in front/.".to_owned(),
        front: "no faster one errs less".to_owned(),
    }
    .svg()
}

/// Filters with their errors, as means over the scenes; of those that cannot run on one, none.
pub(super) fn rivals(scores: &ScoreTable) -> Table {
    let mut table = Table::new([
        ("filter", Align::Left),
        ("RelMSE", Align::Right),
        ("without the worst 0.1%", Align::Right),
    ]);
    let row = |table: &mut Table, name: &str, metrics: Vec<&Metrics>| {
        let mean = |figure: fn(&Metrics) -> f64| {
            number::error(Total::GeometricMean.of(metrics.iter().map(|metrics| figure(metrics))))
        };
        table.row([name.to_owned(), mean(|m| m.rel_mse), mean(|m| m.trimmed_rel_mse)]);
    };
    row(&mut table, "none: as rendered", scores.scenes.iter().map(|score| &score.noisy).collect());
    for (k, name) in scores.filters.iter().enumerate() {
        let measured = scores.scenes.iter().map(|score| score.filters[k].as_ref());
        match measured.collect::<Result<Vec<_>, _>>() {
            Ok(measured) => {
                row(&mut table, name, measured.iter().map(|measured| &measured.metrics).collect())
            }
            Err(_) => table.row([name.as_str(), "-", "-"].map(str::to_owned)),
        }
    }
    table
}
