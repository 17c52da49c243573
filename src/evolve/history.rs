//! The progress of a run: a row per generation and island.

use serde::{Deserialize, Serialize};

use super::encoding;
use super::individual::Individual;
use super::islands::best;
use super::race::Work;
use crate::expr::Tree;

/// An island after a generation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Which generation; 0 is the initial population.
    pub generation: u32,
    /// Which island, from 0.
    pub island: usize,
    /// Fitness of its best.
    #[serde(with = "encoding::exact")]
    pub best: f64,
    /// Fitness of its median individual; of one that was dropped, an estimate.
    #[serde(with = "encoding::exact")]
    pub median: f64,
    /// Nodes of its best.
    pub best_nodes: usize,
    /// Nodes of its individuals, on average.
    pub mean_nodes: f64,
    /// Expressions judged in the whole run so far, on all islands.
    pub evaluations: usize,
    /// Expressions bred in the whole run so far that had been judged before.
    pub memo_hits: usize,
    /// Work that judging has taken in the whole run so far.
    pub work: Work,
    /// Its best.
    #[serde(with = "encoding::expression")]
    pub expression: Tree,
}

/// What a row says of the whole run.
#[derive(Clone, Copy)]
pub(super) struct Progress {
    pub(super) evaluations: usize,
    pub(super) memo_hits: usize,
    pub(super) work: Work,
}

impl Row {
    /// Sums a population up.
    pub(super) fn new(
        generation: u32,
        island: usize,
        population: &[Individual],
        progress: Progress,
    ) -> Self {
        let best = best(population);
        let mut ranked: Vec<f64> = population.iter().map(|i| i.fitness).collect();
        ranked.sort_unstable_by(f64::total_cmp);
        let nodes: usize = population.iter().map(|i| i.tree.len()).sum();
        Self {
            generation,
            island,
            best: best.fitness,
            median: ranked[ranked.len() / 2],
            best_nodes: best.tree.len(),
            mean_nodes: nodes as f64 / population.len() as f64,
            evaluations: progress.evaluations,
            memo_hits: progress.memo_hits,
            work: progress.work,
            expression: best.tree.clone(),
        }
    }
}

/// A column of `history.csv`: its name, and its cell in a row.
type Column = (&'static str, fn(&Row) -> String);

const COLUMNS: [Column; 11] = [
    ("generation", |r| r.generation.to_string()),
    ("island", |r| r.island.to_string()),
    ("best", |r| r.best.to_string()),
    ("median", |r| r.median.to_string()),
    ("best_nodes", |r| r.best_nodes.to_string()),
    ("mean_nodes", |r| r.mean_nodes.to_string()),
    ("evaluations", |r| r.evaluations.to_string()),
    ("memo_hits", |r| r.memo_hits.to_string()),
    ("work", |r| r.work.done.to_string()),
    ("exhaustive_work", |r| r.work.exhaustive.to_string()),
    // The one column with commas; expressions hold no quotes.
    ("expression", |r| format!("\"{}\"", r.expression)),
];

/// The rows as comma-separated values, under a header.
pub fn csv(rows: &[Row]) -> String {
    let mut csv = COLUMNS.map(|(name, _)| name).join(",");
    csv.push('\n');
    for row in rows {
        csv.push_str(&COLUMNS.map(|(_, cell)| cell(row)).join(","));
        csv.push('\n');
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evolve::individual::Judgement;

    #[test]
    fn a_row_has_a_cell_per_column() {
        let population = [("1", f64::INFINITY), ("pow(1, 1)", 0.5)]
            .map(|(text, f)| Individual::new(text.parse().unwrap(), Judgement::Full(f)));
        let work = Work { done: 5, exhaustive: 14 };
        let progress = Progress { evaluations: 7, memo_hits: 2, work };
        let csv = csv(&[Row::new(3, 1, &population, progress)]);
        assert_eq!(
            csv,
            "generation,island,best,median,best_nodes,mean_nodes,evaluations,memo_hits,work,\
             exhaustive_work,expression\n\
             3,1,0.5,inf,3,2,7,2,5,14,\"pow(1, 1)\"\n"
        );
    }
}
