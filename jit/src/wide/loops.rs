//! The loops around the body, in the order that [`call`](crate::call) gives.

use std::mem::offset_of;

use super::body::{Block, Emitter};
use super::encode::{Address, Assembler, Operand, Vector};
use super::frame::{
    CALL, CHUNKS_LEFT, Frame, MIRROR, NEIGHBOUR, OUT, PIXEL, PLANES, RUN, RUNS_LEFT, SAVED,
    SCRATCH, STEP, SUM, TAP, TAPS_LEFT, TEMPORARY,
};
use super::program::Binary;
use crate::call::{Call, RunCall};

/// What runs in the loop over taps.
pub(super) enum Taps {
    /// A tap, or two at once and an odd one alone.
    Whole(Block),
    /// The halves of a [`Pipeline`](super::pipeline::Pipeline).
    Halves { first: Block, both: Block, last: Block },
}

/// Emits the whole function; returns how many bytes of scratch memory it takes.
pub(super) fn emit(asm: &mut Assembler, frame: &Frame, taps: &Taps, constants: &[u32]) -> usize {
    for register in SAVED {
        asm.push(register);
    }
    let call = |offset| Address::new(CALL, offset);
    let local = |offset| Address::new(SCRATCH, offset);
    asm.fetch(SCRATCH, call(offset_of!(Call, scratch)));
    asm.fetch(PLANES, call(offset_of!(Call, planes)));
    asm.fetch(PIXEL, call(offset_of!(Call, pixel)));
    for &(plane, register) in &frame.bases {
        asm.fetch(register, Address::new(PLANES, plane * size_of::<*const f32>()));
    }
    for (field, place) in [(offset_of!(Call, out), OUT), (offset_of!(Call, chunks), CHUNKS_LEFT)] {
        asm.fetch(TEMPORARY, call(field));
        asm.put(local(place), TEMPORARY);
    }
    let (Taps::Whole(inner) | Taps::Halves { both: inner, .. }) = taps;
    let mut body = Emitter::new(asm, frame, frame.taps, inner, constants);
    let pins = body.choose_pins();
    body.keep(&pins);
    let passing = body.passing();
    body.load_pinned(&pins, true);

    let chunk = body.asm().here();
    body.load_pinned(&pins, false);
    let asm = body.asm();
    for (field, place) in [(offset_of!(Call, runs), RUN), (offset_of!(Call, run_count), RUNS_LEFT)]
    {
        asm.fetch(TEMPORARY, call(field));
        asm.put(local(place), TEMPORARY);
    }

    let run = asm.here();
    let of_run = |offset| Address::new(TEMPORARY, offset);
    asm.fetch(TEMPORARY, local(RUN));
    asm.copy(NEIGHBOUR, PIXEL);
    asm.increase_by(NEIGHBOUR, of_run(offset_of!(RunCall, neighbour)));
    if frame.spec.mirrored {
        asm.copy(MIRROR, PIXEL);
        asm.increase_by(MIRROR, of_run(offset_of!(RunCall, mirror)));
    }
    asm.fetch(STEP, of_run(offset_of!(RunCall, step)));
    asm.fetch(TAP, of_run(offset_of!(RunCall, taps)));
    asm.fetch(TAPS_LEFT, of_run(offset_of!(RunCall, count)));
    clear_partials(asm, frame, passing);

    let mut slots = 0;
    let mut block = |asm: &mut Assembler, taps: usize, block: &Block| {
        let mut body = Emitter::new(asm, frame, taps, block, constants);
        body.keep(&pins);
        slots = slots.max(body.run());
    };
    match taps {
        Taps::Whole(whole) if frame.taps == 2 => {
            // Most runs have an odd number of taps, so that one of them comes alone.
            asm.copy(frame.second, NEIGHBOUR);
            asm.increase(frame.second, STEP);
            asm.halve(TAPS_LEFT);
            let pairs = asm.skip_if_zero();
            let tap = asm.here();
            block(asm, 2, whole);
            advance(asm, frame, 2);
            asm.repeat(TAPS_LEFT, tap);
            asm.land(pairs);
            asm.fetch(TEMPORARY, local(RUN));
            asm.fetch(TAPS_LEFT, of_run(offset_of!(RunCall, count)));
            asm.keep_odd(TAPS_LEFT);
            let even = asm.skip_if_zero();
            block(asm, 1, whole);
            asm.land(even);
        }
        Taps::Whole(whole) => {
            let tap = asm.here();
            block(asm, 1, whole);
            advance(asm, frame, 1);
            asm.repeat(TAPS_LEFT, tap);
        }
        Taps::Halves { first, both, last } => {
            asm.copy(frame.second, NEIGHBOUR);
            asm.increase(frame.second, STEP);
            block(asm, 1, first);
            asm.count_down(TAPS_LEFT);
            let only = asm.skip_if_zero();
            let tap = asm.here();
            block(asm, 1, both);
            advance(asm, frame, 1);
            asm.repeat(TAPS_LEFT, tap);
            asm.land(only);
            block(asm, 1, last);
        }
    }

    add_partials(asm, frame, passing);
    asm.advance_at(local(RUN), size_of::<RunCall>());
    asm.repeat_at(local(RUNS_LEFT), run);

    asm.advance(PIXEL, frame.chunk_bytes());
    asm.advance_at(local(OUT), frame.chunk_bytes());
    asm.repeat_at(local(CHUNKS_LEFT), chunk);
    for register in SAVED.into_iter().rev() {
        asm.pop(register);
    }
    asm.leave();
    frame.scratch_bytes(slots)
}

/// Moves the cursors on by so many taps.
fn advance(asm: &mut Assembler, frame: &Frame, taps: usize) {
    for _ in 0..taps {
        asm.increase(NEIGHBOUR, STEP);
        if frame.taps == 2 || frame.carried.is_some() {
            asm.increase(frame.second, STEP);
        }
        if frame.spec.mirrored {
            asm.increase(MIRROR, STEP);
        }
    }
    if frame.spec.taps > 0 {
        asm.advance(TAP, taps * frame.spec.taps * size_of::<f32>());
    }
}

/// Sets all partials to +0.0.
fn clear_partials(asm: &mut Assembler, frame: &Frame, passing: Vector) {
    for &partial in &frame.partials {
        asm.clear(partial);
    }
    if frame.partials.is_empty() {
        asm.clear(passing);
        for (index, chain) in places(frame) {
            asm.store(frame.partial(index, chain), passing);
        }
    }
}

/// Adds the partials of a run to the results of the chunk.
fn add_partials(asm: &mut Assembler, frame: &Frame, passing: Vector) {
    asm.fetch(SUM, Address::new(SCRATCH, OUT));
    for (index, chain) in places(frame) {
        if index > 0 && chain == 0 {
            asm.increase_by(SUM, Address::new(CALL, offset_of!(Call, out_stride)));
        }
        let result = Address::new(SUM, chain * frame.width.bytes());
        let partial = match frame.partials.get(index * frame.chains + chain) {
            Some(&partial) => Operand::Register(partial),
            None => Operand::Memory(frame.partial(index, chain)),
        };
        asm.load(passing, Operand::Memory(result));
        asm.binary(Binary::Add, passing, passing, partial);
        asm.store(result, passing);
    }
}

/// All partials, in the order of the results.
fn places(frame: &Frame) -> impl Iterator<Item = (usize, usize)> + use<> {
    let chains = frame.chains;
    (0..frame.spec.results()).flat_map(move |index| (0..chains).map(move |chain| (index, chain)))
}
