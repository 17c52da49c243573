//! The exact meaning of an expression, in f64, by the meanings of the operator table.

use super::constants::Constants;
use super::feature::{Feature, PlaneId, Quantity};
use super::function::limited;
use super::op::Form;
use super::symbol::{Place, Source, Symbol, Variadic};
use super::tape::Side;
use super::tree::Tree;

/// An expression, ready to be evaluated again and again.
#[derive(Debug)]
pub struct Evaluator<'a> {
    tree: &'a Tree,
    constants: &'a Constants,
    places: Vec<Place>,
    /// The components of all operands that wait, one after another.
    values: Vec<f64>,
    /// How many components each of them has.
    widths: Vec<usize>,
}

impl<'a> Evaluator<'a> {
    /// An evaluator of a map's formula, which looks at one pixel, or of a weight, which
    /// looks at two.
    pub fn new(tree: &'a Tree, map: bool, constants: &'a Constants) -> Self {
        let places = tree.places(map);
        Self { tree, constants, places, values: Vec::new(), widths: Vec::new() }
    }

    /// The expression's components, where `read` gives the value of a plane at a place.
    pub fn run(&mut self, mut read: impl FnMut(Source, Place) -> f64) -> &[f64] {
        self.values.clear();
        self.widths.clear();
        for (position, &symbol) in self.tree.symbols().iter().enumerate() {
            let place = self.places[position];
            let first = self.widths.len() - symbol.arity();
            let width = symbol.width(&self.widths[first..]).expect("trees are well-formed");
            let start = self.values.len() - self.widths[first..].iter().sum::<usize>();
            let mut feature = |values: &mut Vec<f64>, feature: Feature, quantity: Quantity| {
                let planes = PlaneId::of(feature, quantity);
                values.extend(planes.map(|plane| read(Source::Feature(plane), place)));
            };
            match symbol {
                Symbol::Const(literal) => self.values.push(f64::from(literal.value())),
                Symbol::Param(k) => {
                    let param = &self.constants.params[usize::from(k)];
                    self.values.push(f64::from(param.value));
                }
                Symbol::Offset => {
                    let pixel = Source::Feature;
                    for plane in PlaneId::of(Feature::Pixel, Quantity::Value) {
                        let [i, j] = [Side::I, Side::J].map(|s| read(pixel(plane), Place::Side(s)));
                        self.values.push(j - i);
                    }
                }
                Symbol::Variance(f) => feature(&mut self.values, f, Quantity::Variance),
                Symbol::Vector(f) => feature(&mut self.values, f, Quantity::Value),
                Symbol::Gradient(f) => feature(&mut self.values, f, Quantity::Gradient),
                Symbol::Stage(signal) => {
                    let planes = signal.planes();
                    self.values.extend(planes.map(|plane| read(Source::Stage(plane), place)));
                }
                Symbol::At(_) | Symbol::Many(Variadic::Join, _) => {}
                Symbol::Op(_)
                | Symbol::Part(_)
                | Symbol::Many(
                    Variadic::Median | Variadic::Clamp | Variadic::Mean | Variadic::Luminance,
                    _,
                )
                | Symbol::Linear(_) => {
                    let result = self.apply(symbol, start, first, width);
                    self.values.truncate(start);
                    self.values.extend(result);
                }
            }
            self.widths.truncate(first);
            self.widths.push(width);
        }
        &self.values
    }

    /// What a symbol makes of the operands from `start` on, whose widths stand from
    /// `first` on.
    fn apply(&self, symbol: Symbol, start: usize, first: usize, width: usize) -> Vec<f64> {
        let mut operands: Vec<&[f64]> = Vec::with_capacity(symbol.arity());
        let mut at = start;
        for &width in &self.widths[first..] {
            operands.push(&self.values[at..at + width]);
            at += width;
        }
        // An operand of one component stands for as many as are wanted.
        let component = |operand: &[f64], k: usize| operand[k.min(operand.len() - 1)];
        match symbol {
            Symbol::Op(op) => match op.row().form {
                Form::Unary(f) => operands[0].iter().map(|&x| (f.meaning)(x)).collect(),
                Form::Binary(f) => (0..width)
                    .map(|k| (f.meaning)(component(operands[0], k), component(operands[1], k)))
                    .collect(),
                Form::Vectors(f) => {
                    let (x, y) = (operands[0], operands[1]);
                    let missing = |v: &[f64], k: usize| v.get(k).copied().unwrap_or(0.0);
                    let pairs = (0..x.len().max(y.len())).map(|k| (missing(x, k), missing(y, k)));
                    vec![(f.meaning)(&pairs.collect::<Vec<_>>())]
                }
            },
            Symbol::Part(k) => vec![operands[0][usize::from(k)]],
            Symbol::Many(Variadic::Median, _) => (0..width)
                .map(|k| {
                    let mut all: Vec<f64> = operands.iter().map(|x| component(x, k)).collect();
                    all.sort_by(f64::total_cmp);
                    all[(all.len() - 1) / 2]
                })
                .collect(),
            Symbol::Many(Variadic::Clamp, _) => (0..width)
                .map(|k| {
                    let [x, low, high] = [0, 1, 2].map(|n| component(operands[n], k));
                    x.max(low).min(high)
                })
                .collect(),
            Symbol::Many(Variadic::Mean, _) => {
                let sum: f64 = operands.iter().flat_map(|x| x.iter()).sum();
                let count = operands.iter().map(|x| x.len()).sum::<usize>();
                vec![limited(sum / count as f64)]
            }
            Symbol::Many(Variadic::Luminance, _) => {
                let parts = operands[0].iter().zip(Variadic::LUMINANCE);
                vec![limited(parts.map(|(x, share)| x * f64::from(share)).sum())]
            }
            Symbol::Linear(layer) => {
                let layer = &self.constants.layers[usize::from(layer.layer)];
                let rows = layer.weights.iter().zip(&layer.bias);
                rows.map(|(row, &bias)| {
                    let products = row.iter().zip(operands[0]).map(|(&w, x)| f64::from(w) * x);
                    limited(f64::from(bias) + products.sum::<f64>())
                })
                .collect()
            }
            Symbol::Const(_)
            | Symbol::Param(_)
            | Symbol::Offset
            | Symbol::Variance(_)
            | Symbol::Vector(_)
            | Symbol::Gradient(_)
            | Symbol::Stage(_)
            | Symbol::At(_)
            | Symbol::Many(Variadic::Join, _) => {
                unreachable!("leaves have no operands, and the others leave them as they are")
            }
        }
    }
}

impl Tree {
    /// The exact meaning of an expression of one component for one pair of pixels, if it
    /// reads features alone.
    ///
    /// `read` gives a plane's value at either end of the pair.
    ///
    /// # Panics
    /// If the expression has several components, or reads what only programs have.
    pub fn meaning(&self, mut read: impl FnMut(PlaneId, Side) -> f64) -> f64 {
        let constants = Constants::default();
        let mut evaluator = Evaluator::new(self, false, &constants);
        let value = evaluator.run(|source, place| match (source, place) {
            (Source::Feature(plane), Place::Side(side)) => read(plane, side),
            (Source::Stage(_), _) | (_, Place::Shift(..)) => {
                panic!("only programs have stages and offsets")
            }
        });
        assert_eq!(value.len(), 1, "a bare vector has no value");
        value[0]
    }
}
