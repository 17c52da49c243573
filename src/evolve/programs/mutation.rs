//! What changes a program at random.
//!
//! | changes | |
//! |---|---|
//! | formulas, as the paper's do | replace, grow, shrink, swap, wrap, jitter |
//! | the exponents of weights | add a term, drop one, copy one from another pass |
//! | skeletons | a further pass, a new map, a stage less, a copy of one for some of its readers, dilation, radius, half resolution |
//! | what is read | a feature less; a constant of its own for one of its places |
//! | layers | a formula in the place of one |

mod formulas;
mod reads;
mod skeleton;

use rand::RngExt;
use rand::seq::IndexedRandom;

use super::draft::Draft;
use super::genome::Genome;
use crate::expr::feature::{Feature, Quantity};
use crate::tune::Stream;
use formulas::{add_term, copy_term, drop_term, grow, jitter, replace, shrink, swap, wrap};
use reads::{drop_feature, unlayer, untie};
use skeleton::{add_map, add_pass, copy_stage, dilate, halve, remove_stage, resize};

/// How often a change is tried anew that does not apply, makes no sense or changes nothing.
const ATTEMPTS: usize = 24;

/// A kind of change; nothing if it does not apply where it was tried.
pub(super) type Change = fn(&mut Draft<'_>) -> Option<()>;

/// Every kind, with how often it is tried.
pub(super) const CHANGES: &[(f64, Change)] = &[
    (2.0, replace),
    (2.0, grow),
    (2.0, shrink),
    (0.5, swap),
    (1.5, wrap),
    (0.5, jitter),
    (2.0, add_term),
    (1.5, drop_term),
    (1.0, copy_term),
    (1.5, add_pass),
    (1.5, add_map),
    (1.5, remove_stage),
    (0.5, copy_stage),
    (1.0, dilate),
    (1.0, resize),
    (0.7, halve),
    (0.7, drop_feature),
    (0.7, untie),
    (1.0, unlayer),
];

impl Genome {
    /// A mutant: mostly one change, now and then more, with formulas that read `features`.
    /// Nothing if no change that was tried makes a program that makes sense and that `admits`
    /// takes.
    pub fn mutant(
        &self,
        features: &[(Feature, Quantity)],
        rng: &mut Stream,
        admits: impl Fn(&Self) -> bool,
    ) -> Option<Self> {
        for _ in 0..ATTEMPTS {
            let mut draft = Draft::new(self, features, rng);
            let mut changed = false;
            loop {
                let &(_, change) = CHANGES
                    .choose_weighted(draft.rng, |&(share, _)| share)
                    .expect("shares of many");
                let before = draft.filter.clone();
                match change(&mut draft) {
                    Some(()) => changed = true,
                    None => draft.filter = before,
                }
                if draft.rng.random_bool(0.7) {
                    break;
                }
            }
            let child = draft.genome().filter(|child| changed && child != self && admits(child));
            if child.is_some() {
                return child;
            }
        }
        None
    }
}

/// A change at a random place of a program, if it applies there and leaves one that makes sense.
#[cfg(test)]
pub(super) fn change_alone(
    genome: &Genome,
    features: &[(Feature, Quantity)],
    rng: &mut Stream,
    change: Change,
) -> Option<Genome> {
    let mut draft = Draft::new(genome, features, rng);
    change(&mut draft)?;
    draft.genome().filter(|child| child != genome)
}
