//! Whether computing a pair of pixels once, for both of its ends, pays.
//!
//! A weight that is a function of distances is the same both ways, and then half
//! of the work is saved; one that also looks at the variance of pixel i shares
//! its distances with its mirror image. What that costs is memory: every tap adds
//! to the sums of pixel j, which are no longer in registers.

use super::hoist::Tapes;
use super::taps::Taps;
use crate::expr::tape::{Instr, Prim, Tape};

/// What adding a weight to a channel costs: a load and a fused multiply-add.
const ADD: usize = 2;

/// What adding it to the sums of pixel j costs: two loads, a fused multiply-add
/// and a store. The sums overlap those of the last tap by all lanes but one, so that
/// their load waits until that tap's store has reached the cache.
const ADD_MIRRORED: usize = 10;

/// What it costs per pixel to clear a run's sums of what is owed, and to add them to those
/// below: they do not fit into a core's nearest cache. It counts where windows are small:
/// programs of five by five taps take 1.15 times as long mirrored.
const OWE: usize = 40;

/// Weights beyond which it does not pay: what rows owe to those below no longer fits
/// into a core's cache. Measured on bred expressions, with this pass against without:
/// 1.17 times as many a second one by one, 1.05 and 1.02 in fours and eights, 0.95 and
/// 0.98 in sixteens and thirty-twos.
const MOST: usize = 8;

/// Whether the mirrored tapes, run for half of the `taps`, are cheaper with so many sums per
/// pixel: at equal price
/// still, since arithmetic goes on while sums are waited for. The prices part bred
/// expressions and named filters, alone and in batches, at both precisions, where they
/// were measured to part (benches/RESULTS.md).
pub(super) fn pays(plain: &Tapes, mirrored: &Tapes, sums: usize, taps: &Taps) -> bool {
    if plain.pair.results().len() > MOST {
        return false;
    }
    let both_ways = 2 * (cost(&plain.pair) + sums * ADD);
    let at_once = cost(&mirrored.pair) + sums * (ADD + ADD_MIRRORED);
    let count = taps.half().iter().map(|run| run.count as usize).sum::<usize>().max(1);
    let at_once = at_once + taps.half().len() * sums * OWE / count;
    at_once * 20 < both_ways * 21
}

/// Roughly the instructions that one pair takes.
fn cost(tape: &Tape) -> usize {
    let cost = |instr: &Instr| match instr {
        Instr::Const(_) => 0,
        Instr::Input(_) => 1,
        Instr::Prim(Prim::Div | Prim::Sqrt, _) => 4,
        Instr::Prim(Prim::Exp2i, _) => 2,
        Instr::Prim(Prim::Exponent | Prim::Fraction, _) => 3,
        Instr::Prim(..) => 1,
    };
    tape.instrs().iter().map(cost).sum()
}
