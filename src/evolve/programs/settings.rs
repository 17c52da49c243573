//! What a search for programs can be told.

use serde::{Deserialize, Serialize};

use crate::evolve::Error;
use crate::expr::feature::{Feature, Quantity};
use crate::tune::Loss;

/// The name of the program that searches begin with unless they are told another: see
/// [`seed`](super::seed).
pub const SEED: &str = "seed";

/// The parameters of a search for programs. With the scenes and the filter that it begins with
/// they determine its result, whatever the number of threads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Names the random streams.
    pub seed: u64,
    /// What the initial population are mutants of, as whoever began the search called it.
    pub initial: String,
    /// Programs that are kept from one generation to the next.
    pub population: usize,
    /// Programs that are made in a generation.
    pub children: usize,
    /// Generations after the initial population.
    pub generations: u32,
    /// Share of the children that have two parents.
    pub crossover: f64,
    /// Share of the children that are a program of the population, tuned further.
    pub polish: f64,
    /// Steps by which the constants of a child are tuned before it is judged; those that are
    /// tuned further get three times as many.
    pub tune_steps: u32,
    /// Steps by which the winner is tuned at the end.
    pub finish_steps: u32,
    /// Parts of images that a step looks at.
    pub batch: usize,
    /// The side of such a part, in pixels; even.
    pub crop: usize,
    /// The side of the part of every scene that programs are judged by, in pixels; even.
    pub exam: usize,
    /// What is made small.
    pub loss: Loss,
    /// By what share of themselves, or by how much, constants move in a step.
    pub rate: f64,
    /// The same for layers' numbers.
    pub layer_rate: f64,
    /// Most nodes of all formulas and numbers of layers together.
    pub max_nodes: usize,
    /// Most stages.
    pub max_stages: usize,
    /// How far a stage may look beside a pixel, in pixels of its grid: scenes are loaded for that.
    pub max_reach: usize,
    /// Most nanoseconds per pixel that a program may be predicted to take (see
    /// [`Program::cost`](crate::plan::Program::cost)).
    pub max_cost: f64,
    /// The features, gradients and variances that programs may read.
    pub features: Vec<String>,
    /// Share of the scenes that a child is judged by before it is tuned; 0 for none.
    pub rung: f64,
    /// How much worse it may be there than the best program that is neither slower nor larger,
    /// in the loss's score.
    pub slack: f64,
    /// Generations from one trial on the validation scenes to the next.
    pub interval: u32,
    /// Trials in a row of which none is better, after which the search ends; 0 for never.
    pub patience: u32,
}

impl Settings {
    /// A search of a few minutes.
    pub fn quick() -> Self {
        Self {
            seed: 1,
            initial: SEED.to_owned(),
            population: 24,
            children: 24,
            generations: 16,
            crossover: 0.3,
            polish: 0.2,
            tune_steps: 16,
            finish_steps: 150,
            batch: 2,
            crop: 64,
            exam: 48,
            loss: Loss::Balanced,
            rate: 0.05,
            layer_rate: 0.01,
            max_nodes: 400,
            max_stages: 40,
            max_reach: 16,
            max_cost: 400.0,
            features: [
                "color",
                "cVariance",
                "albedo",
                "tVariance",
                "normal",
                "nVariance",
                "depth",
                "dVariance",
            ]
            .map(str::to_owned)
            .into(),
            rung: 0.25,
            slack: 0.2,
            interval: 4,
            patience: 0,
        }
    }

    /// A search of hours.
    pub fn thorough() -> Self {
        Self {
            population: 64,
            children: 64,
            generations: 200,
            tune_steps: 40,
            finish_steps: 3000,
            batch: 4,
            crop: 96,
            exam: 64,
            max_nodes: 1500,
            max_stages: 120,
            max_cost: 1000.0,
            interval: 5,
            patience: 12,
            ..Self::quick()
        }
    }

    /// What programs may read.
    ///
    /// # Errors
    /// If a name is of no feature, gradient or variance.
    pub fn vocabulary(&self) -> Result<Vec<(Feature, Quantity)>, Error> {
        let term = |name: &String| {
            Feature::parse(name).ok_or_else(|| Error::Setting {
                name: "features",
                value: format!("`{name}`"),
                wanted: "it must name features, gradients or variances",
            })
        };
        self.features.iter().map(term).collect()
    }

    /// Checks that a search can be made of them.
    ///
    /// # Errors
    /// For the first that makes no sense.
    pub fn validate(&self) -> Result<(), Error> {
        let refuse = |name, value: String, wanted| Err(Error::Setting { name, value, wanted });
        let within = |name, value: usize, low: usize, high: usize, wanted| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                refuse(name, value.to_string(), wanted)
            }
        };
        within("population", self.population, 4, 10_000, "between 4 and 10000")?;
        within("children", self.children, 1, 10_000, "between 1 and 10000")?;
        within("generations", self.generations as usize, 0, 1_000_000, "at most 1000000")?;
        within("tune_steps", self.tune_steps as usize, 0, 100_000, "at most 100000")?;
        within("finish_steps", self.finish_steps as usize, 0, 1_000_000, "at most 1000000")?;
        within("batch", self.batch, 1, 1024, "between 1 and 1024")?;
        within("max_nodes", self.max_nodes, 1, 1_000_000, "between 1 and 1000000")?;
        within("max_stages", self.max_stages, 1, 1000, "between 1 and 1000")?;
        within("max_reach", self.max_reach, 1, 128, "between 1 and 128")?;
        within("interval", self.interval as usize, 1, 1_000_000, "at least 1")?;
        for (name, value) in [("crop", self.crop), ("exam", self.exam)] {
            if !(8..=4096).contains(&value) || value % 2 != 0 {
                return refuse(name, value.to_string(), "an even number between 8 and 4096");
            }
        }
        for (name, value) in
            [("crossover", self.crossover), ("polish", self.polish), ("rung", self.rung)]
        {
            if !(0.0..=1.0).contains(&value) {
                return refuse(name, value.to_string(), "a share is between 0 and 1");
            }
        }
        if self.crossover + self.polish > 1.0 {
            let value = (self.crossover + self.polish).to_string();
            return refuse("crossover + polish", value, "shares of the children, at most 1");
        }
        for (name, value) in [
            ("rate", self.rate),
            ("layer_rate", self.layer_rate),
            ("max_cost", self.max_cost),
            ("slack", self.slack),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return refuse(name, value.to_string(), "must be finite and positive");
            }
        }
        if i64::try_from(self.seed).is_err() {
            let wanted = "it must be below 2^63, the greatest integer that TOML files hold";
            return refuse("seed", self.seed.to_string(), wanted);
        }
        self.vocabulary().map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_make_sense_and_survive_serialisation() {
        for settings in [Settings::quick(), Settings::thorough()] {
            settings.validate().expect("they make sense");
            let written = toml::to_string(&settings).expect("TOML");
            assert_eq!(toml::from_str::<Settings>(&written).expect("settings"), settings);
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        let refused = |change: fn(&mut Settings)| {
            let mut settings = Settings::quick();
            change(&mut settings);
            settings.validate().expect_err("it makes no sense").to_string()
        };
        assert!(refused(|s| s.population = 0).contains("`population` is 0"));
        assert!(refused(|s| s.crop = 63).contains("`crop` is 63"));
        assert!(refused(|s| s.polish = 0.9).contains("`crossover + polish`"));
        assert!(refused(|s| s.rate = f64::NAN).contains("`rate` is NaN"));
        assert!(refused(|s| s.features.push("colour".to_owned())).contains("`colour`"));
    }
}
