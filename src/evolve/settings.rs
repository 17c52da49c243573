//! What a search can be told, with the paper's values.

use serde::{Deserialize, Serialize};

use super::error::Error;
use crate::expr::Tree;
use crate::expr::grammar::Primitives;
use crate::filter::Window;
use crate::image::metric::Measure;
use crate::plan::Precision;

/// Expressions in one plan, unless told otherwise. A population bred for twenty
/// generations takes 0.53 of its time one by one in plans of 4, 0.42 in plans of 8 and of
/// 16, and 0.36 to 0.38 in plans of 32, which 64 do not better.
pub const TOGETHER: usize = 32;

/// The parameters of a search. Together with the fitness they determine its
/// result, whatever the number of threads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Number of islands (Section 4: 4).
    pub islands: usize,
    /// Expressions on each island (Section 4: 100).
    pub island_size: usize,
    /// Generations after the initial population (Section 5: 200).
    pub generations: u32,
    /// Generations from one migration to the next (Section 4: 5); 0 for none.
    pub migration_interval: u32,
    /// Individuals in a tournament (Section 4.4: 8).
    pub tournament: usize,
    /// Share of a generation that is reproduced as it is (Section 4.4: 0.10).
    /// The first of these is the island's best, so that it is never lost; the
    /// paper leaves all of them to tournaments.
    pub reproduction: f64,
    /// Share of a generation that crossover makes (Section 4.4: 0.45).
    pub crossover: f64,
    /// Share of a generation that mutation makes (Section 4.4: 0.45).
    pub mutation: f64,
    /// How often each kind of mutation is tried.
    pub mutations: MutationWeights,
    /// Standard deviation of the logarithm of the factor by which `jitter`
    /// multiplies a constant.
    pub jitter_sigma: f64,
    /// Most nodes of an expression. The paper sets no limits; without them
    /// trees grow for as long as growth does no harm.
    pub max_nodes: usize,
    /// Most levels of an expression.
    pub max_depth: usize,
    /// Names the random streams.
    pub seed: u64,
    /// What the initial population is made from: a filter by name, or an
    /// expression (Section 4: the bilateral filter).
    pub initial: String,
    /// The individuals of the initial population, but for the first of each
    /// island, are the initial expression after one to this many mutations.
    pub initial_mutations: u32,
    /// The operators that expressions are made of (Figure 2). Searches begun before there was
    /// a choice have the paper's.
    #[serde(default)]
    pub primitives: Primitives,
    /// Names of features, gradients and variances that the search must not use,
    /// because the training scenes do not have them, say.
    pub forbidden: Vec<String>,
    /// What is minimised (Section 4.3: RelMSE), as a sum over the scenes.
    pub error: Measure,
    /// How accurately expressions are computed while they are bred. Finalists are judged
    /// at standard precision. Searches begun before there was a choice are at that.
    #[serde(default)]
    pub precision: Precision,
    /// The window's radius that expressions are judged with.
    pub radius: u32,
    /// Share of the training pixels that breeding looks at, in tiles spread
    /// over the images; 1 for all (the paper). Finalists are judged on all.
    pub share: f64,
    /// How many of the best expressions are judged in full at the end.
    pub finalists: usize,
    /// Most expressions that the fitness gets at once. Between batches the
    /// search looks whether it is to stop; no result depends on it.
    pub batch: usize,
    /// Most expressions that are compiled into one program, in which they share
    /// what they have in common; 1 for each its own. No result depends on it.
    pub together: usize,
    /// Most nodes of the expressions whose fitness is remembered, each counting as 16 more
    /// than it has. The paper's search cannot get there.
    pub remembered: usize,
    /// How expressions that cannot win are given up.
    pub racing: Racing,
}

/// How expressions that cannot win are given up (see [`race`](super::race)). The
/// paper judges all in full.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Racing {
    /// Whether they are.
    pub on: bool,
    /// Shares of the pixels that breeding looks at after which it looks how
    /// entrants stand, in growing order.
    pub rungs: Vec<f64>,
    /// Where the bar stands: at this quantile of an island's previous generation,
    /// 0 being its best.
    pub bar: f64,
    /// By how many standard errors an entrant's error must exceed the bar's for
    /// it to be dropped.
    pub deviations: f64,
}

/// Relative frequencies of the kinds of mutation (Section 4.2: the paper's four
/// alike, and no `jitter`, which is ours).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MutationWeights {
    /// A node becomes another one that takes the same operands.
    pub replace: f64,
    /// Two subtrees change places.
    pub swap: f64,
    /// A subtree becomes an expression from the codebook.
    pub insert: f64,
    /// A subtree becomes the constant 1.
    pub delete: f64,
    /// A constant is multiplied by a log-normal factor. An extension: the
    /// paper's grammar has eight constants only, and bandwidths in between can
    /// be made of them, but take many generations to appear.
    pub jitter: f64,
}

/// Named settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Sections 4 and 5 of the paper, where it took three days on a GPU; half an hour on
    /// two cores with 512-bit vectors.
    Paper,
    /// A minute on the same.
    Weights,
}

impl Preset {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Paper, Self::Weights];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Weights => "weights",
        }
    }

    /// What it stands for.
    pub fn settings(self) -> Settings {
        let paper = Settings {
            islands: 4,
            island_size: 100,
            generations: 200,
            migration_interval: 5,
            tournament: 8,
            reproduction: 0.10,
            crossover: 0.45,
            mutation: 0.45,
            mutations: MutationWeights {
                replace: 1.0,
                swap: 1.0,
                insert: 1.0,
                delete: 1.0,
                jitter: 0.0,
            },
            jitter_sigma: 0.5,
            max_nodes: 150,
            max_depth: 40,
            seed: 1,
            initial: "bilateral".to_owned(),
            initial_mutations: 1,
            primitives: Primitives::Paper,
            forbidden: Vec::new(),
            error: Measure::RelMse,
            precision: Precision::Fast,
            radius: 10,
            share: 1.0,
            finalists: 16,
            batch: 128,
            together: TOGETHER,
            remembered: 1 << 24,
            racing: Racing { on: true, rungs: vec![0.02, 0.1, 0.3], bar: 0.1, deviations: 2.0 },
        };
        match self {
            Self::Paper => paper,
            // So short a search cannot put a cross-bilateral filter together
            // from parts, so this one starts from there; with islands so small,
            // tournaments of eight would leave one family on each.
            Self::Weights => Settings {
                island_size: 40,
                generations: 28,
                tournament: 5,
                initial: "cross-bilateral".to_owned(),
                error: Measure::TwoSided,
                mutations: MutationWeights { jitter: 2.0, ..paper.mutations },
                max_nodes: 100,
                max_depth: 30,
                initial_mutations: 3,
                share: 0.03,
                finalists: 8,
                // On so few pixels running is not what takes the time.
                precision: Precision::Standard,
                // So few leave no room either: races saved 13% of the pairs there, and
                // each survivor is compiled once more for every rung.
                racing: Racing { on: false, ..paper.racing.clone() },
                ..paper
            },
        }
    }
}

impl Settings {
    /// Whether a tree is as small as expressions have to be, and the same all
    /// over the image. The paper's ⟨vector⟩ has no coordinates; ours has, and a
    /// weight that mixed them with another feature would learn where things are
    /// in the training images.
    pub fn admit(&self, tree: &Tree) -> bool {
        tree.len() <= self.max_nodes && tree.depth() <= self.max_depth && tree.is_stationary()
    }

    /// Checks that a search can be made of them.
    pub fn validate(&self) -> Result<(), Error> {
        let racing = &self.racing;
        let counts = [
            ("islands", self.islands, 1, 1000, "from 1 to 1000 islands"),
            (
                "island_size",
                self.island_size,
                2,
                100_000,
                "from 2 (a place for the island's best and one for migrants) to 100000",
            ),
            ("generations", self.generations as usize, 0, 10_000_000, "at most 10000000"),
            (
                "migration_interval",
                self.migration_interval as usize,
                0,
                10_000_000,
                "at most 10000000, or 0 for no migration",
            ),
            (
                "tournament",
                self.tournament,
                1,
                self.island_size,
                "from 1 to the island's size: more would draw the same individuals again",
            ),
            // Of what is planned at once everything is planned before anybody looks whether
            // to stop.
            ("finalists", self.finalists, 1, 1000, "from 1 to 1000"),
            ("batch", self.batch, 1, 1000, "from 1 to 1000"),
            ("together", self.together, 1, 128, "from 1 to 128"),
            ("max_nodes", self.max_nodes, 1, 10_000, "from 1 to 10000"),
            ("max_depth", self.max_depth, 1, 10_000, "from 1 to 10000"),
            (
                "remembered",
                self.remembered,
                1,
                u32::MAX as usize,
                "from 1 to 4294967295: a node takes some ten bytes",
            ),
            (
                "initial_mutations",
                self.initial_mutations as usize,
                1,
                10_000,
                "from 1 (the initial population consists of mutants) to 10000",
            ),
            (
                "radius",
                self.radius as usize,
                1,
                Window::MAX_RADIUS as usize,
                "from 1 (a window of one pixel filters nothing) to 128",
            ),
            ("racing.rungs", racing.rungs.len(), 0, 100, "at most 100 shares"),
        ];
        for (name, value, least, most, wanted) in counts {
            if value < least || value > most {
                return Err(Error::Setting { name, value: value.to_string(), wanted });
            }
        }
        let population = self.islands * self.island_size;
        if population > 1_000_000 {
            return Err(Error::Setting {
                name: "islands * island_size",
                value: population.to_string(),
                wanted: "a generation has at most 1000000 expressions",
            });
        }

        let w = &self.mutations;
        let moderate = "must be at least 0 and at most 1e6";
        for (name, value) in [
            ("reproduction", self.reproduction),
            ("crossover", self.crossover),
            ("mutation", self.mutation),
            ("mutations.replace", w.replace),
            ("mutations.swap", w.swap),
            ("mutations.insert", w.insert),
            ("mutations.delete", w.delete),
            ("mutations.jitter", w.jitter),
            ("jitter_sigma", self.jitter_sigma),
            ("racing.deviations", racing.deviations),
        ] {
            if !(0.0..=1e6).contains(&value) {
                let value = value.to_string();
                return Err(Error::Setting { name, value, wanted: moderate });
            }
        }
        if !(self.share > 0.0 && self.share <= 1.0) {
            return Err(Error::Setting {
                name: "share",
                value: self.share.to_string(),
                wanted: "a share of the pixels is above 0 and at most 1",
            });
        }
        let listed = racing.rungs.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        if !(racing.rungs.iter().all(|&rung| rung > 0.0 && rung < 1.0)
            && racing.rungs.is_sorted_by(|a, b| a < b))
        {
            return Err(Error::Setting {
                name: "racing.rungs",
                value: listed,
                wanted: "rungs are growing shares of the pixels, above 0 and below 1",
            });
        }
        if !(racing.bar >= 0.0 && racing.bar < 1.0) {
            return Err(Error::Setting {
                name: "racing.bar",
                value: racing.bar.to_string(),
                wanted: "a quantile is at least 0 and below 1",
            });
        }
        let shares = self.reproduction + self.crossover + self.mutation;
        if (shares - 1.0).abs() > 1e-6 {
            return Err(Error::Setting {
                name: "reproduction + crossover + mutation",
                value: shares.to_string(),
                wanted: "the three are shares of a generation and must add up to 1",
            });
        }
        if w.replace + w.swap + w.insert + w.delete + w.jitter == 0.0 {
            return Err(Error::Setting {
                name: "mutations",
                value: "0 throughout".to_owned(),
                wanted: "one kind must have a weight: the initial population consists of mutants",
            });
        }
        if i64::try_from(self.seed).is_err() {
            return Err(Error::Setting {
                name: "seed",
                value: self.seed.to_string(),
                wanted: "it must be below 2^63, the greatest integer that TOML files hold",
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_valid_and_survive_serialisation() {
        for preset in Preset::ALL {
            let settings = preset.settings();
            settings.validate().unwrap();
            let written = toml::to_string(&settings).unwrap();
            assert_eq!(toml::from_str::<Settings>(&written).unwrap(), settings);
        }
    }

    #[test]
    fn searches_of_before_there_was_a_choice_breed_at_standard_precision() {
        let written = toml::to_string(&Preset::Paper.settings()).unwrap();
        let before = written.replace("precision = \"fast\"\n", "");
        assert_ne!(before, written);
        let read = toml::from_str::<Settings>(&before).unwrap();
        assert_eq!(read, Settings { precision: Precision::Standard, ..Preset::Paper.settings() });
    }

    /// A preset that named every operator would search differently with each new one.
    #[test]
    fn presets_name_the_papers_primitives() {
        for preset in Preset::ALL {
            assert_eq!(preset.settings().primitives, Primitives::Paper);
            let written = toml::to_string(&preset.settings()).unwrap();
            let before = written.replace("primitives = \"paper\"\n", "");
            assert_ne!(before, written);
            assert_eq!(toml::from_str::<Settings>(&before).unwrap(), preset.settings());
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        let refused = |change: fn(&mut Settings)| {
            let mut settings = Preset::Weights.settings();
            change(&mut settings);
            settings.validate().unwrap_err().to_string()
        };
        assert!(refused(|s| s.tournament = 0).contains("`tournament` is 0"));
        assert!(refused(|s| s.tournament = 41).contains("`tournament` is 41"));
        assert!(refused(|s| s.island_size = 1).contains("`island_size` is 1"));
        assert!(refused(|s| s.island_size = 1_000_000_000).contains("100000"));
        assert!(refused(|s| s.islands = usize::MAX).contains("from 1 to 1000 islands"));
        let population = refused(|s| (s.islands, s.island_size) = (1000, 100_000));
        assert!(population.contains("`islands * island_size` is 100000000"), "{population}");
        assert!(refused(|s| s.generations = u32::MAX).contains("`generations`"));
        assert!(refused(|s| s.migration_interval = u32::MAX).contains("`migration_interval`"));
        assert!(refused(|s| s.radius = 0).contains("`radius` is 0"));
        assert!(refused(|s| s.radius = 129).contains("to 128"));
        assert!(refused(|s| s.finalists = usize::MAX).contains("`finalists`"));
        assert!(refused(|s| s.batch = 0).contains("`batch` is 0"));
        assert!(refused(|s| s.together = 129).contains("`together` is 129"));
        assert!(refused(|s| s.max_nodes = 0).contains("`max_nodes` is 0"));
        assert!(refused(|s| s.max_depth = 10_001).contains("`max_depth` is 10001"));
        assert!(refused(|s| s.initial_mutations = 0).contains("`initial_mutations` is 0"));
        assert!(refused(|s| s.remembered = 0).contains("`remembered` is 0"));
        assert!(refused(|s| s.mutations.jitter = 1e300).contains("at most 1e6"));
        assert!(refused(|s| s.crossover = 0.5).contains("add up to 1"));
        assert!(refused(|s| s.crossover = f64::NAN).contains("`crossover` is NaN"));
        assert!(refused(|s| s.mutations.swap = -1.0).contains("`mutations.swap` is -1"));
        assert!(refused(|s| s.racing.rungs = vec![0.1, 0.1]).contains("`racing.rungs` is 0.1,0.1"));
        assert!(refused(|s| s.racing.rungs = vec![1.0]).contains("below 1"));
        assert!(refused(|s| s.racing.bar = 1.0).contains("`racing.bar` is 1"));
        assert!(refused(|s| s.racing.deviations = f64::NAN).contains("`racing.deviations`"));
        assert!(refused(|s| s.seed = u64::MAX).contains("below 2^63"));
        assert!(
            refused(|s| s.mutations =
                MutationWeights { replace: 0.0, swap: 0.0, insert: 0.0, delete: 0.0, jitter: 0.0 })
            .contains("0 throughout")
        );
    }
}
