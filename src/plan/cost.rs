//! How long a program takes, as far as its kernels tell.
//!
//! A kernel costs what its instructions take per pixel and per pair, and what its planes take
//! to be read and written. The shares were fitted by `cargo bench --bench cost`, which also
//! says how far the prediction is from the clock; benches/RESULTS.md has what it said.

use super::kernel::{Kernel, PairLoop};
use super::schedule::Program;
use crate::expr::tape::{Instr, Prim, Tape};
use crate::filter::Grid;

/// What a program's kernels do per pixel of the image: the terms of its cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effort {
    /// Instructions of maps.
    pub mapped: f64,
    /// Instructions of pairs, all taps together.
    pub paired: f64,
    /// Numbers that pairs read, and sums that they are added to, all taps together.
    pub loaded: f64,
    /// Numbers that maps and gathers write.
    pub written: f64,
    /// Numbers that kernels read.
    pub read: f64,
    /// Means over windows by equal weights.
    pub averaged: f64,
    /// Numbers brought from one grid to the other.
    pub resampled: f64,
    /// One: what every program takes to begin and to end.
    pub fixed: f64,
}

impl Effort {
    /// Nanoseconds per unit of each term, on one core of an x86-64 processor with AVX-512.
    const SHARES: [f64; 8] = [0.0257, 0.0036, 0.076, 0.411, 0.193, 20.6, 1.52, 2.37];

    /// The terms, in their order.
    pub fn terms(&self) -> [f64; 8] {
        let Self { mapped, paired, loaded, written, read, averaged, resampled, fixed } = *self;
        [mapped, paired, loaded, written, read, averaged, resampled, fixed]
    }

    /// So much of it.
    fn times(self, share: f64) -> Self {
        let [mapped, paired, loaded, written, read, averaged, resampled, fixed] =
            self.terms().map(|term| share * term);
        Self { mapped, paired, loaded, written, read, averaged, resampled, fixed }
    }

    /// Both.
    fn and(self, other: Self) -> Self {
        Self {
            mapped: self.mapped + other.mapped,
            paired: self.paired + other.paired,
            loaded: self.loaded + other.loaded,
            written: self.written + other.written,
            read: self.read + other.read,
            averaged: self.averaged + other.averaged,
            resampled: self.resampled + other.resampled,
            fixed: self.fixed + other.fixed,
        }
    }

    /// Nanoseconds per pixel.
    pub fn nanoseconds(&self) -> f64 {
        self.terms().iter().zip(Self::SHARES).map(|(term, share)| term * share).sum()
    }
}

impl Program {
    /// What the program does per pixel.
    pub fn effort(&self) -> Effort {
        let efforts = self.kernels.iter().map(|kernel| {
            let share = match kernel.grid() {
                Grid::Full => 1.0,
                Grid::Half => 0.25,
            };
            effort(kernel).times(share)
        });
        efforts.fold(Effort { fixed: 1.0, ..Effort::default() }, Effort::and)
    }

    /// About how many nanoseconds the program takes per pixel, on one core of the machine that
    /// the prediction was fitted on. Others are faster or slower, by about the same factor for
    /// all programs.
    pub fn cost(&self) -> f64 {
        self.effort().nanoseconds()
    }
}

fn effort(kernel: &Kernel) -> Effort {
    let writes = kernel.writes().len() as f64;
    let read = (kernel.looks().len() + kernel.features().len()) as f64;
    let effort = Effort { read, ..Effort::default() };
    match kernel {
        Kernel::Map(map) => Effort { mapped: instructions(&map.tape), written: writes, ..effort },
        Kernel::Gather(gather) => {
            let channels = gather.channels.len() + 1 + usize::from(gather.variance.is_some());
            let (paired, loaded) = pairs(&gather.pairs, channels);
            Effort { paired, loaded, written: writes, ..effort }
        }
        Kernel::Sum(sum) => {
            let (paired, loaded) = pairs(&sum.pairs, sum.writes.len());
            Effort { paired, loaded, written: writes, ..effort }
        }
        Kernel::Box(_) => Effort { averaged: writes, ..effort },
        Kernel::Resample(_) => Effort { resampled: writes, ..effort },
        Kernel::Transpose(_) | Kernel::Given(_) => Effort { written: writes, ..effort },
    }
}

/// Instructions of a loop over pairs, and numbers that it reads and adds to.
fn pairs(pairs: &PairLoop, sums: usize) -> (f64, f64) {
    let taps = f64::from(pairs.runs.iter().map(|run| run.count).sum::<u32>());
    let ends = if pairs.mirrored { 2 } else { 1 };
    let loads = pairs.pair.inputs().count() + ends * sums;
    (taps * instructions(&pairs.pair), taps * loads as f64)
}

/// Instructions of a tape; divisions and roots count for several.
fn instructions(tape: &Tape) -> f64 {
    let weight = |instr: &Instr| match instr {
        Instr::Prim(Prim::Div | Prim::Sqrt, _) => 4.0,
        Instr::Prim(..) => 1.0,
        Instr::Input(_) | Instr::Const(_) => 0.0,
    };
    tape.instrs().iter().map(weight).sum()
}
