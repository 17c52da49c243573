//! The page of a search for weights.

use super::page;
use crate::cli::evolve::parameters;
use crate::cli::evolve::record::{Origin, effort, ending, error, generations};
use crate::evolve::history::Row;
use crate::evolve::{Individual, Outcome};
use crate::report::number;
use crate::report::page::search::{Course, Line, SearchPage, Section};

/// The page of a search that goes on, after a generation.
pub(super) fn under_way(origin: &Origin<'_>, rows: &[Row], best: &Individual) -> String {
    let standing = format!(
        "Generation {} of {}: the error of the best so far is {} while breeding (sum of {} over {}).",
        rows.last().map_or(0, |row| row.generation),
        origin.settings.generations,
        number::error(best.fitness),
        origin.settings.error.title(),
        number::plural(origin.scenes, "scene"),
    );
    let formula =
        Section::Formulas { title: "The best so far".to_owned(), text: best.tree.to_string() };
    html(origin, rows, standing, true, vec![formula])
}

/// The page of a search that ended.
pub(super) fn finished(origin: &Origin<'_>, outcome: &Outcome) -> String {
    let best = outcome.best();
    let standing = format!(
        "The search {} after generation {} of {}. The result has {} and {} nodes. It {}.",
        ending(outcome.ending),
        generations(outcome).unwrap_or(0),
        origin.settings.generations,
        error(origin, outcome),
        best.tree.len(),
        effort(outcome),
    );
    let sections = vec![
        Section::Formulas { title: "The result".to_owned(), text: best.tree.to_string() },
        Section::Figures {
            title: "Finalists".to_owned(),
            about:
                "The best of the whole run. The first that is close enough to its exact meaning is \
                    the result."
                    .to_owned(),
            table: page::finalists(outcome, "").html(),
        },
    ];
    html(origin, &outcome.history, standing, false, sections)
}

fn html(
    origin: &Origin<'_>,
    rows: &[Row],
    standing: String,
    under_way: bool,
    sections: Vec<Section>,
) -> String {
    let islands = origin.settings.islands;
    let line = |island: usize| Line {
        name: format!("island {}", island + 1),
        values: rows.iter().filter(|row| row.island == island).map(|row| row.best).collect(),
    };
    SearchPage {
        title: format!("A search for weights, seed {}", origin.settings.seed),
        standing,
        under_way,
        course: Course {
            axis: format!("best {}, summed over the scenes", origin.settings.error.title()),
            generations: rows.iter().step_by(islands).map(|row| row.generation).collect(),
            lines: (0..islands).map(line).collect(),
            table: page::course(rows, islands).html(),
        },
        sections,
        command: origin.command.clone(),
        parameters: parameters::table(origin.settings, "").html(),
    }
    .html()
}
