//! The summary of a run, for people: one Markdown page.

use std::fmt::Write;

use crate::cli::evolve::parameters;
use crate::cli::evolve::record::{Origin, effort, ending, error, generations};
use crate::evolve::history::Row;
use crate::evolve::summary::Frequency;
use crate::evolve::{Outcome, Summary};
use crate::expr::Tree;
use crate::expr::text::latex;
use crate::report::{Align, Format, Table, number};

/// Rows of the table that shows the run's course.
const COURSE: usize = 12;

/// Writes the page.
pub(super) fn summary(origin: &Origin<'_>, outcome: &Outcome) -> String {
    let best = outcome.best();
    let mut page = String::from("# A bred filter\n\n");
    let _ = writeln!(
        page,
        "The result has {}, {} nodes, radius {} and seed {}. The search {} \
         after generation {} of {}. It {} ({} more had been judged before).\n",
        error(origin, outcome),
        best.tree.len(),
        origin.settings.radius,
        origin.settings.seed,
        ending(outcome.ending),
        generations(outcome).unwrap_or(0),
        origin.settings.generations,
        effort(outcome),
        number::count(outcome.memo_hits),
    );
    let _ = writeln!(page, "```text\n{}\n```\n\n$${}$$\n", best.tree, latex(&best.tree));

    if let Some(scores) = origin.scores {
        page.push_str(
            "## Training scenes\n\nRelMSE, and without the worst 0.1% of the pixels.\n\n",
        );
        page.push_str(&scores.render(Format::Markdown));
        page.push('\n');
    }

    page.push_str("## What the filters look at\n\n");
    page.push_str(&frequencies(outcome));

    page.push_str(match best.full {
        Some(_) => {
            "\n## Finalists\n\nThe best of the whole run, judged on all pixels. The first that is close \
             enough to its exact meaning is the result.\n\n"
        }
        None => {
            "\n## Finalists\n\nThe best of the whole run as breeding judged them: the search was \
             stopped before they were judged on all pixels.\n\n"
        }
    });
    page.push_str(&finalists(outcome, "`").render(Format::Markdown));
    for (finalist, rank) in outcome.finalists.iter().zip(1..) {
        if let Some(objection) = &finalist.objection {
            let _ = writeln!(page, "\nFinalist {rank} is unstable: {objection}.");
        }
    }

    page.push_str("\n## Course\n\nBest error per island while breeding.\n\n");
    let course = course(&outcome.history, origin.settings.islands);
    page.push_str(&course.render(Format::Markdown));

    page.push_str("\n## Parameters\n\n");
    let mut table = parameters::table(origin.settings, "`");
    if origin.require_stable {
        table
            .row(["`--require-stable`", "yes", "unstable filters are kept out"].map(str::to_owned));
    }
    page.push_str(&table.render(Format::Markdown));
    page
}

/// The paper's last analysis: which features the search came to use.
fn frequencies(outcome: &Outcome) -> String {
    let finalists = Summary::new(outcome.finalists.iter().map(|finalist| &finalist.tree));
    let islands: Vec<&Tree> = outcome.islands.iter().flatten().map(|i| &i.tree).collect();
    let islands = Summary::new(islands);
    let mut page = format!(
        "Share of the expressions that use a term: of {} on the islands at the end, and of {}.\n\n",
        number::plural(islands.expressions, "expression"),
        number::plural(finalists.expressions, "finalist"),
    );
    let (bred, best) = (&islands.terms, &finalists.terms);
    page.push_str(&shares("term", (&islands, bred), (&finalists, best)));
    page.push('\n');
    let (bred, best) = (&islands.operators, &finalists.operators);
    page.push_str(&shares("operator", (&islands, bred), (&finalists, best)));
    page
}

/// How many of two sets of expressions use each of some symbols.
fn shares(
    kind: &str,
    (islands, rows): (&Summary, &[Frequency]),
    (finalists, twins): (&Summary, &[Frequency]),
) -> String {
    let mut table = Table::new([
        (kind, Align::Left),
        ("islands", Align::Right),
        ("finalists", Align::Right),
        ("meaning", Align::Left),
    ]);
    let mut unused = Vec::new();
    for row in rows {
        let same = |other: &&Frequency| (other.name, other.doc) == (row.name, row.doc);
        let twin = twins.iter().find(same).map_or(0, |twin| twin.expressions);
        if row.expressions + twin == 0 {
            unused.push(format!("`{}` ({})", row.name, row.meaning()));
            continue;
        }
        table.row([
            format!("`{}`", row.name),
            number::percent(row.expressions, islands.expressions),
            number::percent(twin, finalists.expressions),
            row.meaning(),
        ]);
    }
    let mut text = table.render(Format::Markdown);
    if !unused.is_empty() {
        let _ = writeln!(text, "\nIn none: {}.", unused.join(", "));
    }
    text
}

/// The best of the whole run, expressions with `mark` around them.
pub(super) fn finalists(outcome: &Outcome, mark: &str) -> Table {
    let mut table = Table::new([
        ("error", Align::Right),
        ("while breeding", Align::Right),
        ("from exact", Align::Right),
        ("nodes", Align::Right),
        ("expression", Align::Left),
    ]);
    for finalist in &outcome.finalists {
        table.row([
            finalist.full.map_or("-".to_owned(), number::error),
            number::error(finalist.bred),
            finalist.difference.map_or("-".to_owned(), number::difference),
            finalist.tree.len().to_string(),
            format!("{mark}{}{mark}", finalist.tree),
        ]);
    }
    table
}

/// The best error of every island in some generations, the first and the last among them.
pub(super) fn course(history: &[Row], islands: usize) -> Table {
    let columns = (1..=islands).map(|island| (format!("island {island}"), Align::Right));
    let mut table =
        Table::new(std::iter::once(("generation".to_owned(), Align::Right)).chain(columns));
    let rows: Vec<&[Row]> = history.chunks_exact(islands).collect();
    let step = rows.len().div_ceil(COURSE).max(1);
    let shown = rows.iter().enumerate().filter(|(k, _)| k % step == 0 || k + 1 == rows.len());
    for (_, row) in shown {
        let best = row.iter().map(|island| number::error(island.best));
        table.row(std::iter::once(row[0].generation.to_string()).chain(best));
    }
    table
}
