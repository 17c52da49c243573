//! Options that several commands share.

use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};

use super::backend::BackendArgs;
use crate::filter::Window;
use crate::image::exr::Unfinished;
use crate::plan::{PASSES, Passes};
use crate::scene::{LoadOptions, Repair};

/// What becomes of pixels that are no numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum RepairChoice {
    /// Replace each by the median of the good ones around it
    Median,
    /// Leave them in: one in the colour keeps its whole window noisy
    None,
    /// Refuse the image, naming the channel and the first pixel
    Error,
}

/// How filters are run.
#[derive(Debug, Args)]
pub(super) struct Running {
    #[command(flatten)]
    pub(super) backend: BackendArgs,

    /// Window radius in pixels [default: the filter's own; 10 for expressions]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(..=i64::from(Window::MAX_RADIUS)))]
    pub(super) radius: Option<u32>,

    /// Leave out an optimisation pass (again for more); costs time, not quality
    #[arg(long, value_name = "PASS", value_parser = PossibleValuesParser::new(PASSES.iter().map(|pass| pass.name)))]
    without: Vec<String>,

    /// What becomes of pixels that are NaN, infinite or beyond ±1e18
    /// [default: median]; if it is asked for, renders that were not finished are read
    /// as far as they go, too
    #[arg(long, value_enum, value_name = "HOW")]
    repair: Option<RepairChoice>,

    /// Samples per pixel, for filters that ask [default: what the file says, if it does]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    samples: Option<u32>,
}

impl Running {
    /// The passes that are left.
    pub(super) fn passes(&self) -> Passes {
        self.without.iter().fold(self.backend.passes(), |passes, name| {
            passes.without(name).expect("the command line accepts no other name")
        })
    }

    /// How scenes are loaded.
    pub(super) fn load_options(&self) -> LoadOptions {
        let repair = match self.repair {
            None | Some(RepairChoice::Median) => Repair::Median,
            Some(RepairChoice::None) => Repair::None,
            Some(RepairChoice::Error) => Repair::Error,
        };
        let unfinished = match self.repair {
            Some(RepairChoice::Median | RepairChoice::None) => Unfinished::Zero,
            None | Some(RepairChoice::Error) => Unfinished::Refused,
        };
        LoadOptions { repair, unfinished, samples: self.samples, ..LoadOptions::default() }
    }
}
