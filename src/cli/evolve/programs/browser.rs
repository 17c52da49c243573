//! The page of a search for programs.

use super::page;
use crate::backend::Backend;
use crate::cli::error::Error;
use crate::cli::evolve::{parameters, record};
use crate::cli::measure::Measuring;
use crate::evolve::Summary;
use crate::evolve::programs::{Finalist, Judged, Outcome, Row, Settings};
use crate::evolve::summary::Frequency;
use crate::expr::Feature;
use crate::filter::{Filter, Stage, spelling, stages};
use crate::plan::Passes;
use crate::report::page::search::{
    BeforeAfter, Course, Front, FrontPoint, Line, SearchPage, Section,
};
use crate::report::{Align, ScoreTable, Table, graph, number};
use crate::scene::LoadOptions;
use crate::tune::{Level, TuningScene};

/// The sample count whose image is shown, if the scene has it: that of the training scenes.
const SAMPLES: u32 = 4;

/// What a search was told.
pub(super) struct Told<'a> {
    /// Its parameters.
    pub(super) settings: &'a Settings,
    /// The command that repeats it.
    pub(super) command: String,
}

/// The page of a search that goes on.
pub(super) fn under_way(told: &Told<'_>, rows: &[Row], best: &Judged) -> String {
    let row = rows.last().expect("a generation is complete");
    let mut standing = format!(
        "Generation {} of {}: the best so far has score {:.4}, is predicted to take {:.0} ns per pixel \
         and has {} nodes. {} programs are judged, {} given up.",
        row.generation,
        told.settings.generations,
        row.best,
        row.cost,
        row.size,
        number::count(row.judged as usize),
        number::count(row.dropped as usize),
    );
    let validated = rows.iter().rev().find(|row| !row.validation.is_nan());
    if let Some(row) = validated {
        standing += &format!(
            " After generation {} the best had score {:.4} on the validation scenes, RelMSE (trimmed) \
             {} ({}).",
            row.generation,
            row.validation,
            number::error(row.rel_mse),
            number::error(row.trimmed_rel_mse),
        );
    }
    let sections = vec![formulas("The best so far", best.genome.filter())];
    page(told, standing, true, rows, sections)
}

/// The page of a search that ended.
pub(super) fn finished(
    told: &Told<'_>,
    outcome: &Outcome,
    scores: Option<&ScoreTable>,
    scene: Option<BeforeAfter>,
) -> String {
    let best = &outcome.best;
    let filter = best.judged.genome.filter();
    let standing = format!(
        "The search {} after generation {} of {}; it judged {} programs and gave up {}. The result: {}.",
        record::ending(outcome.ending),
        outcome.history.last().map_or(0, |row| row.generation),
        told.settings.generations,
        number::count(outcome.judged as usize),
        number::count(outcome.dropped as usize),
        figures(best),
    );
    let mut sections = vec![Section::Front(front(outcome))];
    if let Some(scores) = scores {
        sections.push(Section::Figures {
            title: "Beside other filters".to_owned(),
            about:
                "Geometric means over the scenes that nothing was bred on (the training scenes, \
                    if there are none)."
                    .to_owned(),
            table: page::rivals(scores).html(),
        });
    }
    sections.extend(scene.map(Section::Scene));
    sections.push(Section::Drawing {
        title: "The result as a graph".to_owned(),
        about: "Rounded boxes are maps, square ones gathers; the last line of a box says which \
                features it reads. A line leads from a stage to who reads it, dashed where a \
                weight alone does."
            .to_owned(),
        svg: graph::stages(filter),
    });
    sections.push(formulas("The result's formulas", filter));
    sections.extend(frequencies(outcome));
    page(told, standing, false, &outcome.history, sections)
}

/// What a filter makes of a scene that was loaded for the search.
pub(super) fn scene(
    scene: &TuningScene,
    filter: &Filter,
    validates: bool,
    backend: &dyn Backend,
) -> Result<BeforeAfter, Error> {
    let of_count = |level: &&Level| level.samples == Some(SAMPLES);
    let level = scene.levels.iter().find(of_count).or(scene.levels.first());
    let level = level.expect("a scene has a noisy image");
    let measuring = Measuring { backend, passes: Passes::ALL, options: LoadOptions::default() };
    let (after, _) = measuring.apply(filter, &level.scene)?;
    let samples = level.samples.map_or(String::new(), |n| format!(" at {n} samples per pixel"));
    let kind = if validates { "validation" } else { "training" };
    let title = format!("The result on the {kind} scene {}{samples}", scene.name);
    Ok(BeforeAfter::new(title, &level.scene.noisy(), &after, &scene.image)?)
}

fn page(
    told: &Told<'_>,
    standing: String,
    under_way: bool,
    rows: &[Row],
    sections: Vec<Section>,
) -> String {
    let line = |name: &str, value: fn(&Row) -> f64| Line {
        name: name.to_owned(),
        values: rows.iter().map(value).collect(),
    };
    let mut lines =
        vec![line("best", |row| row.best), line("median of the population", |row| row.median)];
    if rows.iter().any(|row| !row.validation.is_nan()) {
        lines.push(line("best, on the validation scenes", |row| row.validation));
    }
    SearchPage {
        title: format!("A search for programs, seed {}", told.settings.seed),
        standing,
        under_way,
        course: Course {
            axis: format!("score ({} loss): the less, the better", told.settings.loss.name()),
            generations: rows.iter().map(|row| row.generation).collect(),
            lines,
            table: page::course(rows).html(),
        },
        sections,
        command: told.command.clone(),
        parameters: parameters::table(told.settings, "").html(),
    }
    .html()
}

fn formulas(title: &str, filter: &Filter) -> Section {
    let text = stages(&filter.check().expect("genomes make sense"));
    Section::Formulas { title: title.to_owned(), text }
}

/// A program's figures, in a line.
fn figures(finalist: &Finalist) -> String {
    let judged = &finalist.judged;
    let validation = finalist.validation.map_or(String::new(), |[score, rel_mse, trimmed]| {
        format!(
            ", on the validation scenes {score:.4}, RelMSE (trimmed) {} ({})",
            number::error(rel_mse),
            number::error(trimmed)
        )
    });
    format!(
        "score {:.4}{validation}, predicted {:.0} ns per pixel, {} nodes in {}",
        judged.error,
        judged.cost,
        judged.genome.size(),
        number::plural(judged.genome.filter().stages.len(), "stage"),
    )
}

fn front(outcome: &Outcome) -> Front {
    let program = |finalist: &Finalist, name: String, is_result: bool| {
        let filter = finalist.judged.genome.filter();
        FrontPoint {
            name,
            place: [finalist.judged.cost, page::error(finalist)],
            figures: figures(finalist),
            formulas: stages(&filter.check().expect("genomes make sense")),
            is_result,
        }
    };
    let members = outcome.front.iter().zip(1..);
    let members = members.map(|(f, k): (_, usize)| program(f, format!("front-{k:02}"), false));
    let best = program(&outcome.best, "best".to_owned(), true);
    Front {
        x: "predicted nanoseconds per pixel".to_owned(),
        y: match outcome.best.validation {
            Some(_) => "RelMSE, geometric mean over the validation scenes".to_owned(),
            None => "loss on the training scenes".to_owned(),
        },
        programs: members.chain([best]).collect(),
        table: page::front(outcome).html(),
    }
}

/// What the front's formulas are made of.
fn frequencies(outcome: &Outcome) -> [Section; 2] {
    let filters = outcome.front.iter().map(|finalist| finalist.judged.genome.filter());
    let summary = Summary::new(filters.flat_map(|f| f.stages.iter().flat_map(Stage::trees)));
    let about = format!(
        "In the {} of the {} of the front.",
        number::plural(summary.expressions, "formula"),
        number::plural(outcome.front.len(), "program"),
    );
    // The summary has the paper's names.
    let name = |row: &Frequency| {
        let read = Feature::parse(row.name);
        read.and_then(|(feature, quantity)| spelling(feature, quantity)).unwrap_or(row.name)
    };
    let section = |title: &str, rows: &[Frequency]| {
        let mut table = Table::new([
            ("name", Align::Left),
            ("formulas", Align::Right),
            ("share", Align::Right),
            ("occurrences", Align::Right),
            ("meaning", Align::Left),
        ]);
        for row in rows.iter().filter(|row| row.occurrences > 0) {
            table.row([
                name(row).to_owned(),
                row.expressions.to_string(),
                number::percent(row.expressions, summary.expressions),
                number::count(row.occurrences),
                row.meaning(),
            ]);
        }
        Section::Figures { title: title.to_owned(), about: about.clone(), table: table.html() }
    };
    [
        section("What the front looks at", &summary.terms),
        section("What the front computes with", &summary.operators),
    ]
}
