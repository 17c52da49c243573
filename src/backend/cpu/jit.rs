//! Machine code: a pair tape written into the lane assembler of `tamis-jit`,
//! one match over the primitives.

use tamis_jit::{Body, Chains, Compiler, CpuFeatures, Job, Lanes, Routine, Width, WindowSpec};

use super::gradient::GradientCode;
use super::paper::{CHANNELS, Rates, tapes};
use super::program::{self, Engine, MapBlock, Mapper, Summed};
use super::sums::{Frame, Summer, Taps};
use crate::backend::{
    Agreement, Backend, BackendError, Differentiable, Differentiator, Executable, Filtered, Rect,
    Watch,
};
use crate::expr::feature::PlaneId;
use crate::expr::tape::{Input, Instr, Prim, Side, Tape};
use crate::plan::{Gradient, MapKernel, PairLoop, Plan, Run, WindowPlan};
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
    /// If there is no code generator for the processor.
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

    /// A compiler for this machine as if it had no more than these instruction sets:
    /// they give the same bits.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn with_features(features: CpuFeatures) -> Result<Self, BackendError> {
        Ok(Self::with(Compiler::with_features(features)?))
    }

    fn with(compiler: Compiler) -> Self {
        Self { compiler, chains: None }
    }

    /// The instructions that this machine lacks, or is to do without: they take longer,
    /// to the same bits.
    pub fn emulated(&self) -> Vec<&'static str> {
        self.compiler.emulated()
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

struct WindowCode {
    plan: WindowPlan,
    rates: Rates,
    pair: Pair,
}

/// A compiled pair tape.
pub(super) struct Pair {
    kernel: Routine,
    /// The planes that the kernel reads after its channels.
    planes: Vec<PlaneId>,
}

/// A compiled map: a window of one tap, whose weights are the results and whose only
/// channel is one.
pub(super) struct Map {
    kernel: Routine,
}

impl Engine for Jit {
    type Map = Map;
    type Gather = Pair;

    fn map(&self, kernel: &MapKernel) -> Result<Map, BackendError> {
        let results = kernel.writes.len();
        let spec = WindowSpec {
            planes: 1 + kernel.reads.len(),
            taps: kernel.uniform.results().len(),
            channels: 1,
            weights: results,
            absolute: false,
            lone: false,
            mirrored: false,
        };
        let body = TapeBody { tape: &kernel.tape, planes: &[], channels: 1 };
        Ok(Map { kernel: self.compiler.compile(spec, self.chains, &body)? })
    }

    fn pairs(&self, pairs: &PairLoop, summed: Summed) -> Result<Pair, BackendError> {
        let planes = pairs.planes();
        let Summed { channels, weights, signed, lone } = summed;
        let spec = WindowSpec {
            planes: channels + planes.len() + pairs.reads.len(),
            taps: pairs.tap.results().len(),
            channels,
            weights,
            absolute: signed,
            lone,
            mirrored: pairs.mirrored,
        };
        let body = TapeBody { tape: &pairs.pair, planes: &planes, channels };
        let kernel = self.compiler.compile(spec, self.chains, &body)?;
        Ok(Pair { kernel, planes })
    }
}

impl Mapper for Map {
    type Scratch = ();

    fn step(&self) -> usize {
        self.kernel.step()
    }

    fn rows(
        &self,
        inputs: &[&[f32]],
        uniform: &[f32],
        block: MapBlock,
        (): &mut (),
        outputs: &mut [f32],
    ) -> Result<(), BackendError> {
        let MapBlock { layout, rows, pad } = block;
        let (width, stride) = (layout.width(), layout.stride());
        let layout = match rows {
            // The row may end where the plane does.
            1 => tamis_jit::Layout { width, height: 1, pad, stride: width + self.step() - 1 },
            height => tamis_jit::Layout { width, height, pad, stride },
        };
        let runs = [tamis_jit::Run { dx: 0, dy: 0, count: 1, step: 1 }];
        let rect = tamis_jit::Rect { x: 0..width, y: 0..rows };
        let job = Job { layout, planes: inputs, runs: &runs, taps: uniform, rect };
        self.kernel.run(&job, outputs, &mut [])?;
        Ok(())
    }
}

impl Backend for Jit {
    fn name(&self) -> &'static str {
        "jit"
    }

    fn agreement(&self) -> Agreement {
        Agreement::Bits
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        let plan = match plan {
            Plan::Window(plan) => plan,
            Plan::Program(program) => {
                return Ok(Box::new(program::ProgramCode::new(self, program)?));
            }
        };
        let planes = planes(&tapes(plan).pair);
        let body = TapeBody { tape: &tapes(plan).pair, planes: &planes, channels: CHANNELS };
        let kernel = self.compiler.compile(spec(plan, &planes), self.chains, &body)?;
        let pair = Pair { kernel, planes };
        Ok(Box::new(WindowCode { plan: (**plan).clone(), rates: Rates::new(plan), pair }))
    }
}

impl Differentiator for Jit {
    fn differentiate(&self, gradient: &Gradient) -> Result<Box<dyn Differentiable>, BackendError> {
        Ok(Box::new(GradientCode::new(self, gradient)?))
    }
}

impl Executable for WindowCode {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        self.rates.run(&self.plan, &self.pair, scene, region, watch)
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
            .iter()
            .copied()
            .chain(self.planes.iter().map(|&plane| frame.plane(plane)))
            .chain(frame.per_pixel.iter().map(|plane| &**plane))
            .chain(frame.signals.iter().copied())
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
            Input::Offset(_)
            | Input::PerPixel(..)
            | Input::PerTap(_)
            | Input::Signal(..)
            | Input::Constant(_) => None,
        })
        .collect();
    planes.sort_unstable();
    planes.dedup();
    planes
}

/// What the kernel of a plan sums, and over how many of each.
fn spec(plan: &WindowPlan, planes: &[PlaneId]) -> WindowSpec {
    let tapes = tapes(plan);
    WindowSpec {
        planes: CHANNELS + planes.len() + tapes.pixel.results().len(),
        taps: tapes.tap.results().len(),
        channels: CHANNELS,
        weights: plan.weights(),
        absolute: plan.signed(),
        lone: false,
        mirrored: plan.mirrored().is_some(),
    }
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
    channels: usize,
}

impl TapeBody<'_> {
    fn input<L: Lanes>(&self, lanes: &mut L, input: Input) -> L::F {
        match input {
            Input::Plane(plane, side) => {
                let index = self.planes.binary_search(&plane);
                let index = index.expect("planes() listed every plane of the tape");
                lanes.plane(self.channels + index, end(side))
            }
            // A plan has the former, a program's kernel the latter.
            Input::PerPixel(k, side) | Input::Signal(k, side) => {
                lanes.plane(self.channels + self.planes.len() + k as usize, end(side))
            }
            Input::PerTap(k) => lanes.tap(k as usize),
            Input::Offset(_) | Input::Constant(_) => {
                unreachable!("they are read through the tap tape")
            }
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
                        Prim::Fraction => lanes.fraction(a),
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use tamis_jit::CrossCompiler;

    use super::*;
    use crate::expr::{Tree, codebook};
    use crate::filter::Window;
    use crate::plan::Passes;
    use crate::scene::Facts;

    /// The weights that are known by name, and bred ones.
    fn filters() -> Vec<Tree> {
        let named = codebook::known().iter().map(|known| known.weight.clone());
        let bred = include_str!("../../../tests/fixture/bred.txt").lines();
        let bred = bred.filter(|line| !line.starts_with('#') && !line.is_empty());
        let bred = bred.map(|line| line.parse().expect("the fixture is sound"));
        named.chain(bred).collect()
    }

    /// Code for AArch64, which most machines that test cannot run, is verified and calls
    /// no function; `scripts/emulated` runs it.
    #[test]
    fn filters_compile_for_aarch64() {
        let compiler = CrossCompiler::new("aarch64-unknown-linux-gnu", &[]);
        let compiler = compiler.expect("the tests build this target");
        let mut mirrored = 0;
        for (n, weight) in filters().iter().enumerate() {
            let weights = std::slice::from_ref(weight);
            let passes = Passes { symmetry: n % 2 == 0, ..Passes::ALL };
            let plan = WindowPlan::new(weights, Window::dense(4), &Facts::of_any_scene(), passes);
            let plan = plan.expect("any scene has every feature");
            mirrored += usize::from(plan.mirrored().is_some());
            let tape = &tapes(&plan).pair;
            let planes = planes(tape);
            for chains in Chains::ALL {
                let body = TapeBody { tape, planes: &planes, channels: CHANNELS };
                let code = compiler.compile(spec(&plan, &planes), chains, &body);
                let code = code.unwrap_or_else(|why| panic!("{weight}: {why}"));
                // An instruction of the tape is one of four bytes at least, in each chain.
                let prims = tape.instrs().iter().filter(|i| matches!(i, Instr::Prim(..))).count();
                let least = 4 * chains.count() * prims;
                assert!(code.len() > least, "{weight}: {} bytes of {least}", code.len());
            }
        }
        assert!(mirrored > 3, "{mirrored}");
    }

    /// Seconds that this thread has computed, whoever else does, to some milliseconds.
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    fn computed() -> f64 {
        let stat = std::fs::read_to_string("/proc/thread-self/schedstat").expect("Linux has it");
        let nanoseconds = stat.split(' ').next().expect("a first field");
        nanoseconds.parse::<f64>().expect("a number") / 1e9
    }

    /// `cargo test --lib price_of_older -- --ignored --nocapture`
    #[test]
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    #[ignore = "a measurement: nanoseconds per pixel pair"]
    fn price_of_older_processors() {
        use crate::scene::{LoadOptions, Needs};

        let sse41 = CpuFeatures { sse41: true, ..CpuFeatures::default() };
        let older = [CpuFeatures { avx: true, ..sse41 }, sse41, CpuFeatures::default()];
        let jits = [Jit::with_width(Width::Bits128)]
            .into_iter()
            .chain(older.map(Jit::with_features))
            .map(|jit| jit.expect("older processors have less"));
        let jits: Vec<Jit> = jits.collect();
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test/courtyard/4spp.exr");
        let window = Window::dense(8);
        let scene = Scene::load(&file, &Needs::everything(), 8, &LoadOptions::default());
        let scene = scene.expect("the project's own scene");
        let rect = Rect { x: 0, y: 60, width: scene.layout().width(), height: 8 };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
        println!("FMA, AVX, SSE4.1, SSE2");
        // Those of the first filters that take long enough to be measured so.
        for weight in &filters()[3..6] {
            let plan =
                Plan::new(std::slice::from_ref(weight), window, &Facts::of(&scene), Passes::ALL);
            let plan = plan.expect("the scene has every feature");
            let codes: Vec<_> = jits.iter().map(|jit| jit.compile(&plan).expect("sound")).collect();
            // The fastest of interleaved rounds.
            let mut times = vec![f64::INFINITY; codes.len()];
            for _ in 0..5 {
                for (code, time) in codes.iter().zip(&mut times) {
                    let spent = pool.install(|| {
                        let start = computed();
                        code.run(&scene, &[rect]).expect("the plan was made for this scene");
                        computed() - start
                    });
                    *time = time.min(spent);
                }
            }
            let pairs = (rect.pixels() * window.taps()) as f64;
            let times = times.iter().map(|time| format!("{:.2}", time * 1e9 / pairs));
            println!("{}  {weight:.40}", times.collect::<Vec<_>>().join("  "));
        }
    }
}
