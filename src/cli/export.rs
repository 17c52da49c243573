//! `tamis export`: a filter as code or equations for others.

use std::io::{self, IsTerminal};
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use super::backend::precisions;
use super::error::Error;
use super::resolve::resolve;
use crate::export::{ExportError, Language, export};
use crate::filter::Window;
use crate::image::write_atomically;
use crate::plan::Precision;

const EXAMPLES: &str = "\
Examples:
  tamis export tamis-2 --lang c -o tamis_2.c
  tamis export tamis-2 --lang hlsl --precision fast -o tamis_2.hlsl
  tamis export bilateral --lang spirv -o bilateral.spv
  tamis export out/best.toml --lang latex
  tamis export 'exp(-distance2(normal, normal) / 0.1)' --lang wgsl --radius 6

The first lines of every export say what the weight looks at and in which units;
those of shaders, also what to bind and dispatch. SPIR-V holds them as its source.";

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

    /// How accurate code is; equations are exact
    #[arg(long, value_name = "PRECISION", default_value = Precision::Standard.name(), value_parser = precisions())]
    precision: Precision,
}

/// Reads a language by its name, and lists them all.
fn languages() -> impl TypedValueParser<Value = Language> {
    let listed = |language: Language| PossibleValue::new(language.name()).help(language.doc());
    PossibleValuesParser::new(Language::ALL.map(listed))
        .map(|name| Language::named(&name).expect("the command line accepts no other name"))
}

impl Export {
    pub(super) fn run(&self) -> Result<Vec<u8>, Error> {
        let name = self.lang.name();
        if self.lang.is_binary() && self.output.is_none() && io::stdout().is_terminal() {
            return Err(Error::Usage(format!(
                "`--lang {name}` is binary and would garble the terminal; name a file with \
                 --output, or redirect stdout"
            )));
        }
        let filter = resolve(&self.filter, self.radius)?;
        let bytes = match export(&filter, self.lang, self.precision) {
            Err(error @ ExportError::AlwaysExact { .. }) => Err(Error::Usage(error.to_string())),
            result => result.map_err(Error::Export),
        }?;
        match &self.output {
            Some(path) => {
                write_atomically(path, &bytes)?;
                Ok(Vec::new())
            }
            None => Ok(bytes),
        }
    }
}
