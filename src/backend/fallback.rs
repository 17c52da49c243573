//! A GPU with the processor behind it: where the GPU fails, whatever the reason, the work is
//! done all the same, and whoever wants to know is told of the failure.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{Agreement, Backend, BackendError, Executable, Filtered, Rect, Watch};
use crate::plan::Plan;
use crate::scene::Scene;

/// A back end, and another that takes over when it fails.
pub struct Fallback {
    first: Box<dyn Backend>,
    behind: Arc<Behind>,
}

struct Behind {
    second: Box<dyn Backend>,
    /// Set by the first failure: what is lost stays lost.
    failed: AtomicBool,
    remarks: Remarks,
}

/// Who is told in a sentence, from any thread, what was chosen and what failed.
pub type Remarks = Arc<dyn Fn(&str) + Send + Sync>;

impl Fallback {
    /// Runs plans on the first back end, and once that fails on the second.
    pub fn new(first: Box<dyn Backend>, second: Box<dyn Backend>, remarks: Remarks) -> Self {
        let failed = AtomicBool::new(false);
        Self { first, behind: Arc::new(Behind { second, failed, remarks }) }
    }
}

impl Behind {
    fn take_over(&self, error: &BackendError) {
        if !self.failed.swap(true, Ordering::Relaxed) {
            (self.remarks)(&format!("{error}; {} goes on", self.second.name()));
        }
    }

    fn run(
        &self,
        plan: &Plan,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        self.second.compile(plan)?.run_watched(scene, region, watch)
    }
}

impl Backend for Fallback {
    fn name(&self) -> &'static str {
        match self.behind.failed.load(Ordering::Relaxed) {
            false => self.first.name(),
            true => self.behind.second.name(),
        }
    }

    fn agreement(&self) -> Agreement {
        self.first.agreement()
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        if self.behind.failed.load(Ordering::Relaxed) {
            return self.behind.second.compile(plan);
        }
        match self.first.compile(plan) {
            Ok(first) => {
                let (plan, behind) = (plan.clone(), self.behind.clone());
                Ok(Box::new(GuardedCode { first, plan, behind }))
            }
            Err(error) => {
                self.behind.take_over(&error);
                self.behind.second.compile(plan)
            }
        }
    }
}

/// A plan compiled by the first back end.
struct GuardedCode {
    first: Box<dyn Executable>,
    plan: Plan,
    behind: Arc<Behind>,
}

impl Executable for GuardedCode {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        if self.behind.failed.load(Ordering::Relaxed) {
            return self.behind.run(&self.plan, scene, region, watch);
        }
        match self.first.run_watched(scene, region, watch) {
            // What a scene lacks, or a plan takes for granted of it, is no failure of the GPU, and
            // who stopped it wants nothing else to begin.
            Err(
                error @ (BackendError::Unlike { .. }
                | BackendError::NotLoaded(_)
                | BackendError::Stopped
                | BackendError::Outside { .. }),
            ) => Err(error),
            Err(error) => {
                self.behind.take_over(&error);
                self.behind.run(&self.plan, scene, region, watch)
            }
            filtered => filtered,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;
    use crate::backend::Interpreter;
    use crate::filter::Window;
    use crate::plan::Passes;
    use crate::scene::{Facts, LoadOptions, Needs, RawScene};

    /// A device that works for some time and is then lost.
    struct Mortal {
        left: Arc<AtomicUsize>,
    }

    fn lost() -> BackendError {
        BackendError::NotBuilt { backend: "mortal" }
    }

    impl Backend for Mortal {
        fn name(&self) -> &'static str {
            "mortal"
        }

        fn agreement(&self) -> Agreement {
            Agreement::Bits
        }

        fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
            if self.left.load(Ordering::Relaxed) == 0 {
                return Err(lost());
            }
            let inner = Interpreter.compile(plan)?;
            Ok(Box::new(MortalCode { inner, left: self.left.clone() }))
        }
    }

    struct MortalCode {
        inner: Box<dyn Executable>,
        left: Arc<AtomicUsize>,
    }

    impl Executable for MortalCode {
        fn run_watched(
            &self,
            scene: &Scene,
            region: &[Rect],
            watch: &Watch<'_>,
        ) -> Result<Vec<Filtered>, BackendError> {
            match self.left.load(Ordering::Relaxed) {
                0 => Err(lost()),
                left => {
                    self.left.store(left - 1, Ordering::Relaxed);
                    self.inner.run_watched(scene, region, watch)
                }
            }
        }
    }

    #[test]
    fn what_the_first_leaves_undone_the_second_does() {
        let ramp: Vec<f32> = (0..60).map(|k| k as f32).collect();
        let scene = RawScene::new("ramp", 10, 6, [ramp.clone(), ramp.clone(), ramp])
            .prepare(&Needs::everything(), 2, &LoadOptions::default())
            .expect("a sound scene");
        let weight = "exp(-distance2(color, color))".parse().expect("an expression");
        let plan = Plan::new(&[weight], Window::dense(2), &Facts::of(&scene), Passes::ALL)
            .expect("the colour is there");
        let whole = [Rect::whole(&scene)];
        let expected =
            Interpreter.compile(&plan).and_then(|code| code.run(&scene, &whole)).expect("runs");
        for runs in 0..=4 {
            let first = Box::new(Mortal { left: Arc::new(AtomicUsize::new(runs)) });
            let backend = Fallback::new(first, Box::new(Interpreter), Arc::new(|_| {}));
            for _ in 0..2 {
                let code = backend.compile(&plan).expect("one of them compiles");
                assert_eq!(code.run(&scene, &whole).expect("one of them runs"), expected);
                assert_eq!(code.run(&scene, &whole).expect("one of them runs"), expected);
            }
            assert_eq!(backend.name(), if runs < 4 { "interp" } else { "mortal" });
        }
    }
}
