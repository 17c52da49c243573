//! Where a program's planes stand in memory that is used again.
//!
//! Whoever computes kernels one after the other over a whole image (a GPU, exported code)
//! keeps a plane from the kernel that writes it to the last one that reads it. After that its
//! place is another's.

use std::collections::BTreeMap;

use super::kernel::{Kernel, ResampleKernel};
use super::schedule::{Output, Program};
use crate::expr::symbol::StagePlane;
use crate::filter::Grid;

/// Where a plane stands: it is the so many-th of those on its grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The grid.
    pub grid: Grid,
    /// Which one.
    pub number: usize,
}

/// Where all planes of a program stand.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// By plane.
    planes: BTreeMap<StagePlane, Place>,
    /// By kernel: a place per channel of a mean by equal weights, for what is summed down
    /// columns.
    columns: Vec<Vec<Place>>,
    /// How many places there are on the full grid.
    pub full: usize,
    /// How many there are on the half grid.
    pub half: usize,
}

impl Places {
    /// Where a plane stands that a kernel writes.
    pub fn of(&self, plane: StagePlane) -> Place {
        self.planes[&plane]
    }

    /// Where the sums down columns stand of the kernel of that number.
    pub fn columns(&self, kernel: usize) -> &[Place] {
        &self.columns[kernel]
    }
}

/// The places of a grid.
#[derive(Default)]
struct Pool {
    free: Vec<usize>,
    made: usize,
}

impl Pool {
    fn take(&mut self) -> usize {
        self.free.pop().unwrap_or_else(|| {
            self.made += 1;
            self.made - 1
        })
    }
}

impl Program {
    /// Finds places. No kernel writes where it reads.
    pub fn places(&self) -> Places {
        // The last kernel that reads a plane; the result's are read behind all of them.
        let mut last: BTreeMap<StagePlane, usize> = BTreeMap::new();
        for (k, kernel) in self.kernels.iter().enumerate() {
            last.extend(kernel.writes().into_iter().map(|plane| (plane, k)));
            last.extend(kernel.looks().into_iter().map(|look| (look.plane, k)));
        }
        for &output in self.outputs.iter().flatten() {
            if let Output::Plane(plane) = output {
                last.insert(plane, self.kernels.len());
            }
        }
        let mut ends: Vec<Vec<StagePlane>> = vec![Vec::new(); self.kernels.len() + 1];
        last.iter().for_each(|(&plane, &k)| ends[k].push(plane));

        let mut pools = [Pool::default(), Pool::default()];
        let pool = |grid: Grid| usize::from(grid == Grid::Half);
        let mut places = Places::default();
        for (k, kernel) in self.kernels.iter().enumerate() {
            let grid = kernel.grid();
            let take = |pools: &mut [Pool; 2]| Place { grid, number: pools[pool(grid)].take() };
            for plane in kernel.writes() {
                let place = take(&mut pools);
                places.planes.insert(plane, place);
            }
            let columns: Vec<Place> = match kernel {
                Kernel::Box(mean) => mean.channels.iter().map(|_| take(&mut pools)).collect(),
                Kernel::Map(_)
                | Kernel::Gather(_)
                | Kernel::Resample(_)
                | Kernel::Sum(_)
                | Kernel::Transpose(_)
                | Kernel::Given(_) => Vec::new(),
            };
            let ended = ends[k].iter().map(|plane| places.planes[plane]);
            for place in ended.chain(columns.iter().copied()) {
                pools[pool(place.grid)].free.push(place.number);
            }
            places.columns.push(columns);
        }
        [places.full, places.half] = pools.map(|pool| pool.made);
        places
    }

    /// How far from a pixel of the result pixels of the image lie that it hangs on, along
    /// an axis; a multiple of two, so that pixels of half the resolution are made of the same
    /// ones wherever a part of an image begins at an even one.
    pub fn halo(&self) -> usize {
        let mut halo = vec![0; self.kernels.len()];
        let mut most = 0;
        for (k, kernel) in self.kernels.iter().enumerate().rev() {
            let step = match kernel {
                // It reads the other grid, one pixel beside the one where it stands.
                Kernel::Resample(ResampleKernel { .. }) => Grid::Half.step(),
                Kernel::Map(_)
                | Kernel::Gather(_)
                | Kernel::Box(_)
                | Kernel::Sum(_)
                | Kernel::Transpose(_)
                | Kernel::Given(_) => kernel.grid().step(),
            };
            let reach = halo[k] + kernel.reach() * step;
            most = most.max(reach);
            for &writer in &self.writers[k] {
                halo[writer] = halo[writer].max(reach);
            }
        }
        most.next_multiple_of(2)
    }
}
