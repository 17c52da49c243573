//! Splits a tape by how often each value changes: once for all, per tap (the
//! offset from i to j), per pixel, or per pair.
//!
//! Of a window of 441 taps, what depends on pixel i alone is computed once and
//! not 441 times, and what depends on the offset alone once per image. What
//! remains in the pair tape reads those results as inputs. In a mirrored tape,
//! what depends on pixel j alone is what was computed for pixel i elsewhere: the
//! same result, read at j.

use std::collections::BTreeSet;

use rustc_hash::FxHashMap;

use crate::expr::feature::PlaneId;
use crate::expr::tape::{Input, Instr, Prim, Side, Tape, Value};

#[derive(Clone, Copy, PartialEq, Eq)]
enum Rate {
    Constant,
    /// Named constants, whose values are given when the code runs.
    Uniform,
    Tap,
    Pixel(Side),
    Pair,
}

impl Rate {
    fn of_input(input: Input) -> Self {
        match input {
            Input::Plane(_, side) | Input::PerPixel(_, side) | Input::Signal(_, side) => {
                Self::Pixel(side)
            }
            Input::Offset(_) | Input::PerTap(_) => Self::Tap,
            Input::Constant(_) => Self::Uniform,
        }
    }

    fn join(self, other: Self) -> Self {
        match (self, other) {
            (Self::Constant, rate) | (rate, Self::Constant) => rate,
            (Self::Uniform, rate) | (rate, Self::Uniform) => rate,
            (a, b) if a == b => a,
            _ => Self::Pair,
        }
    }
}

/// What is computed for every tap, every pixel and every pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Tapes {
    /// Computes, from the offset and named constants, what the pair tape reads as `PerTap`.
    pub tap: Tape,
    /// Computes, from planes at pixel i and named constants, what the pair tape reads as
    /// `PerPixel`, at either pixel.
    pub pixel: Tape,
    /// Computes the weights.
    pub pair: Tape,
}

impl Tapes {
    /// The planes that the tapes read, at either pixel.
    pub fn planes(&self) -> BTreeSet<PlaneId> {
        self.pixel
            .inputs()
            .chain(self.pair.inputs())
            .filter_map(|input| match input {
                Input::Plane(plane, _) => Some(plane),
                Input::Offset(_)
                | Input::PerPixel(..)
                | Input::PerTap(_)
                | Input::Signal(..)
                | Input::Constant(_) => None,
            })
            .collect()
    }
}

/// Splits the tape of a map: into what hangs on named constants alone, and the rest, which
/// reads that as `PerTap`.
pub(super) fn uniform(tape: &Tape) -> [Tape; 2] {
    let rates = rates(tape);
    let is_uniform = |k: usize| rates[k] == Rate::Uniform;
    let mut crosses = vec![false; tape.instrs().len()];
    for (k, instr) in tape.instrs().iter().enumerate() {
        if !is_uniform(k) {
            instr.operands().iter().for_each(|a| crosses[a.index()] |= is_uniform(a.index()));
        }
    }
    tape.results().iter().for_each(|r| crosses[r.index()] |= is_uniform(r.index()));
    let mut results = Vec::new();
    let mut rest = Tape::default();
    let mut renamed: Vec<Option<Value>> = vec![None; tape.instrs().len()];
    for (value, _) in tape.iter() {
        let k = value.index();
        renamed[k] = match (crosses[k], is_uniform(k)) {
            (true, _) => {
                let input = Input::PerTap(number(&mut results, value));
                Some(rest.push(Instr::Input(input), tape.range(value)))
            }
            (false, true) => None,
            (false, false) => Some(rest.push_from(tape, value, |v| renamed[v.index()])),
        };
    }
    let kept = |r: &Value| renamed[r.index()].expect("results stay or cross");
    let kept: Vec<Value> = tape.results().iter().map(kept).collect();
    [tape.clone().finish(&results), rest.finish(&kept)]
}

/// Splits the tape. With `hoist` off only the bare offsets leave the pair tape:
/// back ends read offsets from a table in any case. Only a `mirrored` tape may
/// look at pixel j through what was computed per pixel: the others' back ends
/// compute that for the pixels to be filtered alone.
pub(super) fn split(tape: &Tape, hoist: bool, mirrored: bool) -> Tapes {
    let rates = rates(tape);
    let twins = if mirrored { twins(tape) } else { vec![None; tape.instrs().len()] };
    let hoisted = |k: usize| match (tape.instrs()[k], rates[k]) {
        (Instr::Input(Input::Offset(_) | Input::Constant(_)), _) => true,
        (Instr::Const(_) | Instr::Input(_), _) => false,
        (Instr::Prim(..), Rate::Uniform | Rate::Tap | Rate::Pixel(Side::I)) => hoist,
        (Instr::Prim(..), Rate::Pixel(Side::J)) => hoist && twins[k].is_some(),
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
        crossing[k] = Some(match rates[k] {
            Rate::Uniform | Rate::Tap => Input::PerTap(number(&mut tap_results, value)),
            Rate::Pixel(Side::I) => Input::PerPixel(number(&mut pixel_results, value), Side::I),
            Rate::Pixel(Side::J) => {
                let twin = twins[k].expect("nothing else is hoisted of pixel j");
                Input::PerPixel(number(&mut pixel_results, twin), Side::J)
            }
            Rate::Constant | Rate::Pair => unreachable!("only taps and pixels are hoisted"),
        });
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
    Tapes {
        tap: tape.clone().finish(&tap_results),
        pixel: tape.clone().finish(&pixel_results),
        pair: pair.finish(&results),
    }
}

/// The position of a value among results, at the end if it is not there yet.
fn number(results: &mut Vec<Value>, value: Value) -> u32 {
    let position = results.iter().position(|&result| result == value);
    position.unwrap_or_else(|| {
        results.push(value);
        results.len() - 1
    }) as u32
}

/// For every value the one that is made like it with the pixels exchanged.
fn twins(tape: &Tape) -> Vec<Option<Value>> {
    let made: FxHashMap<Instr, Value> = tape.iter().map(|(value, &instr)| (instr, value)).collect();
    let mut twins: Vec<Option<Value>> = Vec::with_capacity(tape.instrs().len());
    for (value, instr) in tape.iter() {
        twins.push(match *instr {
            Instr::Const(_)
            | Instr::Input(Input::Offset(_) | Input::PerTap(_) | Input::Constant(_)) => Some(value),
            Instr::Input(Input::Plane(plane, side)) => {
                made.get(&Instr::Input(Input::Plane(plane, side.other()))).copied()
            }
            Instr::Input(Input::PerPixel(k, side)) => {
                made.get(&Instr::Input(Input::PerPixel(k, side.other()))).copied()
            }
            Instr::Input(Input::Signal(k, side)) => {
                made.get(&Instr::Input(Input::Signal(k, side.other()))).copied()
            }
            Instr::Prim(prim, _) => {
                let known = instr.operands().iter().all(|a| twins[a.index()].is_some());
                let twin = |a: Value| twins[a.index()].expect("as tested");
                known.then(|| instr.renamed(twin)).and_then(|twin| {
                    made.get(&twin).or_else(|| made.get(&exchanged(prim, twin)?)).copied()
                })
            }
        });
    }
    twins
}

/// The same with the first two operands exchanged, where that is the same.
fn exchanged(prim: Prim, instr: Instr) -> Option<Instr> {
    match (prim, instr) {
        (Prim::Add | Prim::Mul, Instr::Prim(_, [a, b, _, _])) => {
            Some(Instr::Prim(prim, [b, a, b, b]))
        }
        (Prim::Fma, Instr::Prim(_, [a, b, c, _])) => Some(Instr::Prim(prim, [b, a, c, b])),
        _ => None,
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
