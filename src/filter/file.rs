//! Filter files: TOML, versioned.
//!
//! ```toml
//! version = 2
//! name = "two-pass"
//!
//! [absent]              # optional: what stands in for features that a file lacks
//! depth = 0
//! direct = "color"
//!
//! [params]              # optional: constants with names
//! delta = { value = 0.3, min = 0.01, max = 2 }
//! spread = 4            # without bounds; `tune = false` keeps one from being tuned
//!
//! [layers.bandwidth]    # optional: W and b of linear layers
//! weights = [[1, 0.5], [0, 2]]
//! bias = [0, 1]
//!
//! [[stage]]
//! name = "light"
//! map = "color / (albedo + delta)"
//!
//! [[stage]]
//! name = "smooth"
//! gather = "light"
//! weight = "exp(-distance2(normal, normal) * spread)"
//! radius = 2
//! dilation = 2          # 1 if left out
//! variance = "cVariance"  # optional: the stage then has `smooth.variance`
//!
//! [[stage]]
//! name = "result"
//! map = "smooth * (albedo + delta)"
//!
//! [training]            # optional: where the filter comes from
//! seed = 1
//! ```
//!
//! Files of version 1 list stages of `weight`, `radius` and `dilation`, of which there
//! can be one: they are read as a gather of the colour.
//!
//! A reader refuses what it does not know: a file of a later version, or a
//! stage with an option that this version lacks, would otherwise be applied
//! with another meaning than its writer's.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Checked, Filter, FilterError, Gather, Grid, Stage, StageKind, StandIn, Window};
use crate::expr::builder::LIMIT;
use crate::expr::constants::{Constants, Layer, Param};
use crate::expr::feature::{Feature, Quantity};
use crate::expr::text::{
    Declared, Reads, Scope, TextError, parse_formula, parse_scalar, print_formula,
};
use crate::expr::tree::Tree;

/// The version of the format that this library writes.
pub const VERSION: u32 = 2;

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
    /// A file of version 1 with no stage or several.
    #[error("{path}: files of version 1 have one [[stage]], and this one has {stages}; several need version 2", path = path.display())]
    Stages {
        /// Which file.
        path: PathBuf,
        /// How many it lists.
        stages: usize,
    },
    /// A stage is neither a map nor a gather, or half of each.
    #[error("{path}: stage `{stage}` {problem}; a map has `map`, a gather has `gather`, `weight` and `radius`, and may have `dilation` and `variance`; both may have `grid`", path = path.display())]
    Kind {
        /// Which file.
        path: PathBuf,
        /// The stage's name.
        stage: String,
        /// What is wrong.
        problem: &'static str,
    },
    /// A formula cannot be read.
    #[error("{path}: `{key}` of stage `{stage}` cannot be parsed:\n{source}", path = path.display())]
    Formula {
        /// Which file.
        path: PathBuf,
        /// The stage's name, or its number in files of version 1.
        stage: String,
        /// Which formula.
        key: &'static str,
        /// Where and why.
        source: Box<TextError>,
    },
    /// `[absent]` names what is no feature.
    #[error("{path}: [absent]: `{name}` is no feature that a file can lack, no stand-in for one, or named twice", path = path.display())]
    Absent {
        /// Which file.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// The filter makes no sense.
    #[error("{path}: {source}", path = path.display())]
    Filter {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: FilterError,
    },
}

/// A file of version 1.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Version1 {
    #[serde(rename = "version")]
    _version: u32,
    name: String,
    stage: Vec<Weight>,
    #[serde(default, rename = "training")]
    _training: toml::Table,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Weight {
    weight: String,
    radius: u32,
    #[serde(default = "one")]
    dilation: u32,
    #[serde(default, rename = "source")]
    _source: Color,
}

/// The one source that stages of version 1 have.
#[derive(Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Color {
    #[default]
    Color,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    name: String,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    absent: BTreeMap<String, AbsentText>,
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    params: toml::Table,
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    layers: toml::Table,
    stage: Vec<StageText>,
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    training: toml::Table,
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum AbsentText {
    Constant(f64),
    Feature(String),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum ParamText {
    Value(f64),
    Bounded(BoundedText),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BoundedText {
    value: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    min: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max: Option<f64>,
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    tune: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LayerText {
    weights: Vec<Vec<f64>>,
    bias: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StageText {
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    map: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gather: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    weight: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    radius: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dilation: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    variance: Option<String>,
    #[serde(default, skip_serializing_if = "is_full")]
    grid: GridText,
}

#[derive(Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum GridText {
    #[default]
    Full,
    Half,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
fn is_full(grid: &GridText) -> bool {
    *grid == GridText::Full
}

fn one() -> u32 {
    1
}

fn yes() -> bool {
    true
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
fn is_yes(yes: &bool) -> bool {
    *yes
}

/// The shortest decimal of a number of 32 bits, as the number of 64 bits that it names.
fn decimal(x: f32) -> f64 {
    x.to_string().parse().expect("a number's text is a number")
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
        // The version comes first: another one has another form.
        #[derive(Deserialize)]
        struct Versioned {
            version: u32,
        }
        let format = |source| FilterFileError::Format { path: path.to_owned(), source };
        let Versioned { version: found } = toml::from_str(text).map_err(format)?;
        let filter = match found {
            0..=1 => Self::version_1(toml::from_str(text).map_err(format)?, path)?,
            VERSION => Reader { path }.filter(toml::from_str(text).map_err(format)?)?,
            _ => return Err(FilterFileError::Version { path: path.to_owned(), found }),
        };
        let sense = |source| FilterFileError::Filter { path: path.to_owned(), source };
        filter.check().map_err(sense)?;
        Ok(filter)
    }

    fn version_1(file: Version1, path: &Path) -> Result<Self, FilterFileError> {
        let stages = file.stage.len();
        let Ok([stage]) = <[Weight; 1]>::try_from(file.stage) else {
            return Err(FilterFileError::Stages { path: path.to_owned(), stages });
        };
        let Weight { weight, radius, dilation, _source: Color::Color } = stage;
        let weight = parse_scalar(&weight).map_err(|source| FilterFileError::Formula {
            path: path.to_owned(),
            stage: "1".to_owned(),
            key: "weight",
            source: Box::new(source),
        })?;
        Ok(Self::of_gather(file.name, Gather::of_color(weight, Window { radius, dilation })))
    }

    /// A number that tells filters apart: that of another text is another, but for one pair
    /// in 2^64. (FNV-1a of the file's text without what it says of its training.)
    pub fn fingerprint(&self) -> u64 {
        let text = self.to_toml(toml::Table::new());
        let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        text.bytes().fold(0xcbf2_9ce4_8422_2325, step)
    }

    /// The filter as a file's text, with what is worth knowing of its origin.
    ///
    /// # Panics
    /// If the filter makes no sense: see [`Filter::check`].
    pub fn to_toml(&self, training: toml::Table) -> String {
        let checked = self.check().expect("what is written makes sense");
        let table = |value: Result<toml::Value, _>| value.expect("numbers are TOML");
        let params = self.constants.params.iter().map(|param| {
            let [low, high] = param.bounds;
            let bound = |x: f32| (x.abs() < LIMIT).then(|| decimal(x));
            let text = match (bound(low), bound(high), param.tuned) {
                (None, None, true) => ParamText::Value(decimal(param.value)),
                (min, max, tune) => {
                    let value = decimal(param.value);
                    ParamText::Bounded(BoundedText { value, min, max, tune })
                }
            };
            (param.name.clone(), table(toml::Value::try_from(text)))
        });
        let layers = self.constants.layers.iter().map(|layer| {
            let row = |row: &Vec<f32>| row.iter().copied().map(decimal).collect();
            let weights = layer.weights.iter().map(row).collect();
            let text = LayerText { weights, bias: row(&layer.bias) };
            (layer.name.clone(), table(toml::Value::try_from(text)))
        });
        let absent = self.absent.iter().map(|&(feature, stand_in)| {
            let text = match stand_in {
                StandIn::Constant(x) => AbsentText::Constant(decimal(x)),
                StandIn::Feature(other) => AbsentText::Feature(other.term().to_owned()),
            };
            (feature.term().to_owned(), text)
        });
        let file = File {
            version: VERSION,
            name: self.name.clone(),
            absent: absent.collect(),
            params: params.collect(),
            layers: layers.collect(),
            stage: (0..self.stages.len()).map(|k| stage_text(&checked, k)).collect(),
            training,
        };
        toml::to_string(&file).expect("strings, numbers and tables are TOML")
    }
}

/// What programs call a quantity of a feature; none for one that formulas cannot name.
pub fn spelling(feature: Feature, quantity: Quantity) -> Option<&'static str> {
    match quantity {
        Quantity::Value => Some(feature.term()),
        Quantity::Gradient | Quantity::Variance => feature.spelling(quantity),
    }
}

/// A formula of stage number `k`.
pub fn formula(checked: &Checked<'_>, k: usize, tree: &Tree, reads: Reads) -> String {
    print_formula(tree, &checked.scope(k, reads))
}

fn stage_text(checked: &Checked<'_>, k: usize) -> StageText {
    let Stage { name, kind, grid } = &checked.filter().stages[k];
    let text = |tree: &Tree, reads: Reads| formula(checked, k, tree, reads);
    let mut written = StageText {
        name: name.clone(),
        map: None,
        gather: None,
        weight: None,
        radius: None,
        dilation: None,
        variance: None,
        grid: match grid {
            Grid::Full => GridText::Full,
            Grid::Half => GridText::Half,
        },
    };
    match kind {
        StageKind::Map(value) => written.map = Some(text(value, Reads::Pixel)),
        StageKind::Gather(gather) => {
            written.gather = Some(text(&gather.of, Reads::Pixel));
            written.weight = Some(text(&gather.weight, Reads::Pair));
            written.radius = Some(gather.window.radius);
            written.dilation = (gather.window.dilation != 1).then_some(gather.window.dilation);
            written.variance = gather.variance.as_ref().map(|v| text(v, Reads::Pixel));
        }
    }
    written
}

/// Reads files of version 2.
struct Reader<'a> {
    path: &'a Path,
}

impl Reader<'_> {
    fn filter(&self, file: File) -> Result<Filter, FilterFileError> {
        let mut filter = Filter {
            name: file.name,
            stages: Vec::with_capacity(file.stage.len()),
            constants: self.constants(file.params, file.layers)?,
            absent: self.absent(file.absent)?,
        };
        let names: Vec<String> = file.stage.iter().map(|stage| stage.name.clone()).collect();
        let mut declared: Vec<Declared> = Vec::with_capacity(names.len());
        for (k, text) in file.stage.into_iter().enumerate() {
            let stage = self.stage(text, &filter.constants, &declared, &names[k..])?;
            let (width, variance) = match &stage.kind {
                StageKind::Map(value) => (value.width(), false),
                StageKind::Gather(gather) => (gather.of.width(), gather.variance.is_some()),
            };
            declared.push(Declared { name: stage.name.clone(), width: width as u16, variance });
            filter.stages.push(stage);
        }
        Ok(filter)
    }

    fn stage(
        &self,
        text: StageText,
        constants: &Constants,
        stages: &[Declared],
        later: &[String],
    ) -> Result<Stage, FilterFileError> {
        let StageText { name, map, gather, weight, radius, dilation, variance, grid } = text;
        let grid = match grid {
            GridText::Full => Grid::Full,
            GridText::Half => Grid::Half,
        };
        let formula = |key: &'static str, text: &str, reads: Reads| {
            let scope = Scope { reads, stages, later, constants: Some(constants) };
            parse_formula(text, &scope).map_err(|source| FilterFileError::Formula {
                path: self.path.to_owned(),
                stage: name.clone(),
                key,
                source: Box::new(source),
            })
        };
        let problem = |problem: &'static str| FilterFileError::Kind {
            path: self.path.to_owned(),
            stage: name.clone(),
            problem,
        };
        let kind = match (map, gather) {
            (Some(map), None) => {
                let options = [weight.is_some(), radius.is_some(), dilation.is_some()];
                if options.contains(&true) || variance.is_some() {
                    return Err(problem("is a map, and has what only gathers have"));
                }
                StageKind::Map(formula("map", &map, Reads::Pixel)?)
            }
            (None, Some(gather)) => {
                let Some(weight) = weight else { return Err(problem("has no `weight`")) };
                let Some(radius) = radius else { return Err(problem("has no `radius`")) };
                let variance = variance.map(|text| formula("variance", &text, Reads::Pixel));
                StageKind::Gather(Gather {
                    of: formula("gather", &gather, Reads::Pixel)?,
                    weight: formula("weight", &weight, Reads::Pair)?,
                    window: Window { radius, dilation: dilation.unwrap_or(1) },
                    variance: variance.transpose()?,
                })
            }
            (Some(_), Some(_)) => return Err(problem("has both `map` and `gather`")),
            (None, None) => return Err(problem("has neither `map` nor `gather`")),
        };
        Ok(Stage { name, kind, grid })
    }

    fn constants(
        &self,
        params: toml::Table,
        layers: toml::Table,
    ) -> Result<Constants, FilterFileError> {
        let format = |source| FilterFileError::Format { path: self.path.to_owned(), source };
        let params = params.into_iter().map(|(name, text)| {
            let text: ParamText = text.try_into().map_err(format)?;
            let BoundedText { value, min, max, tune } = match text {
                ParamText::Value(value) => BoundedText { value, min: None, max: None, tune: true },
                ParamText::Bounded(text) => text,
            };
            let bounds = [min.map_or(-LIMIT, |x| x as f32), max.map_or(LIMIT, |x| x as f32)];
            Ok(Param { name, value: value as f32, bounds, tuned: tune })
        });
        let layers = layers.into_iter().map(|(name, text)| {
            let LayerText { weights, bias } = text.try_into().map_err(format)?;
            let row = |row: Vec<f64>| row.into_iter().map(|x| x as f32).collect();
            let weights = weights.into_iter().map(row).collect();
            Ok(Layer { name, weights, bias: row(bias) })
        });
        Ok(Constants {
            params: params.collect::<Result<_, _>>()?,
            layers: layers.collect::<Result<_, _>>()?,
        })
    }

    fn absent(
        &self,
        absent: BTreeMap<String, AbsentText>,
    ) -> Result<Vec<(Feature, StandIn)>, FilterFileError> {
        let feature = |name: &str| match Feature::parse(name) {
            Some((feature, Quantity::Value)) => Ok(feature),
            Some((_, Quantity::Gradient | Quantity::Variance)) | None => {
                Err(FilterFileError::Absent { path: self.path.to_owned(), name: name.to_owned() })
            }
        };
        let stand_in = |text| match text {
            AbsentText::Constant(x) => Ok(StandIn::Constant(x as f32)),
            AbsentText::Feature(name) => Ok(StandIn::Feature(feature(&name)?)),
        };
        let mut read: Vec<(Feature, StandIn)> = Vec::with_capacity(absent.len());
        for (name, text) in absent {
            let feature = feature(&name)?;
            // A feature has two names.
            if read.iter().any(|(known, _)| *known == feature) {
                return Err(FilterFileError::Absent { path: self.path.to_owned(), name });
            }
            read.push((feature, stand_in(text)?));
        }
        read.sort_by_key(|&(feature, _)| feature);
        Ok(read)
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
        assert_eq!(filter.paper().expect("one gather").window, Window::dense(3));
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
        assert!(weight.contains("stage `1`"), "{weight}");
        let window = message(
            "version = 1\nname = \"x\"\n[[stage]]\nweight = \"1\"\nradius = 4000000\ndilation = 4000\n",
        );
        assert!(window.contains("4000000"), "{window}");
        assert!(message("version = 1\nname = \"x\"\nstage = []\n").contains("[[stage]]"));
    }
}
