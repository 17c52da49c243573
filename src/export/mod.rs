//! Floor 7: filters as text that others can paste into their renderer or their
//! paper.
//!
//! A filter is exported as its weight function and a complete kernel around it,
//! Equation 1 with its window and its guard, in the language asked for; in a
//! typesetting language, as the equations.
//!
//! What it promises:
//! - An export is right for every image: nothing is assumed of the features but
//!   what [`Facts::of_any_scene`] says, and what must be supplied, in which
//!   units, stands in the text's first lines.
//! - Code comes from the tape that the back ends run, and sums in the order that
//!   [`crate::backend`] states. Languages that round as `f32` does give the bits
//!   of the interpreter on the same plan.
//! - Shaders are the kernel that the GPU back end runs, and validated before they
//!   are written.
//! - Whatever the filter is called, the text is well formed.
//!
//! What it does not know: files. Whoever asks gets bytes.
//!
//! Adding a language is adding a variant to [`Language`] or [`Shading`] and what
//! the compiler then asks for: its row, and its writer.

mod c;
mod header;
mod identifier;
mod language;
mod latex;
#[cfg(feature = "gpu")]
mod shading;
mod term;

pub use language::{Language, Shading};

use crate::expr::feature::{Feature, Quantity};
use crate::expr::tree::Tree;
use crate::filter::{Filter, Gather};
use crate::plan::Precision;
use crate::plan::{Passes, PlanError, WindowPlan};
use crate::scene::Facts;

/// Why a filter cannot be exported.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExportError {
    /// A filter of a later version's kind.
    #[error(
        "filter `{filter}` has {stages} stages or stand-ins for features; only filters of one \
         gather of the colour are exported"
    )]
    Stages {
        /// The filter's name.
        filter: String,
        /// How many it has.
        stages: usize,
    },
    /// Its weight is no number, or its window too large.
    #[error("filter `{filter}` cannot be exported: {source}")]
    Plan {
        /// The filter's name.
        filter: String,
        /// Why.
        source: PlanError,
    },
    /// There is nothing to choose.
    #[error("`{language}` says what a filter means; only code takes `--precision fast`")]
    AlwaysExact {
        /// The language.
        language: &'static str,
    },
    /// A shading language, in a program that knows none.
    #[error(
        "the program was built without the feature `gpu`, which `--lang {language}` needs; build \
         it with that feature, or choose `--lang c`"
    )]
    WithoutGpu {
        /// The language.
        language: &'static str,
    },
    /// The shader is not valid or cannot be said in its language: an error of ours.
    #[error(
        "filter `{filter}` cannot be exported as `{language}`, which is an error of this program; \
         choose another language. The reason: {reason}"
    )]
    Refused {
        /// The filter's name.
        filter: String,
        /// The language.
        language: &'static str,
        /// What was said.
        reason: String,
    },
}

/// A filter on its way out, as every language gets it.
struct Subject<'a> {
    /// What people call the filter: any text.
    name: &'a str,
    /// The same for compilers.
    identifier: String,
    weight: &'a Tree,
    /// The weight as one tape, for any scene: all of it per pair, but for the
    /// offsets, which are the tap tape's results.
    plan: WindowPlan,
}

impl<'a> Subject<'a> {
    fn of(filter: &'a Filter, precision: Precision) -> Result<Self, ExportError> {
        let name = filter.name.as_str();
        let Some(Gather { weight, window, .. }) = filter.paper() else {
            let stages = filter.stages.len();
            return Err(ExportError::Stages { filter: name.to_owned(), stages });
        };
        // In one piece: a compiler moves what does not depend on the pair itself.
        let passes = Passes { hoist: false, symmetry: false, precision, ..Passes::ALL };
        let plan =
            WindowPlan::new(std::slice::from_ref(weight), *window, &Facts::of_any_scene(), passes)
                .map_err(|source| ExportError::Plan { filter: name.to_owned(), source })?;
        Ok(Self { name, identifier: identifier::of(name), weight, plan })
    }
}

/// The images that a filter's exported kernel takes beside the noisy colour. Code
/// calls them by [`Feature::identifier`].
///
/// # Errors
/// If the filter cannot be exported.
pub fn images(filter: &Filter) -> Result<Vec<(Feature, Quantity)>, ExportError> {
    let subject = Subject::of(filter, Precision::Standard)?;
    let terms = term::Term::of(&subject.plan).into_iter().filter(|term| term.is_image());
    Ok(terms.map(|term| (term.feature, term.quantity)).collect())
}

/// Exports a filter. The result is text in UTF-8 unless the language is binary.
/// Only code can be less than exact.
///
/// # Errors
/// If the filter has several stages, or no plan can be made of it, or the language
/// is not to be had like that.
pub fn export(
    filter: &Filter,
    language: Language,
    precision: Precision,
) -> Result<Vec<u8>, ExportError> {
    let subject = Subject::of(filter, precision)?;
    match (language, precision) {
        (Language::C, _) => Ok(c::text(&subject).into_bytes()),
        (Language::Latex, Precision::Standard) => Ok(latex::text(&subject).into_bytes()),
        (Language::Latex, Precision::Fast) => {
            Err(ExportError::AlwaysExact { language: language.name() })
        }
        #[cfg(feature = "gpu")]
        (Language::Shading(shading), precision) => shading::bytes(&subject, shading, precision)
            .map_err(|reason| ExportError::Refused {
                filter: filter.name.clone(),
                language: language.name(),
                reason,
            }),
        #[cfg(not(feature = "gpu"))]
        (Language::Shading(_), _) => Err(ExportError::WithoutGpu { language: language.name() }),
    }
}
