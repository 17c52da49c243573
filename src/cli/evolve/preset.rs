//! Named searches, of either kind.

use clap::ValueEnum;
use clap::builder::PossibleValue;

use crate::evolve::{self, Settings, programs};

/// A named search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Preset {
    /// Programs, in about two minutes.
    Quick,
    /// Programs, for hours.
    Programs,
    /// Weights of one window, in less than a minute.
    Weights,
    /// Weights as the paper finds them.
    Paper,
}

impl Preset {
    /// All of them.
    pub(super) const ALL: [Self; 4] = [Self::Quick, Self::Programs, Self::Weights, Self::Paper];

    /// What `--preset` calls it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Quick => "quick",
            Self::Programs => "programs",
            Self::Weights => "weights",
            Self::Paper => "paper",
        }
    }

    /// The settings of a search for weights, if it is one.
    pub(super) fn weights(self) -> Option<Settings> {
        match self {
            Self::Quick | Self::Programs => None,
            Self::Weights => Some(evolve::Preset::Weights.settings()),
            Self::Paper => Some(evolve::Preset::Paper.settings()),
        }
    }

    /// The settings of a search for programs, if it is one.
    pub(super) fn programs(self) -> Option<programs::Settings> {
        match self {
            Self::Quick => Some(programs::Settings::quick()),
            Self::Programs => Some(programs::Settings::thorough()),
            Self::Weights | Self::Paper => None,
        }
    }
}

impl ValueEnum for Preset {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name()))
    }
}
