//! Names that nothing else in their scope has.

use std::collections::BTreeSet;

/// The names of a scope.
#[derive(Clone, Default)]
pub(in crate::export) struct Names {
    taken: BTreeSet<String>,
}

impl Names {
    /// A scope in which these names are taken.
    pub(in crate::export) fn with(taken: &[&str]) -> Self {
        Self { taken: taken.iter().map(|&name| name.to_owned()).collect() }
    }

    /// The name, or if it is taken one that begins like it.
    pub(in crate::export) fn unique(&mut self, name: String) -> String {
        let mut free = name;
        while !self.taken.insert(free.clone()) {
            free.push('_');
        }
        free
    }
}
