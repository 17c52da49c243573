//! Where a bred filter comes from, as its file tells.

use std::fmt::Write;
use std::path::Path;

use crate::evolve::{Ending, Individual, Outcome, Settings, Work};
use crate::report::{Format, ScoreTable, number};

/// What a run was started with, beside its settings.
pub(super) struct Origin<'a> {
    /// What bred it.
    pub(super) settings: &'a Settings,
    /// What ran the filters.
    pub(super) backend: &'static str,
    /// Whether unstable expressions were kept out.
    pub(super) require_stable: bool,
    /// The command that repeats the run.
    pub(super) command: String,
    /// How many training scenes there are.
    pub(super) scenes: usize,
    /// The training scenes' errors, if they were measured; the bred filter comes first.
    pub(super) scores: Option<&'a ScoreTable>,
}

/// What both tables begin with.
fn begun() -> toml::Table {
    let mut table = toml::Table::new();
    table.insert("program".to_owned(), concat!("tamis ", env!("CARGO_PKG_VERSION")).into());
    table
}

/// The `[training]` table of the best so far, of a search that has formed so many generations.
pub(super) fn under_way(
    origin: &Origin<'_>,
    best: &Individual,
    complete: u32,
    evaluations: usize,
) -> toml::Table {
    let mut table = begun();
    let mut put = |key: &str, value: toml::Value| table.insert(key.to_owned(), value);
    put("error-while-breeding", best.fitness.into());
    put("seed", integer(origin.settings.seed));
    put("ending", "none yet: the search was under way, and this was the best so far".into());
    put("generations", integer(complete.saturating_sub(1)));
    put("expressions-judged", integer(evaluations));
    put("backend", origin.backend.into());
    if origin.require_stable {
        put("require-stable", true.into());
    }
    let parameters = toml::Value::try_from(origin.settings).expect("settings are TOML");
    put("parameters", parameters);
    table
}

/// The `[training]` table of a filter file. Nothing in it depends on a clock or
/// on the number of threads, so that a run that is repeated writes the same
/// bytes.
pub(super) fn training(origin: &Origin<'_>, outcome: &Outcome) -> toml::Table {
    let best = outcome.best();
    let mut table = begun();
    let mut put = |key: &str, value: toml::Value| table.insert(key.to_owned(), value);
    if let Some(error) = best.full {
        put("error", error.into());
    }
    put("error-while-breeding", best.bred.into());
    put("finalist", integer(outcome.winner + 1));
    if let Some(difference) = best.difference {
        put("difference-from-exact", difference.into());
    }
    put("seed", integer(origin.settings.seed));
    put("ending", ending(outcome.ending).into());
    put("generations", integer(generations(outcome).unwrap_or(0)));
    put("expressions-judged", integer(outcome.evaluations));
    put("expressions-dropped", integer(outcome.dropped));
    put("pixel-pairs", integer(outcome.work.done));
    put("pixel-pairs-without-racing", integer(outcome.work.exhaustive));
    put("backend", origin.backend.into());
    if origin.require_stable {
        put("require-stable", true.into());
    }
    let scores = origin.scores.into_iter().flat_map(|scores| &scores.scenes);
    let scenes = scores.map(|score| {
        let mut scene = toml::Table::new();
        scene.insert("name".to_owned(), score.scene.clone().into());
        scene.insert("noisy-rel-mse".to_owned(), score.noisy.rel_mse.into());
        scene.insert("noisy-trimmed-rel-mse".to_owned(), score.noisy.trimmed_rel_mse.into());
        if let Some(Ok(measured)) = score.filters.first() {
            scene.insert("rel-mse".to_owned(), measured.metrics.rel_mse.into());
            scene.insert("trimmed-rel-mse".to_owned(), measured.metrics.trimmed_rel_mse.into());
        }
        toml::Value::Table(scene)
    });
    let scenes: Vec<toml::Value> = scenes.collect();
    if !scenes.is_empty() {
        put("scenes", toml::Value::Array(scenes));
    }
    let parameters = toml::Value::try_from(origin.settings).expect("settings are TOML");
    put("parameters", parameters);
    table
}

/// What is printed at the end: the filter first.
pub(super) fn report(origin: &Origin<'_>, outcome: &Outcome, out: &Path) -> String {
    let best = outcome.best();
    let mut text = format!("{}\n\n", best.tree);
    let _ = writeln!(
        text,
        "{}, search {}\n{}",
        error(origin, outcome),
        ending(outcome.ending),
        effort(outcome)
    );
    if outcome.ending == Ending::Stopped {
        text += match best.full {
            None => {
                "The finalists were not judged on all pixels, nor compared with their exact meanings.\n"
            }
            Some(_) => {
                "Not all finalists were compared with their exact meanings that had to be.\n"
            }
        };
        let out = out.display();
        let _ = match generations(outcome) {
            Some(generation) => writeln!(
                text,
                "`tamis evolve --resume --generations {generation} --out {out}` does that and no more."
            ),
            None => writeln!(text, "`tamis evolve --resume --out {out}` goes on."),
        };
    }
    if let Some(scores) = origin.scores {
        text.push('\n');
        text += &scores.render(Format::Plain);
    }
    text
}

/// The result's error, in words.
pub(super) fn error(origin: &Origin<'_>, outcome: &Outcome) -> String {
    let best = outcome.best();
    let (kind, value) = match best.full {
        Some(error) => ("training error", error),
        None => ("error while breeding", best.bred),
    };
    format!(
        "{kind} {} (sum of {} over {})",
        number::error(value),
        origin.settings.error.title(),
        number::plural(origin.scenes, "scene"),
    )
}

/// The last complete generation.
pub(super) fn generations(outcome: &Outcome) -> Option<u32> {
    outcome.history.last().map(|row| row.generation)
}

/// How a run ended, in words.
pub(super) fn ending(ending: Ending) -> &'static str {
    match ending {
        Ending::Finished => "finished",
        Ending::Stopped => "stopped by the user",
        Ending::TimeLimit => "stopped by the time limit",
    }
}

/// What judging took, in words.
pub(super) fn effort(outcome: &Outcome) -> String {
    let Work { done, exhaustive } = outcome.work;
    let judged = number::plural(outcome.evaluations, "expression");
    if outcome.dropped == 0 && done == exhaustive {
        return format!("judged {judged}: {:.3e} pixel pairs", done as f64);
    }
    format!(
        "judged {judged}, {} of them given up early: {:.3e} pixel pairs, {} of the {:.3e} that judging \
         all in full takes",
        number::count(outcome.dropped),
        done as f64,
        number::percent(done as usize, exhaustive as usize),
        exhaustive as f64,
    )
}

fn integer(n: impl TryInto<i64>) -> toml::Value {
    // Settings refuse greater seeds; counts do not get there.
    toml::Value::Integer(n.try_into().unwrap_or(i64::MAX))
}
