//! `tamis export`: a filter as code or equations for others.

use std::fs;
use std::io::{self, IsTerminal};
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use super::backend::precisions;
use super::error::Error;
use super::resolve::resolve;
use crate::export::{Export as Exported, ExportError, Language, Options, export};
use crate::expr::Feature;
use crate::filter::Window;
use crate::image::write_atomically;
use crate::plan::Precision;

const EXAMPLES: &str = "\
Examples:
  tamis export tamis --lang c -o tamis.c                    # and tamis.h
  tamis export tamis --lang wgsl -o tamis_wgsl              # a folder: kernels, manifest.json
  tamis export tamis --lang python --without depth -o tamis.py
  tamis export cross-bilateral --lang hlsl --precision fast -o cross_bilateral.hlsl
  tamis export bilateral --lang spirv -o bilateral.spv
  tamis export out/best.toml --lang latex
  tamis export 'exp(-distance2(normal, normal) / 0.1)' --lang wgsl --radius 6

The first lines of every export say what the weight looks at and in which units;
those of shaders, also what to bind and dispatch. SPIR-V holds them as its source.
C of a program (a filter of several stages) is two files, FILE and beside it FILE with the
ending `.h`; on stdout it is the code alone, which is complete. Shaders of a program are a
new folder of kernels with a manifest: buffers, lengths, dispatch sizes, halo, taps.";

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

    /// Where it goes: a file, or for shaders of a program a new folder [default: stdout]
    #[arg(long, short, value_name = "PATH")]
    output: Option<PathBuf>,

    /// Features that the renderer does not have: a program's code then has what stands in for
    /// them
    #[arg(long, value_name = "FEATURE,...", value_delimiter = ',', value_parser = features())]
    without: Vec<Feature>,

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

/// Reads a feature that a file may lack by its name, and lists them all.
fn features() -> impl TypedValueParser<Value = Feature> {
    let stored = Feature::ALL.into_iter().filter(|&f| f.is_stored() && f != Feature::Color);
    let listed = stored.map(|feature| {
        let row = feature.row();
        PossibleValue::new(row.term.unwrap_or(row.name)).alias(row.name).help(row.doc)
    });
    PossibleValuesParser::new(listed.collect::<Vec<_>>())
        .map(|name| Feature::parse(&name).expect("the command line accepts no other name").0)
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
        let options = Options { precision: self.precision, without: &self.without };
        let exported = match export(&filter, self.lang, &options) {
            Err(error @ ExportError::AlwaysExact { .. }) => Err(Error::Usage(error.to_string())),
            result => result.map_err(Error::Export),
        }?;
        let Some(path) = &self.output else {
            return exported.into_file().ok_or_else(|| {
                Error::Usage(format!(
                    "`--lang {name}` of a program is a folder of kernels; name it with --output"
                ))
            });
        };
        match exported {
            Exported::Single(bytes) => write_atomically(path, &bytes)?,
            // Beside a pipe or a device stands no header.
            Exported::WithHeader { code, .. } if path.exists() && !path.is_file() => {
                write_atomically(path, &code)?;
            }
            Exported::WithHeader { code, header } => {
                let beside = path.with_extension("h");
                if beside == *path {
                    return Err(Error::Usage(format!(
                        "--output {}: the ending `.h` is for the header, which is written beside the \
                         code; name a file that ends in `.c`",
                        path.display()
                    )));
                }
                write_atomically(&beside, &header)?;
                write_atomically(path, &code)?;
            }
            Exported::Folder(files) => {
                let failed = |source| Error::Folder {
                    path: path.display().to_string(),
                    option: "--output",
                    source,
                };
                fs::create_dir_all(path).map_err(failed)?;
                // Kernels of another export would stand among these.
                if fs::read_dir(path).map_err(failed)?.next().is_some() {
                    return Err(Error::Usage(format!(
                        "--output {}: the folder is not empty; name a new one, or remove what is in it",
                        path.display()
                    )));
                }
                for (name, bytes) in &files {
                    write_atomically(&path.join(name), bytes)?;
                }
            }
        }
        Ok(Vec::new())
    }
}
