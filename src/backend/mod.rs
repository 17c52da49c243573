//! Floor 5: back ends run plans on scenes. They contain no policy: what is
//! computed, and what is skipped, was decided in the plan.
//!
//! Two back ends run on the CPU and give the same bits: [`Interpreter`], the
//! reference, and [`Jit`], machine code. The [`mod@reference`] room computes a filter's
//! exact meaning in f64; it is no back end, but what back ends are held to.
//!
//! **The sum.** Σ c·w and Σ w are accumulated by fused multiply-adds per run of
//! taps (a row of the window; the row of pixel i in three parts), and the runs are
//! then added, in the order of [`Taps`](crate::plan::Taps). So a sum over
//! n = (2r+1)² taps carries the rounding of 4r+4 additions in a chain, not of n:
//! for weights of one sign, a relative error below (2r+2) · 2^-23, 2.6e-6 at
//! radius 10. A tap outside the image meets zero in all channels, the constant-one
//! channel of Σ w included, and so drops out.
//!
//! **The guard.** Where Σ w cannot be trusted the noisy colour stays, and is
//! counted: see [`TRUSTED_SUM`] and [`TRUSTED_SHARE`].

mod choice;
mod cpu;
mod fallback;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod reference;
#[cfg(feature = "gpu")]
pub mod shader;
mod stoppable;

use std::any::Any;
use std::ops::ControlFlow;

use crate::plan::{Gradient, Plan, Precision};
use crate::scene::{Fact, Facts, Scene};

pub use choice::{Choice, Opening, auto};
pub use cpu::Interpreter;
#[cfg(feature = "jit")]
pub use cpu::Jit;
pub use fallback::{Fallback, Remarks};
#[cfg(feature = "gpu")]
pub use gpu::Gpu;
pub use reference::Exact;
pub use stoppable::{PAIRS, Stoppable};
#[cfg(feature = "jit")]
pub use tamis_jit::{Chains, CpuFeatures, Width};

/// Sums of weights (in magnitude) below this are treated as zero: with weights
/// so small, products with dark colours are subnormal and carry no precision.
pub const TRUSTED_SUM: f32 = 1e-30;

/// With weights of both signs, |Σ w| must be at least this share of Σ |w|:
/// cancellation magnifies rounding errors by the reciprocal, at most 1024-fold.
pub const TRUSTED_SHARE: f32 = 1.0 / 1024.0;

/// What a back end promises of every pixel whose weights sum to at least
/// [`SMALLEST_SUM`] in magnitude and that the guard lets through: the greatest
/// difference from the exact meaning, relative to the pixel's colour, for weights
/// of one sign. With weights of both signs it grows by the sums' condition,
/// Σ |w| / |Σ w|.
pub const ACCURACY: f64 = 1e-5;

/// The same where functions are made with [`Precision::Fast`](crate::plan::Precision).
/// Short exponentials and powers are within 600 units in the last place, built-in ones of
/// shaders within 3 + 2 abs(x), and weights below a millionth of the greatest hardly count.
pub const FAST_ACCURACY: f64 = 1e-4;

/// Smaller sums of weights may be further from exact than [`ACCURACY`]. A factor
/// below the normal numbers, 1e-38, is flushed to zero; beside another as large as
/// [`LIMIT`](crate::expr::builder::LIMIT), 1e18, that takes 1e-20 from a weight, and
/// 1e-17 from a thousand.
pub const SMALLEST_SUM: f32 = 1e-12;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Rect {
    /// Leftmost column.
    pub x: usize,
    /// Topmost row.
    pub y: usize,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

impl Rect {
    /// The whole of a scene.
    pub fn whole(scene: &Scene) -> Self {
        Self { x: 0, y: 0, width: scene.layout().width(), height: scene.layout().height() }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }
}

/// The filtered colours of some pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filtered {
    /// Linear R, G, B; rectangle after rectangle, each row by row.
    pub pixels: Vec<[f32; 3]>,
    /// By stage of the filter: how many of its pixels kept what was to be averaged (of the
    /// paper's filters the noisy colour), because their weights summed to nothing that can
    /// be trusted. Maps average nothing.
    pub kept: Vec<usize>,
}

/// How far a back end's results may be from the interpreter's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Agreement {
    /// Equal bit for bit.
    Bits,
    /// Within a relative difference.
    Budget(f64),
}

impl Agreement {
    /// How far from the exact meaning results of such a plan may be, where anything is
    /// promised.
    pub fn bound(self, precision: Precision) -> f64 {
        match (self, precision) {
            (Self::Bits, Precision::Standard) => ACCURACY,
            (Self::Bits, Precision::Fast) => FAST_ACCURACY,
            (Self::Budget(budget), _) => budget,
        }
    }
}

/// Why a back end could not run a plan.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// The machine code could not be made or installed.
    #[cfg(feature = "jit")]
    #[error("the expression could not be compiled: {0}; `--backend interp` runs it all the same")]
    Compile(#[from] tamis_jit::CompileError),
    /// The machine code was given data of the wrong shape: an error of ours.
    #[cfg(feature = "jit")]
    #[error("the compiled filter refused its data: {0}")]
    Shape(#[from] tamis_jit::ShapeError),
    /// The GPU failed.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] gpu::GpuError),
    /// This build does not have the back end.
    #[error("this build has no back end `{backend}`; build it with the feature `{backend}`")]
    NotBuilt {
        /// Its name, and its feature's.
        backend: &'static str,
    },
    /// The scene's planes are padded for smaller windows.
    #[error("the window reaches {reach} pixels but the scene was loaded for windows of {pad}")]
    Padding {
        /// The window's reach.
        reach: usize,
        /// The scene's padding.
        pad: usize,
    },
    /// The scene was loaded without a plane that the plan reads.
    #[error("the scene was loaded without `{0}`")]
    NotLoaded(crate::expr::PlaneId),
    /// The scene's colours are laid out for the paper's filters.
    #[error("programs compute with linear colours, but the scene was loaded with compressed ones")]
    ColorScale,
    /// The plan is specialised to facts that do not hold of the scene.
    #[error(
        "the filter was compiled for scenes in which `{plane}` {assumed}, \
         but in `{scene}` it {actual}; compile it for this scene"
    )]
    Unlike {
        /// The scene.
        scene: String,
        /// Of which plane something else holds.
        plane: crate::expr::PlaneId,
        /// What the plan was made for.
        assumed: Fact,
        /// What holds of the scene.
        actual: Fact,
    },
    /// A rectangle lies outside of the image.
    #[error("{rect:?} lies outside of an image of {width} x {height} pixels")]
    Outside {
        /// The rectangle.
        rect: Rect,
        /// The image's width.
        width: usize,
        /// The image's height.
        height: usize,
    },
    /// Somebody asked to stop: a [`Watch`], or whoever raised the flag of a [`Stoppable`].
    #[error("it was stopped")]
    Stopped,
}

impl BackendError {
    /// Whether an error says no more than that somebody asked to stop, whatever it is wrapped in.
    pub fn is_stop(error: &(dyn std::error::Error + 'static)) -> bool {
        let mut cause = Some(error);
        while let Some(error) = cause {
            if matches!(error.downcast_ref(), Some(Self::Stopped)) {
                return true;
            }
            cause = error.source();
        }
        false
    }
}

/// Something that turns plans into code.
pub trait Backend: Send + Sync {
    /// What `--backend` calls it.
    fn name(&self) -> &'static str;

    /// How its results compare to the interpreter's.
    fn agreement(&self) -> Agreement;

    /// Makes a plan executable.
    ///
    /// # Errors
    /// If that fails.
    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError>;
}

/// A plan in executable form.
pub trait Executable: Send + Sync {
    /// Filters the given rectangles of a scene: one [`Filtered`] per weight of
    /// the plan. Runs on the current rayon pool; the result does not depend on
    /// its number of threads.
    ///
    /// # Errors
    /// If the scene lacks a plane that the plan's weights read; if the code relies on the
    /// plan's [facts](crate::plan::WindowPlan::facts) and they do not hold of the scene; if a
    /// rectangle lies outside of it; if the device fails.
    fn run(&self, scene: &Scene, region: &[Rect]) -> Result<Vec<Filtered>, BackendError> {
        self.run_watched(scene, region, UNWATCHED)
    }

    /// The same, and tells how far it is: rows of the region's rectangles as they are done, all
    /// of them when it returns.
    ///
    /// # Errors
    /// Those of [`run`](Self::run), and [`BackendError::Stopped`] if the watch breaks off.
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError>;
}

/// Whoever is told, from any thread, that so many more rows are done, and says whether to go on.
/// Programs tell every few rows; plans of one window tell strip by strip, of which a single thread
/// may have but one.
pub type Watch<'w> = dyn Fn(usize) -> ControlFlow<()> + Sync + 'w;

/// Nobody looks.
pub const UNWATCHED: &Watch<'static> = &|_| ControlFlow::Continue(());

/// Tells a watch, and stops where it says so.
fn tell(watch: &Watch<'_>, rows: usize) -> Result<(), BackendError> {
    match watch(rows) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(BackendError::Stopped),
    }
}

/// A loss: given the filtered colours of a whole image, row by row in units of the exposure,
/// it says how bad they are, and writes its derivative by each of them.
pub type Loss<'l> = dyn FnMut(&[[f32; 3]], &mut [[f32; 3]]) -> f64 + 'l;

/// Memory that running a [`Differentiable`] leaves to the next run on a scene of the same
/// size.
#[derive(Default)]
pub struct Workspace(Option<Box<dyn Any + Send>>);

/// Something that turns programs and their adjoints into code.
pub trait Differentiator: Send + Sync {
    /// Makes them executable.
    ///
    /// # Errors
    /// If that fails.
    fn differentiate(&self, gradient: &Gradient) -> Result<Box<dyn Differentiable>, BackendError>;
}

/// A program and its adjoint in executable form.
pub trait Differentiable: Send + Sync {
    /// Filters a scene with these values of the constants that may be tuned, asks for the
    /// loss, and adds its derivatives by every constant, in the order of
    /// [`Constants`](crate::expr::Constants). Returns the loss. It runs on one thread: whoever
    /// has several scenes gives each a thread.
    ///
    /// # Errors
    /// Those of [`Executable::run`].
    ///
    /// # Panics
    /// If there are not as many values and derivatives as constants.
    fn run(
        &self,
        scene: &Scene,
        constants: &[f32],
        loss: &mut Loss<'_>,
        workspace: &mut Workspace,
        derivatives: &mut [f64],
    ) -> Result<f64, BackendError>;
}

/// Checks that what a plan or a program takes for granted holds of a scene.
fn holds(facts: &Facts, scene: &Scene) -> Result<(), BackendError> {
    for (plane, assumed) in facts.iter() {
        let actual = scene.fact(plane);
        if actual == Fact::Absent {
            return Err(BackendError::NotLoaded(plane));
        }
        if !assumed.covers(actual) {
            let scene = scene.name().to_owned();
            return Err(BackendError::Unlike { scene, plane, assumed, actual });
        }
    }
    Ok(())
}

/// Checks that rectangles lie inside of the image.
fn inside(scene: &Scene, region: &[Rect]) -> Result<(), BackendError> {
    let (width, height) = (scene.layout().width(), scene.layout().height());
    let fits = |rect: &Rect| rect.x + rect.width <= width && rect.y + rect.height <= height;
    match region.iter().find(|rect| !fits(rect)) {
        None => Ok(()),
        Some(&rect) => Err(BackendError::Outside { rect, width, height }),
    }
}

/// The noisy colour of a pixel.
fn color_at(scene: &Scene, x: usize, y: usize) -> [f32; 3] {
    scene.color().each_ref().map(|channel| channel.at(x, y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::interval::Interval;
    use crate::expr::{Feature, PlaneId, Quantity};

    #[test]
    fn a_refusal_says_what_was_assumed_and_what_is() {
        let plane =
            PlaneId { feature: Feature::SecTexture, quantity: Quantity::Value, component: 0 };
        let error = BackendError::Unlike {
            scene: "showroom".to_owned(),
            plane,
            assumed: Fact::Constant(0.0),
            actual: Fact::Range(Interval::new(0.0, 0.5)),
        };
        assert_eq!(
            error.to_string(),
            "the filter was compiled for scenes in which `secTexture[0]` is 0 everywhere, \
             but in `showroom` it lies between 0 and 0.5; compile it for this scene"
        );
    }
}
