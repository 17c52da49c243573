//! Which expressions should share a program.
//!
//! The more two expressions have in common, the more is saved by computing them
//! together; and a program runs over all taps that count for any of its weights, so
//! that one whose support is small should not have to follow one whose is not.

use std::hash::{BuildHasher, Hash};

use rustc_hash::{FxBuildHasher, FxHashSet};

use crate::expr::tape::{Input, Instr, Tape};
use crate::plan::WindowPlan;

/// What a program computes for every pair, as names: equal values of different
/// plans have equal names.
struct Work {
    names: Vec<u64>,
    taps: usize,
}

impl Work {
    fn of(plan: &WindowPlan) -> Self {
        let per_tap = results(plan.tap(), &names(plan.tap(), &[], &[]));
        let per_pixel = results(plan.pixel(), &names(plan.pixel(), &per_tap, &[]));
        let all = names(plan.pair(), &per_tap, &per_pixel);
        let instrs = plan.pair().instrs().iter().zip(all);
        let computed = instrs.filter(|(instr, _)| matches!(instr, Instr::Prim(..)));
        Self { names: computed.map(|(_, name)| name).collect(), taps: plan.taps().count() }
    }
}

/// The names of a tape's values, given those of what it reads.
fn names(tape: &Tape, per_tap: &[u64], per_pixel: &[u64]) -> Vec<u64> {
    let mut names: Vec<u64> = Vec::with_capacity(tape.instrs().len());
    for instr in tape.instrs() {
        let name = match instr {
            Instr::Const(bits) => name(&("constant", bits)),
            Instr::Input(Input::PerTap(k)) => name(&("per tap", per_tap[*k as usize])),
            Instr::Input(Input::PerPixel(k, side)) => {
                name(&("per pixel", per_pixel[*k as usize], side))
            }
            Instr::Input(input) => name(input),
            Instr::Prim(prim, _) => {
                let operands = instr.operands().iter().map(|operand| names[operand.index()]);
                name(&(prim, operands.collect::<Vec<_>>()))
            }
        };
        names.push(name);
    }
    names
}

fn name(value: &impl Hash) -> u64 {
    FxBuildHasher.hash_one(value)
}

fn results(tape: &Tape, names: &[u64]) -> Vec<u64> {
    tape.results().iter().map(|result| names[result.index()]).collect()
}

/// Divides plans into the fewest groups of at most `most`, of about equal size,
/// each of relatives. The order of the groups and in them follows from the plans
/// alone.
pub(super) fn groups(plans: &[&WindowPlan], most: usize) -> Vec<Vec<usize>> {
    let work: Vec<Work> = plans.iter().map(|plan| Work::of(plan)).collect();
    let mut rest: Vec<usize> = (0..plans.len()).collect();
    rest.sort_by_key(|&k| work[k].taps);
    let count = plans.len().div_ceil(most.max(1)).max(1);
    let size = plans.len().div_ceil(count).max(1);
    let mut groups = Vec::with_capacity(count);
    while !rest.is_empty() {
        let mut group = vec![rest.remove(0)];
        let mut shared: FxHashSet<u64> = work[group[0]].names.iter().copied().collect();
        while group.len() < size && !rest.is_empty() {
            // A group of few taps may take in expressions of half as many again.
            let few = work[group[0]].taps;
            let near = rest.partition_point(|&k| work[k].taps * 2 <= few * 3).max(1);
            let in_common = |k: usize| {
                let names = &work[k].names;
                let common = names.iter().filter(|name| shared.contains(name)).count();
                common as f64 / names.len().max(1) as f64
            };
            // The first of the best.
            let best = (0..near)
                .map(|at| (at, in_common(rest[at])))
                .reduce(|best, other| if other.1 > best.1 { other } else { best });
            let next = rest.remove(best.expect("at least one is near").0);
            shared.extend(&work[next].names);
            group.push(next);
        }
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::Tree;
    use crate::filter::Window;
    use crate::plan::Passes;
    use crate::scene::Facts;

    fn plans(texts: &[&str]) -> Vec<WindowPlan> {
        let plan = |text: &&str| {
            let tree: Tree = text.parse().expect("an expression");
            WindowPlan::new(&[tree], Window::dense(8), &Facts::of_any_scene(), Passes::ALL)
                .expect("a plan")
        };
        texts.iter().map(plan).collect()
    }

    #[test]
    fn relatives_are_together() {
        let plans = plans(&[
            "exp(-distance2(normal, normal) / 0.3) * 2",
            "exp(-distance2(texture, texture) / 0.1)",
            "exp(-distance2(normal, normal) / 0.3) * 3 + 1",
            "exp(-distance2(texture, texture) / 0.1) + 0.5",
        ]);
        let plans: Vec<&WindowPlan> = plans.iter().collect();
        assert_eq!(groups(&plans, 2), [[0, 2], [1, 3]]);
        assert_eq!(groups(&plans, 1).len(), 4);
        assert_eq!(groups(&plans, 9).len(), 1);
        assert!(groups(&[], 9).is_empty());
    }

    #[test]
    fn those_of_small_support_are_among_themselves() {
        let plans = plans(&[
            "exp(-distance2(normal, normal) / 0.3) * exp(-distance2(pixel, pixel) / 0.01)",
            "exp(-distance2(normal, normal) / 0.3)",
            "exp(-distance2(texture, texture) / 0.3) * exp(-distance2(pixel, pixel) / 0.01)",
            "exp(-distance2(texture, texture) / 0.3)",
        ]);
        assert!(plans[0].taps().count() < plans[1].taps().count());
        let plans: Vec<&WindowPlan> = plans.iter().collect();
        assert_eq!(groups(&plans, 2), [[0, 2], [1, 3]]);
    }
}
