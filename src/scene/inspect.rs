//! What a file holds and what becomes of it: for `tamis inspect`.

use std::collections::BTreeMap;
use std::path::Path;

use super::SceneError;
use super::defect::{self, Defect, Tally};
use super::mapping::{Mapping, Selection};
use super::target::Target;
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::image::exr::{Channel, Header, Part, Unfinished};
use crate::image::files::read_channels;
use crate::image::is_good;

/// A file's channels and their meaning, without a pixel decoded.
#[derive(Clone, Debug)]
pub struct Inspection {
    /// The pictures in it, the best one first.
    targets: Vec<Target>,
    roles: BTreeMap<String, PlaneId>,
}

impl Inspection {
    /// Reads the file's headers.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        let targets = Target::all(path, &[], &Selection::default())?;
        let mut roles = BTreeMap::new();
        for (feature, quantity, source) in targets.iter().flat_map(|t| t.mapping().sources()) {
            for (k, channel) in source.channels.iter().enumerate() {
                let component = match quantity {
                    Quantity::Value => k as u8,
                    Quantity::Variance | Quantity::Gradient => 0,
                };
                roles.insert(channel.clone(), PlaneId { feature, quantity, component });
            }
        }
        Ok(Self { targets, roles })
    }

    /// Parts, channels, types.
    pub fn header(&self) -> &Header {
        self.targets[0].listing().header()
    }

    /// Which channels feed which feature of the first picture, by whose convention.
    pub fn mapping(&self) -> &Mapping {
        self.targets[0].mapping()
    }

    /// The pictures in the file.
    pub fn targets(&self) -> &[Target] {
        &self.targets
    }

    /// Every channel with its part and the plane that it feeds, if any.
    pub fn channels(&self) -> impl Iterator<Item = (&Part, &Channel, Option<PlaneId>)> {
        self.header().parts().iter().flat_map(|part| {
            let role = |channel: &Channel| self.roles.get(&channel.name).copied();
            part.channels.iter().map(move |channel| (part, channel, role(channel)))
        })
    }

    /// The features that no channel feeds.
    pub fn absent(&self) -> impl Iterator<Item = Feature> {
        let stored = Feature::ALL.into_iter().filter(|feature| !feature.row().channels.is_empty());
        stored.filter(|&feature| self.mapping().value(feature).is_none())
    }

    /// Decodes every channel that can be read, one part at a time (parts may differ in size), and
    /// says what is in them and what is wrong with it.
    ///
    /// # Errors
    /// If the file turns out to be damaged.
    pub fn scan(&self) -> Result<Scans, SceneError> {
        let mut scans = Scans::default();
        // Fireflies show in a feature's components together.
        let mut values = BTreeMap::new();
        for part in self.header().parts() {
            let readable = part.channels.iter().filter(|c| !part.deep && c.sampling == (1, 1));
            let names: Vec<&str> = readable.map(|c| c.name.as_str()).collect();
            if names.is_empty() {
                continue;
            }
            let path = self.header().path();
            let pixels = read_channels(path, &names, None, Unfinished::Zero)?;
            for (name, mut samples) in pixels.channels {
                let role = self.roles.get(&name).copied();
                scans.channels.insert(name.clone(), Scan::of(&samples));
                scans.findings.extend(findings(&name, &mut samples, role, part.window.size.0));
                if role.is_some_and(|plane| plane.quantity == Quantity::Value) {
                    values.insert(name, (part.window.size, samples));
                }
            }
        }
        for feature in Feature::ALL {
            let Some(source) = self.mapping().value(feature) else { continue };
            let mut parts = source.channels.iter().filter_map(|name| values.remove(name));
            let Some((size, first)) = parts.next() else { continue };
            // Components of several sizes are no feature, which loading them will say.
            let others = parts.filter(|(other, _)| *other == size).map(|(_, samples)| samples);
            let components: Vec<_> = std::iter::once(first).chain(others).collect();
            let finding = |tally: Tally| {
                let quantity = Some(Quantity::Value);
                Finding::new(Defect::Firefly, feature.row().name, quantity, &tally, size.0)
            };
            let found = defect::fireflies(&components, size.0, feature);
            scans.findings.extend(found.map(finding));
        }
        Ok(scans)
    }
}

/// What is in a file.
#[derive(Clone, Debug, Default)]
pub struct Scans {
    /// What the samples are like, by the channel's full name.
    pub channels: BTreeMap<String, Scan>,
    /// All that is wrong, or looks it.
    pub findings: Vec<Finding>,
}

/// Pixels of a channel, or of a feature, with a defect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What is wrong.
    pub defect: Defect,
    /// The channel's full name; of fireflies, the feature.
    pub of: String,
    /// What the channel feeds with it, if anything.
    pub quantity: Option<Quantity>,
    /// How many pixels.
    pub count: usize,
    /// Columns and rows of the first of them.
    pub first: Vec<(usize, usize)>,
}

impl Finding {
    fn new(
        defect: Defect,
        of: &str,
        quantity: Option<Quantity>,
        tally: &Tally,
        width: usize,
    ) -> Self {
        let first = tally.first.iter().map(|k| (k % width, k / width)).collect();
        Self { defect, of: of.to_owned(), quantity, count: tally.count, first }
    }
}

/// What is wrong with a channel, in the order in which loading looks for it.
fn findings(name: &str, samples: &mut [f32], role: Option<PlaneId>, width: usize) -> Vec<Finding> {
    let is = |feature, quantity| {
        role.is_some_and(|plane| (plane.feature, plane.quantity) == (feature, quantity))
    };
    let far = is(Feature::Depth, Quantity::Value).then(|| defect::drop_far(samples)).flatten();
    let negative = role.and_then(|plane| defect::negative(samples, plane.feature, plane.quantity));
    let outside = role.and_then(|plane| defect::outside(samples, plane.feature, plane.quantity));
    let huge = |x: f32| x.is_finite() && !is_good(x);
    let found = [
        (Defect::Far, far),
        (Defect::Nan, Tally::of(samples, f32::is_nan)),
        (Defect::Infinite, Tally::of(samples, f32::is_infinite)),
        (Defect::Huge, Tally::of(samples, huge)),
        (Defect::Negative, negative),
        (Defect::Outside, outside),
    ];
    let quantity = role.map(|plane| plane.quantity);
    let found = found.into_iter().filter_map(|(defect, tally)| Some((defect, tally?)));
    found.map(|(defect, tally)| Finding::new(defect, name, quantity, &tally, width)).collect()
}

/// What the samples of a channel are like.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scan {
    /// Least and greatest good sample; `None` if there is none.
    pub range: Option<(f32, f32)>,
    /// Samples that are NaN.
    pub nan: usize,
    /// Infinite samples.
    pub infinite: usize,
    /// Finite samples beyond ±1e18.
    pub huge: usize,
    /// Good samples below zero.
    pub negative: usize,
}

impl Scan {
    /// Looks at all samples of a channel.
    pub fn of(samples: &[f32]) -> Self {
        let mut scan = Self::default();
        for &x in samples {
            if is_good(x) {
                let (lo, hi) = scan.range.unwrap_or((x, x));
                scan.range = Some((lo.min(x), hi.max(x)));
                scan.negative += usize::from(x < 0.0);
            } else if x.is_nan() {
                scan.nan += 1;
            } else if x.is_infinite() {
                scan.infinite += 1;
            } else {
                scan.huge += 1;
            }
        }
        scan
    }

    /// Samples that would be repaired.
    pub fn bad(&self) -> usize {
        self.nan + self.infinite + self.huge
    }

    /// The one value that all samples have, if they do.
    pub fn constant(&self) -> Option<f32> {
        self.range.filter(|(lo, hi)| lo == hi && self.bad() == 0).map(|(lo, _)| lo)
    }
}
