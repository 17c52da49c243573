//! Neighbouring maps as one kernel: the pass `inline`.

use super::kernel::{Kernel, MapKernel};
use super::lower::Read;
use crate::expr::symbol::{Source, StagePlane};
use crate::expr::tape::{Input, Tape};

/// Instructions beyond which maps are not put together: what is under way at a time would
/// no longer fit into registers.
const LONGEST: usize = 4096;

/// Makes one map of those that stand side by side, between one gather and the next, where
/// none of them looks at another's result beside the pixel. Their common values are
/// computed once, and what only they read is stored nowhere.
pub(super) fn fuse(kernels: Vec<Kernel>, share: bool) -> Vec<Kernel> {
    let mut fused: Vec<Kernel> = Vec::with_capacity(kernels.len());
    // Where the maps since the last gather begin.
    let mut segment = 0;
    for kernel in kernels {
        let Kernel::Map(map) = kernel else {
            fused.push(kernel);
            segment = fused.len();
            continue;
        };
        let looks = |map: &MapKernel, at: &[StagePlane]| {
            let plane = |read: &Read| match read.source {
                Source::Stage(plane) => at.contains(&plane),
                Source::Feature(_) => false,
            };
            map.reads.iter().any(plane)
        };
        let candidate = (segment..fused.len()).rev().find(|&k| {
            let Kernel::Map(earlier) = &fused[k] else { return false };
            let beside = map.reads.iter().any(|read| match read.source {
                Source::Stage(plane) => read.shift != [0, 0] && earlier.writes.contains(&plane),
                Source::Feature(_) => false,
            });
            // It moves up to the earlier map, before all that stands between.
            let passes = fused[k + 1..].iter().all(|between| !looks(&map, &between.writes()));
            let length = earlier.tape.instrs().len() + map.tape.instrs().len();
            earlier.grid == map.grid && !beside && passes && length <= LONGEST
        });
        match candidate {
            Some(k) => {
                let Kernel::Map(earlier) = &fused[k] else { unreachable!("it was found") };
                fused[k] = Kernel::Map(together(earlier, &map, share));
            }
            None => fused.push(Kernel::Map(map)),
        }
    }
    fused
}

/// Two maps as one, of which the second may read what the first writes.
fn together(first: &MapKernel, second: &MapKernel, share: bool) -> MapKernel {
    let mut reads = first.reads.clone();
    let written = |read: &Read| match read.source {
        Source::Stage(plane) => first.writes.iter().position(|&known| known == plane),
        Source::Feature(_) => None,
    };
    // Inputs that the first map gives keep numbers that nothing else has.
    let given = u32::MAX / 2;
    let tape = second.renumbered(|read| match written(&read) {
        Some(result) => given + result as u32,
        None => number(&mut reads, read),
    });
    let result = |input| match input {
        Input::Signal(k, _) => k.checked_sub(given).map(|result| result as usize),
        Input::Plane(..)
        | Input::Offset(_)
        | Input::PerPixel(..)
        | Input::PerTap(_)
        | Input::Constant(_) => None,
    };
    let tape = Tape::joined(&first.tape, &tape, share, result);
    let writes = [first.writes.as_slice(), &second.writes].concat();
    MapKernel::new(tape, reads, writes, first.grid)
}

/// The position of something in a list, at whose end it is put if it is not there yet.
pub(super) fn number<T: PartialEq>(list: &mut Vec<T>, item: T) -> u32 {
    let position = list.iter().position(|known| *known == item);
    position.unwrap_or_else(|| {
        list.push(item);
        list.len() - 1
    }) as u32
}
