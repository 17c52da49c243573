//! What crossover and mutation have in common.

use crate::expr::{Sort, Tree};

/// How often an operation is tried anew, with other random nodes, when it would
/// break the limits, change nothing or finds no node that it applies to.
pub(super) const ATTEMPTS: usize = 16;

/// The positions of a tree's nodes of one sort.
pub(super) fn positions_of_sort(tree: &Tree, sort: Sort) -> Vec<usize> {
    (0..tree.len()).filter(|&at| tree.symbols()[at].sort() == sort).collect()
}
