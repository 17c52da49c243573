//! What people call filters: a name, a file or an expression.

use std::path::Path;

use super::file::FilterFileError;
use super::shipped;
use super::{Filter, Window};
use crate::expr::codebook;
use crate::expr::feature::Feature;
use crate::expr::text::parse_scalar;

/// Why a text stands for no filter.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// One word that is none of the names.
    #[error("there is no filter or file `{word}`; filters: {}", names().join(", "))]
    Unknown {
        /// The word.
        word: String,
    },
    /// It is no name, no file, and no expression.
    #[error(
        "{text} is neither a filter's name ({}) nor a file, and as an expression it cannot be \
         read:\n{reason}",
        names().join(", ")
    )]
    NoExpression {
        /// Its beginning.
        text: String,
        /// Where the expression goes wrong.
        reason: String,
    },
    /// A filter file that cannot be read.
    #[error(transparent)]
    File(#[from] Box<FilterFileError>),
}

/// The names of filters: those that ship, and those that are known.
pub fn names() -> Vec<String> {
    let own = shipped::programs().map(|filter| filter.name);
    own.chain(codebook::known().iter().map(|known| known.name.to_owned())).collect()
}

impl Filter {
    /// The filter of a name: one that ships, or one that is known.
    pub fn named(name: &str) -> Option<Self> {
        let known = || {
            let weight = codebook::named(name)?.clone();
            Some(Self::single(name, weight, Window::DEFAULT_RADIUS))
        };
        shipped::programs().find(|filter| filter.name == name).or_else(known)
    }

    /// The filter that a text stands for, as `tamis denoise --filter` takes it: a name, a
    /// filter file's path, or a weight.
    ///
    /// # Errors
    /// If it stands for none, or the file cannot be read.
    pub fn find(text: &str) -> Result<Self, FindError> {
        if let Some(filter) = Self::named(text) {
            return Ok(filter);
        }
        let path = Path::new(text);
        let called_a_file = path.extension().is_some_and(|extension| extension == "toml");
        if called_a_file || path.is_file() {
            return Ok(Self::read(path).map_err(Box::new)?);
        }
        let error = match parse_scalar(text) {
            Ok(weight) => return Ok(Self::single("expression", weight, Window::DEFAULT_RADIUS)),
            Err(error) => error,
        };
        // One unknown word is hardly an expression: where it goes wrong as one tells nothing.
        let word = text.chars().all(|c| c.is_alphanumeric() || "-_./\\".contains(c));
        Err(match word && Feature::parse(text).is_none() {
            true => FindError::Unknown { word: text.to_owned() },
            false => FindError::NoExpression { text: shortened(text), reason: error.to_string() },
        })
    }
}

fn shortened(text: &str) -> String {
    const LONGEST: usize = 40;
    match text.char_indices().nth(LONGEST) {
        Some((cut, _)) => format!("`{}…`", &text[..cut]),
        None => format!("`{text}`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_files_and_expressions_are_told_apart() {
        assert_eq!(Filter::find("bilateral").expect("a name").name, "bilateral");
        let expression = Filter::find("exp(-distance2(normal, normal))").expect("it parses");
        assert_eq!(expression.paper().expect("one gather").window, Window::dense(10));
        let missing = Filter::find("no/such/file.toml").unwrap_err();
        assert!(matches!(missing, FindError::File(_)) && missing.to_string().contains("no/such"));
        let nonsense = Filter::find("bilatral").unwrap_err();
        assert!(nonsense.to_string().contains("cross-bilateral"), "{nonsense}");
        let broken = Filter::find("exp(-distance2(normal, normal)").unwrap_err();
        assert!(matches!(broken, FindError::NoExpression { .. }), "{broken}");
    }

    #[test]
    fn every_name_is_found() {
        for name in names() {
            assert_eq!(Filter::find(&name).expect("a known name").name, name);
        }
    }
}
