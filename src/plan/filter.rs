//! A filter: a list of stages, as files and the command line give it.

use std::collections::BTreeSet;

use crate::expr::feature::{Feature, PlaneId};
use crate::expr::tree::Tree;

/// The neighbourhood of a pixel: (2 radius + 1)² taps, `dilation` pixels apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Window {
    /// Taps on each side of the centre, along each axis.
    pub radius: u32,
    /// Distance between neighbouring taps, in pixels; 1 for a dense window.
    pub dilation: u32,
}

impl Window {
    /// The paper gives no radius; 10 is where its filter's error levels off.
    pub const DEFAULT_RADIUS: u32 = 10;

    /// The largest radius that is accepted: a window of 257 x 257 taps.
    pub const MAX_RADIUS: u32 = 128;

    /// A dense window.
    pub fn dense(radius: u32) -> Self {
        Self { radius, dilation: 1 }
    }

    /// The greatest offset along an axis, in pixels.
    pub fn reach(self) -> u32 {
        self.radius * self.dilation
    }

    /// Taps along one axis.
    pub fn diameter(self) -> usize {
        2 * self.radius as usize + 1
    }

    /// Number of taps.
    pub fn taps(self) -> usize {
        self.diameter() * self.diameter()
    }
}

/// What a stage averages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The noisy colour as it is (Equation 1 of the paper).
    #[default]
    Color,
}

/// One pass over the image: ĉ_i = Σ_j c_j w(i, j) / Σ_j w(i, j).
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// w(i, j).
    pub weight: Tree,
    /// Where j ranges.
    pub window: Window,
    /// Where c comes from.
    pub source: Source,
}

/// A filter: its stages in order, each working on the one before.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    /// What people call it.
    pub name: String,
    /// At least one.
    pub stages: Vec<Stage>,
}

impl Filter {
    /// A filter of one dense stage on the noisy colour, as in the paper.
    pub fn single(name: impl Into<String>, weight: Tree, radius: u32) -> Self {
        let window = Window::dense(radius);
        let stage = Stage { weight, window, source: Source::Color };
        Self { name: name.into(), stages: vec![stage] }
    }

    /// The features that the filter reads something of that a scene does not provide, each
    /// once, in the feature table's order.
    pub fn lacking(&self, provides: impl Fn(PlaneId) -> bool) -> Vec<Feature> {
        let planes = self.stages.iter().flat_map(|stage| stage.weight.planes());
        let lacking = planes.filter(|&plane| !provides(plane)).map(|plane| plane.feature);
        lacking.collect::<BTreeSet<Feature>>().into_iter().collect()
    }
}
