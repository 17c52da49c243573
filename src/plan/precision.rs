//! How accurate code is: a choice that commands offer.

use serde::{Deserialize, Serialize};

/// How accurate code is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// Every row of the operator table within its budget.
    #[default]
    Standard,
    /// Exponentials and powers in fewer primitives; in shaders built-in ones, and no
    /// care for roundings.
    Fast,
}

impl Precision {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Standard, Self::Fast];

    /// What `--precision` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Standard => "standard",
            Self::Fast => "fast",
        }
    }

    /// One line for people.
    pub fn doc(self) -> &'static str {
        match self {
            Self::Standard => "Every operator within its budget: within 1e-5 of the exact colour",
            Self::Fast => "Short or built-in exponentials and powers: within 1e-4",
        }
    }

    /// What tables call something that computes so: by its name alone at standard
    /// precision.
    pub fn title(self, name: &str) -> String {
        match self {
            Self::Standard => name.to_owned(),
            Self::Fast => format!("{name} fast"),
        }
    }

    /// The precision of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|precision| precision.name() == name)
    }
}
