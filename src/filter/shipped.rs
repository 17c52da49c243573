//! The filters that come with the program, and which of them a file can feed.
//!
//! The first are programs, which read colour, albedo, normals and depth, and do without all
//! but the colour. The others are single weights, for other files and for back
//! ends that run no programs. Some of those were bred and are embedded as files too. They
//! read colour, direct light, albedo, normals and positions; for files that lack some of
//! these there are *stand-ins*, factors of a bred filter that read what is left. Every file
//! that has a colour can feed the last of them.

use std::path::Path;

use super::{Filter, Window};
use crate::expr::feature::{Feature, PlaneId};
use crate::expr::{codebook, text};

/// Path in the project, and text: programs, the default first.
const PROGRAMS: &[(&str, &str)] = &[
    ("data/filters/tamis.toml", include_str!("../../data/filters/tamis.toml")),
    ("data/filters/tamis-fast.toml", include_str!("../../data/filters/tamis-fast.toml")),
    ("data/filters/tamis-formula.toml", include_str!("../../data/filters/tamis-formula.toml")),
];

/// The same: filters that were bred, the best first.
const FILES: &[(&str, &str)] =
    &[("data/filters/tamis-2.toml", include_str!("../../data/filters/tamis-2.toml"))];

// Factors of a bred filter. Where there is no albedo, the window must be smaller.
const ALBEDO: &str = "exp(-pow(distance2(texture, texture), 2) / 0.0458)";
const NORMAL: &str = "exp(-pow(distance2(normal, normal), 1.22) / 0.605) \
     * exp(-pow(distance2(normal, color), 2.75) / 3400)";
const POSITION: &str = "exp(-pow(distance2(worldPosition, worldPosition), 2.1) / 0.0578)";
const WIDE: &str = "exp(-pow(distance2(pixel, pixel), 2) / 7.22)";
// Of the tuned cross-bilateral and bilateral filters.
const DEPTH: &str = "exp(-pow(distance2(depth, depth), 2) / 0.0578)";
const COLOR: &str = "exp(-pow(distance2(color, color), 2) / 4050)";
const NARROW: &str = "exp(-pow(distance2(pixel, pixel), 2) / 1.5488)";

/// A filter for files that cannot feed those that were bred.
struct StandIn {
    name: &'static str,
    factors: &'static [&'static str],
}

/// The stand-ins by their error on `data/train`, the best first. Geometric means of the
/// RelMSE over its six scenes at radius 10, beside .0574 for `tamis-2` and
/// .448 for the noisy images:
///
/// | filter | RelMSE |
/// |---|---|
/// | guided-normal-albedo-position | .0599 |
/// | guided-normal-albedo-depth | .0599 |
/// | guided-normal-albedo | .0619 |
/// | guided-albedo-depth | .0840 |
/// | guided-albedo-position | .0843 |
/// | guided-normal-position | .0870 |
/// | guided-normal-depth | .0872 |
/// | guided-normal | .0887 |
/// | guided-albedo | .0912 |
/// | guided-depth | .127 |
/// | guided-position | .127 |
/// | bilateral | .140 |
///
/// The tuned cross-bilateral filter without direct light has .0777, and `tamis-2` .0605.
/// Direct light takes 1% to 3% from the error of those that do without, which is not worth
/// a row for each.
const STAND_INS: &[StandIn] = &[
    StandIn { name: "guided-normal-albedo-position", factors: &[ALBEDO, NORMAL, POSITION, WIDE] },
    StandIn { name: "guided-normal-albedo-depth", factors: &[ALBEDO, NORMAL, DEPTH, WIDE] },
    StandIn { name: "guided-normal-albedo", factors: &[ALBEDO, NORMAL, WIDE] },
    StandIn { name: "guided-albedo-depth", factors: &[ALBEDO, DEPTH, COLOR, WIDE] },
    StandIn { name: "guided-albedo-position", factors: &[ALBEDO, POSITION, COLOR, WIDE] },
    StandIn { name: "guided-normal-position", factors: &[NORMAL, POSITION, NARROW] },
    StandIn { name: "guided-normal-depth", factors: &[NORMAL, DEPTH, NARROW] },
    StandIn { name: "guided-normal", factors: &[NORMAL, NARROW] },
    StandIn { name: "guided-albedo", factors: &[ALBEDO, COLOR, WIDE] },
    StandIn { name: "guided-depth", factors: &[DEPTH, COLOR, NARROW] },
    StandIn { name: "guided-position", factors: &[POSITION, COLOR, NARROW] },
];

/// What every file has to have, and then can feed.
const LAST: &str = "bilateral";

/// Programs, the best first.
pub fn programs() -> impl Iterator<Item = Filter> {
    parsed(PROGRAMS)
}

/// Filters that were bred, the best first.
pub fn bred() -> impl Iterator<Item = Filter> {
    parsed(FILES)
}

fn parsed(files: &'static [(&str, &str)]) -> impl Iterator<Item = Filter> {
    files.iter().map(|(path, text)| {
        Filter::parse(text, Path::new(path)).expect("a test parses every shipped filter")
    })
}

/// The stand-ins, the best first.
pub fn stand_ins() -> impl Iterator<Item = Filter> {
    STAND_INS.iter().map(|StandIn { name, factors }| {
        let weight = text::parse_scalar(&factors.join(" * "));
        let weight = weight.expect("a test parses every shipped filter");
        Filter::single(*name, weight, Window::DEFAULT_RADIUS)
    })
}

/// All filters to choose from, the best first. The last is of one window and needs colour
/// alone.
pub fn by_preference() -> impl Iterator<Item = Filter> {
    let last = codebook::named(LAST).expect("a test looks it up").clone();
    let last = Filter::single(LAST, last, Window::DEFAULT_RADIUS);
    programs().chain(bred()).chain(stand_ins()).chain([last])
}

/// A filter for a file, and why it is not the best there is.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The best that the file can feed.
    pub filter: Filter,
    /// The best of all.
    pub best: String,
    /// What that reads and the file lacks; nothing if it was chosen.
    pub lacking: Vec<Feature>,
}

/// Chooses one that `may` be taken, for a file that provides colour and what `provides` says.
///
/// # Panics
/// If no filter of one window may be taken.
pub fn choose(may: impl Fn(&Filter) -> bool, provides: impl Fn(PlaneId) -> bool) -> Choice {
    let mut filters = by_preference().filter(may).peekable();
    let best = filters.peek().expect("there is a last one");
    let (name, lacking) = (best.name.clone(), best.lacking(&provides));
    let filter = filters.find(|filter| filter.lacking(&provides).is_empty());
    // A file without colour is refused when it is loaded, whatever is chosen.
    let filter = filter.or_else(|| by_preference().last()).expect("there is a last one");
    Choice { filter, best: name, lacking }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::feature::Quantity;

    fn chosen(features: &[Feature]) -> Choice {
        choose(
            |filter| filter.paper().is_some(),
            |plane| {
                let given = !plane.feature.is_stored() || plane.feature == Feature::Color;
                given || features.contains(&plane.feature)
            },
        )
    }

    #[test]
    fn shipped_filters_parse_and_have_names_of_their_own() {
        let own = programs().chain(bred()).chain(stand_ins());
        let mut names: Vec<String> = own.map(|filter| filter.name).collect();
        names.extend(codebook::known().iter().map(|known| known.name.to_owned()));
        let all = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all, "{names:?}");
        assert!(names.contains(&LAST.to_owned()));
    }

    #[test]
    fn a_stand_in_is_named_for_what_it_reads() {
        let words = [
            ("normal", Feature::Normal),
            ("albedo", Feature::Texture),
            ("position", Feature::WorldPosition),
            ("depth", Feature::Depth),
        ];
        for filter in stand_ins() {
            let planes = filter.paper().expect("one gather").weight.planes();
            assert!(planes.iter().all(|plane| plane.quantity == Quantity::Value));
            for (word, feature) in words {
                let reads = planes.iter().any(|plane| plane.feature == feature);
                let said = filter.name.split('-').any(|part| part == word);
                assert_eq!(reads, said, "{}: {word}", filter.name);
            }
        }
    }

    /// Whatever a file lacks; and more features never choose what comes later.
    #[test]
    fn every_file_with_a_colour_can_feed_one() {
        let guides = [
            Feature::WorldPosition,
            Feature::Normal,
            Feature::Texture,
            Feature::SecTexture,
            Feature::Depth,
            Feature::DirIllumination,
        ];
        let place = |choice: &Choice| {
            let mut single = by_preference().filter(|filter| filter.paper().is_some());
            single.position(|filter| filter == choice.filter).expect("it is one of them")
        };
        let of = |set: usize| -> Vec<Feature> {
            (0..guides.len()).filter(|k| set >> k & 1 == 1).map(|k| guides[k]).collect()
        };
        for set in 0..1 << guides.len() {
            let choice = chosen(&of(set));
            let given = of(set);
            let reads = choice.filter.paper().expect("one gather").weight.planes();
            let is_given = |f: Feature| f == Feature::Color || given.contains(&f);
            assert!(reads.iter().all(|plane| is_given(plane.feature)), "{given:?}");
            assert_eq!(choice.lacking.is_empty(), place(&choice) == 0, "{given:?}");
            for k in 0..guides.len() {
                assert!(place(&chosen(&of(set | 1 << k))) <= place(&choice), "{given:?} and one");
            }
        }
        let with = |albedo: bool| {
            choose(
                |_| true,
                |plane| match plane.feature {
                    Feature::Texture => albedo,
                    feature => feature == Feature::Color || !feature.is_stored(),
                },
            )
        };
        assert_eq!([with(true), with(false)].map(|choice| choice.filter.name), ["tamis"; 2]);
        assert_eq!(chosen(&[]).filter.name, LAST);
        assert_eq!(chosen(&guides).filter.name, "tamis-2");
        let guides = [Feature::Texture, Feature::Normal, Feature::WorldPosition];
        let without_direct_light = chosen(&guides);
        assert_eq!(without_direct_light.filter.name, "guided-normal-albedo-position");
        assert_eq!(without_direct_light.lacking, [Feature::DirIllumination]);
    }
}
