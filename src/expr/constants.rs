//! The constants of a program that have names: single numbers, and the blocks of layers.
//!
//! Formulas refer to them by number, so that their values can be tuned without touching
//! a formula.

/// A named constant.
#[derive(Clone, Debug, PartialEq)]
pub struct Param {
    /// What formulas call it.
    pub name: String,
    /// Its value, within the bounds.
    pub value: f32,
    /// The least and the greatest value that tuning may give it.
    pub bounds: [f32; 2],
    /// Whether tuning may change it.
    pub tuned: bool,
}

/// The constants of a linear layer, W x + b.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// What formulas call it.
    pub name: String,
    /// W, one row per component that the layer gives; all rows are equally long.
    pub weights: Vec<Vec<f32>>,
    /// b, one number per row of W.
    pub bias: Vec<f32>,
}

impl Layer {
    /// Components that the layer gives.
    pub fn rows(&self) -> usize {
        self.weights.len()
    }

    /// Components that the layer takes.
    pub fn columns(&self) -> usize {
        self.weights.first().map_or(0, Vec::len)
    }
}

/// All named constants of a program.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Constants {
    /// Single numbers.
    pub params: Vec<Param>,
    /// Layers.
    pub layers: Vec<Layer>,
}
