//! The parameters of both kinds of search as flags: one row each, with the presets' values in
//! the help read off the presets.

use clap::builder::ValueParser;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};

use super::preset::Preset;
use crate::cli::error::Error;
use crate::evolve::{self, Settings, programs};
use crate::expr::grammar::Primitives;
use crate::image::metric::Measure;
use crate::plan::Precision;
use crate::report::{Align, Table};
use crate::tune::Loss;

/// A parameter of settings `S`.
pub(super) struct Parameter<S> {
    /// The flag, which is also the identifier.
    flag: &'static str,
    value: &'static str,
    doc: &'static str,
    get: fn(&S) -> String,
    set: fn(&mut S, &str) -> Result<(), String>,
}

/// Settings whose fields are flags.
pub(super) trait Tabled: Sized + 'static {
    /// A row per field.
    const TABLE: &[Parameter<Self>];
    /// What they are of.
    const KIND: &str;
    /// The presets that have such settings, with them.
    fn presets() -> Vec<(&'static str, Self)>;
    /// Checks that they make sense.
    fn validated(&self) -> Result<(), evolve::Error>;
}

impl Tabled for Settings {
    const TABLE: &[Parameter<Self>] = PARAMETERS;
    const KIND: &str = "a search for weights";

    fn presets() -> Vec<(&'static str, Self)> {
        let settings = |preset: Preset| Some((preset.name(), preset.weights()?));
        Preset::ALL.into_iter().filter_map(settings).collect()
    }

    fn validated(&self) -> Result<(), evolve::Error> {
        self.validate()
    }
}

impl Tabled for programs::Settings {
    const TABLE: &[Parameter<Self>] = OF_PROGRAMS;
    const KIND: &str = "a search for programs";

    fn presets() -> Vec<(&'static str, Self)> {
        let settings = |preset: Preset| Some((preset.name(), preset.programs()?));
        Preset::ALL.into_iter().filter_map(settings).collect()
    }

    fn validated(&self) -> Result<(), evolve::Error> {
        self.validate()
    }
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

const OF_PROGRAMS: &[Parameter<programs::Settings>] = parameters! {
    "seed" "N" seed:
        "Names the random streams: the same seed finds the same program";
    "initial" "FILTER" initial:
        "What the initial population are mutants of: `seed`, a filter's name or a file";
    "generations" "N" generations:
        "Generations after the initial population";
    "population" "N" population:
        "Programs that are kept from one generation to the next";
    "children" "N" children:
        "Programs that are made in a generation";
    "crossover" "SHARE" crossover:
        "Share of the children that have two parents";
    "polish" "SHARE" polish:
        "Share of the children that are a program of the population, tuned further";
    "tune-steps" "N" tune_steps:
        "Steps by which a child's constants are tuned before it is judged";
    "finish-steps" "N" finish_steps:
        "Steps by which the winner's are tuned at the end";
    "crops" "N" batch:
        "Parts of images that a step of tuning looks at";
    "crop" "PIXELS" crop:
        "The side of such a part";
    "exam" "PIXELS" exam:
        "The side of the part of every scene that programs are judged by";
    "loss" "LOSS" loss:
        "What is made small: balanced, relative or tone-mapped, as in `tamis tune`";
    "rate" "RATE" rate:
        "By how much constants move in a step of tuning";
    "layer-rate" "RATE" layer_rate:
        "The same for layers' numbers";
    "max-nodes" "N" max_nodes:
        "Most nodes of a program's formulas, and numbers of its layers";
    "max-stages" "N" max_stages:
        "Most stages of a program";
    "max-reach" "PIXELS" max_reach:
        "How far a stage may look beside a pixel";
    "max-cost" "NS" max_cost:
        "Most nanoseconds per pixel that it may be predicted to take on one core";
    "features" "NAME,..." features:
        "Features, gradients and variances that programs may read";
    "rung" "SHARE" rung:
        "Share of the scenes that a child is judged by before it is tuned; 0 for none";
    "slack" "SCORE" slack:
        "How much worse it may be there than the best that is neither slower nor larger";
    "interval" "N" interval:
        "Generations from one trial on the validation scenes to the next";
    "patience" "N" patience:
        "Trials without a better one after which the search ends; 0 for never";
};

const PARAMETERS: &[Parameter<Settings>] = parameters! {
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

impl Text for Loss {
    fn text(&self) -> String {
        self.name().to_owned()
    }
    fn parsed(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|loss| loss.name() == text).ok_or_else(|| {
            format!("must be {}", Self::ALL.map(|loss| format!("`{}`", loss.name())).join(" or "))
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

/// The parameters that the command line gives, by their flags.
#[derive(Clone, Debug, Default)]
pub(super) struct Parameters {
    given: Vec<(&'static str, String)>,
}

impl Parameters {
    /// Changes settings as the command line says.
    pub(super) fn apply<S: Tabled>(&self, settings: &mut S) -> Result<(), Error> {
        for (flag, text) in &self.given {
            let Some(parameter) = S::TABLE.iter().find(|parameter| parameter.flag == *flag) else {
                let presets = S::presets().into_iter().map(|(name, _)| format!("`{name}`"));
                return Err(Error::Usage(format!(
                    "--{flag} is no parameter of {} (--preset {}): leave it out, or choose another \
                     preset",
                    S::KIND,
                    presets.collect::<Vec<_>>().join(" or "),
                )));
            };
            (parameter.set)(settings, text)
                .map_err(|why| Error::Usage(format!("--{flag} {text}: {why}")))?;
        }
        Ok(())
    }

    /// Whether the command line gives a parameter, by its flag's name.
    pub(super) fn gives(&self, flag: &str) -> bool {
        self.given.iter().any(|&(given, _)| given == flag)
    }

    /// The flags given that a search under way cannot obey.
    pub(super) fn fixed(&self) -> Vec<String> {
        let flags = self.given.iter().map(|&(flag, _)| flag);
        flags.filter(|&flag| flag != GENERATIONS).map(|flag| format!("--{flag}")).collect()
    }
}

/// Every parameter's flag, with `mark` around it, value and meaning.
pub(super) fn table<S: Tabled>(settings: &S, mark: &str) -> Table {
    let mut table = Table::new(["flag", "value", "meaning"].map(|name| (name, Align::Left)));
    for p in S::TABLE {
        let flag = format!("{mark}--{}{mark}", p.flag);
        table.row([flag, (p.get)(settings), p.doc.to_owned()]);
    }
    table
}

/// Arguments that name a search of these settings: the preset that is closest, and what differs
/// from it.
pub(super) fn arguments<S: Tabled>(settings: &S) -> Vec<String> {
    let beyond = |(name, preset): (&str, S)| {
        let mut arguments = vec!["--preset".to_owned(), name.to_owned()];
        for p in S::TABLE {
            let value = (p.get)(settings);
            if value != (p.get)(&preset) {
                // In one word, as values may begin with a dash or be empty.
                arguments.push(format!("--{}={value}", p.flag));
            }
        }
        arguments
    };
    let all = S::presets().into_iter().map(beyond);
    all.min_by_key(Vec::len).expect("there are presets of every kind")
}

/// The flags of one kind of settings, but for those that another has already.
fn flags<S: Tabled>(heading: &'static str, known: &[&str]) -> Vec<Arg> {
    let presets = S::presets();
    let rows = S::TABLE.iter().filter(|parameter| !known.contains(&parameter.flag));
    let flag = |parameter: &'static Parameter<S>| {
        let value = |(name, settings): &(&'static str, S)| {
            let value = (parameter.get)(settings);
            (*name, if value.is_empty() { "none".to_owned() } else { value })
        };
        let values: Vec<(&str, String)> = presets.iter().map(value).collect();
        let same = values.iter().all(|(_, value)| *value == values[0].1);
        let values = match same {
            true => values[0].1.clone(),
            false => {
                let named = values.iter().map(|(name, value)| format!("{name}: {value}"));
                named.collect::<Vec<_>>().join(", ")
            }
        };
        let set = parameter.set;
        Arg::new(parameter.flag)
            .long(parameter.flag)
            .value_name(parameter.value)
            .help(format!("{} [{values}]", parameter.doc))
            .help_heading(heading)
            .value_parser(ValueParser::new(move |text: &str| {
                let (_, mut settings) = S::presets().swap_remove(0);
                set(&mut settings, text).map(|()| text.to_owned())
            }))
    };
    rows.map(flag).collect()
}

impl Args for Parameters {
    fn augment_args(command: Command) -> Command {
        let shared: Vec<&str> = OF_PROGRAMS.iter().map(|parameter| parameter.flag).collect();
        let programs = "Parameters of a search for programs (--preset quick, programs)";
        let weights = "Parameters of a search for weights (--preset weights, paper)";
        command
            .args(flags::<programs::Settings>(programs, &[]))
            .args(flags::<Settings>(weights, &shared))
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
        let programs = OF_PROGRAMS.iter().map(|parameter| parameter.flag);
        let weights = PARAMETERS.iter().map(|parameter| parameter.flag);
        let weights = weights.filter(|flag| OF_PROGRAMS.iter().all(|row| row.flag != *flag));
        for flag in programs.chain(weights) {
            if matches.value_source(flag) == Some(ValueSource::CommandLine)
                && let Some(text) = matches.get_one::<String>(flag)
            {
                self.given.push((flag, text.clone()));
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
        every_field::<Settings>();
        every_field::<programs::Settings>();
    }

    fn every_field<S: Tabled + serde::Serialize>() {
        let (_, mut settings) = S::presets().swap_remove(0);
        let before = toml::Value::try_from(&settings).expect("settings are TOML");
        for parameter in S::TABLE {
            let value = (parameter.get)(&settings);
            let other = match (parameter.flag, value.as_str()) {
                ("error", "rel-mse") => "two-sided".to_owned(),
                ("error", _) => "rel-mse".to_owned(),
                ("precision", "fast") => "standard".to_owned(),
                ("precision", _) => "fast".to_owned(),
                ("primitives", _) => "all".to_owned(),
                ("initial", _) => "gaussian".to_owned(),
                ("forbid", _) => "depth,sin".to_owned(),
                ("features", _) => "depth,color".to_owned(),
                ("loss", _) => "relative".to_owned(),
                ("racing", "on") => "off".to_owned(),
                ("racing", _) => "on".to_owned(),
                ("rungs", _) => "0.25,0.75".to_owned(),
                (_, value) => format!("{}", value.parse::<f64>().expect("a number") + 1.0),
            };
            let flag = format!("--{}", parameter.flag);
            let given = parse(&[&flag, &other]).expect("its own value");
            given.apply(&mut settings).expect("a parameter of these settings");
            assert_eq!((parameter.get)(&settings), other);
        }
        let after = toml::Value::try_from(&settings).expect("settings are TOML");
        assert_changed("settings", &before, &after);
    }

    #[test]
    fn arguments_name_the_settings() {
        let mut settings = programs::Settings::thorough();
        settings.seed = 7;
        settings.features = vec!["depth".to_owned(), "color".to_owned()];
        let named = arguments(&settings);
        assert_eq!(named, ["--preset", "programs", "--seed=7", "--features=depth,color"]);
        let mut parsed = programs::Settings::thorough();
        let flags: Vec<&str> = named[2..].iter().map(String::as_str).collect();
        parse(&flags).expect("flags").apply(&mut parsed).expect("a parameter of these settings");
        assert_eq!(parsed, settings);
    }

    #[test]
    fn a_parameter_of_the_other_kind_is_refused() {
        let given = parse(&["--islands", "3"]).expect("a number");
        let (_, mut settings) = programs::Settings::presets().swap_remove(0);
        let error = given.apply(&mut settings).expect_err("programs have no islands").to_string();
        assert!(error.contains("--islands") && error.contains("`quick`"), "{error}");
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
