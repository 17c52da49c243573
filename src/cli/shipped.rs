//! Filters that come with the program: bred by it, and embedded in it.

use std::path::Path;

use crate::plan::Filter;

/// Path in the project, and text.
const FILES: &[(&str, &str)] = &[
    ("data/filters/tamis-2.toml", include_str!("../../data/filters/tamis-2.toml")),
    ("data/filters/tamis-1.toml", include_str!("../../data/filters/tamis-1.toml")),
];

/// Every shipped filter, the default first.
pub(super) fn filters() -> impl Iterator<Item = Filter> {
    FILES.iter().map(|(path, text)| {
        Filter::parse(text, Path::new(path)).expect("a test parses every shipped filter")
    })
}

/// The filter to use where none is asked for.
pub(super) fn default_name() -> String {
    filters().next().map_or_else(|| "cross-bilateral".to_owned(), |filter| filter.name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::codebook;

    #[test]
    fn shipped_filters_parse_and_have_names_of_their_own() {
        let mut names: Vec<String> = filters().map(|filter| filter.name).collect();
        names.extend(codebook::known().iter().map(|known| known.name.to_owned()));
        let all = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all, "{names:?}");
        assert!(names.contains(&default_name()));
    }
}
