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
    /// Computes the results from [`Signal`](Input::Signal)s at pixel i.
    pub tape: Tape,
    /// The planes behind the signals, by their number.
    pub reads: Vec<Read>,
    /// Where the tape's results go.
    pub writes: Vec<StagePlane>,
    /// The pixels that it computes.
    pub grid: Grid,
}

/// A weighted mean over a window.
#[derive(Clone, Debug)]
pub struct GatherKernel {
    /// Computes what the pair tape reads as [`PerTap`](Input::PerTap), from the offset.
    pub tap: Tape,
    /// Computes the weight, and if there is a variance its square; if `mirrored` the same
    /// for the pixels exchanged after them. Reads features, signals and taps.
    pub pair: Tape,
    /// Whether the pair tape computes both ends of a pair.
    pub mirrored: bool,
    /// Whether a weight may be negative.
    pub signed: bool,
    /// The taps, in the order of summation; half of them if `mirrored`.
    pub runs: Vec<Run>,
    /// How far the taps reach, in pixels.
    pub reach: usize,
    /// The planes behind the signals, by their number.
    pub reads: Vec<StagePlane>,
    /// What is averaged.
    pub channels: Vec<StagePlane>,
    /// Where the means go, and what they are kept within.
    pub writes: Vec<(StagePlane, Interval)>,
    /// The plane of variances, and where the means' variance goes.
    pub variance: Option<(StagePlane, StagePlane, Interval)>,
    /// Which stage it is.
    pub stage: usize,
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
        }
    }

    /// The planes that it writes.
    pub fn writes(&self) -> Vec<StagePlane> {
        match self {
            Self::Map(map) => map.writes.clone(),
            Self::Gather(gather) => {
                let variance = gather.variance.iter().map(|&(_, plane, _)| plane);
                gather.writes.iter().map(|&(plane, _)| plane).chain(variance).collect()
            }
            Self::Box(mean) => mean.writes.iter().map(|&(plane, _)| plane).collect(),
            Self::Resample(resample) => vec![resample.writes],
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
                let look = |plane: StagePlane, columns: Columns| Look {
                    plane,
                    above: gather.reach,
                    below: gather.reach,
                    columns,
                };
                let around: BTreeSet<u32> = gather
                    .pair
                    .inputs()
                    .filter_map(|input| match input {
                        Input::Signal(k, Side::J) => Some(k),
                        Input::Signal(_, Side::I)
                        | Input::Plane(..)
                        | Input::Offset(_)
                        | Input::PerPixel(..)
                        | Input::PerTap(_) => None,
                    })
                    .collect();
                // Mirrored kernels compute columns beside the image, too.
                let columns = |k: u32| match around.contains(&k) || gather.mirrored {
                    true => Columns::Around,
                    false => Columns::Own,
                };
                let reads = (0..).zip(&gather.reads).map(|(k, &plane)| look(plane, columns(k)));
                let variance = gather.variance.iter().map(|&(source, ..)| source);
                let averaged = gather.channels.iter().copied().chain(variance);
                reads.chain(averaged.map(|plane| look(plane, Columns::Averaged))).collect()
            }
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
            Self::Gather(gather) => {
                let planes = gather.pair.inputs().filter_map(|input| match input {
                    Input::Plane(plane, _) => Some(plane),
                    Input::Offset(_)
                    | Input::PerPixel(..)
                    | Input::PerTap(_)
                    | Input::Signal(..) => None,
                });
                planes.collect()
            }
            Self::Box(_) => BTreeSet::new(),
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
            Self::Gather(gather) => gather.reach,
            Self::Box(mean) => mean.window.reach() as usize,
            Self::Resample(_) => 1,
        }
    }

    /// The rows of what it reads that stand where rows of its own do, in an image of so
    /// many rows: the same, unless it leads from one grid to the other.
    pub fn stands(&self, rows: Range<usize>, height: usize) -> Range<usize> {
        match self {
            Self::Map(_) | Self::Gather(_) | Self::Box(_) => rows,
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

/// How a stage's plane is stored; with anything beside it if it is only read where it stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    /// With the image's edge repeated beside it: it is looked at there.
    pub repeated: bool,
    /// With zeros beside it: it is averaged.
    pub zero: bool,
}
