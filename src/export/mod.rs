//! Floor 7: filters as text that others can paste into their renderer or their
//! paper.
//!
//! A filter of a single weight is exported as its weight function and a complete kernel
//! around it, Equation 1 with its window and its guard, in the language asked for; a
//! program as the kernels of its schedule and what runs them; in a typesetting language,
//! both as equations.
//!
//! What it promises:
//! - An export is right for every image: nothing is assumed of the features but
//!   what [`crate::scene::Facts::of_any_scene`] says (and of programs, which features are absent), and
//!   what must be supplied, in which units, stands in the text's first lines.
//! - Code comes from the tapes that the back ends run, and sums in the order that
//!   [`crate::backend`] states. Languages that round as `f32` does give the bits
//!   of the interpreter on the same plan.
//! - Shaders are the kernels that the GPU back end runs, and validated before they
//!   are written.
//! - Whatever the filter is called, the text is well formed.
//!
//! What it does not know: files. Whoever asks gets bytes, and what goes beside them.
//!
//! Adding a language is adding a variant to [`Language`] or [`Shading`] and what
//! the compiler then asks for: its row, and its writer.

mod c;
mod header;
mod identifier;
mod language;
mod latex;
mod names;
mod program;
mod python;
#[cfg(feature = "gpu")]
mod shading;
mod term;

pub use language::{Language, Shading};

use crate::expr::feature::{Feature, Quantity};
use crate::expr::tree::Tree;
use crate::filter::{Filter, Gather};
use crate::plan::Precision;
use crate::plan::{Passes, PlanError, WindowPlan};

/// Why a filter cannot be exported.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExportError {
    /// It is a program, where a single weight is asked for.
    #[error(
        "filter `{filter}` is a program of {stages} stages, and no single weight over the noisy \
         colour; export the program as it is, or choose a filter of one weight such as `bilateral`"
    )]
    Stages {
        /// The filter's name.
        filter: String,
        /// How many it has.
        stages: usize,
    },
    /// It makes no sense.
    #[error("filter `{filter}` cannot be exported: {reason}")]
    Filter {
        /// The filter's name.
        filter: String,
        /// Why not.
        reason: String,
    },
    /// Nothing stands in for a feature that the renderer is said to lack.
    #[error(
        "filter `{filter}` reads `{term}` and names nothing that stands in for it; supply it, \
         or choose another filter (`tamis filters` says what each reads)"
    )]
    Required {
        /// The filter's name.
        filter: String,
        /// What is lacking.
        term: String,
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
    #[error("`{language}` says what a filter means exactly; only code takes `--precision fast`")]
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
    fn of(filter: &'a Filter, options: &Options<'_>) -> Result<Self, ExportError> {
        let name = filter.name.as_str();
        let Some(Gather { weight, window, .. }) = filter.paper() else {
            let stages = filter.stages.len();
            return Err(ExportError::Stages { filter: name.to_owned(), stages });
        };
        // In one piece: a compiler moves what does not depend on the pair itself.
        let precision = options.precision;
        let passes = Passes { hoist: false, symmetry: false, precision, ..Passes::ALL };
        let facts = program::facts(options.without);
        let plan = WindowPlan::new(std::slice::from_ref(weight), *window, &facts, passes);
        let plan = plan.map_err(|source| {
            let filter = name.to_owned();
            match source {
                PlanError::Missing { term, .. } => ExportError::Required { filter, term },
                source => ExportError::Plan { filter, source },
            }
        })?;
        Ok(Self { name, identifier: identifier::of(name), weight, plan })
    }
}

/// How a filter is exported.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options<'a> {
    /// How accurate code is.
    pub precision: Precision,
    /// Features that the renderer does not have: what stands in for them is in the code. Only
    /// programs name such.
    pub without: &'a [Feature],
}

/// What an export is made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Export {
    /// One text, in UTF-8, or one binary.
    Single(Vec<u8>),
    /// C of a program, and the header for whoever calls it. The code is complete without it.
    WithHeader {
        /// The code.
        code: Vec<u8>,
        /// Its declarations.
        header: Vec<u8>,
    },
    /// The kernels of a program, and a manifest that says how they are run: files of a folder,
    /// by name.
    Folder(Vec<(String, Vec<u8>)>),
}

impl Export {
    /// What is complete as one file; nothing of a folder.
    pub fn into_file(self) -> Option<Vec<u8>> {
        match self {
            Self::Single(text) | Self::WithHeader { code: text, .. } => Some(text),
            Self::Folder(_) => None,
        }
    }
}

/// The images that the exported kernel of a single weight takes beside the noisy colour. Code
/// calls them by [`Feature::identifier`].
///
/// # Errors
/// If the filter is a program or cannot be exported.
pub fn images(filter: &Filter) -> Result<Vec<(Feature, Quantity)>, ExportError> {
    let subject = Subject::of(filter, &Options::default())?;
    let terms = term::Term::of(&subject.plan).into_iter().filter(|term| term.is_image());
    Ok(terms.map(|term| (term.feature, term.quantity)).collect())
}

/// Exports a filter. Only code can be less than exact.
///
/// # Errors
/// If no plan can be made of the filter, or the language is not to be had like that.
pub fn export(
    filter: &Filter,
    language: Language,
    options: &Options<'_>,
) -> Result<Export, ExportError> {
    // What a filter means is said alike of one stage and of many.
    if filter.paper().is_some() && language != Language::Python {
        return weight(&Subject::of(filter, options)?, language, options.precision);
    }
    let subject = program::ProgramSubject::of(filter, options.precision, options.without)?;
    match language {
        Language::C => {
            let c::program::Text { code, header } = c::program::text(&subject);
            Ok(Export::WithHeader { code: code.into_bytes(), header: header.into_bytes() })
        }
        Language::Latex | Language::Python if options.precision == Precision::Fast => {
            Err(ExportError::AlwaysExact { language: language.name() })
        }
        Language::Latex => Ok(Export::Single(latex::program(&subject).into_bytes())),
        Language::Python => Ok(Export::Single(python::text(&subject).into_bytes())),
        #[cfg(feature = "gpu")]
        Language::Shading(shading) => {
            let files = shading::program::files(&subject, shading, options.precision);
            files.map(Export::Folder).map_err(|reason| ExportError::Refused {
                filter: filter.name.clone(),
                language: language.name(),
                reason,
            })
        }
        #[cfg(not(feature = "gpu"))]
        Language::Shading(_) => Err(ExportError::WithoutGpu { language: language.name() }),
    }
}

fn weight(
    subject: &Subject<'_>,
    language: Language,
    precision: Precision,
) -> Result<Export, ExportError> {
    let bytes = match (language, precision) {
        (Language::C, _) => c::text(subject).into_bytes(),
        (Language::Latex, Precision::Standard) => latex::text(subject).into_bytes(),
        (Language::Python, _) => unreachable!("it is written as a program"),
        (Language::Latex, Precision::Fast) => {
            return Err(ExportError::AlwaysExact { language: language.name() });
        }
        #[cfg(feature = "gpu")]
        (Language::Shading(shading), precision) => shading::bytes(subject, shading, precision)
            .map_err(|reason| ExportError::Refused {
                filter: subject.name.to_owned(),
                language: language.name(),
                reason,
            })?,
        #[cfg(not(feature = "gpu"))]
        (Language::Shading(_), _) => {
            return Err(ExportError::WithoutGpu { language: language.name() });
        }
    };
    Ok(Export::Single(bytes))
}
