//! How accurate shaders are: a choice that commands offer, also where the program
//! was built without them.

/// How much accuracy a shader keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Precision {
    /// Every row of the operator table within its budget.
    #[default]
    Exact,
    /// Built-in exponentials and logarithms, and no care for roundings.
    Fast,
}

impl Precision {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Exact, Self::Fast];

    /// What `--precision` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Fast => "fast",
        }
    }

    /// One line for people.
    pub fn doc(self) -> &'static str {
        match self {
            Self::Exact => "Every operator within its budget, as on the processor",
            Self::Fast => "Built-in exponentials and logarithms: within 1e-4 of the exact colour",
        }
    }

    /// The precision of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|precision| precision.name() == name)
    }
}
