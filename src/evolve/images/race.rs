//! How a race between expressions is run: rung by rung, on more and more pixels.

use std::sync::{Arc, Mutex};

use rustc_hash::FxHashMap;

use super::rungs::{Ladder, Rung, TileErrors};
use super::sample::{Sample, mean};
use super::{ImageFitness, JudgeError, total};
use crate::evolve::individual::Judgement;
use crate::evolve::race::{Entrant, Ruling};
use crate::expr::Tree;
use crate::scene::Scene;

/// What races need beside the fitness itself.
pub(super) struct Course {
    pub(super) ladder: Ladder,
    /// A newcomer is dropped when its excess over the bar is more than so many
    /// standard errors.
    pub(super) deviations: f64,
    /// The tiles' errors of expressions that were judged in full: the bars come
    /// from among them. What is not here is computed when it is needed, to the
    /// same bits.
    pub(super) known: Mutex<FxHashMap<Tree, Arc<TileErrors>>>,
}

/// Expressions whose tile errors are kept: some generations of the paper's size,
/// tens of megabytes.
const KNOWN: usize = 4096;

impl Course {
    fn keep(&self, tree: &Tree, errors: Arc<TileErrors>) {
        let mut known = self.known.lock().expect("nobody panics while holding it");
        if known.len() >= KNOWN {
            known.clear();
        }
        known.insert(tree.clone(), errors);
    }
}

impl ImageFitness<'_> {
    /// Runs a race.
    pub(super) fn run_race(
        &self,
        course: &Course,
        entrants: &[Entrant<'_>],
    ) -> Result<Vec<Ruling>, JudgeError> {
        let taps = self.batching.window.taps();
        let work = |pixels: usize| (pixels * taps) as u64;
        let bars = self.bars(course, entrants)?;
        let mut rulings: Vec<Option<Ruling>> = vec![None; entrants.len()];
        let mut seen: Vec<TileErrors> = vec![vec![Vec::new(); self.scenes.len()]; entrants.len()];
        let mut running: Vec<usize> =
            (0..entrants.len()).filter(|&k| entrants[k].bar.is_some()).collect();
        for (number, rung) in course.ladder.rungs.iter().enumerate() {
            let trees: Vec<Tree> = running.iter().map(|&k| entrants[k].tree.clone()).collect();
            let spent = work(course.ladder.pixels(number + 1));
            for (&k, errors) in running.iter().zip(self.tile_errors(&trees, rung)?) {
                let bar = entrants[k].bar.expect("only those with a bar run up the rungs");
                let verdict = match errors {
                    // As in `errors`: good for nothing, and that is known.
                    None => Some(Judgement::Full(f64::INFINITY)),
                    Some(errors) => {
                        for (seen, errors) in seen[k].iter_mut().zip(errors) {
                            seen.extend(errors);
                        }
                        let (excess, doubt) = course.ladder.excess(&seen[k], &bars[bar.tree]);
                        // An error that is no number is beyond doubt.
                        let open = excess <= course.deviations * doubt;
                        let hopeless = excess > 0.0 && !open;
                        hopeless.then_some(Judgement::Dropped(bar.fitness + excess))
                    }
                };
                rulings[k] = verdict.map(|verdict| Ruling { verdict, work: spent });
            }
            running.retain(|&k| rulings[k].is_none());
        }

        let finalists: Vec<usize> = (0..entrants.len()).filter(|&k| rulings[k].is_none()).collect();
        let trees: Vec<Tree> = finalists.iter().map(|&k| entrants[k].tree.clone()).collect();
        let values = self.unless_refused(&trees, |trees| self.in_full(course, trees))?;
        for (&k, value) in finalists.iter().zip(values) {
            // The last rung is run as a whole, what was seen before included.
            let rungs = if entrants[k].bar.is_some() { course.ladder.rungs.len() } else { 0 };
            let pixels = course.ladder.pixels(rungs);
            let work = work(pixels) + self.pairs() as u64;
            rulings[k] = Some(Ruling { verdict: Judgement::Full(value), work });
        }
        Ok(rulings.into_iter().map(|r| r.expect("dropped or judged in full")).collect())
    }

    /// Judges in full, and keeps the tiles' errors.
    fn in_full(&self, course: &Course, trees: &[Tree]) -> Result<Vec<f64>, JudgeError> {
        let measured =
            self.batching.run(trees, &self.pairs_of(&self.samples), self.breeding, |k, pixels| {
                let errors = self.samples[k].errors(pixels, self.measure);
                (mean(&errors), course.ladder.read(k, &self.samples[k], &errors))
            });
        let measured = measured.map_err(|source| self.failed(source))?;
        let mut values = Vec::with_capacity(trees.len());
        for (tree, measured) in trees.iter().zip(measured) {
            values.push(measured.map_or(f64::INFINITY, |measured| {
                let (means, tiles) = measured.into_iter().unzip();
                course.keep(tree, Arc::new(tiles));
                total(means)
            }));
        }
        Ok(values)
    }

    /// Per tree and scene, the errors on the tiles that a rung adds.
    fn tile_errors(
        &self,
        trees: &[Tree],
        rung: &Rung,
    ) -> Result<Vec<Option<TileErrors>>, JudgeError> {
        let measured =
            self.batching.run(trees, &self.pairs_of(&rung.samples), self.breeding, |k, pixels| {
                rung.samples[k].means(&rung.samples[k].errors(pixels, self.measure))
            });
        measured.map_err(|source| self.failed(source))
    }

    /// The tiles' errors of all bars.
    fn bars<'a>(
        &self,
        course: &Course,
        entrants: &[Entrant<'a>],
    ) -> Result<FxHashMap<&'a Tree, Arc<TileErrors>>, JudgeError> {
        let mut bars = FxHashMap::default();
        for tree in entrants.iter().filter_map(|entrant| Some(entrant.bar?.tree)) {
            if bars.contains_key(tree) {
                continue;
            }
            let known = course.known.lock().expect("nobody panics while holding it");
            let found = known.get(tree).cloned();
            drop(known);
            let errors = match found {
                Some(errors) => errors,
                None => {
                    let errors = Arc::new(self.climb(course, tree)?);
                    course.keep(tree, Arc::clone(&errors));
                    errors
                }
            };
            bars.insert(tree, errors);
        }
        Ok(bars)
    }

    /// An expression's errors on the tiles of all rungs.
    fn climb(&self, course: &Course, tree: &Tree) -> Result<TileErrors, JudgeError> {
        let mut whole: TileErrors = vec![Vec::new(); self.scenes.len()];
        for rung in &course.ladder.rungs {
            let errors = self.tile_errors(std::slice::from_ref(tree), rung)?.swap_remove(0);
            let errors = errors.expect("a bar's fitness is finite, so it can be planned");
            for (whole, errors) in whole.iter_mut().zip(errors) {
                whole.extend(errors);
            }
        }
        Ok(whole)
    }

    /// The scenes with samples of them.
    pub(super) fn pairs_of<'a>(&'a self, samples: &'a [Sample]) -> Vec<(&'a Scene, &'a Sample)> {
        self.scenes.iter().map(|training| &training.scene).zip(samples).collect()
    }
}
