//! Filter files: TOML, versioned.
//!
//! ```toml
//! version = 1
//! name = "gaussian"
//!
//! [[stage]]
//! weight = "exp(-pow(distance2(pixel, pixel), 2) / 50)"
//! radius = 10
//!
//! [training]            # optional: where the filter comes from
//! seed = 1
//! ```
//!
//! A reader refuses what it does not know: a file of a later version, or a
//! stage with an option that this version lacks, would otherwise be applied
//! with another meaning than its writer's.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::filter::{Filter, Source, Stage, Window};
use crate::expr::text::TextError;

/// The version of the format that this library writes.
pub const VERSION: u32 = 1;

/// Why a filter file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum FilterFileError {
    /// The file could not be read.
    #[error("{path}: cannot read the filter file: {source}", path = path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is no TOML, or not of the expected form.
    #[error("{path}: not a filter file: {source}", path = path.display())]
    Format {
        /// Which file.
        path: PathBuf,
        /// Where and why.
        source: toml::de::Error,
    },
    /// It was written by a later version.
    #[error("{path}: filter files of version {found} are newer than this program, which reads up to {VERSION}; update it", path = path.display())]
    Version {
        /// Which file.
        path: PathBuf,
        /// The version that it states.
        found: u32,
    },
    /// It lists no stage.
    #[error("{path}: the file has no [[stage]]", path = path.display())]
    NoStage {
        /// Which file.
        path: PathBuf,
    },
    /// A weight is no expression.
    #[error("{path}: the weight of stage {stage} cannot be parsed:\n{source}", path = path.display())]
    Weight {
        /// Which file.
        path: PathBuf,
        /// Counted from 1.
        stage: usize,
        /// Where and why.
        source: Box<TextError>,
    },
    /// A window is empty or larger than is accepted.
    #[error("{path}: stage {stage} has radius {radius} and dilation {dilation}; the dilation must be at least 1 and their product at most {max}", path = path.display(), max = Window::MAX_RADIUS)]
    Window {
        /// Which file.
        path: PathBuf,
        /// Counted from 1.
        stage: usize,
        /// The radius that it states.
        radius: u32,
        /// The dilation that it states.
        dilation: u32,
    },
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    name: String,
    stage: Vec<StageText>,
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    training: toml::Table,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StageText {
    weight: String,
    radius: u32,
    #[serde(default = "one")]
    dilation: u32,
    #[serde(default)]
    source: Source,
}

fn one() -> u32 {
    1
}

impl Filter {
    /// Reads a filter file.
    pub fn read(path: &Path) -> Result<Self, FilterFileError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| FilterFileError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Parses a filter file's text; `path` only names it in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FilterFileError> {
        // The version comes first: a later one may have another form.
        #[derive(Deserialize)]
        struct Versioned {
            version: u32,
        }
        let path = || path.to_owned();
        let format = |source| FilterFileError::Format { path: path(), source };
        let Versioned { version: found } = toml::from_str(text).map_err(format)?;
        if found > VERSION {
            return Err(FilterFileError::Version { path: path(), found });
        }
        let file: File = toml::from_str(text).map_err(format)?;
        if file.stage.is_empty() {
            return Err(FilterFileError::NoStage { path: path() });
        }
        let stages = file.stage.into_iter().zip(1..).map(|(text, stage)| {
            let StageText { weight, radius, dilation, source } = text;
            if dilation == 0
                || radius.checked_mul(dilation).is_none_or(|reach| reach > Window::MAX_RADIUS)
            {
                return Err(FilterFileError::Window { path: path(), stage, radius, dilation });
            }
            let weight = weight.parse().map_err(|source| {
                let source = Box::new(source);
                FilterFileError::Weight { path: path(), stage, source }
            })?;
            Ok(Stage { weight, window: Window { radius, dilation }, source })
        });
        Ok(Self { name: file.name, stages: stages.collect::<Result<_, _>>()? })
    }

    /// The filter as a file's text, with what is worth knowing of its origin.
    pub fn to_toml(&self, training: toml::Table) -> String {
        let file = File {
            version: VERSION,
            name: self.name.clone(),
            stage: self
                .stages
                .iter()
                .map(|stage| StageText {
                    weight: stage.weight.to_string(),
                    radius: stage.window.radius,
                    dilation: stage.window.dilation,
                    source: stage.source,
                })
                .collect(),
            training,
        };
        toml::to_string(&file).expect("strings, numbers and tables are TOML")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Filter, FilterFileError> {
        Filter::parse(text, Path::new("filter.toml"))
    }

    #[test]
    fn a_written_filter_reads_back() {
        let filter = parse(
            "version = 1\nname = \"x\"\n[[stage]]\nweight = \"exp(-distance2(normal, normal))\"\nradius = 3\n",
        )
        .unwrap();
        assert_eq!(filter.stages[0].window, Window::dense(3));
        let mut training = toml::Table::new();
        training.insert("seed".into(), 7.into());
        assert_eq!(parse(&filter.to_toml(training)).unwrap(), filter);
    }

    #[test]
    fn what_is_not_understood_is_refused_by_name() {
        let stage = "[[stage]]\nweight = \"1\"\nradius = 3\n";
        let message = |text: &str| parse(text).unwrap_err().to_string();
        let future = message("version = 9\nname = \"x\"\nsurprise = 1\n");
        assert!(future.contains("filter.toml") && future.contains("version 9"), "{future}");
        let unknown = message(&format!("version = 1\nname = \"x\"\n{stage}guide = 2\n"));
        assert!(unknown.contains("guide"), "{unknown}");
        let weight =
            message("version = 1\nname = \"x\"\n[[stage]]\nweight = \"exp(\"\nradius = 3\n");
        assert!(weight.contains("stage 1"), "{weight}");
        let window = message(
            "version = 1\nname = \"x\"\n[[stage]]\nweight = \"1\"\nradius = 4000000\ndilation = 4000\n",
        );
        assert!(window.contains("4000000"), "{window}");
        assert!(message("version = 1\nname = \"x\"\nstage = []\n").contains("[[stage]]"));
    }
}
