//! The hall of fame: the best expressions of a whole run.
//!
//! Breeding may judge by a subset of the training data, and its very best may
//! owe their rank to that subset. So the hall keeps the best few, and the end
//! of the run judges those by everything.

use serde::{Deserialize, Serialize};

use super::individual::Individual;

/// The best distinct expressions seen so far, the best first.
///
/// Expressions of exactly equal fitness are taken for one (`x` and `x * 1`),
/// and the smallest stands for it. What the hall holds depends on what it was
/// offered, not on the order.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HallOfFame {
    capacity: usize,
    members: Vec<Individual>,
}

impl HallOfFame {
    /// A hall for so many expressions.
    pub fn new(capacity: usize) -> Self {
        Self { capacity, members: Vec::new() }
    }

    /// The members, the best first.
    pub fn members(&self) -> &[Individual] {
        &self.members
    }

    /// Takes an expression in, if it belongs here.
    pub fn offer(&mut self, candidate: Individual) {
        let twin = self.members.iter().position(|m| m.fitness == candidate.fitness);
        match twin {
            Some(at) if candidate < self.members[at] => self.members[at] = candidate,
            Some(_) => {}
            None => {
                let at = self.members.partition_point(|m| *m < candidate);
                self.members.insert(at, candidate);
                self.members.truncate(self.capacity);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expr::Tree;

    #[test]
    fn the_hall_keeps_the_best_distinct_in_whatever_order_they_come() {
        let [one, negated]: [Tree; 2] = ["1", "-exp(1)"].map(|text| text.parse().unwrap());
        let candidates: Vec<Individual> = (0..6)
            .flat_map(|k| [(&one, k), (&negated, k)])
            .map(|(tree, k)| Individual { tree: tree.clone(), fitness: f64::from(k), full: true })
            .collect();
        let gather = |order: &mut dyn Iterator<Item = &Individual>| {
            let mut hall = HallOfFame::new(3);
            order.for_each(|c| hall.offer(c.clone()));
            hall.members().to_vec()
        };
        let members = gather(&mut candidates.iter());
        assert_eq!(members, gather(&mut candidates.iter().rev()));
        assert_eq!(members.iter().map(|m| m.fitness).collect::<Vec<_>>(), [0.0, 1.0, 2.0]);
        assert!(members.iter().all(|m| m.tree == one));
    }
}
