//! Another back end, which whoever waits for it can stop.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{Agreement, Backend, BackendError, Executable, Filtered, Rect, Watch};
use crate::plan::Plan;
use crate::scene::Scene;

/// Pairs of pixels, times the weights that are computed for each, that machine code does in
/// about half a second on one thread: a scene of 256 x 256 pixels with windows of radius 10 and
/// 32 weights.
pub const PAIRS: usize = 1 << 30;

/// Runs plans on another back end, and fails with [`BackendError::Stopped`] as soon as a flag
/// is raised. Regions of plans of one window are filtered piece by piece for that, to the same
/// bits; programs look at the flag every few rows.
pub struct Stoppable<'a> {
    inner: &'a dyn Backend,
    stop: Arc<AtomicBool>,
    pairs: usize,
}

impl<'a> Stoppable<'a> {
    /// Does at most about so many `pairs` (times weights) between two looks at the flag.
    pub fn new(inner: &'a dyn Backend, stop: Arc<AtomicBool>, pairs: usize) -> Self {
        Self { inner, stop, pairs }
    }
}

impl Backend for Stoppable<'_> {
    fn name(&self) -> &'static str {
        self.inner.name()
    }

    fn agreement(&self) -> Agreement {
        self.inner.agreement()
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        go_on(&self.stop)?;
        let pixels = plan.window().map(|plan| {
            let each = plan.taps().count() * plan.weights();
            (self.pairs / each.max(1)).max(1)
        });
        Ok(Box::new(Code {
            inner: self.inner.compile(plan)?,
            stop: Arc::clone(&self.stop),
            pixels: pixels.unwrap_or(usize::MAX),
        }))
    }
}

fn go_on(stop: &AtomicBool) -> Result<(), BackendError> {
    if stop.load(Ordering::Relaxed) { Err(BackendError::Stopped) } else { Ok(()) }
}

struct Code {
    inner: Box<dyn Executable>,
    stop: Arc<AtomicBool>,
    /// Most pixels in a piece, unless a row has more.
    pixels: usize,
}

impl Executable for Code {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        let mut whole: Vec<Filtered> = Vec::new();
        let watch = |rows: usize| match watch(rows) {
            ControlFlow::Continue(()) if !self.stop.load(Ordering::Relaxed) => {
                ControlFlow::Continue(())
            }
            _ => ControlFlow::Break(()),
        };
        for piece in pieces(region, self.pixels) {
            go_on(&self.stop)?;
            let filtered = self.inner.run_watched(scene, &piece, &watch)?;
            if whole.is_empty() {
                whole = filtered;
                continue;
            }
            for (whole, Filtered { pixels, kept }) in whole.iter_mut().zip(filtered) {
                whole.pixels.extend(pixels);
                whole.kept.iter_mut().zip(kept).for_each(|(sum, kept)| *sum += kept);
            }
        }
        Ok(whole)
    }
}

/// A region in pieces of at most so many pixels, in its order: rectangles together, and such as
/// are too large cut into bands of about equal height. There is one piece at least.
fn pieces(region: &[Rect], pixels: usize) -> Vec<Vec<Rect>> {
    let mut pieces: Vec<Vec<Rect>> = vec![Vec::new()];
    let mut filled = 0usize;
    for rect in region.iter().copied() {
        let rows = (pixels / rect.width.max(1)).max(1);
        let bands = rect.height.div_ceil(rows).max(1);
        for band in 0..bands {
            let [top, bottom] = [band, band + 1].map(|band| band * rect.height / bands);
            let part = Rect { y: rect.y + top, height: bottom - top, ..rect };
            if filled > 0 && filled.saturating_add(part.pixels()) > pixels {
                pieces.push(Vec::new());
                filled = 0;
            }
            filled += part.pixels();
            pieces.last_mut().expect("there is one").push(part);
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::backend::Interpreter;
    use crate::expr::Tree;
    use crate::filter::Window;
    use crate::plan::{Passes, WindowPlan};
    use crate::scene::{LoadOptions, Needs, RawScene};

    fn scene() -> Scene {
        let channel = |salt: usize| (0..40 * 30).map(|k| (k * salt % 17) as f32 / 8.0).collect();
        RawScene::new("room", 40, 30, [5, 7, 11].map(channel))
            .prepare(&Needs::everything(), 3, &LoadOptions::default())
            .expect("a sound scene")
    }

    fn plan(scene: &Scene) -> Plan {
        let trees: Vec<Tree> =
            ["exp(-distance2(color, color))", "1", "0.5 - distance2(color, color)"]
                .map(|text| text.parse().expect("an expression"))
                .into();
        let facts = crate::scene::Facts::of_all([scene]);
        WindowPlan::new(&trees, Window::dense(3), &facts, Passes::ALL).expect("a plan").into()
    }

    /// Notes what it is given, and raises a flag at a run.
    struct Counting {
        runs: Arc<Mutex<Vec<usize>>>,
        last: Option<(usize, Arc<AtomicBool>)>,
    }

    impl Backend for Counting {
        fn name(&self) -> &'static str {
            "counting"
        }

        fn agreement(&self) -> Agreement {
            Agreement::Bits
        }

        fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
            let (runs, last) = (Arc::clone(&self.runs), self.last.clone());
            Ok(Box::new(Counted { inner: Interpreter.compile(plan)?, runs, last }))
        }
    }

    struct Counted {
        inner: Box<dyn Executable>,
        runs: Arc<Mutex<Vec<usize>>>,
        last: Option<(usize, Arc<AtomicBool>)>,
    }

    impl Executable for Counted {
        fn run_watched(
            &self,
            scene: &Scene,
            region: &[Rect],
            watch: &Watch<'_>,
        ) -> Result<Vec<Filtered>, BackendError> {
            let mut runs = self.runs.lock().expect("nobody panics with it");
            runs.push(region.iter().map(Rect::pixels).sum());
            if let Some((last, flag)) = &self.last
                && runs.len() == *last
            {
                flag.store(true, Ordering::Relaxed);
            }
            drop(runs);
            self.inner.run_watched(scene, region, watch)
        }
    }

    const REGION: [Rect; 4] = [
        Rect { x: 0, y: 0, width: 40, height: 30 },
        Rect { x: 3, y: 2, width: 5, height: 1 },
        Rect { x: 30, y: 20, width: 10, height: 10 },
        Rect { x: 1, y: 1, width: 2, height: 2 },
    ];

    #[test]
    fn pieces_change_no_bit() {
        let scene = scene();
        let plan = plan(&scene);
        let whole =
            Interpreter.compile(&plan).expect("code").run(&scene, &REGION).expect("it runs");
        let each = 49 * 3;
        for pixels in [1, 40, 41, 97, 500, 100_000] {
            let runs = Arc::new(Mutex::default());
            let counting = Counting { runs: Arc::clone(&runs), last: None };
            let stoppable = Stoppable::new(&counting, Arc::default(), pixels * each);
            let code = stoppable.compile(&plan).expect("code");
            assert_eq!(code.run(&scene, &REGION).expect("nobody stops it"), whole, "{pixels}");
            let runs = runs.lock().expect("nobody panics with it");
            // Less than a row is never run alone.
            assert!(runs.iter().all(|&run| run <= pixels.max(40)), "{pixels}: {runs:?}");
            assert_eq!(runs.iter().sum::<usize>(), REGION.iter().map(Rect::pixels).sum::<usize>());
        }
        let stoppable = Stoppable::new(&Interpreter, Arc::default(), 1);
        let code = stoppable.compile(&plan).expect("code");
        assert_eq!(code.run(&scene, &[]).expect("it runs").len(), 3);
    }

    #[test]
    fn nothing_is_run_once_the_flag_is_up() {
        let scene = scene();
        let plan = plan(&scene);
        let (runs, stop) = (Arc::new(Mutex::default()), Arc::new(AtomicBool::new(false)));
        let last = Some((3, Arc::clone(&stop)));
        let counting = Counting { runs: Arc::clone(&runs), last };
        let stoppable = Stoppable::new(&counting, stop, 40 * 49 * 3);
        let code = stoppable.compile(&plan).expect("code");
        assert!(matches!(code.run(&scene, &REGION), Err(BackendError::Stopped)));
        assert_eq!(*runs.lock().expect("nobody panics with it"), [40, 40, 40]);
        assert!(matches!(code.run(&scene, &REGION), Err(BackendError::Stopped)));
        assert!(matches!(stoppable.compile(&plan), Err(BackendError::Stopped)));
        assert_eq!(runs.lock().expect("nobody panics with it").len(), 3);
    }

    #[test]
    fn a_program_stops_on_its_way() {
        let scene = scene();
        let filter = crate::filter::shipped::programs().last().expect("one ships");
        let checked = filter.check().expect("it makes sense");
        let raw = RawScene::new("room", 40, 30, scene.noisy().rgb().map(<[f32]>::to_vec));
        let scene = raw
            .prepare(&checked.needs(), checked.reach(), &LoadOptions::default())
            .expect("a sound scene");
        let plan = Plan::of(&checked, &crate::scene::Facts::of(&scene), Passes::ALL);
        let stop = Arc::new(AtomicBool::new(false));
        let stoppable = Stoppable::new(&Interpreter, Arc::clone(&stop), PAIRS);
        let code = stoppable.compile(&plan.expect("a plan")).expect("code");
        let told = Mutex::new(Vec::new());
        // Somebody raises the flag while the first rows are told.
        let watch = |rows: usize| {
            told.lock().expect("nobody panics").push(rows);
            stop.store(true, Ordering::Relaxed);
            ControlFlow::Continue(())
        };
        let stopped = code.run_watched(&scene, &[Rect::whole(&scene)], &watch);
        assert!(matches!(stopped, Err(BackendError::Stopped)));
        let told = told.into_inner().expect("nobody panics");
        assert!(told.len() == 1 && told[0] < 30, "{told:?}");
    }

    #[test]
    fn a_stop_is_known_whatever_it_is_wrapped_in() {
        #[derive(Debug, thiserror::Error)]
        #[error("on the way")]
        struct Wrapped(#[source] BackendError);
        assert!(BackendError::is_stop(&Wrapped(BackendError::Stopped)));
        assert!(!BackendError::is_stop(&Wrapped(BackendError::ColorScale)));
    }
}
