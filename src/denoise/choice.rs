//! Which filter a file gets.

use std::fmt;

use super::{DenoiseError, Denoiser};
use crate::expr::Feature;
use crate::filter::Filter;
use crate::filter::shipped::{self, Choice};
use crate::scene::{ColorScale, Target};

/// The filter of a frame.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// The filter.
    pub filter: Filter,
    /// Why it is not the best there is; nothing if it is, or what was asked for.
    pub why: Option<Why>,
}

/// A better filter needs features that a file lacks.
#[derive(Clone, Debug, PartialEq)]
pub struct Why {
    /// The filter that it gets.
    pub filter: String,
    /// The features.
    pub features: Vec<Feature>,
    /// The better filter.
    pub best: String,
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let titles: Vec<&str> = self.features.iter().map(|feature| feature.row().title).collect();
        write!(
            f,
            "no {} in the file: using `{}` instead of `{}`",
            titles.join(", no "),
            self.filter,
            self.best
        )
    }
}

impl Denoiser<'_> {
    /// The filter for a picture.
    ///
    /// # Errors
    /// If the filter has no such radius as was asked for.
    pub fn choose(&self, target: &Target) -> Result<Chosen, DenoiseError> {
        let options = &self.options;
        if let Some(filter) = &options.filter {
            return Ok(Chosen { filter: filter.clone(), why: None });
        }
        let mapping = target.mapping();
        // The windows of a program have radii of their own, and its colours are linear.
        let programs = options.radius.is_none() && options.load.color_scale == ColorScale::Linear;
        let may = |filter: &Filter| programs || filter.paper().is_some();
        let Choice { filter, best, lacking } =
            shipped::choose(may, |plane| mapping.provides(plane));
        let filter = match options.radius {
            Some(radius) => filter.resized(radius)?,
            None => filter,
        };
        let name = filter.name.clone();
        let why = (!lacking.is_empty()).then_some(Why { filter: name, features: lacking, best });
        Ok(Chosen { filter, why })
    }
}
