//! What `--filter` means: a name, a file or an expression.

use std::path::Path;

use super::error::Error;
use crate::expr::text::parse_scalar;
use crate::expr::{Feature, codebook};
use crate::filter::{Filter, Window, shipped};

/// The names of filters: those that ship, and those that are known.
pub(super) fn names() -> Vec<String> {
    let own = shipped::programs().map(|filter| filter.name);
    own.chain(codebook::known().iter().map(|known| known.name.to_owned())).collect()
}

/// The filter of a name.
pub(super) fn named(name: &str) -> Option<Filter> {
    let known = || {
        let weight = codebook::named(name)?.clone();
        Some(Filter::single(name, weight, Window::DEFAULT_RADIUS))
    };
    shipped::programs().find(|filter| filter.name == name).or_else(known)
}

/// The filter that a text stands for, with another radius if one is given.
pub(super) fn resolve(text: &str, radius: Option<u32>) -> Result<Filter, Error> {
    let filter = find(text)?;
    match radius {
        Some(radius) => Ok(filter.resized(radius)?),
        None => Ok(filter),
    }
}

fn find(text: &str) -> Result<Filter, Error> {
    if let Some(filter) = named(text) {
        return Ok(filter);
    }
    let path = Path::new(text);
    let called_a_file = path.extension().is_some_and(|extension| extension == "toml");
    if called_a_file || path.is_file() {
        return Ok(Filter::read(path)?);
    }
    let error = match parse_scalar(text) {
        Ok(weight) => return Ok(Filter::single("expression", weight, Window::DEFAULT_RADIUS)),
        Err(error) => error,
    };
    let names = names().join(", ");
    // One unknown word is hardly an expression: where it goes wrong as one tells nothing.
    let word = text.chars().all(|c| c.is_alphanumeric() || "-_./\\".contains(c));
    Err(Error::Usage(if word && Feature::parse(text).is_none() {
        format!("--filter: there is no filter or file `{text}`; filters: {names}")
    } else {
        format!(
            "--filter: {} is neither a filter's name ({names}) nor a file, and as an expression \
             it cannot be read:\n{error}",
            shortened(text),
        )
    }))
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
        assert_eq!(resolve("bilateral", None).expect("a name").name, "bilateral");
        let expression = resolve("exp(-distance2(normal, normal))", Some(3)).expect("parses");
        assert_eq!(expression.paper().expect("one gather").window, Window::dense(3));
        let missing = resolve("no/such/file.toml", None).unwrap_err();
        assert!(missing.to_string().contains("no/such/file.toml") && missing.status() == 1);
        let nonsense = resolve("bilatral", None).unwrap_err();
        assert!(nonsense.to_string().contains("cross-bilateral"), "{nonsense}");
        assert_eq!(nonsense.status(), 2);
    }

    #[test]
    fn every_name_resolves() {
        for name in names() {
            assert_eq!(resolve(&name, None).expect("a known name").name, name);
        }
    }
}
