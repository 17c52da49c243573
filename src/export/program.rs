//! A program on its way out, as every language gets it.

use super::{ExportError, identifier};
use crate::expr::feature::Feature;
use crate::filter::{Checked, Filter, StandIn};
use crate::plan::{Passes, PlanError, Precision, Program};
use crate::scene::Facts;

/// A program, for renderers that have all features but some.
pub(super) struct ProgramSubject<'a> {
    /// What people call the filter: any text.
    pub(super) name: &'a str,
    /// The same for compilers.
    pub(super) identifier: String,
    pub(super) checked: Checked<'a>,
    /// The schedule, for any scene that has these features.
    pub(super) program: Program,
    /// The features that the renderer lacks.
    pub(super) without: &'a [Feature],
}

impl<'a> ProgramSubject<'a> {
    pub(super) fn of(
        filter: &'a Filter,
        precision: Precision,
        without: &'a [Feature],
    ) -> Result<Self, ExportError> {
        let name = filter.name.as_str();
        let checked = filter.check().map_err(|source| ExportError::Filter {
            filter: name.to_owned(),
            reason: source.to_string(),
        })?;
        // Every pair on its own: who computes it for both of its ends must compute rows in
        // their order.
        let passes = Passes { symmetry: false, precision, ..Passes::ALL };
        let program = Program::new(&checked, &facts(without), passes).map_err(|source| {
            let filter = name.to_owned();
            match source {
                PlanError::Missing { term, .. } => ExportError::Required { filter, term },
                source => ExportError::Plan { filter, source },
            }
        })?;
        let identifier = identifier::of(name);
        Ok(Self { name, identifier, checked, program, without })
    }

    /// The features that something stands in for where a renderer lacks them: those that are
    /// read, and those that are lacking.
    pub(super) fn optional(&self) -> Vec<(Feature, StandIn)> {
        let reads = crate::filter::reads(&self.checked).into_iter();
        reads.filter_map(|(feature, stand_in)| Some((feature, stand_in?))).collect()
    }
}

/// What holds of any scene that lacks these features.
pub(super) fn facts(without: &[Feature]) -> Facts {
    let facts = Facts::of_any_scene();
    Facts::from_planes(facts.iter().filter(|(plane, _)| !without.contains(&plane.feature)))
}
