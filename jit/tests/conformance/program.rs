//! Straight-line programs as data, so that tests can list and generate them.

use tamis_jit::{Body, Lanes, Side};

/// One node; operands are numbers of earlier nodes, taken modulo their count.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Node {
    Constant(f32),
    Plane(usize, Side),
    Tap(usize),
    Neg(usize),
    Abs(usize),
    Sqrt(usize),
    Round(usize),
    Exp2i(usize),
    Exponent(usize),
    Fraction(usize),
    Add(usize, usize),
    Sub(usize, usize),
    Mul(usize, usize),
    Div(usize, usize),
    Min(usize, usize),
    Max(usize, usize),
    Fma(usize, usize, usize),
    /// `if a < b { c } else { d }`
    Select(usize, usize, usize, usize),
}

/// Nodes in order; the last `weights` of them are the weights.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub(crate) nodes: Vec<Node>,
    pub(crate) weights: usize,
}

impl Program {
    /// A program with one weight.
    pub(crate) fn new(nodes: impl IntoIterator<Item = Node>) -> Self {
        Self { nodes: nodes.into_iter().collect(), weights: 1 }
    }
}

/// `x`, or minus infinity for a NaN, for instructions that read bits: the sign of a NaN is
/// not promised.
fn a_number<L: Lanes>(lanes: &mut L, x: L::F) -> L::F {
    let least = lanes.constant(f32::NEG_INFINITY);
    lanes.max(x, least)
}

impl Body for Program {
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
        let mut values: Vec<L::F> = Vec::new();
        for &node in &self.nodes {
            let at = |n: usize| values[n % values.len()];
            let value = match node {
                Node::Constant(value) => lanes.constant(value),
                Node::Plane(index, side) => lanes.plane(index, side),
                Node::Tap(index) => lanes.tap(index),
                Node::Neg(a) => lanes.neg(at(a)),
                Node::Abs(a) => lanes.abs(at(a)),
                Node::Sqrt(a) => lanes.sqrt(at(a)),
                Node::Round(a) => lanes.round(at(a)),
                Node::Exp2i(a) => {
                    let number = a_number(lanes, at(a));
                    lanes.exp2i(number)
                }
                Node::Exponent(a) => {
                    let number = a_number(lanes, at(a));
                    lanes.exponent(number)
                }
                Node::Fraction(a) => {
                    let number = a_number(lanes, at(a));
                    lanes.fraction(number)
                }
                Node::Add(a, b) => lanes.add(at(a), at(b)),
                Node::Sub(a, b) => lanes.sub(at(a), at(b)),
                Node::Mul(a, b) => lanes.mul(at(a), at(b)),
                Node::Div(a, b) => lanes.div(at(a), at(b)),
                Node::Min(a, b) => lanes.min(at(a), at(b)),
                Node::Max(a, b) => lanes.max(at(a), at(b)),
                Node::Fma(a, b, c) => lanes.fma(at(a), at(b), at(c)),
                Node::Select(a, b, c, d) => {
                    let mask = lanes.lt(at(a), at(b));
                    lanes.select(mask, at(c), at(d))
                }
            };
            values.push(value);
        }
        values.split_off(values.len() - self.weights)
    }
}
