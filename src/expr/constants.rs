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

    /// Where a number of W, or in the column after its last one of b, stands among the
    /// layer's own.
    pub fn place(&self, row: usize, column: usize) -> usize {
        match column == self.columns() {
            true => self.rows() * column + row,
            false => row * self.columns() + column,
        }
    }
}

/// All named constants of a program.
///
/// Their numbers stand in one order: the single ones, and then layer by layer the rows of
/// W, one after another, and b.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Constants {
    /// Single numbers.
    pub params: Vec<Param>,
    /// Layers.
    pub layers: Vec<Layer>,
}

impl Constants {
    /// Where a layer's numbers begin.
    pub fn start_of_layer(&self, layer: usize) -> usize {
        let before = self.layers[..layer].iter();
        self.params.len() + before.map(|layer| layer.rows() * (layer.columns() + 1)).sum::<usize>()
    }

    /// All numbers, in their order.
    pub fn values(&self) -> Vec<f32> {
        let params = self.params.iter().map(|param| param.value);
        let layers = self.layers.iter().flat_map(|layer| layer.weights.iter().chain([&layer.bias]));
        params.chain(layers.flatten().copied()).collect()
    }

    /// Gives every number another value.
    ///
    /// # Panics
    /// If there are not as many values as numbers.
    pub fn set_values(&mut self, values: &[f32]) {
        let params = self.params.iter_mut().map(|param| &mut param.value);
        let layers = self.layers.iter_mut();
        let layers = layers.flat_map(|layer| layer.weights.iter_mut().chain([&mut layer.bias]));
        let layers = layers.flatten();
        let mut given = values.iter();
        for number in params.chain(layers) {
            *number = *given.next().expect("one value per number");
        }
        assert!(given.next().is_none(), "one value per number");
    }
}
