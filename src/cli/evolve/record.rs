//! Where a bred filter comes from, as its file tells.

use crate::evolve::{Ending, Outcome, Settings, Work};
use crate::report::{ScoreTable, number};

/// What a run was started with, beside its settings.
pub(super) struct Origin<'a> {
    /// What bred it.
    pub(super) settings: &'a Settings,
    /// What ran the filters.
    pub(super) backend: &'static str,
    /// Whether unstable expressions were kept out.
    pub(super) require_stable: bool,
    /// The training scenes' errors; the bred filter comes first.
    pub(super) scores: &'a ScoreTable,
}

/// The `[training]` table of a filter file. Nothing in it depends on a clock or
/// on the number of threads, so that a run that is repeated writes the same
/// bytes.
pub(super) fn training(origin: &Origin<'_>, outcome: &Outcome) -> toml::Table {
    let best = outcome.best();
    let mut table = toml::Table::new();
    let mut put = |key: &str, value: toml::Value| table.insert(key.to_owned(), value);
    put("program", concat!("tamis ", env!("CARGO_PKG_VERSION")).into());
    put("error", best.full.into());
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
    let scenes = origin.scores.scenes.iter().map(|score| {
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
    put("scenes", toml::Value::Array(scenes.collect()));
    let parameters = toml::Value::try_from(origin.settings).expect("settings are TOML");
    put("parameters", parameters);
    table
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
