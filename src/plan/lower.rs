//! From trees to a tape: each operator's row emits its primitives.

use super::{Precision, Window};
use crate::expr::builder::{Builder, LIMIT};
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::expr::interval::Interval;
use crate::expr::op::{Form, Op};
use crate::expr::tape::{Axis, Input, Side, Value};
use crate::expr::tree::{Symbol, Tree, component_pairs};

/// What lowering needs to know about its surroundings.
pub(super) struct Surroundings<'a> {
    /// The range of a plane; a single point for one that is constant.
    pub(super) range: &'a dyn Fn(PlaneId) -> Interval,
    /// The window that offsets range over.
    pub(super) window: Window,
    /// Whether pixels i and j change places: w(j, i) is made of what is read at
    /// i and j for w(i, j).
    pub(super) mirrored: bool,
    /// How accurate functions are made.
    pub(super) precision: Precision,
}

impl Surroundings<'_> {
    /// What is made for an operator.
    pub(super) fn form(&self, op: Op) -> Form {
        let form = op.row().form;
        match self.precision {
            Precision::Standard => form,
            Precision::Fast => form.short(),
        }
    }

    fn read(&self, b: &mut Builder, plane: PlaneId, side: Side) -> Value {
        let side = if self.mirrored { side.other() } else { side };
        b.input(Input::Plane(plane, side), (self.range)(plane))
    }

    /// From i to j, which is minus as far from j to i.
    fn offset(&self, b: &mut Builder, axis: Axis) -> Value {
        let reach = self.window.reach() as f32;
        let offset = b.input(Input::Offset(axis), Interval::new(-reach, reach));
        if self.mirrored { b.neg(offset) } else { offset }
    }

    /// The pairs of components of two vector operands. Where a function looks at
    /// nothing but differences (`relative`), the pixel's coordinates are given
    /// relative to pixel i, 0 there and the offset at j: no coordinate is read,
    /// and what follows from the offset alone leaves the window loop.
    fn components(
        &self,
        b: &mut Builder,
        left: (Feature, Quantity),
        right: (Feature, Quantity),
        relative: bool,
    ) -> Vec<(Value, Value)> {
        if relative && left == right && left.0 == Feature::Pixel {
            let pair = |axis| (b.constant(0.0), self.offset(b, axis));
            return [Axis::X, Axis::Y].map(pair).into();
        }
        component_pairs(left, right)
            .map(|(x, y)| {
                let x = match x {
                    Some(plane) => self.read(b, plane, Side::I),
                    None => b.constant(0.0),
                };
                let y = match y {
                    Some(plane) => self.read(b, plane, Side::J),
                    None => b.constant(0.0),
                };
                (x, y)
            })
            .collect()
    }
}

/// Emits a scalar tree. Returns the value of every scalar node by position;
/// vectors have none.
pub(super) fn lower(b: &mut Builder, tree: &Tree, at: &Surroundings<'_>) -> Vec<Option<Value>> {
    enum Operand {
        Scalar(Value),
        Vector(Feature, Quantity),
    }
    let mut nodes = Vec::with_capacity(tree.len());
    let mut stack: Vec<Operand> = Vec::new();
    for &symbol in tree.symbols() {
        let operands = stack.split_off(stack.len() - symbol.arity());
        let value = match (symbol, operands.as_slice()) {
            (Symbol::Const(literal), _) => b.constant(literal.value().clamp(-LIMIT, LIMIT)),
            (Symbol::Variance(feature), _) => {
                let plane = PlaneId { feature, quantity: Quantity::Variance, component: 0 };
                at.read(b, plane, Side::I)
            }
            (Symbol::Vector(f), _) => {
                stack.push(Operand::Vector(f, Quantity::Value));
                nodes.push(None);
                continue;
            }
            (Symbol::Gradient(f), _) => {
                stack.push(Operand::Vector(f, Quantity::Gradient));
                nodes.push(None);
                continue;
            }
            (Symbol::Op(op), operands) => match (at.form(op), operands) {
                (Form::Unary(f), [Operand::Scalar(x)]) => {
                    let range = (f.range)(b.range(*x));
                    let value = (f.build)(b, *x);
                    b.assume(value, range);
                    value
                }
                (Form::Binary(f), [Operand::Scalar(x), Operand::Scalar(y)]) => {
                    let range = (f.range)(b.range(*x), b.range(*y));
                    let value = (f.build)(b, *x, *y);
                    b.assume(value, range);
                    value
                }
                (Form::Vectors(f), [Operand::Vector(p, m), Operand::Vector(q, n)]) => {
                    let pairs = at.components(b, (*p, *m), (*q, *n), f.differences);
                    (f.build)(b, &pairs)
                }
                (Form::Unary(_) | Form::Binary(_) | Form::Vectors(_), _) => {
                    unreachable!("a Tree is well-sorted, so {op:?} finds its operands")
                }
            },
        };
        stack.push(Operand::Scalar(value));
        nodes.push(Some(value));
    }
    nodes
}

/// What is known of every scalar node's value, by position.
pub(super) fn ranges(tree: &Tree, at: &Surroundings<'_>) -> Vec<Interval> {
    let mut b = Builder::new(crate::expr::builder::Rules::ALL);
    let nodes = lower(&mut b, tree, at);
    nodes.into_iter().map(|node| node.map_or(Interval::ENTIRE, |v| b.range(v))).collect()
}
