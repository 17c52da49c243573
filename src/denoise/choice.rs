//! Which filter a file gets.

use std::fmt;
use std::path::Path;

use super::{DenoiseError, Denoiser};
use crate::expr::Feature;
use crate::filter::Filter;
use crate::filter::shipped::{self, Choice};
use crate::image::exr::Header;
use crate::scene::mapping::Mapping;
use crate::scene::{ColorScale, SceneError};

/// The filter of a frame.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// The filter.
    pub filter: Filter,
    /// Why it is not the best there is, or does not do its best; nothing if it is what was
    /// asked for.
    pub why: Option<Why>,
}

/// What a file lacks, and what that leads to.
#[derive(Clone, Debug, PartialEq)]
pub enum Why {
    /// The filter does without some features.
    Without {
        /// The filter.
        filter: String,
        /// The features.
        features: Vec<Feature>,
    },
    /// A better filter needs them.
    Instead {
        /// The filter.
        filter: String,
        /// The features.
        features: Vec<Feature>,
        /// The better one.
        best: String,
    },
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Without { features, .. } | Self::Instead { features, .. }) = self;
        let titles: Vec<&str> = features.iter().map(|feature| feature.row().title).collect();
        write!(f, "no {} in the file: ", titles.join(", no "))?;
        match self {
            Self::Without { filter, .. } => write!(f, "`{filter}` does without"),
            Self::Instead { filter, best, .. } => {
                write!(f, "using `{filter}` instead of `{best}`")
            }
        }
    }
}

impl Denoiser<'_> {
    /// The filter for a file.
    ///
    /// # Errors
    /// If its header cannot be read, or the filter has no such radius as was asked for.
    pub fn choose(&self, path: &Path) -> Result<Chosen, DenoiseError> {
        let options = &self.options;
        if let Some(filter) = &options.filter {
            return Ok(Chosen { filter: filter.clone(), why: None });
        }
        let mapping = Mapping::of(&Header::read(path).map_err(SceneError::from)?);
        // The windows of a program have radii of their own, and its colours are linear.
        let programs = options.radius.is_none() && options.load.color_scale == ColorScale::Linear;
        let may = |filter: &Filter| match filter.paper() {
            Some(_) => true,
            None => programs && self.backend.supports(filter).is_ok(),
        };
        let Choice { filter, best, lacking } =
            shipped::choose(may, |plane| mapping.provides(plane));
        let filter = match options.radius {
            Some(radius) => filter.resized(radius)?,
            None => filter,
        };
        let without = filter.does_without(|plane| mapping.provides(plane));
        let name = filter.name.clone();
        let why = match (lacking.is_empty(), without.is_empty()) {
            (true, true) => None,
            (true, false) => Some(Why::Without { filter: name, features: without }),
            (false, _) => Some(Why::Instead { filter: name, features: lacking, best }),
        };
        Ok(Chosen { filter, why })
    }
}
