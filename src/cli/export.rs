//! `tamis export`: a filter as code or equations for others.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use super::error::Error;
use super::resolve::resolve;
use crate::export::{Language, export};
use crate::plan::Window;
use crate::scene::write_atomically;

const EXAMPLES: &str = "\
Examples:
  tamis export tamis-1 --lang c -o tamis_1.c
  tamis export out/best.toml --lang latex
  tamis export 'exp(-distance2(normal, normal) / 0.1)' --lang c --radius 6

The first lines of every export say what the weight looks at and in which units.";

/// Write a filter as code or equations to paste elsewhere.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Export {
    /// A filter's name (see `tamis filters`), a filter file, or an expression
    #[arg(value_name = "FILTER")]
    filter: String,

    /// The language
    #[arg(long, short, value_name = "LANGUAGE", value_parser = languages())]
    lang: Language,

    /// Where the text goes [default: stdout]
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Window radius in pixels [default: the filter's own; 10 for expressions]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(..=i64::from(Window::MAX_RADIUS)))]
    radius: Option<u32>,
}

/// Reads a language by its name, and lists them all.
fn languages() -> impl TypedValueParser<Value = Language> {
    let listed = |language: Language| PossibleValue::new(language.name()).help(language.doc());
    PossibleValuesParser::new(Language::ALL.map(listed))
        .map(|name| Language::named(&name).expect("the command line accepts no other name"))
}

impl Export {
    pub(super) fn run(&self) -> Result<Vec<u8>, Error> {
        let text = export(&resolve(&self.filter, self.radius)?, self.lang)?;
        match &self.output {
            Some(path) => {
                write_atomically(path, &text)?;
                Ok(Vec::new())
            }
            None => Ok(text),
        }
    }
}
