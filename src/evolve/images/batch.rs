//! Many expressions as one program.
//!
//! A generation is full of relatives. Planned together they share one tape, in
//! which what they have in common (subtrees, distances, loads) is computed once;
//! and expressions whose tapes are the same (`x`, `x * 1`) run once. Neither
//! changes a bit of any result: an expression's fitness is a function of the
//! expression alone, whatever company it was judged in.

use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::kin;
use super::sample::Sample;
use crate::backend::{Backend, BackendError};
use crate::expr::Tree;
use crate::expr::tape::{Instr, Tape, Value};
use crate::filter::Window;
use crate::plan::{Passes, Plan, PlanError, Precision, WindowPlan};
use crate::scene::{Facts, Scene};

/// How expressions become programs.
pub(super) struct Batching<'a> {
    pub(super) backend: &'a dyn Backend,
    pub(super) facts: Facts,
    pub(super) window: Window,
    pub(super) passes: Passes,
    /// Most expressions in one plan.
    pub(super) together: usize,
}

/// A plan's tapes as a key: equal keys, equal programs.
#[derive(PartialEq, Eq, Hash)]
struct Program(Vec<(Vec<Instr>, Vec<Value>)>);

impl Program {
    fn of(plan: &WindowPlan) -> Self {
        let code = |tape: &Tape| (tape.instrs().to_vec(), tape.results().to_vec());
        Self([plan.tap(), plan.pixel(), plan.pair()].map(code).into())
    }
}

impl Batching<'_> {
    /// A plan for whole images.
    pub(super) fn plan(&self, trees: &[Tree]) -> Result<Plan, PlanError> {
        Plan::new(trees, self.window, &self.facts, self.passes)
    }

    /// The passes for these samples. Computing pairs for both of their ends takes
    /// all rows above a rectangle and all columns beside it that reach it: in small
    /// tiles that is more than it saves. It changes no bit.
    fn passes_for(&self, samples: &[(&Scene, &Sample)]) -> Passes {
        let reach = self.window.reach() as usize;
        let rects = || {
            samples.iter().flat_map(|(scene, sample)| {
                let width = scene.layout().width();
                sample.region().iter().map(move |rect| (width, rect))
            })
        };
        let wanted: usize = rects().map(|(_, rect)| rect.pixels()).sum();
        let computed = rects().map(|(width, rect)| {
            (rect.width + 2 * reach).min(width) * (rect.height + (reach / 2).min(rect.y))
        });
        let compact = computed.sum::<usize>() * 4 < wanted * 5;
        Passes { symmetry: self.passes.symmetry && compact, ..self.passes }
    }

    /// Runs every tree on every sample and measures what comes out: per tree,
    /// what `measure` makes of the pixels of each sample, by its number. `None`
    /// for a tree that cannot be planned, which is a property of the tree.
    ///
    /// # Errors
    /// If the back end fails with a tree alone. That says nothing of the tree: memory
    /// was short, or the device was lost, and next time it may do.
    pub(super) fn run<T: Clone + Send + Sync>(
        &self,
        trees: &[Tree],
        samples: &[(&Scene, &Sample)],
        precision: Precision,
        measure: impl Fn(usize, &[[f32; 3]]) -> T + Sync,
    ) -> Result<Vec<Option<Vec<T>>>, BackendError> {
        let passes = Passes { precision, ..self.passes_for(samples) };
        let plan = |trees: &[Tree]| WindowPlan::new(trees, self.window, &self.facts, passes);
        let plans: Vec<Option<WindowPlan>> =
            trees.par_iter().map(|tree| plan(std::slice::from_ref(tree)).ok()).collect();
        // The first of those with equal programs runs for all of them.
        let mut first = FxHashMap::default();
        let leader: Vec<Option<usize>> = plans
            .iter()
            .enumerate()
            .map(|(k, plan)| Some(*first.entry(Program::of(plan.as_ref()?)).or_insert(k)))
            .collect();
        // One weight that may be negative makes a plan sum all magnitudes.
        let batches: Vec<Vec<usize>> = [false, true]
            .into_iter()
            .flat_map(|signed| {
                let (numbers, plans): (Vec<usize>, Vec<&WindowPlan>) = plans
                    .iter()
                    .enumerate()
                    .filter_map(|(k, plan)| Some((k, plan.as_ref()?)))
                    .filter(|&(k, plan)| leader[k] == Some(k) && plan.signed() == signed)
                    .unzip();
                let groups = kin::groups(&plans, self.together);
                groups.into_iter().map(move |group| group.iter().map(|&k| numbers[k]).collect())
            })
            .collect();
        let measured: Vec<Vec<(usize, Vec<T>)>> = batches
            .par_iter()
            .map(|batch| {
                let members: Vec<Tree> = batch.iter().map(|&k| trees[k].clone()).collect();
                let in_company = || {
                    let plan = plan(&members).ok().filter(|_| members.len() > 1)?;
                    self.measure(plan, samples, &measure).ok()
                };
                let alone = |&k: &usize| {
                    let plan = plans[k].as_ref().expect("batches are made of plans");
                    Ok(self.measure(plan.clone(), samples, &measure)?.swap_remove(0))
                };
                // What fails in company may well do alone: a smaller program needs less.
                let each: Vec<Vec<T>> = match in_company() {
                    Some(each) => each,
                    None => batch.iter().map(alone).collect::<Result<_, BackendError>>()?,
                };
                Ok(batch.iter().copied().zip(each).collect())
            })
            .collect::<Result<_, BackendError>>()?;
        let measured: FxHashMap<usize, Vec<T>> = measured.into_iter().flatten().collect();
        Ok(leader.into_iter().map(|leader| measured.get(&leader?).cloned()).collect())
    }

    /// Per weight of a plan, what `measure` makes of each sample.
    fn measure<T>(
        &self,
        plan: WindowPlan,
        samples: &[(&Scene, &Sample)],
        measure: impl Fn(usize, &[[f32; 3]]) -> T,
    ) -> Result<Vec<Vec<T>>, BackendError> {
        let weights = plan.pair().results().len();
        let code = self.backend.compile(&plan.into())?;
        let mut measured: Vec<Vec<T>> = (0..weights).map(|_| Vec::new()).collect();
        for (k, (scene, sample)) in samples.iter().enumerate() {
            let filtered = code.run(scene, sample.region())?;
            for (measured, filtered) in measured.iter_mut().zip(filtered) {
                measured.push(measure(k, &filtered.pixels));
            }
        }
        Ok(measured)
    }
}
