//! `tamis filters`: the filters that have names.

use std::fmt::Write;

use clap::{Args, Subcommand};
use serde::Serialize;

use super::error::Error;
use super::resolve;
use crate::expr::codebook;
use crate::expr::text::latex;
use crate::filter::{Filter, names, shipped, show};
use crate::report::score::json;

const EXAMPLES: &str = "\
Examples:
  tamis filters
  tamis filters kan2017 --latex
  tamis filters show tamis-formula";

/// List the filters that have names.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, args_conflicts_with_subcommands = true)]
pub(super) struct Filters {
    #[command(subcommand)]
    show: Option<Show>,

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

#[derive(Debug, Subcommand)]
enum Show {
    /// Print what a filter computes: its stages as formulas, its constants, what it reads
    /// and what stands in for what a file lacks
    Show {
        /// A filter's name, a filter file, or an expression
        #[arg(value_name = "FILTER")]
        filter: String,
    },
}

#[derive(Serialize)]
struct Entry {
    name: String,
    description: String,
    default: bool,
    /// How many stages a program has; 1 for a single weight.
    stage_count: usize,
    /// The weight of a filter of the paper's; empty for programs.
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
        if let Some(Show::Show { filter }) = &self.show {
            let filter = resolve::resolve(filter, None)?;
            let checked = filter.check().expect("only filters that make sense get here");
            return Ok(format!("{}\n\n{}", filter.name, show(&checked)));
        }
        let named = !self.filters.is_empty();
        let wanted = if named { self.filters.clone() } else { names() };
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
            let Entry { name, description, stage_count, .. } = entry;
            let _ = writeln!(text, "{gap}{name}{default}: {description}");
            if entry.stages.is_empty() {
                let _ = writeln!(
                    text,
                    "  a program of {stage_count} stages: `tamis filters show {name}` prints it"
                );
            }
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
            None if shipped::programs().any(|program| program.name == filter.name) => {
                "written by hand, its constants tuned by gradients".to_owned()
            }
            None => "given on the command line".to_owned(),
        };
        let stage_count = filter.stages.len();
        let stages = filter.paper().into_iter().map(|gather| StageEntry {
            weight: if self.latex { latex(&gather.weight) } else { gather.weight.to_string() },
            radius: gather.window.radius,
            dilation: gather.window.dilation,
        });
        let stages = stages.collect();
        let default = shipped::best().name == filter.name;
        Entry { name: filter.name, description, default, stage_count, stages }
    }
}
