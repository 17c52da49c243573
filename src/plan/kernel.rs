//! The kernels that programs are scheduled as, and what each reads and writes.

use std::collections::BTreeSet;
use std::ops::Range;

use super::Run;
use super::lower::Read;
use crate::expr::feature::PlaneId;
use crate::expr::interval::Interval;
use crate::expr::symbol::{Source, StagePlane};
use crate::expr::tape::{Input, Side, Tape};
use crate::filter::{Grid, Window};

/// A value at every pixel.
#[derive(Clone, Debug)]
pub struct MapKernel {
    /// Computes what the other tape reads as [`PerTap`](Input::PerTap), from named constants.
    pub uniform: Tape,
    /// Computes the results from [`Signal`](Input::Signal)s at pixel i.
    pub tape: Tape,
    /// The planes behind the signals, by their number.
    pub reads: Vec<Read>,
    /// Where the tape's results go.
    pub writes: Vec<StagePlane>,
    /// The pixels that it computes.
    pub grid: Grid,
}

/// A loop over pairs of pixels.
#[derive(Clone, Debug)]
pub struct PairLoop {
    /// Computes what the pair tape reads as [`PerTap`](Input::PerTap), from the offset and
    /// named constants.
    pub tap: Tape,
    /// Computes what is summed; if `mirrored` the same for the pixels exchanged after that.
    /// Reads features, signals and taps.
    pub pair: Tape,
    /// Whether the pair tape computes both ends of a pair.
    pub mirrored: bool,
    /// The taps, in the order of summation; half of them if `mirrored`.
    pub runs: Vec<Run>,
    /// How far the taps reach, in pixels.
    pub reach: usize,
    /// The planes behind the signals, by their number.
    pub reads: Vec<StagePlane>,
}

/// A weighted mean over a window.
#[derive(Clone, Debug)]
pub struct GatherKernel {
    /// Computes the weight, and if there is a variance its square.
    pub pairs: PairLoop,
    /// Whether a weight may be negative.
    pub signed: bool,
    /// What is averaged.
    pub channels: Vec<StagePlane>,
    /// Where the means go, and what they are kept within.
    pub writes: Vec<(StagePlane, Interval)>,
    /// The plane of variances, and where the means' variance goes.
    pub variance: Option<(StagePlane, StagePlane, Interval)>,
    /// Where one over the sum of the weights goes, 0 where they cannot be trusted: gradients
    /// ask for it.
    pub inverse: Option<StagePlane>,
    /// Which stages it is: one, or several means by the same weight.
    pub stages: Vec<usize>,
    /// The pixels that it computes.
    pub grid: Grid,
}

/// Sums over a window, of what is computed for every pair: they are what a gather's adjoints
/// are made of.
#[derive(Clone, Debug)]
pub struct SumKernel {
    /// Computes what is summed, for both ends of a pair at once.
    pub pairs: PairLoop,
    /// Where the sums go.
    pub writes: Vec<StagePlane>,
    /// The pixels that it computes.
    pub grid: Grid,
}

/// A mean by equal weights: sums down the columns, and of these along the rows.
#[derive(Clone, Debug)]
pub struct BoxKernel {
    /// What is averaged.
    pub channels: Vec<StagePlane>,
    /// Where the means go, and what they are kept within.
    pub writes: Vec<(StagePlane, Interval)>,
    /// Over which pixels.
    pub window: Window,
    /// The pixels that it computes.
    pub grid: Grid,
}

/// A plane on the other grid: the means of two by two pixels, or what lies between pixels.
#[derive(Clone, Copy, Debug)]
pub struct ResampleKernel {
    /// What is resampled.
    pub reads: Source,
    /// Where the result goes.
    pub writes: StagePlane,
    /// The grid of the result.
    pub grid: Grid,
}

/// The transpose of a linear kernel: each pixel hands back what it was made of. It is
/// computed for whole images.
#[derive(Clone, Debug)]
pub struct TransposeKernel {
    /// Of which kernel.
    pub of: Linear,
    /// What is handed back: one plane, or of [`Linear::Shifts`] one per place.
    pub reads: Vec<StagePlane>,
    /// Where it goes.
    pub writes: StagePlane,
    /// The grid of the result.
    pub grid: Grid,
}

/// A kernel whose results are sums of what it reads, by shares that are known.
#[derive(Clone, Debug)]
pub enum Linear {
    /// A map that reads a plane so many columns to the right and rows below, where the image's
    /// edge is repeated.
    Shifts(Vec<[i8; 2]>),
    /// A kernel that reads a plane on another grid.
    Resample,
    /// A mean by equal weights.
    Box(Window),
}

/// A step of a schedule.
#[derive(Clone, Debug)]
pub enum Kernel {
    /// A value at every pixel.
    Map(MapKernel),
    /// A weighted mean over a window.
    Gather(GatherKernel),
    /// A mean by equal weights.
    Box(BoxKernel),
    /// A plane on another grid.
    Resample(ResampleKernel),
    /// Sums over a window.
    Sum(SumKernel),
    /// The transpose of a linear kernel.
    Transpose(TransposeKernel),
    /// Planes that whoever runs the schedule provides before anything after this is computed.
    Given(Vec<StagePlane>),
}

/// An earlier kernel's plane that a kernel reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// The plane.
    pub plane: StagePlane,
    /// How many rows further up it is read than where the kernel's own rows stand.
    pub above: usize,
    /// How many rows further down.
    pub below: usize,
    /// In which columns.
    pub columns: Columns,
}

/// In which columns a plane is read, and so what has to stand beside the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Columns {
    /// That of the pixel alone.
    Own,
    /// Others too, where the image's edge is repeated.
    Around,
    /// Others too, where there are zeros: the plane is averaged.
    Averaged,
}

impl Kernel {
    /// The pixels that it computes.
    pub fn grid(&self) -> Grid {
        match self {
            Self::Map(map) => map.grid,
            Self::Gather(gather) => gather.grid,
            Self::Box(mean) => mean.grid,
            Self::Resample(resample) => resample.grid,
            Self::Sum(sum) => sum.grid,
            Self::Transpose(transpose) => transpose.grid,
            // Gradients begin with what is owed to the result.
            Self::Given(_) => Grid::Full,
        }
    }

    /// The planes that it writes.
    pub fn writes(&self) -> Vec<StagePlane> {
        match self {
            Self::Map(map) => map.writes.clone(),
            Self::Gather(gather) => {
                let variance = gather.variance.iter().map(|&(_, plane, _)| plane);
                let means = gather.writes.iter().map(|&(plane, _)| plane);
                means.chain(variance).chain(gather.inverse).collect()
            }
            Self::Box(mean) => mean.writes.iter().map(|&(plane, _)| plane).collect(),
            Self::Resample(resample) => vec![resample.writes],
            Self::Sum(sum) => sum.writes.clone(),
            Self::Transpose(transpose) => vec![transpose.writes],
            Self::Given(planes) => planes.clone(),
        }
    }

    /// What it reads of earlier kernels.
    pub fn looks(&self) -> Vec<Look> {
        match self {
            Self::Map(map) => {
                let look = |read: &Read| match read.source {
                    Source::Feature(_) => None,
                    Source::Stage(plane) => Some(Look {
                        plane,
                        above: usize::from((-read.shift[1]).max(0).unsigned_abs()),
                        below: usize::from(read.shift[1].max(0).unsigned_abs()),
                        columns: match read.shift[0] {
                            0 => Columns::Own,
                            _ => Columns::Around,
                        },
                    }),
                };
                map.reads.iter().filter_map(look).collect()
            }
            Self::Gather(gather) => {
                let reach = gather.pairs.reach;
                let (above, below, columns) = (reach, reach, Columns::Averaged);
                let variance = gather.variance.iter().map(|&(source, ..)| source);
                let averaged = gather.channels.iter().copied().chain(variance);
                let averaged = averaged.map(|plane| Look { plane, above, below, columns });
                gather.pairs.looks().into_iter().chain(averaged).collect()
            }
            Self::Sum(sum) => sum.pairs.looks(),
            Self::Transpose(transpose) => {
                let columns = Columns::Own;
                let look = |&plane| Look { plane, above: 0, below: 0, columns };
                transpose.reads.iter().map(look).collect()
            }
            Self::Given(_) => Vec::new(),
            Self::Box(mean) => {
                let reach = mean.window.reach() as usize;
                let (above, below, columns) = (reach, reach, Columns::Averaged);
                let look = |&plane| Look { plane, above, below, columns };
                mean.channels.iter().map(look).collect()
            }
            Self::Resample(resample) => match resample.reads {
                Source::Feature(_) => Vec::new(),
                Source::Stage(plane) => {
                    vec![Look { plane, above: 0, below: 0, columns: Columns::Around }]
                }
            },
        }
    }

    /// The planes of features that it reads.
    pub fn features(&self) -> BTreeSet<PlaneId> {
        let feature = |source: Source| match source {
            Source::Feature(plane) => Some(plane),
            Source::Stage(_) => None,
        };
        match self {
            Self::Map(map) => map.reads.iter().filter_map(|read| feature(read.source)).collect(),
            Self::Gather(GatherKernel { pairs, .. }) | Self::Sum(SumKernel { pairs, .. }) => {
                pairs.planes().into_iter().collect()
            }
            Self::Box(_) | Self::Transpose(_) | Self::Given(_) => BTreeSet::new(),
            Self::Resample(resample) => feature(resample.reads).into_iter().collect(),
        }
    }

    /// How far beside a pixel it looks, in pixels of its grid.
    pub fn reach(&self) -> usize {
        match self {
            Self::Map(map) => {
                let shifts = map.reads.iter().flat_map(|read| read.shift);
                shifts.map(|shift| usize::from(shift.unsigned_abs())).max().unwrap_or(0)
            }
            Self::Gather(GatherKernel { pairs, .. }) | Self::Sum(SumKernel { pairs, .. }) => {
                pairs.reach
            }
            Self::Box(mean) => mean.window.reach() as usize,
            Self::Resample(_) => 1,
            Self::Transpose(_) | Self::Given(_) => 0,
        }
    }

    /// The rows of what it reads that stand where rows of its own do, in an image of so
    /// many rows: the same, unless it leads from one grid to the other.
    pub fn stands(&self, rows: Range<usize>, height: usize) -> Range<usize> {
        match self {
            Self::Map(_)
            | Self::Gather(_)
            | Self::Box(_)
            | Self::Sum(_)
            | Self::Transpose(_)
            | Self::Given(_) => rows,
            // Two rows each.
            Self::Resample(ResampleKernel { grid: Grid::Half, .. }) => {
                2 * rows.start..(2 * rows.end).min(height)
            }
            // The nearest rows above and below.
            Self::Resample(ResampleKernel { grid: Grid::Full, .. }) => {
                let last = Grid::Half.along(height);
                rows.start.saturating_sub(1) / 2..(rows.end / 2 + 1).min(last)
            }
        }
    }
}

impl MapKernel {
    /// A map that computes all in one tape, named constants among what that reads.
    pub(super) fn new(tape: Tape, reads: Vec<Read>, writes: Vec<StagePlane>, grid: Grid) -> Self {
        Self { uniform: Tape::default(), tape, reads, writes, grid }
    }

    /// The tape with its signals numbered anew.
    pub(super) fn renumbered(&self, mut number: impl FnMut(Read) -> u32) -> Tape {
        self.tape.with_inputs(|input| match input {
            Input::Signal(k, side) => Input::Signal(number(self.reads[k as usize]), side),
            Input::Constant(_) => input,
            Input::Plane(..) | Input::Offset(_) | Input::PerPixel(..) | Input::PerTap(_) => {
                unreachable!("maps read signals and constants alone")
            }
        })
    }
}

impl PairLoop {
    /// The features' planes that the pair tape reads, each once.
    pub fn planes(&self) -> Vec<PlaneId> {
        let planes = self.pair.inputs().filter_map(|input| match input {
            Input::Plane(plane, _) => Some(plane),
            Input::Offset(_)
            | Input::PerPixel(..)
            | Input::PerTap(_)
            | Input::Signal(..)
            | Input::Constant(_) => None,
        });
        planes.collect::<BTreeSet<PlaneId>>().into_iter().collect()
    }

    fn looks(&self) -> Vec<Look> {
        let around: BTreeSet<u32> = self
            .pair
            .inputs()
            .filter_map(|input| match input {
                Input::Signal(k, Side::J) => Some(k),
                Input::Signal(_, Side::I)
                | Input::Plane(..)
                | Input::Offset(_)
                | Input::PerPixel(..)
                | Input::PerTap(_)
                | Input::Constant(_) => None,
            })
            .collect();
        // Mirrored kernels compute columns beside the image, too.
        let columns = |k: u32| match around.contains(&k) || self.mirrored {
            true => Columns::Around,
            false => Columns::Own,
        };
        let (above, below) = (self.reach, self.reach);
        let look = |(k, &plane)| Look { plane, above, below, columns: columns(k) };
        (0..).zip(&self.reads).map(look).collect()
    }
}

/// How a stage's plane is stored; with anything beside it if it is only read where it stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    /// With the image's edge repeated beside it: it is looked at there.
    pub repeated: bool,
    /// With zeros beside it: it is averaged.
    pub zero: bool,
}
