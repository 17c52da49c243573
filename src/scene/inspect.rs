//! What a file holds and what becomes of it: for `tamis inspect`.

use std::collections::BTreeMap;
use std::path::Path;

use super::SceneError;
use super::exr::{Channel, Header, Part, read_channels};
use super::mapping::Mapping;
use super::repair::is_good;
use crate::expr::feature::{Feature, PlaneId, Quantity};

/// A file's channels and their meaning, without a pixel decoded.
#[derive(Clone, Debug)]
pub struct Inspection {
    header: Header,
    mapping: Mapping,
    roles: BTreeMap<String, PlaneId>,
}

impl Inspection {
    /// Reads the file's headers.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        let header = Header::read(path)?;
        let mapping = Mapping::of(&header);
        let mut roles = BTreeMap::new();
        for (feature, quantity, source) in mapping.sources() {
            for (k, channel) in source.channels.iter().enumerate() {
                let component = match quantity {
                    Quantity::Value => k as u8,
                    Quantity::Variance | Quantity::Gradient => 0,
                };
                roles.insert(channel.clone(), PlaneId { feature, quantity, component });
            }
        }
        Ok(Self { header, mapping, roles })
    }

    /// Parts, channels, types.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Which channels feed which feature, by whose convention.
    pub fn mapping(&self) -> &Mapping {
        &self.mapping
    }

    /// Every channel with its part and the plane that it feeds, if any.
    pub fn channels(&self) -> impl Iterator<Item = (&Part, &Channel, Option<PlaneId>)> {
        self.header.parts().iter().flat_map(|part| {
            let role = |channel: &Channel| self.roles.get(&channel.name).copied();
            part.channels.iter().map(move |channel| (part, channel, role(channel)))
        })
    }

    /// The features that no channel feeds.
    pub fn absent(&self) -> impl Iterator<Item = Feature> {
        let stored = Feature::ALL.into_iter().filter(|feature| !feature.row().channels.is_empty());
        stored.filter(|&feature| self.mapping.value(feature).is_none())
    }

    /// Decodes every channel, one part at a time (parts may differ in size), and
    /// says what is in it, by full name.
    ///
    /// # Errors
    /// If the file turns out to be damaged.
    pub fn scan(&self) -> Result<BTreeMap<String, Scan>, SceneError> {
        let mut scans = BTreeMap::new();
        for part in self.header.parts() {
            let names: Vec<&str> = part.channels.iter().map(|c| c.name.as_str()).collect();
            let pixels = read_channels(self.header.path(), &names)?;
            let all = pixels.channels.into_iter();
            scans.extend(all.map(|(name, samples)| (name, Scan::of(&samples))));
        }
        Ok(scans)
    }
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
