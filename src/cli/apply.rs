//! What filters read of scenes.

use crate::filter::{Checked, Filter};
use crate::scene::Needs;

/// The planes that a filter reads of a scene.
pub(super) fn needs(filter: &Filter) -> Needs {
    checked(filter).needs()
}

/// How far a filter looks, in pixels: the padding that its scene needs.
pub(super) fn reach(filter: &Filter) -> usize {
    checked(filter).reach()
}

/// A filter that was checked when it was read or made.
pub(super) fn checked(filter: &Filter) -> Checked<'_> {
    filter.check().expect("only filters that make sense get here")
}
