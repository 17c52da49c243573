//! The filters that come with the program. They need the colour alone, and use what else a file
//! has.

use std::path::Path;

use super::Filter;

/// Path in the project, and text: the default first.
const PROGRAMS: &[(&str, &str)] = &[
    ("data/filters/tamis.toml", include_str!("../../data/filters/tamis.toml")),
    ("data/filters/tamis-fast.toml", include_str!("../../data/filters/tamis-fast.toml")),
    ("data/filters/tamis-formula.toml", include_str!("../../data/filters/tamis-formula.toml")),
];

/// All of them, the best first.
pub fn programs() -> impl Iterator<Item = Filter> {
    PROGRAMS.iter().map(|(path, text)| {
        Filter::parse(text, Path::new(path)).expect("a test parses every shipped filter")
    })
}

/// The one that filters what nobody names a filter for.
///
/// # Panics
/// Never: a test parses it.
pub fn best() -> Filter {
    programs().next().expect("there are some")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::codebook;
    use crate::expr::feature::Feature;

    #[test]
    fn shipped_filters_parse_and_have_names_of_their_own() {
        let mut names: Vec<String> = programs().map(|filter| filter.name).collect();
        names.extend(codebook::known().iter().map(|known| known.name.to_owned()));
        let all = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all, "{names:?}");
    }

    #[test]
    fn every_file_with_a_colour_can_feed_each_of_them() {
        for filter in programs() {
            let required = filter.check().expect("it makes sense").required();
            for plane in required.named().into_iter().flatten() {
                let is_there = plane.feature == Feature::Color || !plane.feature.is_stored();
                assert!(is_there, "{} needs {plane}", filter.name);
            }
        }
    }
}
