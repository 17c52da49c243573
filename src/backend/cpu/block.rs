//! A tape, run over blocks of pixels at a time.
//!
//! Each instruction is a loop over a few hundred pixels, so that what is paid
//! once per instruction (deciding what it is, finding its operands) is paid
//! once per block and not per pixel, and the loop itself is vector code at the
//! full width of the machine. Values live in *slots* of block size that are
//! reused as soon as their value is dead, which keeps the working set in the
//! first-level cache.
//!
//! The arithmetic is [`Prim::eval`] itself, inlined into every loop. Callers
//! run [`Program::run`] inside a `pulp` dispatch, so that the loops are compiled
//! for the vector units the host has (and `mul_add` is an instruction, not a
//! library call).

use crate::expr::tape::{Input, Instr, Prim, Tape, Value};

/// Pixels that one pass of an inner loop handles: one 512-bit register.
pub(super) const LANES: usize = 16;

/// The unit of storage.
pub(super) type Chunk = [f32; LANES];

/// Chunks per block at most: 256 pixels. What a step costs beside its loop is
/// paid once per block, so at 128 pixels the paper's filter takes 1.4 times as
/// long; at 320 its slots outgrow the first-level cache, and it takes five times
/// as long (Sapphire Rapids, 48 KiB).
pub(super) const BLOCK: usize = 16;

#[derive(Clone, Copy, Debug)]
enum Operand {
    Slot(u32),
    Constant(f32),
    Input(u32),
}

#[derive(Clone, Copy, Debug)]
struct Step {
    prim: Prim,
    args: [Operand; 4],
    slot: u32,
}

/// A tape with a slot for every live value.
#[derive(Debug)]
pub(super) struct Program {
    steps: Vec<Step>,
    inputs: Vec<Input>,
    results: Vec<Operand>,
    slots: usize,
}

/// The slots of one thread.
#[derive(Default)]
pub(super) struct Slots(Vec<Block>);

/// A run of chunks that starts on a cache line. A store that straddles two
/// lines costs two, and every instruction of a tape stores a whole block.
#[derive(Clone, Default)]
pub(super) struct Block {
    data: Vec<f32>,
    /// Where the first line begins.
    start: usize,
    chunks: usize,
}

impl Block {
    /// Makes room for so many chunks; what they hold is left open.
    #[inline(always)]
    pub(super) fn resize(&mut self, chunks: usize) {
        if self.data.len() < (chunks + 1) * LANES {
            self.data = vec![0.0; (chunks + 1) * LANES];
            self.start = self.data.as_ptr().align_offset(size_of::<Chunk>()).min(LANES);
        }
        self.chunks = chunks;
    }

    #[inline(always)]
    pub(super) fn chunks(&self) -> &[Chunk] {
        self.data[self.start..][..self.chunks * LANES].as_chunks().0
    }

    #[inline(always)]
    pub(super) fn chunks_mut(&mut self) -> &mut [Chunk] {
        self.data[self.start..][..self.chunks * LANES].as_chunks_mut().0
    }
}

/// A result of a block: one value per pixel, or one for all.
#[derive(Clone, Copy)]
pub(super) enum Arg<'a> {
    /// One chunk after another.
    Block(&'a [Chunk]),
    /// The same everywhere.
    Splat(f32),
}

impl Program {
    /// Assigns slots to a tape's values.
    pub(super) fn new(tape: &Tape) -> Self {
        let mut last_use = vec![0; tape.instrs().len()];
        for (value, instr) in tape.iter() {
            for a in instr.operands() {
                last_use[a.index()] = value.index();
            }
        }
        for r in tape.results() {
            last_use[r.index()] = usize::MAX;
        }
        let mut program =
            Self { steps: Vec::new(), inputs: Vec::new(), results: Vec::new(), slots: 0 };
        let mut places: Vec<Operand> = Vec::with_capacity(tape.instrs().len());
        let mut free: Vec<u32> = Vec::new();
        for (value, instr) in tape.iter() {
            places.push(match *instr {
                Instr::Const(bits) => Operand::Constant(f32::from_bits(bits)),
                Instr::Input(input) => {
                    program.inputs.push(input);
                    Operand::Input(program.inputs.len() as u32 - 1)
                }
                Instr::Prim(prim, args) => {
                    // The result's slot is taken before the operands' are given
                    // back: a step never writes where it reads.
                    let slot = free.pop().unwrap_or_else(|| {
                        program.slots += 1;
                        program.slots as u32 - 1
                    });
                    let args = args.map(|a: Value| places[a.index()]);
                    program.steps.push(Step { prim, args, slot });
                    let mut released: Vec<u32> = instr
                        .operands()
                        .iter()
                        .filter(|a| last_use[a.index()] == value.index())
                        .filter_map(|a| match places[a.index()] {
                            Operand::Slot(slot) => Some(slot),
                            Operand::Constant(_) | Operand::Input(_) => None,
                        })
                        .collect();
                    released.sort_unstable();
                    released.dedup();
                    free.extend(released);
                    Operand::Slot(slot)
                }
            });
        }
        program.results = tape.results().iter().map(|r| places[r.index()]).collect();
        program
    }

    /// What the tape reads, in the order that [`Program::run`] takes it.
    pub(super) fn inputs(&self) -> &[Input] {
        &self.inputs
    }

    /// Number of results.
    pub(super) fn results(&self) -> usize {
        self.results.len()
    }

    /// Runs the tape on `chunks` chunks. Every block among the inputs must hold
    /// at least that many.
    #[inline(always)]
    pub(super) fn run(&self, inputs: &[Arg<'_>], slots: &mut Slots, chunks: usize) {
        if slots.0.len() < self.slots {
            slots.0.resize(self.slots, Block::default());
        }
        for step in &self.steps {
            let mut out = std::mem::take(&mut slots.0[step.slot as usize]);
            out.resize(chunks);
            apply(step, inputs, &slots.0, out.chunks_mut());
            slots.0[step.slot as usize] = out;
        }
    }

    /// A result of the last run.
    #[inline(always)]
    pub(super) fn result<'a>(&self, index: usize, inputs: &[Arg<'a>], slots: &'a Slots) -> Arg<'a> {
        fetch(self.results[index], inputs, &slots.0)
    }
}

#[inline(always)]
fn fetch<'a>(operand: Operand, inputs: &[Arg<'a>], slots: &'a [Block]) -> Arg<'a> {
    match operand {
        Operand::Slot(slot) => Arg::Block(slots[slot as usize].chunks()),
        Operand::Constant(x) => Arg::Splat(x),
        Operand::Input(input) => inputs[input as usize],
    }
}

/// Where a loop finds an operand: a block, or one value for all of it.
trait Source: Copy {
    fn chunk(self, k: usize) -> Chunk;
}

impl Source for &[Chunk] {
    #[inline(always)]
    fn chunk(self, k: usize) -> Chunk {
        self[k]
    }
}

impl Source for f32 {
    #[inline(always)]
    fn chunk(self, _: usize) -> Chunk {
        [self; LANES]
    }
}

/// Loops over a block with `Prim::ALL[PRIM]` known to the compiler.
#[inline(always)]
fn each<const PRIM: usize>(
    a: impl Source,
    b: impl Source,
    c: impl Source,
    d: impl Source,
    out: &mut [Chunk],
) {
    for (k, out) in out.iter_mut().enumerate() {
        let (a, b, c, d) = (a.chunk(k), b.chunk(k), c.chunk(k), d.chunk(k));
        for lane in 0..LANES {
            out[lane] = Prim::ALL[PRIM].eval([a[lane], b[lane], c[lane], d[lane]]);
        }
    }
}

/// Calls `each` with operand types chosen by which operands are blocks. One
/// loop is compiled for every combination, so that no loop tests it. Operands
/// beyond the primitive's arity are given as `unused` constants.
macro_rules! by_kind {
    ($prim:ident, $out:ident; [$($ready:expr),*] unused $($unused:literal)*) => {
        each::<{ Prim::$prim as usize }>($($ready,)* $($unused,)* $out)
    };
    ($prim:ident, $out:ident; [$($ready:expr),*] $next:ident $($rest:tt)*) => {
        match $next {
            Arg::Block(block) => {
                let block = &block[..$out.len()];
                by_kind!($prim, $out; [$($ready,)* block] $($rest)*)
            }
            Arg::Splat(x) => by_kind!($prim, $out; [$($ready,)* x] $($rest)*),
        }
    };
}

#[inline(always)]
fn apply(step: &Step, inputs: &[Arg<'_>], slots: &[Block], out: &mut [Chunk]) {
    // Operands are fetched where they are used: a step pays for its own arity.
    macro_rules! with {
        ($prim:ident unused $($unused:literal)*; $($name:ident $index:literal),*) => {{
            $(let $name = fetch(step.args[$index], inputs, slots);)*
            by_kind!($prim, out; [] $($name)* unused $($unused)*)
        }};
    }
    match step.prim {
        Prim::Neg => with!(Neg unused 0.0 0.0 0.0; a 0),
        Prim::Abs => with!(Abs unused 0.0 0.0 0.0; a 0),
        Prim::Sqrt => with!(Sqrt unused 0.0 0.0 0.0; a 0),
        Prim::Round => with!(Round unused 0.0 0.0 0.0; a 0),
        Prim::Exp2i => with!(Exp2i unused 0.0 0.0 0.0; a 0),
        Prim::Exponent => with!(Exponent unused 0.0 0.0 0.0; a 0),
        Prim::Fraction => with!(Fraction unused 0.0 0.0 0.0; a 0),
        Prim::Add => with!(Add unused 0.0 0.0; a 0, b 1),
        Prim::Sub => with!(Sub unused 0.0 0.0; a 0, b 1),
        Prim::Mul => with!(Mul unused 0.0 0.0; a 0, b 1),
        Prim::Div => with!(Div unused 0.0 0.0; a 0, b 1),
        Prim::Min => with!(Min unused 0.0 0.0; a 0, b 1),
        Prim::Max => with!(Max unused 0.0 0.0; a 0, b 1),
        Prim::Fma => with!(Fma unused 0.0; a 0, b 1, c 2),
        Prim::SelectLt => with!(SelectLt unused; a 0, b 1, c 2, d 3),
    }
}

/// Adds `weight * channel` to a block of sums, fused.
#[inline(always)]
pub(super) fn accumulate(weight: Arg<'_>, channel: &[Chunk], sums: &mut [Chunk]) {
    #[inline(always)]
    fn run(weight: impl Source, channel: &[Chunk], sums: &mut [Chunk]) {
        for (k, sum) in sums.iter_mut().enumerate() {
            let (w, c) = (weight.chunk(k), channel[k]);
            for lane in 0..LANES {
                sum[lane] = w[lane].mul_add(c[lane], sum[lane]);
            }
        }
    }
    let channel = &channel[..sums.len()];
    match weight {
        Arg::Block(weight) => run(&weight[..sums.len()], channel, sums),
        Arg::Splat(weight) => run(weight, channel, sums),
    }
}

/// Adds `|weight| * channel` to a block of sums, fused.
#[inline(always)]
pub(super) fn accumulate_magnitude(weight: Arg<'_>, channel: &[Chunk], sums: &mut [Chunk]) {
    for (k, sum) in sums.iter_mut().enumerate() {
        let weight = match weight {
            Arg::Block(block) => block[k],
            Arg::Splat(x) => [x; LANES],
        };
        for lane in 0..LANES {
            sum[lane] = weight[lane].abs().mul_add(channel[k][lane], sum[lane]);
        }
    }
}
