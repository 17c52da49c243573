//! The course of a search for programs, generation by generation.

use serde::{Deserialize, Serialize};

use super::judge::Judged;
use super::selection::ranks;
use crate::evolve::encoding;

/// What a search had come to after a generation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Which; 0 is the initial one.
    pub generation: u32,
    /// The least error of the population.
    #[serde(with = "encoding::exact")]
    pub best: f64,
    /// The median of its errors.
    #[serde(with = "encoding::exact")]
    pub median: f64,
    /// Nanoseconds per pixel that the program of the least error is predicted to take.
    #[serde(with = "encoding::exact")]
    pub cost: f64,
    /// Its nodes and layers' numbers.
    pub size: usize,
    /// Programs of which none is better by all goals.
    pub front: usize,
    /// The score of the program of the least error on the validation scenes; not a number
    /// where it was not tried.
    #[serde(with = "encoding::exact")]
    pub validation: f64,
    /// Its RelMSE there, the geometric mean.
    #[serde(with = "encoding::exact")]
    pub rel_mse: f64,
    /// The same without the worst 0.1% of the pixels.
    #[serde(with = "encoding::exact")]
    pub trimmed_rel_mse: f64,
    /// Programs judged by now.
    pub judged: u64,
    /// Programs given up by now.
    pub dropped: u64,
}

impl Row {
    /// The row of a population that a generation leaves; `trial` is of the program of the least
    /// error.
    pub(super) fn new(
        generation: u32,
        population: &[Judged],
        trial: Option<[f64; 3]>,
        judged: u64,
        dropped: u64,
    ) -> Self {
        let mut errors: Vec<f64> = population.iter().map(|judged| judged.error).collect();
        errors.sort_by(f64::total_cmp);
        let best = population.iter().min_by(|a, b| a.error.total_cmp(&b.error));
        let best = best.expect("a generation leaves somebody");
        let goals: Vec<[f64; 3]> = population.iter().map(Judged::goals).collect();
        let [validation, rel_mse, trimmed_rel_mse] = trial.unwrap_or([f64::NAN; 3]);
        Self {
            generation,
            best: best.error,
            median: errors[errors.len() / 2],
            cost: best.cost,
            size: best.genome.size(),
            front: ranks(&goals).iter().filter(|&&rank| rank == 0).count(),
            validation,
            rel_mse,
            trimmed_rel_mse,
            judged,
            dropped,
        }
    }
}

/// Rows as comma-separated values, under a header. What is not known is left empty.
pub fn csv(rows: &[Row]) -> String {
    let mut csv = String::from(
        "generation,best,median,cost,size,front,validation,rel_mse,trimmed_rel_mse,judged,dropped\n",
    );
    let known = |x: f64| if x.is_nan() { String::new() } else { x.to_string() };
    for row in rows {
        let Row { generation, best, median, cost, size, front, judged, dropped, .. } = row;
        let [validation, rel_mse, trimmed] =
            [row.validation, row.rel_mse, row.trimmed_rel_mse].map(known);
        csv += &format!(
            "{generation},{best},{median},{cost},{size},{front},{validation},{rel_mse},{trimmed},\
             {judged},{dropped}\n"
        );
    }
    csv
}

/// Rows as JSON, an object a line. Numbers are in full; what is not known is null.
pub fn json_lines(rows: &[Row]) -> String {
    /// A row as a reader has it: what is no number is null.
    #[derive(Serialize)]
    struct Line {
        generation: u32,
        best: f64,
        median: f64,
        cost: f64,
        size: usize,
        front: usize,
        validation: f64,
        rel_mse: f64,
        trimmed_rel_mse: f64,
        judged: u64,
        dropped: u64,
    }
    let line = |row: &Row| {
        let Row { generation, best, median, cost, size, front, .. } = *row;
        let Row { validation, rel_mse, trimmed_rel_mse, judged, dropped, .. } = *row;
        let line = Line {
            generation,
            best,
            median,
            cost,
            size,
            front,
            validation,
            rel_mse,
            trimmed_rel_mse,
            judged,
            dropped,
        };
        serde_json::to_string(&line).expect("rows have text for keys") + "\n"
    };
    rows.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_json_have_every_bit_and_null_for_what_is_not_known() {
        let row = Row {
            generation: 3,
            best: -0.1 - 0.2,
            median: f64::INFINITY,
            cost: 1e-300,
            size: 7,
            front: 2,
            validation: f64::NAN,
            rel_mse: f64::NAN,
            trimmed_rel_mse: 0.25,
            judged: u64::MAX,
            dropped: 1,
        };
        let text = json_lines(&[row.clone(), row.clone()]);
        assert_eq!(text.lines().count(), 2);
        let line: serde_json::Value =
            serde_json::from_str(text.lines().next().expect("a line")).expect("JSON");
        assert_eq!(line["best"].as_f64().map(f64::to_bits), Some(row.best.to_bits()));
        assert_eq!(line["cost"].as_f64(), Some(1e-300));
        assert_eq!(line["judged"].as_u64(), Some(u64::MAX));
        assert!(line["validation"].is_null() && line["median"].is_null());
        // The same columns as the table.
        let columns: Vec<&str> =
            line.as_object().expect("an object").keys().map(String::as_str).collect();
        let csv = csv(&[row]);
        let mut header: Vec<&str> = csv.lines().next().expect("a header").split(',').collect();
        header.sort_unstable();
        assert_eq!(columns, header);
    }
}
