//! `tamis filters`: the filters that have names.

use std::fmt::Write;

use clap::Args;
use serde::Serialize;

use super::error::Error;
use super::resolve;
use crate::expr::codebook;
use crate::expr::text::latex;
use crate::plan::{Filter, shipped};
use crate::report::score::json;

const EXAMPLES: &str = "\
Examples:
  tamis filters
  tamis filters kan2017 --latex";

/// List the filters that have names.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Filters {
    /// Filters to list: names, files or expressions [default: all that have names]
    #[arg(value_name = "FILTER")]
    filters: Vec<String>,

    /// Print weights as LaTeX
    #[arg(long, conflicts_with = "json")]
    latex: bool,

    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Entry {
    name: String,
    description: String,
    default: bool,
    stages: Vec<StageEntry>,
}

#[derive(Serialize)]
struct StageEntry {
    weight: String,
    radius: u32,
    dilation: u32,
}

impl Filters {
    pub(super) fn run(&self) -> Result<String, Error> {
        let every = || {
            let stand_ins = shipped::stand_ins().map(|filter| filter.name);
            resolve::names().into_iter().chain(stand_ins).collect()
        };
        let wanted = if self.filters.is_empty() { every() } else { self.filters.clone() };
        let mut entries = Vec::with_capacity(wanted.len());
        for text in wanted {
            entries.push(self.entry(resolve::resolve(&text, None)?));
        }
        if self.json {
            return Ok(json(&entries));
        }
        let mut text = String::new();
        for (k, entry) in entries.iter().enumerate() {
            let gap = if k > 0 { "\n" } else { "" };
            let default = if entry.default { " (default)" } else { "" };
            let Entry { name, description, .. } = entry;
            let _ = writeln!(text, "{gap}{name}{default}: {description}");
            for StageEntry { weight, radius, dilation } in &entry.stages {
                let apart = if *dilation > 1 {
                    format!(", {dilation} pixels apart")
                } else {
                    String::new()
                };
                let _ = writeln!(text, "  radius {radius}{apart}\n  {weight}");
            }
        }
        Ok(text)
    }

    fn entry(&self, filter: Filter) -> Entry {
        let known = codebook::known().iter().find(|known| known.name == filter.name);
        let description = match known {
            Some(known) => known.doc.to_owned(),
            None if shipped::bred().any(|bred| bred.name == filter.name) => {
                "bred by this program".to_owned()
            }
            None if shipped::stand_ins().any(|stand_in| stand_in.name == filter.name) => {
                "for files that hold no more guides than its name says".to_owned()
            }
            None => "given on the command line".to_owned(),
        };
        let stages = filter.stages.iter().map(|stage| StageEntry {
            weight: if self.latex { latex(&stage.weight) } else { stage.weight.to_string() },
            radius: stage.window.radius,
            dilation: stage.window.dilation,
        });
        let stages = stages.collect();
        let default = shipped::by_preference().next().is_some_and(|best| best.name == filter.name);
        Entry { name: filter.name, description, default, stages }
    }
}
