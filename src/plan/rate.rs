//! Splits a tape by how often each value changes: once for all, per tap (the
//! offset from i to j), per pixel i, or per pair.
//!
//! Of a window of 441 taps, what depends on pixel i alone is computed once and
//! not 441 times, and what depends on the offset alone once per image. What
//! remains in the pair tape reads those results as inputs.

use crate::expr::tape::{Input, Instr, Side, Tape, Value};

#[derive(Clone, Copy, PartialEq, Eq)]
enum Rate {
    Constant,
    Tap,
    Pixel,
    Pair,
}

impl Rate {
    fn of_input(input: Input) -> Self {
        match input {
            Input::Plane(_, Side::I) | Input::PerPixel(_) => Self::Pixel,
            Input::Plane(_, Side::J) => Self::Pair,
            Input::Offset(_) | Input::PerTap(_) => Self::Tap,
        }
    }

    fn join(self, other: Self) -> Self {
        match (self, other) {
            (Self::Constant, rate) | (rate, Self::Constant) => rate,
            (a, b) if a == b => a,
            _ => Self::Pair,
        }
    }
}

/// A tape split by rate.
pub(super) struct Split {
    /// Computes, from the offset, what the pair tape reads as `PerTap`.
    pub(super) tap: Tape,
    /// Computes, from planes at pixel i, what it reads as `PerPixel`.
    pub(super) pixel: Tape,
    /// Computes the weights.
    pub(super) pair: Tape,
}

/// Splits the tape. With `hoist` off only the bare offsets leave the pair tape:
/// back ends read offsets from a table in any case.
pub(super) fn split(tape: &Tape, hoist: bool) -> Split {
    let rates = rates(tape);
    let hoisted = |k: usize| match (tape.instrs()[k], rates[k]) {
        (Instr::Input(Input::Offset(_)), _) => true,
        (Instr::Const(_) | Instr::Input(_), _) => false,
        (Instr::Prim(..), Rate::Tap | Rate::Pixel) => hoist,
        (Instr::Prim(..), Rate::Constant | Rate::Pair) => false,
    };
    // Of the hoisted values only those cross over that a pair-rate instruction
    // (or a result) reads.
    let mut crosses = vec![false; tape.instrs().len()];
    for (k, instr) in tape.instrs().iter().enumerate() {
        if !hoisted(k) {
            for a in instr.operands() {
                crosses[a.index()] |= hoisted(a.index());
            }
        }
    }
    for r in tape.results() {
        crosses[r.index()] |= hoisted(r.index());
    }

    // The values that cross, numbered in the order of the tape.
    let mut tap_results = Vec::new();
    let mut pixel_results = Vec::new();
    let mut crossing = vec![None; tape.instrs().len()];
    for (value, _) in tape.iter().filter(|(value, _)| crosses[value.index()]) {
        let k = value.index();
        let (results, input): (&mut Vec<Value>, fn(u32) -> Input) = match rates[k] {
            Rate::Tap => (&mut tap_results, Input::PerTap),
            Rate::Pixel => (&mut pixel_results, Input::PerPixel),
            Rate::Constant | Rate::Pair => unreachable!("only taps and pixels are hoisted"),
        };
        crossing[k] = Some(input(results.len() as u32));
        results.push(value);
    }

    let mut pair = Tape::default();
    let mut renamed: Vec<Option<Value>> = vec![None; tape.instrs().len()];
    for (value, _) in tape.iter() {
        let k = value.index();
        renamed[k] = match crossing[k] {
            Some(input) => Some(pair.push(Instr::Input(input), tape.range(value))),
            None if hoisted(k) => None,
            None => Some(pair.push_from(tape, value, |v| renamed[v.index()])),
        };
    }
    let results: Vec<Value> =
        tape.results().iter().map(|r| renamed[r.index()].expect("results stay or cross")).collect();
    Split {
        tap: tape.clone().finish(&tap_results),
        pixel: tape.clone().finish(&pixel_results),
        pair: pair.finish(&results),
    }
}

fn rates(tape: &Tape) -> Vec<Rate> {
    let mut rates: Vec<Rate> = Vec::with_capacity(tape.instrs().len());
    for instr in tape.instrs() {
        rates.push(match *instr {
            Instr::Const(_) => Rate::Constant,
            Instr::Input(input) => Rate::of_input(input),
            Instr::Prim(..) => {
                instr.operands().iter().fold(Rate::Constant, |rate, a| rate.join(rates[a.index()]))
            }
        });
    }
    rates
}
