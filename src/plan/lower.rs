//! From trees to a tape: each operator's row emits its primitives.

use std::cell::RefCell;

use super::Precision;
use crate::expr::builder::{Builder, LIMIT};
use crate::expr::constants::Constants;
use crate::expr::feature::{Feature, PlaneId, Quantity};
use crate::expr::function::VectorFunction;
use crate::expr::interval::Interval;
use crate::expr::op::{Form, Op};
use crate::expr::symbol::{LayerRef, Place, Source, Symbol, Variadic};
use crate::expr::tape::{Axis, Input, Side, Value};
use crate::expr::tree::Tree;
use crate::filter::Window;

/// A plane that a kernel reads, so many columns to the right of the pixel and rows below.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Read {
    /// The plane.
    pub source: Source,
    /// Columns to the right, rows below; nothing but zeros in a gather.
    pub shift: [i8; 2],
}

/// What lowering needs to know about its surroundings.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'a> {
    /// The range of a plane; a single point for one that is constant.
    pub(super) range: &'a dyn Fn(Source) -> Interval,
    /// The window that offsets range over; `None` in a map, which looks at one pixel.
    pub(super) window: Option<Window>,
    /// Whether pixels i and j change places: w(j, i) is made of what is read at
    /// i and j for w(i, j).
    pub(super) mirrored: bool,
    /// Pixels of the image between neighbouring pixels of the stage's grid.
    pub(super) step: i32,
    /// How accurate functions are made.
    pub(super) precision: Precision,
    /// The program's named constants.
    pub(super) constants: &'a Constants,
    /// Whether those that may be tuned are read as [`Input::Constant`]: then the code serves
    /// any values of theirs.
    pub(super) tuned: bool,
    /// What is read as [`Input::Signal`], each once: everything in a map, the results of
    /// earlier stages in a gather, which reads features as [`Input::Plane`].
    pub(super) reads: &'a RefCell<Vec<Read>>,
}

/// The components of an operand.
enum Operand {
    Scalar(Value),
    /// A bare feature, not read yet.
    Vector(Feature, Quantity),
    /// More than one component, or less known ones.
    Wide(Vec<Value>),
}

impl Operand {
    fn width(&self) -> usize {
        match self {
            Self::Scalar(_) => 1,
            Self::Vector(feature, quantity) => PlaneId::components(*feature, *quantity),
            Self::Wide(values) => values.len(),
        }
    }
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

    pub(super) fn is_map(&self) -> bool {
        self.window.is_none()
    }

    pub(super) fn read(&self, b: &mut Builder, source: Source, place: Place) -> Value {
        let range = (self.range)(source);
        let (side, shift) = match place {
            Place::Side(side) if self.mirrored => (side.other(), [0, 0]),
            Place::Side(side) => (side, [0, 0]),
            Place::Shift(dx, dy) => (Side::I, [dx, dy]),
        };
        match source {
            Source::Feature(plane) if !self.is_map() => b.input(Input::Plane(plane, side), range),
            Source::Feature(_) | Source::Stage(_) if range.lo == range.hi => b.constant(range.lo),
            Source::Feature(_) | Source::Stage(_) => {
                let read = Read { source, shift };
                let mut reads = self.reads.borrow_mut();
                let known = reads.iter().position(|&known| known == read);
                let k = known.unwrap_or_else(|| {
                    reads.push(read);
                    reads.len() - 1
                });
                b.input(Input::Signal(k as u32, side), range)
            }
        }
    }

    /// A named constant.
    fn param(&self, b: &mut Builder, k: u16) -> Value {
        let param = &self.constants.params[usize::from(k)];
        match self.tuned && param.tuned {
            true => {
                let [low, high] = param.bounds;
                b.input(Input::Constant(k.into()), Interval::new(low, high))
            }
            false => b.constant(param.value.clamp(-LIMIT, LIMIT)),
        }
    }

    /// A number of a layer's block: a component of b after the last column of W.
    pub(super) fn weight(
        &self,
        b: &mut Builder,
        layer: LayerRef,
        row: usize,
        column: usize,
    ) -> Value {
        let block = &self.constants.layers[usize::from(layer.layer)];
        match self.tuned {
            true => {
                let start = self.constants.start_of_layer(layer.layer.into());
                let k = start + block.place(row, column);
                b.input(Input::Constant(k as u32), Interval::new(-LIMIT, LIMIT))
            }
            false => b.constant(match column == block.columns() {
                true => block.bias[row],
                false => block.weights[row][column],
            }),
        }
    }

    /// W x + b, each row summed from the left. Values stay within ±LIMIT.
    fn linear(&self, b: &mut Builder, layer: LayerRef, x: &[Value]) -> Vec<Value> {
        let rows = 0..usize::from(layer.rows);
        rows.map(|row| {
            let mut sum = self.weight(b, layer, row, x.len());
            for (column, &x) in x.iter().enumerate() {
                let weight = self.weight(b, layer, row, column);
                sum = b.fma(weight, x, sum);
            }
            b.limited(sum)
        })
        .collect()
    }

    /// The components of a bare feature.
    pub(super) fn bare(&self, b: &mut Builder, symbol: Symbol, place: Place) -> Vec<Value> {
        let (feature, quantity) = symbol.reads().expect("it is a feature");
        self.components(b, Operand::Vector(feature, quantity), place)
    }

    /// From i to j, which is minus as far from j to i.
    fn offset(&self, b: &mut Builder, axis: Axis) -> Value {
        let reach = self.window.map_or(0, Window::reach) as f32;
        let offset = b.input(Input::Offset(axis), Interval::new(-reach, reach));
        let offset = match self.step {
            1 => offset,
            step => {
                let step = b.constant(step as f32);
                b.mul(offset, step)
            }
        };
        if self.mirrored { b.neg(offset) } else { offset }
    }

    /// A function of two vectors. Where it looks at nothing but differences, the pixel's
    /// coordinates are given relative to pixel i, 0 there and the offset at j: no
    /// coordinate is read, and what follows from the offset alone leaves the window loop.
    fn vectors(
        &self,
        b: &mut Builder,
        f: &VectorFunction,
        operands: [Operand; 2],
        places: [Place; 2],
    ) -> Value {
        let coordinates =
            |operand: &Operand| matches!(operand, Operand::Vector(Feature::Pixel, Quantity::Value));
        if f.differences && operands.iter().all(coordinates) {
            let pair = |axis| match self.is_map() {
                true => (b.constant(0.0), b.constant(0.0)),
                false => (b.constant(0.0), self.offset(b, axis)),
            };
            let pairs = [Axis::X, Axis::Y].map(pair);
            return (f.build)(b, &pairs);
        }
        let width = operands.iter().map(Operand::width).max().unwrap_or(1);
        let mut pairs = Vec::with_capacity(width);
        for k in 0..width {
            let [x, y] = [0, 1].map(|n| self.component(b, &operands[n], places[n], k));
            pairs.push((x, y));
        }
        (f.build)(b, &pairs)
    }

    /// A component of an operand of a function of two; missing ones are zero.
    fn component(&self, b: &mut Builder, operand: &Operand, place: Place, k: usize) -> Value {
        if k >= operand.width() {
            return b.constant(0.0);
        }
        match *operand {
            Operand::Scalar(value) => value,
            Operand::Wide(ref values) => values[k],
            Operand::Vector(feature, quantity) => {
                let plane = PlaneId { feature, quantity, component: k as u8 };
                self.read(b, Source::Feature(plane), place)
            }
        }
    }

    /// An operand's components; a bare feature is read.
    fn components(&self, b: &mut Builder, operand: Operand, place: Place) -> Vec<Value> {
        match operand {
            Operand::Scalar(value) => vec![value],
            Operand::Wide(values) => values,
            Operand::Vector(feature, quantity) => PlaneId::of(feature, quantity)
                .map(|plane| self.read(b, Source::Feature(plane), place))
                .collect(),
        }
    }
}

/// Emits a tree. Returns the components of every node by position; of bare features only
/// where something else than a function of two pixels reads them.
pub(super) fn lower(b: &mut Builder, tree: &Tree, at: &Surroundings<'_>) -> Vec<Vec<Value>> {
    let places = tree.places(at.is_map());
    let mut nodes: Vec<Vec<Value>> = Vec::with_capacity(tree.len());
    let mut stack: Vec<(Operand, usize)> = Vec::new();
    for (position, &symbol) in tree.symbols().iter().enumerate() {
        let mut operands = stack.split_off(stack.len() - symbol.arity());
        let operand = match symbol {
            Symbol::Const(literal) => {
                Operand::Scalar(b.constant(literal.value().clamp(-LIMIT, LIMIT)))
            }
            Symbol::Param(k) => Operand::Scalar(at.param(b, k)),
            Symbol::Offset => {
                Operand::Wide([Axis::X, Axis::Y].map(|axis| at.offset(b, axis)).into())
            }
            Symbol::Variance(f) => {
                let plane = PlaneId { feature: f, quantity: Quantity::Variance, component: 0 };
                Operand::Scalar(at.read(b, Source::Feature(plane), places[position]))
            }
            Symbol::Vector(f) => Operand::Vector(f, Quantity::Value),
            Symbol::Gradient(f) => Operand::Vector(f, Quantity::Gradient),
            Symbol::Stage(signal) => Operand::Wide(
                signal
                    .planes()
                    .map(|plane| at.read(b, Source::Stage(plane), places[position]))
                    .collect(),
            ),
            Symbol::Op(op) => {
                if let (Form::Vectors(f), [_, _]) = (at.form(op), operands.as_slice()) {
                    let (y, j) = operands.remove(1);
                    let (x, i) = operands.remove(0);
                    Operand::Scalar(at.vectors(b, &f, [x, y], [places[i], places[j]]))
                } else {
                    let operands = all_components(b, at, &places, operands, &mut nodes);
                    operator(b, op, at.form(op), &operands)
                }
            }
            Symbol::At(_) => match operands.remove(0) {
                // What a bare feature is read for decides how: it keeps its own place.
                (bare @ Operand::Vector(..), _) => {
                    let place = places[position - 1];
                    Operand::Wide(at.components(b, bare, place))
                }
                (operand, _) => operand,
            },
            Symbol::Part(k) => {
                let operands = all_components(b, at, &places, operands, &mut nodes);
                Operand::Scalar(operands[0][usize::from(k)])
            }
            Symbol::Many(function, _) => {
                let operands = all_components(b, at, &places, operands, &mut nodes);
                Operand::Wide(match function {
                    Variadic::Join => operands.concat(),
                    Variadic::Median => median(b, &operands),
                    Variadic::Clamp => clamp(b, &operands),
                    Variadic::Mean => vec![mean(b, &operands.concat())],
                    Variadic::Luminance => vec![luminance(b, &operands[0])],
                })
            }
            Symbol::Linear(layer) => {
                let operands = all_components(b, at, &places, operands, &mut nodes);
                Operand::Wide(at.linear(b, layer, &operands[0]))
            }
        };
        nodes.push(match &operand {
            Operand::Scalar(value) => vec![*value],
            Operand::Wide(values) => values.clone(),
            Operand::Vector(..) => Vec::new(),
        });
        stack.push((operand, position));
    }
    if let Some((bare @ Operand::Vector(..), root)) = stack.pop() {
        nodes[root] = at.components(b, bare, places[root]);
    }
    nodes
}

/// The components of operands. Those of bare features are noted with their nodes.
fn all_components(
    b: &mut Builder,
    at: &Surroundings<'_>,
    places: &[Place],
    operands: Vec<(Operand, usize)>,
    nodes: &mut [Vec<Value>],
) -> Vec<Vec<Value>> {
    let components = operands.into_iter().map(|(operand, position)| {
        let values = at.components(b, operand, places[position]);
        nodes[position].clone_from(&values);
        values
    });
    components.collect()
}

/// An operator on numbers, component by component.
fn operator(b: &mut Builder, op: Op, form: Form, operands: &[Vec<Value>]) -> Operand {
    let width = operands.iter().map(Vec::len).max().unwrap_or(1);
    // What a row says of its results holds for operands as they were rounded. Contracted
    // arithmetic leaves that rounding out, and its primitives know their own ranges.
    let contracted = b.rules().contract && matches!(op, Op::Add | Op::Sub | Op::Mul);
    let mut component = |k: usize| {
        let operand = |n: usize| {
            let values: &Vec<Value> = &operands[n];
            values[k.min(values.len() - 1)]
        };
        let (value, range) = match form {
            Form::Unary(f) => {
                let range = (f.range)(b.range(operand(0)));
                ((f.build)(b, operand(0)), range)
            }
            Form::Binary(f) => {
                let range = (f.range)(b.range(operand(0)), b.range(operand(1)));
                ((f.build)(b, operand(0), operand(1)), range)
            }
            Form::Vectors(_) => unreachable!("functions of two vectors have a way of their own"),
        };
        if !contracted {
            b.assume(value, range);
        }
        value
    };
    match width {
        1 => Operand::Scalar(component(0)),
        width => Operand::Wide((0..width).map(component).collect()),
    }
}

/// The first operand, kept between the second and the third.
fn clamp(b: &mut Builder, operands: &[Vec<Value>]) -> Vec<Value> {
    let width = operands.iter().map(Vec::len).max().unwrap_or(1);
    (0..width)
        .map(|k| {
            let [x, low, high] = [0, 1, 2].map(|n: usize| {
                let values: &Vec<Value> = &operands[n];
                values[k.min(values.len() - 1)]
            });
            let raised = b.max(x, low);
            b.min(raised, high)
        })
        .collect()
}

/// The mean of some values, which are summed in their order.
fn mean(b: &mut Builder, values: &[Value]) -> Value {
    let sum = values.iter().copied().reduce(|sum, x| b.sum(sum, x));
    let share = b.constant(1.0 / values.len() as f32);
    let mean = b.product(sum.expect("a value has components"), share);
    b.limited(mean)
}

fn luminance(b: &mut Builder, color: &[Value]) -> Value {
    let parts = color.iter().zip(Variadic::LUMINANCE);
    let parts: Vec<Value> = parts
        .map(|(&x, share)| {
            let share = b.constant(share);
            b.product(x, share)
        })
        .collect();
    let sum = parts.into_iter().reduce(|sum, x| b.sum(sum, x)).expect("three components");
    b.limited(sum)
}

/// The lower median of every component.
fn median(b: &mut Builder, operands: &[Vec<Value>]) -> Vec<Value> {
    let width = operands.iter().map(Vec::len).max().unwrap_or(1);
    (0..width)
        .map(|k| {
            let values = operands.iter().map(|values| values[k.min(values.len() - 1)]);
            middle(b, values.collect())
        })
        .collect()
}

/// The lower median of some values by forgetful selection: among the first half and two
/// more, the least and the greatest cannot be the median; they are dropped, and the next
/// value takes their place.
fn middle(b: &mut Builder, mut values: Vec<Value>) -> Value {
    // Of an even number the lower median is that of all but the greatest.
    let sort = |b: &mut Builder, pool: &mut [Value], x: usize, y: usize| {
        let (low, high) = (b.min(pool[x], pool[y]), b.max(pool[x], pool[y]));
        (pool[x], pool[y]) = (low, high);
    };
    if values.len().is_multiple_of(2) {
        let last = values.len() - 1;
        (0..last).for_each(|k| sort(b, &mut values, k, last));
        values.pop();
    }
    let count = values.len();
    let mut rest = values.split_off((count / 2 + 2).min(count)).into_iter();
    let mut pool = values;
    while pool.len() > 1 {
        let last = pool.len() - 1;
        (1..=last).for_each(|k| sort(b, &mut pool, 0, k));
        (1..last).for_each(|k| sort(b, &mut pool, k, last));
        pool.remove(last);
        pool.remove(0);
        pool.extend(rest.next());
    }
    pool[0]
}

/// What is known of every node's components, by position: of several components what
/// holds of all.
pub(super) fn ranges(tree: &Tree, at: &Surroundings<'_>) -> Vec<Interval> {
    let mut b = Builder::new(crate::expr::builder::Rules::ALL);
    let nodes = lower(&mut b, tree, at);
    let range = |values: Vec<Value>| values.into_iter().map(|v| b.range(v)).reduce(Interval::hull);
    nodes.into_iter().map(|values| range(values).unwrap_or(Interval::ENTIRE)).collect()
}
