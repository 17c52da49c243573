//! What a coordinator and its workers say to each other: one JSON object per line, to the bit.
//!
//! | who | says | when |
//! |---|---|---|
//! | worker | `hello` | at once: its program, its protocol, its threads |
//! | coordinator | `setup` | then, if both are its own |
//! | worker | `ready`, or `refused` with a reason | once it has the scenes |
//! | coordinator | `judge` | as many at a time as the worker has threads |
//! | worker | `verdict`, or `failed` with a reason | when one is done, in any order |
//! | worker | `alive` | every few seconds, from the setup on |
//!
//! A worker ends when its input does.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::genome::Genome;
use super::judge::{Job, Verdict};
use super::settings::Settings;
use super::written::{Exact, WrittenProgram, genome, text};
use crate::filter::{Filter, FilterFileError};
use crate::scene::Fingerprint;

/// The version of these messages; raised with every change to them.
pub(super) const PROTOCOL: u32 = 1;

/// The program as a worker introduces it.
pub(super) const PROGRAM: &str = concat!("tamis ", env!("CARGO_PKG_VERSION"));

/// What errors call a program that came from the other side.
const SENT: &str = "the program that was sent";

/// What a coordinator says.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) enum ToWorker {
    Setup(Box<Setup>),
    Judge(Task),
}

/// What a worker says.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) enum FromWorker {
    Hello(Hello),
    Ready { probe: Answer },
    Refused { reason: String },
    Verdict { job: u64, verdict: Answer },
    Failed { job: u64, reason: String },
    Alive {},
}

/// Who a worker is. Other versions may say more.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Hello {
    pub(super) program: String,
    pub(super) protocol: u32,
    /// How many jobs it wants at a time.
    pub(super) threads: usize,
}

/// What a worker judges by.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Setup {
    pub(super) briefing: Briefing,
    /// The scenes to train on, as the coordinator's command line has them.
    pub(super) scenes: Vec<String>,
    /// Milliseconds from one sign of life to the next.
    pub(super) heartbeat: u64,
}

/// What others have to know to judge the children of a search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Briefing {
    pub(super) settings: Settings,
    /// The filter that it begins with.
    initial: String,
    /// The pictures of the training scenes, in their order.
    pub(super) pictures: Vec<Fingerprint>,
    /// What the coordinator's judge says of the initial filter.
    pub(super) probe: Answer,
}

impl Briefing {
    /// Of a search with these settings, from this filter, on these pictures.
    pub(super) fn new(
        settings: &Settings,
        initial: &Filter,
        pictures: Vec<Fingerprint>,
        probe: &Verdict,
    ) -> Self {
        let (settings, initial) = (settings.clone(), text(initial));
        Self { settings, initial, pictures, probe: Answer::of(probe) }
    }

    /// The filter that it begins with.
    ///
    /// # Errors
    /// If it is none.
    pub(super) fn initial(&self) -> Result<Genome, FilterFileError> {
        genome(&self.initial, Path::new(SENT))
    }
}

/// A job on its way.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Task {
    /// What its verdict names.
    pub(super) job: u64,
    filter: String,
    earlier: u32,
    steps: u32,
    bar: Option<Vec<Exact>>,
    name: [usize; 2],
}

impl Task {
    pub(super) fn of(id: u64, job: &Job<'_>) -> Self {
        Self {
            job: id,
            filter: text(job.genome.filter()),
            earlier: job.earlier,
            steps: job.steps,
            bar: job.bar.map(|bar| bar.iter().map(|&score| Exact(score)).collect()),
            name: job.name,
        }
    }

    /// The program that is to be judged.
    ///
    /// # Errors
    /// If it is none.
    pub(super) fn genome(&self) -> Result<Genome, FilterFileError> {
        genome(&self.filter, Path::new(SENT))
    }

    /// What it has to come near to.
    pub(super) fn bar(&self) -> Option<Vec<f64>> {
        self.bar.as_ref().map(|bar| bar.iter().map(|score| score.0).collect())
    }

    /// The job, with the two parts that were read already.
    pub(super) fn as_job<'c>(&self, genome: &'c Genome, bar: Option<&'c [f64]>) -> Job<'c> {
        Job { genome, earlier: self.earlier, steps: self.steps, bar, name: self.name }
    }
}

/// A verdict on its way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) enum Answer {
    Judged(Box<WrittenProgram>),
    Dropped,
    Unfit,
}

impl Answer {
    pub(super) fn of(verdict: &Verdict) -> Self {
        match verdict {
            Verdict::Judged(judged) => Self::Judged(Box::new(WrittenProgram::of(judged))),
            Verdict::Dropped => Self::Dropped,
            Verdict::Unfit => Self::Unfit,
        }
    }

    /// # Errors
    /// If its program is none.
    pub(super) fn verdict(self) -> Result<Verdict, FilterFileError> {
        Ok(match self {
            Self::Judged(program) => Verdict::Judged(Box::new(program.read(Path::new(SENT))?)),
            Self::Dropped => Verdict::Dropped,
            Self::Unfit => Verdict::Unfit,
        })
    }
}

/// A message as a line, with its end.
pub(super) fn line(message: &impl Serialize) -> String {
    serde_json::to_string(message).expect("text, numbers and lists are JSON") + "\n"
}

/// The message that a line is.
///
/// # Errors
/// If it is none, with how it begins.
pub(super) fn parse<T: DeserializeOwned>(line: &str) -> Result<T, String> {
    /// Most characters of a line that errors quote.
    const QUOTED: usize = 120;
    serde_json::from_str(line).map_err(|error| {
        let line = line.trim_end();
        // What a terminal would take for orders is not shown to one.
        let shown = |c: char| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c };
        let start: String = line.chars().take(QUOTED).map(shown).collect();
        let rest = if line.chars().nth(QUOTED).is_some() { "…" } else { "" };
        format!("wrote `{start}{rest}`, which is no message of this protocol ({error})")
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::judge::Judged;
    use super::super::seed;
    use super::*;
    use crate::expr::builder::LIMIT;
    use crate::filter::shipped;
    use crate::tune::stream;

    /// A mutant some generations on, whose constants have these bits as far as they may.
    fn genome_of(seed_: u64, bits: &[u32]) -> Genome {
        let mut rng = stream(seed_, 0, 0, 0);
        let features = Settings::quick().vocabulary().expect("features");
        let begun = if seed_.is_multiple_of(2) { seed() } else { shipped::best() };
        let mut genome = Genome::new(begun).expect("it makes sense");
        for _ in 0..seed_ % 4 {
            genome = genome.mutant(&features, &mut rng, |_| true).unwrap_or(genome);
        }
        let mut filter = genome.filter().clone();
        let mut bounds = filter.constants.params.iter().map(|param| param.bounds);
        let moved: Vec<f32> = filter
            .constants
            .values()
            .iter()
            .zip(bits.iter().cycle())
            .map(|(&old, &bits)| {
                let ([low, high], new) =
                    (bounds.next().unwrap_or([-LIMIT, LIMIT]), f32::from_bits(bits));
                if (low..=high).contains(&new) { new } else { old }
            })
            .collect();
        filter.constants.set_values(&moved);
        Genome::new(filter).expect("it makes sense")
    }

    /// A program's constants by their bits: -0 is 0 to whoever compares numbers.
    fn bits(genome: &Genome) -> Vec<u32> {
        genome.filter().constants.values().iter().map(|x| x.to_bits()).collect()
    }

    fn sent<T: Serialize + DeserializeOwned>(message: &T) -> T {
        let line = line(message);
        assert_eq!(line.find('\n'), Some(line.len() - 1), "one line");
        parse(&line).expect("it is a message")
    }

    /// Scores may be anything but NaN, infinite ones included.
    fn score() -> impl Strategy<Value = f64> {
        any::<u64>().prop_map(f64::from_bits).prop_filter("a number", |x| !x.is_nan())
    }

    fn same(a: &[f64], b: &[f64]) -> bool {
        a.iter().map(|x| x.to_bits()).eq(b.iter().map(|x| x.to_bits()))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn jobs_arrive_to_the_bit(
            seed in any::<u64>(),
            constants in prop::collection::vec(any::<u32>(), 1..40),
            bar in prop::option::of(prop::collection::vec(score(), 0..20)),
            (earlier, steps, name) in any::<(u32, u32, [usize; 2])>(),
        ) {
            let genome = genome_of(seed, &constants);
            let job = Job { genome: &genome, earlier, steps, bar: bar.as_deref(), name };
            let sent = sent(&ToWorker::Judge(Task::of(seed, &job)));
            let ToWorker::Judge(task) = sent else { panic!("another message: {sent:?}") };
            let (read, read_bar) = (task.genome().expect("a program"), task.bar());
            prop_assert_eq!(task.job, seed);
            prop_assert_eq!(&read, &genome);
            prop_assert_eq!(bits(&read), bits(&genome));
            let read = task.as_job(&read, read_bar.as_deref());
            prop_assert_eq!((read.earlier, read.steps, read.name), (earlier, steps, name));
            prop_assert_eq!(read.bar.is_some(), bar.is_some());
            prop_assert!(same(read.bar.unwrap_or_default(), bar.as_deref().unwrap_or_default()));
        }

        #[test]
        fn verdicts_arrive_to_the_bit(
            seed in any::<u64>(),
            constants in prop::collection::vec(any::<u32>(), 1..40),
            scores in prop::collection::vec(score(), 0..20),
            (error, cost, steps) in (score(), score(), any::<u32>()),
        ) {
            let genome = genome_of(seed, &constants);
            let judged = Judged { genome, scores, error, cost, steps };
            let verdict = Verdict::Judged(Box::new(judged.clone()));
            let sent = sent(&FromWorker::Verdict { job: 7, verdict: Answer::of(&verdict) });
            let FromWorker::Verdict { job: 7, verdict } = sent else { panic!("{sent:?}") };
            let Verdict::Judged(read) = verdict.verdict().expect("a program") else {
                panic!("another verdict")
            };
            prop_assert_eq!(&read.genome, &judged.genome);
            prop_assert_eq!(bits(&read.genome), bits(&judged.genome));
            prop_assert!(same(&read.scores, &judged.scores));
            prop_assert!(same(&[read.error, read.cost], &[error, cost]));
            prop_assert_eq!(read.steps, steps);
        }
    }

    #[test]
    fn the_other_messages_arrive() {
        for verdict in [Verdict::Dropped, Verdict::Unfit] {
            let message = FromWorker::Verdict { job: u64::MAX, verdict: Answer::of(&verdict) };
            assert_eq!(sent(&message), message);
        }
        let hello = Hello { program: PROGRAM.to_owned(), protocol: PROTOCOL, threads: 5 };
        let reason = "two\nlines, \"quoted\"".to_owned();
        for message in [
            FromWorker::Hello(hello),
            FromWorker::Alive {},
            FromWorker::Ready { probe: Answer::Unfit },
            FromWorker::Refused { reason: reason.clone() },
            FromWorker::Failed { job: 3, reason },
        ] {
            assert_eq!(sent(&message), message);
        }
        let pictures = vec![Fingerprint { name: "room".to_owned(), checksum: u32::MAX }];
        let settings = Settings { rate: 0.1 + 0.2, slack: 1e-300, ..Settings::quick() };
        let briefing = Briefing::new(&settings, &seed(), pictures, &Verdict::Dropped);
        assert_eq!(Some(briefing.initial().expect("a program")), Genome::new(seed()));
        let scenes = vec!["a b".to_owned()];
        let setup = ToWorker::Setup(Box::new(Setup { briefing, scenes, heartbeat: 9 }));
        assert_eq!(sent(&setup), setup);
    }

    #[test]
    fn what_is_no_message_is_quoted() {
        let error = parse::<FromWorker>("Welcome to node7\n").expect_err("it is none");
        assert!(error.contains("`Welcome to node7`"), "{error}");
        let error = parse::<FromWorker>("\u{1b}[2J").expect_err("it is none");
        assert!(error.contains("`\u{fffd}[2J`"), "{error}");
        let error = parse::<FromWorker>(&"é".repeat(1000)).expect_err("it is none");
        assert!(error.contains("é…") && error.len() < 500, "{error}");
        assert!(parse::<FromWorker>("{\"hello\":{\"program\":\"x\"}}").is_err());
        // Other versions are told by name, whatever else they say.
        let newer = r#"{"hello":{"program":"tamis 9","protocol":9,"threads":1,"more":[]}}"#;
        assert!(matches!(parse(newer), Ok(FromWorker::Hello(Hello { protocol: 9, .. }))));
    }
}
