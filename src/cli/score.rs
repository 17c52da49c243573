//! `tamis score`: filters on scenes, in one table.

use std::path::{Path, PathBuf};

use clap::Args;

use super::error::Error;
use super::log::Log;
use super::measure::Measuring;
use super::options::Running;
use super::resolve::resolve;
use super::scenes;
use crate::filter::{Filter, names};
use crate::report::{Format, Total};

const EXAMPLES: &str = "\
Examples:
  tamis score
  tamis score --scenes data/test renders/room.exr,renders/room_clean.exr --markdown
  tamis score --filters out/best.toml kan2017 --json

Each cell is the RelMSE and, in parentheses, the same without the worst 0.1% of
the pixels. A dash stands where a filter reads what the scene does not have.
Times are those of the filtering alone.";

/// Measure filters on scenes.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Score {
    /// Filters: names, files or expressions [default: all that have names]
    #[arg(long, num_args = 1.., value_name = "FILTER")]
    filters: Vec<String>,

    /// Folders with 4spp.exr and reference.exr in or below them, or pairs of files
    #[arg(long, num_args = 1.., value_name = scenes::VALUE, default_value = "data/test")]
    scenes: Vec<PathBuf>,

    #[command(flatten)]
    running: Running,

    /// Print JSON
    #[arg(long, conflicts_with = "markdown")]
    json: bool,

    /// Print a Markdown table
    #[arg(long)]
    markdown: bool,
}

impl Score {
    pub(super) fn run(&self, log: Log) -> Result<String, Error> {
        let backend = self.running.backend.open(log)?.backend;
        let filters = filters(&self.filters, self.running.radius)?;
        let scenes = scenes::find(&self.scenes)?;
        let measuring = Measuring::with(&self.running, &*backend);
        let table = measuring.table(&scenes, &filters, Total::GeometricMean, log)?;
        for failure in table.failures() {
            log.say(failure);
        }
        Ok(match (self.json, self.markdown) {
            (true, _) => table.to_json(),
            (false, true) => table.render(Format::Markdown),
            (false, false) => table.render(Format::Plain),
        })
    }
}

/// The filters that texts stand for, under names of their own; all filters that
/// have names, if there are no texts. Another radius is for single weights: of the named
/// filters, programs are then left out.
pub(super) fn filters(texts: &[String], radius: Option<u32>) -> Result<Vec<Filter>, Error> {
    let takes = |name: &String| {
        radius.is_none() || Filter::named(name).is_some_and(|f| f.paper().is_some())
    };
    let all: Vec<String> = names().into_iter().filter(takes).collect();
    let texts = if texts.is_empty() { &all } else { texts };
    let filters: Result<Vec<Filter>, Error> =
        texts.iter().map(|text| resolve(text, radius)).collect();
    let filters = filters?;
    let distinct = filters.iter().zip(texts).enumerate().map(|(k, (filter, text))| {
        let namesakes = filters.iter().filter(|other| other.name == filter.name).count();
        let name = match namesakes {
            1 => filter.name.clone(),
            // Every search calls what it bred the same.
            _ if Path::new(text).is_file() => text.clone(),
            _ => format!("{} {}", filter.name, k + 1),
        };
        Filter { name, ..filter.clone() }
    });
    Ok(distinct.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_of_one_name_are_told_apart() {
        let named = |texts: [&str; 3]| -> Vec<String> {
            let filters = filters(&texts.map(str::to_owned), None).expect("they parse");
            filters.into_iter().map(|filter| filter.name).collect()
        };
        assert_eq!(named(["1", "bilateral", "2"]), ["expression 1", "bilateral", "expression 3"]);
    }
}
