//! The passes by name: each can be switched off, and none changes meaning.

use super::Precision;
use crate::expr::builder::Rules;

/// Which passes a plan is made with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passes {
    /// Products of exponentials and nested powers become one.
    pub merge: bool,
    /// Facts about the scene's planes (constants, ranges) are used.
    pub facts: bool,
    /// Constants and identities are folded.
    pub fold: bool,
    /// Equal subexpressions are computed once.
    pub share: bool,
    /// Guards that value ranges prove idle are dropped.
    pub ranges: bool,
    /// Products and sums are fused, constant divisors become reciprocals.
    pub contract: bool,
    /// What does not depend on the pair leaves the window loop.
    pub hoist: bool,
    /// Taps whose weight is proved to be zero are left out.
    pub support: bool,
    /// Every pair of pixels is computed once, for both of its ends.
    pub symmetry: bool,
    /// Pixels whose window holds one colour keep it.
    pub uniform: bool,
    /// Maps that stand side by side become one.
    pub inline: bool,
    /// Means by equal weights are sums down columns and then along rows.
    pub separate: bool,
    /// Means by the same weight are taken together.
    pub dedupe: bool,
    /// How accurate functions are made: no pass, as it says how far off results may be.
    pub precision: Precision,
}

/// A pass as the command line and the benches name it.
#[derive(Debug)]
pub struct PassRow {
    /// The pass's name.
    pub name: &'static str,
    /// What it does, in one line.
    pub doc: &'static str,
    /// Whether results with and without it are equal bit for bit, as long as `separate` is
    /// off: which means it takes can hang on what `share` finds equal. The others agree to
    /// within rounding.
    pub exact: bool,
    switch: fn(&mut Passes) -> &mut bool,
}

/// Every pass.
pub const PASSES: &[PassRow] = &[
    PassRow {
        name: "merge",
        doc: "products of exponentials become one exponential, powers of powers one power",
        exact: false,
        switch: |p| &mut p.merge,
    },
    PassRow {
        name: "facts",
        doc: "planes that are constant in the scene become constants, ranges are known",
        exact: false,
        switch: |p| &mut p.facts,
    },
    PassRow {
        name: "fold",
        doc: "constants and algebraic identities are folded",
        exact: false,
        switch: |p| &mut p.fold,
    },
    PassRow {
        name: "share",
        doc: "equal subexpressions are computed once",
        exact: true,
        switch: |p| &mut p.share,
    },
    PassRow {
        name: "ranges",
        doc: "guards and selections that value ranges decide are dropped",
        exact: false,
        switch: |p| &mut p.ranges,
    },
    PassRow {
        name: "contract",
        doc: "products and sums are fused, constant divisors become reciprocals",
        exact: false,
        switch: |p| &mut p.contract,
    },
    PassRow {
        name: "hoist",
        doc: "what does not depend on the pair of pixels leaves the window loop",
        exact: true,
        switch: |p| &mut p.hoist,
    },
    PassRow {
        name: "support",
        doc: "taps whose weight is proved to be zero are left out",
        exact: true,
        switch: |p| &mut p.support,
    },
    PassRow {
        name: "symmetry",
        doc: "every pair of pixels is computed once, for both of its ends",
        exact: true,
        switch: |p| &mut p.symmetry,
    },
    PassRow {
        name: "uniform",
        doc: "pixels whose window holds one colour keep it",
        exact: false,
        switch: |p| &mut p.uniform,
    },
    PassRow {
        name: "inline",
        doc: "maps side by side become one, and what only they read is not stored",
        exact: true,
        switch: |p| &mut p.inline,
    },
    PassRow {
        name: "separate",
        doc: "means by equal weights are sums down columns and then along rows",
        exact: false,
        switch: |p| &mut p.separate,
    },
    PassRow {
        name: "dedupe",
        doc: "means by the same weight are taken together, as those of other layers are",
        exact: true,
        switch: |p| &mut p.dedupe,
    },
];

impl Passes {
    /// Every pass on.
    pub const ALL: Self = Self {
        merge: true,
        facts: true,
        fold: true,
        share: true,
        ranges: true,
        contract: true,
        hoist: true,
        support: true,
        symmetry: true,
        uniform: true,
        inline: true,
        separate: true,
        dedupe: true,
        precision: Precision::Standard,
    };

    /// Every pass off.
    pub const NONE: Self = Self {
        merge: false,
        facts: false,
        fold: false,
        share: false,
        ranges: false,
        contract: false,
        hoist: false,
        support: false,
        symmetry: false,
        uniform: false,
        inline: false,
        separate: false,
        dedupe: false,
        precision: Precision::Standard,
    };

    /// The same passes without the named one; `None` if there is no such pass.
    pub fn without(mut self, name: &str) -> Option<Self> {
        let row = PASSES.iter().find(|row| row.name == name)?;
        *(row.switch)(&mut self) = false;
        Some(self)
    }

    /// The part that the tape builder obeys.
    pub(super) fn rules(self) -> Rules {
        Rules {
            fold: self.fold,
            share: self.share,
            ranges: self.ranges,
            contract: self.contract,
            merge: self.merge,
        }
    }
}

impl Default for Passes {
    fn default() -> Self {
        Self::ALL
    }
}
