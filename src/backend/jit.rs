//! Machine code: a pair tape written into the lane assembler of `tamis-jit`,
//! one match over the primitives.

use tamis_jit::{Body, Chains, Compiler, Job, Kernel, Lanes, Width, WindowSpec};

use super::cpu::{CHANNELS, Frame, Rates, Summer, Taps, tapes};
use super::{Agreement, Backend, BackendError, Executable, Filtered, Rect};
use crate::expr::feature::PlaneId;
use crate::expr::tape::{Input, Instr, Prim, Side, Tape};
use crate::plan::{Plan, Run};
use crate::scene::Scene;

/// Compiles tapes to machine code.
#[derive(Clone)]
pub struct Jit {
    compiler: Compiler,
    chains: Option<Chains>,
}

impl Jit {
    /// A compiler for this machine, with vectors as wide as it has them.
    ///
    /// # Errors
    /// If there is no code generator for the processor, or it lacks a fused
    /// multiply-add.
    pub fn new() -> Result<Self, BackendError> {
        Ok(Self::with(Compiler::host()?))
    }

    /// A compiler for this machine, with vectors of this width: they give the same
    /// bits.
    ///
    /// # Errors
    /// As for [`new`](Self::new), and if the processor has no such vectors.
    pub fn with_width(width: Width) -> Result<Self, BackendError> {
        Ok(Self::with(Compiler::with_width(width)?))
    }

    fn with(compiler: Compiler) -> Self {
        Self { compiler, chains: None }
    }

    /// How wide its vectors are.
    pub fn width(&self) -> Width {
        self.compiler.width()
    }

    /// The same compiler always interleaving this number of chains, instead of as
    /// many as suit each expression: to the same bits.
    #[must_use]
    pub fn with_chains(self, chains: Chains) -> Self {
        Self { chains: Some(chains), ..self }
    }
}

struct Compiled {
    plan: Plan,
    rates: Rates,
    pair: Pair,
}

/// A compiled pair tape.
struct Pair {
    kernel: Kernel,
    /// The planes that the kernel reads after its channels.
    planes: Vec<PlaneId>,
}

impl Backend for Jit {
    fn name(&self) -> &'static str {
        "jit"
    }

    fn agreement(&self) -> Agreement {
        Agreement::Bits
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        let tapes = tapes(plan);
        let planes = planes(&tapes.pair);
        let spec = WindowSpec {
            planes: CHANNELS + planes.len() + tapes.pixel.results().len(),
            taps: tapes.tap.results().len(),
            channels: CHANNELS,
            weights: plan.weights(),
            absolute: plan.signed(),
            mirrored: plan.mirrored().is_some(),
        };
        let body = TapeBody { tape: &tapes.pair, planes: &planes };
        let kernel = self.compiler.compile(spec, self.chains, &body)?;
        let pair = Pair { kernel, planes };
        Ok(Box::new(Compiled { plan: plan.clone(), rates: Rates::new(plan), pair }))
    }
}

impl Executable for Compiled {
    fn run(&self, scene: &Scene, region: &[Rect]) -> Result<Vec<Filtered>, BackendError> {
        self.rates.run(&self.plan, &self.pair, scene, region)
    }
}

impl Summer for Pair {
    type Scratch = ();

    fn step(&self) -> usize {
        self.kernel.step()
    }

    fn add(
        &self,
        frame: &Frame<'_>,
        taps: Taps<'_>,
        rect: Rect,
        (): &mut (),
        sums: &mut [f32],
        owed: &mut [f32],
    ) -> Result<(), BackendError> {
        let planes: Vec<&[f32]> = frame
            .channels
            .into_iter()
            .chain(self.planes.iter().map(|&plane| frame.plane(plane)))
            .chain(frame.per_pixel.iter().map(Vec::as_slice))
            .collect();
        let layout = tamis_jit::Layout {
            width: frame.layout.width(),
            height: frame.layout.height(),
            pad: frame.layout.pad(),
            stride: frame.layout.stride(),
        };
        let run = |run: &Run| tamis_jit::Run {
            dx: run.dx as isize,
            dy: run.dy as isize,
            count: run.count as usize,
            step: run.step as isize,
        };
        let runs: Vec<tamis_jit::Run> = taps.runs.iter().map(run).collect();
        let rect =
            tamis_jit::Rect { x: rect.x..rect.x + rect.width, y: rect.y..rect.y + rect.height };
        let job = Job { layout, planes: &planes, runs: &runs, taps: taps.values, rect };
        self.kernel.run(&job, sums, owed)?;
        Ok(())
    }
}

/// The planes that a pair tape reads, each once.
fn planes(tape: &Tape) -> Vec<PlaneId> {
    let mut planes: Vec<PlaneId> = tape
        .inputs()
        .filter_map(|input| match input {
            Input::Plane(plane, _) => Some(plane),
            Input::Offset(_) | Input::PerPixel(..) | Input::PerTap(_) => None,
        })
        .collect();
    planes.sort_unstable();
    planes.dedup();
    planes
}

fn end(side: Side) -> tamis_jit::Side {
    match side {
        Side::I => tamis_jit::Side::I,
        Side::J => tamis_jit::Side::J,
    }
}

/// A tape as the straight-line program inside the window loop.
struct TapeBody<'a> {
    tape: &'a Tape,
    planes: &'a [PlaneId],
}

impl TapeBody<'_> {
    fn input<L: Lanes>(&self, lanes: &mut L, input: Input) -> L::F {
        match input {
            Input::Plane(plane, side) => {
                let index = self.planes.binary_search(&plane);
                let index = index.expect("planes() listed every plane of the tape");
                lanes.plane(CHANNELS + index, end(side))
            }
            Input::PerPixel(k, side) => {
                lanes.plane(CHANNELS + self.planes.len() + k as usize, end(side))
            }
            Input::PerTap(k) => lanes.tap(k as usize),
            Input::Offset(_) => unreachable!("offsets are read through the tap tape"),
        }
    }
}

impl Body for TapeBody<'_> {
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
        let mut values: Vec<L::F> = Vec::with_capacity(self.tape.instrs().len());
        for instr in self.tape.instrs() {
            let value = match *instr {
                Instr::Const(bits) => lanes.constant(f32::from_bits(bits)),
                Instr::Input(input) => self.input(lanes, input),
                Instr::Prim(prim, args) => {
                    let [a, b, c, d] = args.map(|a| values[a.index()]);
                    match prim {
                        Prim::Neg => lanes.neg(a),
                        Prim::Abs => lanes.abs(a),
                        Prim::Sqrt => lanes.sqrt(a),
                        Prim::Round => lanes.round(a),
                        Prim::Exp2i => lanes.exp2i(a),
                        Prim::Exponent => lanes.exponent(a),
                        Prim::Mantissa => lanes.mantissa(a),
                        Prim::Add => lanes.add(a, b),
                        Prim::Sub => lanes.sub(a, b),
                        Prim::Mul => lanes.mul(a, b),
                        Prim::Div => lanes.div(a, b),
                        Prim::Min => lanes.min(a, b),
                        Prim::Max => lanes.max(a, b),
                        Prim::Fma => lanes.fma(a, b, c),
                        Prim::SelectLt => {
                            let below = lanes.lt(a, b);
                            lanes.select(below, c, d)
                        }
                    }
                }
            };
            values.push(value);
        }
        self.tape.results().iter().map(|r| values[r.index()]).collect()
    }
}
