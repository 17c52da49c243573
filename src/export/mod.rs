//! Floor 4: filters as text that others can paste into their renderer or their
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
//! - Whatever the filter is called, the text is well formed.
//!
//! What it does not know: files. Whoever asks gets bytes.
//!
//! Adding a language is adding a variant to [`Language`] and what the compiler
//! then asks for: its row, and its arm in [`export`].

mod c;
mod header;
mod identifier;
mod latex;
mod term;

use crate::expr::tree::Tree;
use crate::plan::{Filter, Passes, Plan, PlanError, Source, Stage};
use crate::scene::Facts;

/// What a filter can be exported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Language {
    /// C99.
    C,
    /// LaTeX with amsmath.
    Latex,
}

/// A language as the command line knows it.
struct Row {
    name: &'static str,
    ending: &'static str,
    doc: &'static str,
}

impl Language {
    /// Every language.
    pub const ALL: [Self; 2] = [Self::C, Self::Latex];

    /// What the command line calls it.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The usual ending of its files' names.
    pub fn ending(self) -> &'static str {
        self.row().ending
    }

    /// One line for people.
    pub fn doc(self) -> &'static str {
        self.row().doc
    }

    /// The language of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|language| language.name() == name)
    }

    fn row(self) -> Row {
        match self {
            Self::C => Row {
                name: "c",
                ending: "c",
                doc: "C99: weight function and kernel, the interpreter's bits",
            },
            Self::Latex => Row {
                name: "latex",
                ending: "tex",
                doc: "LaTeX with amsmath: the filter as equations",
            },
        }
    }
}

/// Why a filter cannot be exported.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExportError {
    /// A filter of a later version's kind.
    #[error(
        "filter `{filter}` has {stages} stages; this version exports filters of one stage: \
         split it up, or update the program"
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
    plan: Plan,
}

/// Exports a filter. The result is text in UTF-8 unless the language is binary.
///
/// # Errors
/// If the filter has several stages, or no plan can be made of it.
pub fn export(filter: &Filter, language: Language) -> Result<Vec<u8>, ExportError> {
    let name = filter.name.as_str();
    let [Stage { weight, window, source: Source::Color }] = filter.stages.as_slice() else {
        return Err(ExportError::Stages { filter: name.to_owned(), stages: filter.stages.len() });
    };
    // In one piece: a compiler moves what does not depend on the pair itself.
    let passes = Passes { rate: false, ..Passes::ALL };
    let plan = Plan::new(std::slice::from_ref(weight), *window, &Facts::of_any_scene(), passes)
        .map_err(|source| ExportError::Plan { filter: name.to_owned(), source })?;
    let subject = Subject { name, identifier: identifier::of(name), weight, plan };
    Ok(match language {
        Language::C => c::text(&subject).into_bytes(),
        Language::Latex => latex::text(&subject).into_bytes(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn languages_have_names_of_their_own() {
        for language in Language::ALL {
            assert_eq!(Language::named(language.name()), Some(language));
        }
        assert_eq!(Language::named("fortran"), None);
    }
}
