//! The search's parameters as flags: one row each, with the presets' values
//! in the help read off the presets.

use clap::builder::ValueParser;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};

use crate::evolve::{Preset, Settings};
use crate::expr::grammar::Primitives;
use crate::image::metric::Measure;
use crate::plan::Precision;

/// A parameter.
struct Parameter {
    /// The flag, which is also the identifier.
    flag: &'static str,
    value: &'static str,
    doc: &'static str,
    get: fn(&Settings) -> String,
    set: fn(&mut Settings, &str) -> Result<(), String>,
}

macro_rules! parameters {
    ($($flag:literal $value:literal $($field:ident).+: $doc:literal;)*) => {
        &[$(Parameter {
            flag: $flag,
            value: $value,
            doc: $doc,
            get: |settings| Text::text(&settings.$($field).+),
            set: |settings, text| {
                settings.$($field).+ = Text::parsed(text)?;
                Ok(())
            },
        }),*]
    };
}

const PARAMETERS: &[Parameter] = parameters! {
    "seed" "N" seed:
        "Names the random streams: the same seed finds the same filter";
    "error" "ERROR" error:
        "What is minimised: rel-mse (the paper's), which puts small lights out with the fireflies, or two-sided, which keeps them";
    "precision" "PRECISION" precision:
        "How accurately filters are computed while they are bred: standard, or fast, in three quarters of the time; finalists are judged at standard";
    "generations" "N" generations:
        "Generations after the initial population";
    "radius" "PIXELS" radius:
        "Window radius that filters are bred with";
    "share" "SHARE" share:
        "Share of the training pixels that breeding looks at, in tiles; 1 for all";
    "islands" "N" islands:
        "Populations that breed apart";
    "island-size" "N" island_size:
        "Expressions on each island";
    "migration" "N" migration_interval:
        "Generations between migrations of each island's best; 0 for none";
    "tournament" "N" tournament:
        "Individuals in a tournament for parenthood";
    "reproduction" "SHARE" reproduction:
        "Share of a generation that is copied, the best among it";
    "crossover" "SHARE" crossover:
        "Share of a generation that crossover makes";
    "mutation" "SHARE" mutation:
        "Share of a generation that mutation makes";
    "replace" "WEIGHT" mutations.replace:
        "How often mutation replaces a node by a compatible one";
    "swap" "WEIGHT" mutations.swap:
        "How often it swaps two subtrees";
    "insert" "WEIGHT" mutations.insert:
        "How often it inserts from the codebook of known filters";
    "delete" "WEIGHT" mutations.delete:
        "How often it makes a subtree the constant 1";
    "jitter" "WEIGHT" mutations.jitter:
        "How often it multiplies a constant (not in the paper)";
    "jitter-sigma" "SIGMA" jitter_sigma:
        "Standard deviation of that factor's logarithm";
    "max-nodes" "N" max_nodes:
        "Most nodes of an expression";
    "max-depth" "N" max_depth:
        "Most levels of an expression";
    "initial" "NAME|EXPRESSION" initial:
        "What the initial population are mutants of";
    "initial-mutations" "N" initial_mutations:
        "Most mutations between it and them";
    "primitives" "SET" primitives:
        "The operators that expressions are made of: paper (its Figure 2), or all that the language has";
    "forbid" "NAME,..." forbidden:
        "Features and operators that expressions must not use";
    "finalists" "N" finalists:
        "Best expressions judged on all pixels at the end";
    "batch" "N" batch:
        "Expressions judged at once; no result depends on it";
    "together" "N" together:
        "Expressions compiled into one program, which computes once what they share; no result depends on it";
    "remembered" "NODES" remembered:
        "Most nodes of the expressions whose fitness is remembered; those that were not bred for longest are forgotten first";
    "racing" "on|off" racing.on:
        "Whether expressions that cannot win are given up early (not in the paper)";
    "rungs" "SHARE,..." racing.rungs:
        "Shares of the pixels looked at after which some are given up";
    "bar" "QUANTILE" racing.bar:
        "What they have to beat: this quantile of their island's last generation, 0 for its best";
    "deviations" "N" racing.deviations:
        "By how many standard errors they must fail to";
};

/// The one parameter that a resumed search may change.
const GENERATIONS: &str = "generations";

/// A parameter's value as text.
trait Text: Sized {
    fn text(&self) -> String;
    fn parsed(text: &str) -> Result<Self, String>;
}

macro_rules! plain_text {
    ($($of:ty)*) => {
        $(impl Text for $of {
            fn text(&self) -> String {
                self.to_string()
            }
            fn parsed(text: &str) -> Result<Self, String> {
                text.parse().map_err(|error| format!("{error}"))
            }
        })*
    };
}

plain_text! { u32 u64 usize f64 String }

impl Text for bool {
    fn text(&self) -> String {
        if *self { "on" } else { "off" }.to_owned()
    }
    fn parsed(text: &str) -> Result<Self, String> {
        match text {
            "on" => Ok(true),
            "off" => Ok(false),
            _ => Err("must be `on` or `off`".to_owned()),
        }
    }
}

impl Text for Measure {
    fn text(&self) -> String {
        self.name().to_owned()
    }
    fn parsed(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|measure| measure.name() == text);
        known.ok_or_else(|| {
            format!("must be {}", Self::ALL.map(|m| format!("`{}`", m.name())).join(" or "))
        })
    }
}

impl Text for Precision {
    fn text(&self) -> String {
        self.name().to_owned()
    }
    fn parsed(text: &str) -> Result<Self, String> {
        Self::named(text).ok_or_else(|| {
            format!("must be {}", Self::ALL.map(|p| format!("`{}`", p.name())).join(" or "))
        })
    }
}

impl Text for Primitives {
    fn text(&self) -> String {
        self.name().to_owned()
    }
    fn parsed(text: &str) -> Result<Self, String> {
        Self::named(text).ok_or_else(|| {
            format!("must be {}", Self::ALL.map(|set| format!("`{}`", set.name())).join(" or "))
        })
    }
}

impl Text for Vec<f64> {
    fn text(&self) -> String {
        self.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
    }
    fn parsed(text: &str) -> Result<Self, String> {
        text.split(',').map(|number| f64::parsed(number.trim())).collect()
    }
}

impl Text for Vec<String> {
    fn text(&self) -> String {
        self.join(",")
    }
    fn parsed(text: &str) -> Result<Self, String> {
        Ok(text
            .split(',')
            .map(|name| name.trim().to_owned())
            .filter(|name| !name.is_empty())
            .collect())
    }
}

/// The parameters that the command line gives.
#[derive(Clone, Debug, Default)]
pub(super) struct Parameters {
    given: Vec<(usize, String)>,
}

impl Parameters {
    /// Changes settings as the command line says.
    pub(super) fn apply(&self, settings: &mut Settings) {
        for (row, text) in &self.given {
            (PARAMETERS[*row].set)(settings, text).expect("the command line parser tried it");
        }
    }

    /// Whether the command line gives a parameter, by its flag's name.
    pub(super) fn gives(&self, flag: &str) -> bool {
        self.given.iter().any(|&(row, _)| PARAMETERS[row].flag == flag)
    }

    /// The flags given that a search under way cannot obey.
    pub(super) fn fixed(&self) -> Vec<String> {
        let flags = self.given.iter().map(|(row, _)| PARAMETERS[*row].flag);
        flags.filter(|&flag| flag != GENERATIONS).map(|flag| format!("--{flag}")).collect()
    }
}

/// Every parameter's flag, value and meaning.
pub(super) fn listing(settings: &Settings) -> impl Iterator<Item = [String; 3]> {
    PARAMETERS.iter().map(|p| [format!("--{}", p.flag), (p.get)(settings), p.doc.to_owned()])
}

impl Args for Parameters {
    fn augment_args(command: Command) -> Command {
        let presets = Preset::ALL.map(|preset| (preset.name(), preset.settings()));
        command.args(PARAMETERS.iter().map(|parameter| {
            let values = presets.each_ref().map(|(name, settings)| {
                let value = (parameter.get)(settings);
                (name, if value.is_empty() { "none".to_owned() } else { value })
            });
            let values = match &values {
                [(_, a), (_, b)] if a == b => a.clone(),
                different => {
                    different.each_ref().map(|(name, v)| format!("{name}: {v}")).join(", ")
                }
            };
            let set = parameter.set;
            Arg::new(parameter.flag)
                .long(parameter.flag)
                .value_name(parameter.value)
                .help(format!("{} [{values}]", parameter.doc))
                .help_heading("Parameters of the search")
                .value_parser(ValueParser::new(move |text: &str| {
                    set(&mut Preset::Quick.settings(), text).map(|()| text.to_owned())
                }))
        }))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Parameters {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut parameters = Self::default();
        parameters.update_from_arg_matches(matches)?;
        Ok(parameters)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        for (row, parameter) in PARAMETERS.iter().enumerate() {
            if matches.value_source(parameter.flag) == Some(ValueSource::CommandLine)
                && let Some(text) = matches.get_one::<String>(parameter.flag)
            {
                self.given.push((row, text.clone()));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(arguments: &[&str]) -> Result<Parameters, clap::Error> {
        let command = Parameters::augment_args(Command::new("test").no_binary_name(true));
        Parameters::from_arg_matches(&command.try_get_matches_from(arguments)?)
    }

    #[test]
    fn every_parameter_of_a_search_is_a_flag() {
        let mut settings = Preset::Quick.settings();
        let before = toml::Value::try_from(&settings).expect("settings are TOML");
        for parameter in PARAMETERS {
            let value = (parameter.get)(&settings);
            let other = match parameter.flag {
                "error" => "rel-mse".to_owned(),
                "precision" => "fast".to_owned(),
                "primitives" => "all".to_owned(),
                "initial" => "gaussian".to_owned(),
                "forbid" => "depth,sin".to_owned(),
                "racing" => "on".to_owned(),
                "rungs" => "0.25,0.75".to_owned(),
                _ => format!("{}", value.parse::<f64>().expect("a number") + 1.0),
            };
            let flag = format!("--{}", parameter.flag);
            parse(&[&flag, &other]).expect("its own value").apply(&mut settings);
            assert_eq!((parameter.get)(&settings), other);
        }
        let after = toml::Value::try_from(&settings).expect("settings are TOML");
        assert_changed("settings", &before, &after);
    }

    /// Fails for a field that no flag has changed.
    fn assert_changed(name: &str, before: &toml::Value, after: &toml::Value) {
        match (before, after) {
            (toml::Value::Table(before), toml::Value::Table(after)) => {
                for (name, value) in before {
                    assert_changed(name, value, &after[name]);
                }
            }
            (before, after) => assert_ne!(before, after, "no flag sets `{name}`"),
        }
    }

    #[test]
    fn what_is_no_value_is_refused() {
        assert!(parse(&["--islands", "many"]).is_err());
        assert!(parse(&["--seed", "-1"]).is_err());
        let given = parse(&["--generations", "3", "--seed", "4"]).expect("numbers");
        assert_eq!(given.fixed(), ["--seed"]);
    }
}
