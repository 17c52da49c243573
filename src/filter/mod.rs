//! Floor 3: filters as programs, which say *what* is computed and nothing of how.
//!
//! A [`Filter`] is a list of named stages of two kinds, and there is no third:
//!
//! * A **map** makes a value at pixel i from what stands at pixel i and at constant
//!   offsets from it.
//! * A **gather** is a weighted mean, Σ_j s_j w(i, j) / Σ_j w(i, j), of a signal s over
//!   a window, and if asked the variance of that mean.
//!
//! A stage reads features and earlier stages; the last one is the filtered colour. The
//! paper's filters are a single gather of the colour.
//!
//! Light is measured in units of the picture's exposure all the way through, as weights
//! see it (`scene::normalize`); what the last stage gives is multiplied by the exposure.
//!
//! [`Filter::check`] gives a [`Checked`] filter, the proof that every stage reads only
//! what exists and that widths fit. Whoever plans or evaluates a filter takes that.

mod carry;
mod check;
pub mod file;
mod find;
pub mod shipped;
mod show;

use crate::expr::constants::Constants;
use crate::expr::feature::Feature;
use crate::expr::symbol::Symbol;
use crate::expr::tree::Tree;

pub use carry::Carrying;
pub use check::{Checked, FilterError, Resolved};
pub use file::{FilterFileError, formula, spelling};
pub use find::{FindError, names};
pub use show::{reads, show, stages};

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

/// The pixels that a stage has a value at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Grid {
    /// Those of the image.
    #[default]
    Full,
    /// One for every two by two of the image's, the last column and row of which may be
    /// single. What is read from the full grid is the mean of those pixels; who reads from
    /// the full grid what stands on this one interpolates bilinearly. Windows and places
    /// count pixels of this grid, `offset` and `pixel` those of the image.
    Half,
}

impl Grid {
    /// How many pixels of this grid lie along so many of the image's.
    pub fn along(self, pixels: usize) -> usize {
        pixels.div_ceil(self.step())
    }

    /// Pixels of the image from one pixel of the grid to the next.
    pub fn step(self) -> usize {
        match self {
            Self::Full => 1,
            Self::Half => 2,
        }
    }
}

/// A weighted mean over a window: ĉ_i = Σ_j c_j w(i, j) / Σ_j w(i, j).
#[derive(Clone, Debug, PartialEq)]
pub struct Gather {
    /// The signal c, of any width; looked at at one pixel, as a map's formula is.
    pub of: Tree,
    /// w(i, j).
    pub weight: Tree,
    /// Where j ranges.
    pub window: Window,
    /// The variance v of the signal, one number per pixel; then the stage also gives the
    /// variance of its mean, Σ_j v_j w(i, j)² / (Σ_j w(i, j))².
    pub variance: Option<Tree>,
}

impl Gather {
    /// A gather of the noisy colour, as in the paper.
    pub fn of_color(weight: Tree, window: Window) -> Self {
        let of = Tree::leaf(Symbol::Vector(Feature::Color)).expect("a leaf is a tree");
        Self { of, weight, window, variance: None }
    }

    /// Whether it is what the paper's filters are: a mean of the noisy colour, by a
    /// weight that reads features alone.
    pub fn is_paper(&self) -> bool {
        self.of.symbols() == [Symbol::Vector(Feature::Color)]
            && self.variance.is_none()
            && self.weight.is_paper()
    }
}

/// What a stage does.
#[derive(Clone, Debug, PartialEq)]
pub enum StageKind {
    /// A value at every pixel.
    Map(Tree),
    /// A weighted mean over a window.
    Gather(Gather),
}

/// A named step of a filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// What later stages call it.
    pub name: String,
    /// What it does.
    pub kind: StageKind,
    /// Where it does so.
    pub grid: Grid,
}

impl Stage {
    /// Its formulas.
    pub fn trees(&self) -> impl Iterator<Item = &Tree> {
        let [value, weight, variance] = match &self.kind {
            StageKind::Map(value) => [Some(value), None, None],
            StageKind::Gather(gather) => {
                [Some(&gather.of), Some(&gather.weight), gather.variance.as_ref()]
            }
        };
        [value, weight, variance].into_iter().flatten()
    }
}

/// What stands in for a feature that a file lacks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StandIn {
    /// A number, in all components. A distance of two equal numbers is zero, so that this
    /// also drops terms that look at distances alone.
    Constant(f32),
    /// Another feature of the same width.
    Feature(Feature),
}

/// Why a filter cannot have another radius.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResizeError {
    /// Its windows are of several sizes.
    #[error(
        "--radius {radius}: filter `{filter}` is a program of {stages} stages, each with a radius \
         of its own; change them in its file"
    )]
    Program {
        /// The filter.
        filter: String,
        /// What was asked for.
        radius: u32,
        /// How many stages it has.
        stages: usize,
    },
    /// Its taps are far apart.
    #[error(
        "--radius {radius}: filter `{filter}` places its taps {dilation} pixels apart, so the \
         radius can be at most {}",
        Window::MAX_RADIUS / dilation
    )]
    Reach {
        /// The filter.
        filter: String,
        /// What was asked for.
        radius: u32,
        /// How far apart the taps are.
        dilation: u32,
    },
}

/// A filter: its stages in order, with their constants.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    /// What people call it.
    pub name: String,
    /// At least one; each reads those before it, and the last is the result.
    pub stages: Vec<Stage>,
    /// Constants that have names.
    pub constants: Constants,
    /// What stands in for features that a file lacks. Without one of those that it reads
    /// and that are not listed here, the filter cannot run.
    pub absent: Vec<(Feature, StandIn)>,
}

impl Filter {
    /// What the only stage of a filter of one stage is called.
    pub const RESULT: &str = "result";

    /// A filter of one dense stage on the noisy colour, as in the paper.
    pub fn single(name: impl Into<String>, weight: Tree, radius: u32) -> Self {
        Self::of_gather(name, Gather::of_color(weight, Window::dense(radius)))
    }

    /// A filter of one gather.
    pub fn of_gather(name: impl Into<String>, gather: Gather) -> Self {
        let stage = Stage {
            name: Self::RESULT.to_owned(),
            kind: StageKind::Gather(gather),
            grid: Grid::Full,
        };
        let constants = Constants::default();
        Self { name: name.into(), stages: vec![stage], constants, absent: Vec::new() }
    }

    /// The gather, if the filter is one of the paper's: one gather of the noisy colour, in
    /// which nothing stands in for features.
    pub fn paper(&self) -> Option<&Gather> {
        match self.stages.as_slice() {
            [Stage { kind: StageKind::Gather(gather), grid: Grid::Full, .. }]
                if gather.is_paper() && self.absent.is_empty() =>
            {
                Some(gather)
            }
            _ => None,
        }
    }

    /// The filter with windows of another radius.
    ///
    /// # Errors
    /// If it is a program, or its taps are too far apart for that.
    pub fn resized(mut self, radius: u32) -> Result<Self, ResizeError> {
        if self.paper().is_none() {
            let stages = self.stages.len();
            return Err(ResizeError::Program { filter: self.name, radius, stages });
        }
        let name = self.name.clone();
        for Gather { window, .. } in self.gathers_mut() {
            window.radius = radius;
            if window.reach() > Window::MAX_RADIUS {
                let dilation = window.dilation;
                return Err(ResizeError::Reach { filter: name, radius, dilation });
            }
        }
        Ok(self)
    }

    /// What a reader has to read: nodes of formulas, and the numbers of layers.
    pub fn size(&self) -> usize {
        let nodes = self.stages.iter().flat_map(Stage::trees).map(Tree::len).sum::<usize>();
        let numbers = self.constants.layers.iter().map(|l| l.rows() * (l.columns() + 1));
        nodes + numbers.sum::<usize>()
    }

    /// The gathers, in order.
    pub fn gathers(&self) -> impl Iterator<Item = &Gather> {
        self.stages.iter().filter_map(|stage| match &stage.kind {
            StageKind::Gather(gather) => Some(gather),
            StageKind::Map(_) => None,
        })
    }

    /// The gathers, to be changed.
    pub fn gathers_mut(&mut self) -> impl Iterator<Item = &mut Gather> {
        self.stages.iter_mut().filter_map(|stage| match &mut stage.kind {
            StageKind::Gather(gather) => Some(gather),
            StageKind::Map(_) => None,
        })
    }
}
