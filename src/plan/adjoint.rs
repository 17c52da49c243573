//! Reverse mode through a formula: from what is owed to its result to what is owed to
//! everything that it reads.
//!
//! The adjoint of a value is the derivative of the loss by it. Nodes are visited from the
//! root down; each hands its adjoint to its operands, times its row's derivatives. Only
//! nodes that hang on something that may change are visited.
//!
//! Functions of any number of operands have kinks of their own. A median hands all to the
//! first operand that it equals, a clamp to whichever of the three it equals, and to the
//! bound where two are equal.

use std::collections::BTreeMap;

use super::lower::Surroundings;
use crate::expr::builder::Builder;
use crate::expr::derivative::unless_limited;
use crate::expr::op::Form;
use crate::expr::symbol::{LayerRef, Place, StagePlane, Symbol, Variadic};
use crate::expr::tape::Value;
use crate::expr::tree::Tree;

/// What is owed to what a formula reads.
#[derive(Default)]
pub(super) struct Adjoints {
    /// To planes of earlier stages, by where they are looked at.
    pub(super) reads: BTreeMap<(StagePlane, Place), Value>,
    /// To single constants, by number.
    pub(super) params: BTreeMap<u16, Value>,
    /// To the numbers of layers.
    pub(super) layers: Vec<LayerAdjoint>,
}

/// What is owed to the numbers of a layer: to W the products of both, to b the first.
pub(super) struct LayerAdjoint {
    pub(super) layer: LayerRef,
    /// What is owed to each result; nothing to those that nobody reads.
    pub(super) outputs: Vec<Option<Value>>,
    /// What the layer was applied to.
    pub(super) inputs: Vec<Value>,
}

/// What is owed to the components of nodes, by position.
struct Owed<'a> {
    b: &'a mut Builder,
    nodes: Vec<Vec<Option<Value>>>,
}

impl Owed<'_> {
    /// Adds to what is owed to a component; a single one stands for all.
    fn add(&mut self, position: usize, component: usize, value: Value) {
        let components = &mut self.nodes[position];
        let component = component.min(components.len() - 1);
        let sum = match components[component] {
            Some(known) => self.b.sum(known, value),
            None => value,
        };
        components[component] = Some(sum);
    }
}

/// Emits the adjoints of a tree whose nodes have been lowered to these components, from
/// those of its result. `changes` says whether what a leaf, or a layer, reads may change.
pub(super) fn reverse(
    b: &mut Builder,
    tree: &Tree,
    nodes: &[Vec<Value>],
    result: &[Option<Value>],
    at: &Surroundings<'_>,
    changes: &dyn Fn(Symbol) -> bool,
) -> Adjoints {
    let places = tree.places(at.is_map());
    let operands: Vec<Vec<usize>> = (0..tree.len()).map(|k| tree.operands(k)).collect();
    let mut changing: Vec<bool> = Vec::with_capacity(tree.len());
    for (position, &symbol) in tree.symbols().iter().enumerate() {
        changing.push(changes(symbol) || operands[position].iter().any(|&k| changing[k]));
    }
    let mut adjoints = Adjoints::default();
    let nothing = |values: &Vec<Value>| vec![None; values.len().max(1)];
    let mut owed = Owed { b, nodes: nodes.iter().map(nothing).collect() };
    if changing[tree.root()] {
        owed.nodes[tree.root()] = result.to_vec();
    }
    for position in (0..tree.len()).rev() {
        let own = std::mem::take(&mut owed.nodes[position]);
        if !changing[position] || own.iter().all(Option::is_none) {
            continue;
        }
        let children = operands[position].as_slice();
        let components = || own.iter().enumerate().filter_map(|(k, &value)| Some((k, value?)));
        let of = |child: usize, component: usize| {
            let values = &nodes[child];
            values[component.min(values.len() - 1)]
        };
        match tree.symbols()[position] {
            Symbol::Const(_)
            | Symbol::Offset
            | Symbol::Variance(_)
            | Symbol::Vector(_)
            | Symbol::Gradient(_) => {}
            Symbol::Param(k) => {
                for (_, value) in components() {
                    let sum = match adjoints.params.get(&k) {
                        Some(&known) => owed.b.sum(known, value),
                        None => value,
                    };
                    adjoints.params.insert(k, sum);
                }
            }
            Symbol::Stage(signal) => {
                let planes: Vec<StagePlane> = signal.planes().collect();
                for (k, value) in components() {
                    let key = (planes[k], places[position]);
                    let sum = match adjoints.reads.get(&key) {
                        Some(&known) => owed.b.sum(known, value),
                        None => value,
                    };
                    adjoints.reads.insert(key, sum);
                }
            }
            Symbol::Op(op) => match (at.form(op), children) {
                (Form::Unary(f), &[x]) => {
                    for (k, value) in components() {
                        let derivative = (f.derivative)(owed.b, of(x, k), nodes[position][k]);
                        let share = owed.b.product(value, derivative);
                        owed.add(x, k, share);
                    }
                }
                (Form::Binary(f), &[x, y]) => {
                    for (k, value) in components() {
                        let result = nodes[position][k];
                        let derivatives = (f.derivatives)(owed.b, of(x, k), of(y, k), result);
                        for (child, derivative) in [x, y].into_iter().zip(derivatives) {
                            if changing[child] {
                                let share = owed.b.product(value, derivative);
                                owed.add(child, k, share);
                            }
                        }
                    }
                }
                (Form::Vectors(f), &[x, y]) => {
                    let [own_x, own_y] = [x, y].map(|child| match nodes[child].as_slice() {
                        [] => at.bare(owed.b, tree.symbols()[child], places[child]),
                        values => values.to_vec(),
                    });
                    let width = own_x.len().max(own_y.len());
                    let zero = owed.b.constant(0.0);
                    let component = |values: &[Value], k| values.get(k).copied().unwrap_or(zero);
                    let pairs: Vec<(Value, Value)> =
                        (0..width).map(|k| (component(&own_x, k), component(&own_y, k))).collect();
                    let derivatives = (f.derivatives)(owed.b, &pairs, nodes[position][0]);
                    for (_, value) in components() {
                        for (k, &(by_x, by_y)) in derivatives.iter().enumerate() {
                            for (child, own, by) in [(x, &own_x, by_x), (y, &own_y, by_y)] {
                                if changing[child] && k < own.len() {
                                    let share = owed.b.product(value, by);
                                    owed.add(child, k, share);
                                }
                            }
                        }
                    }
                }
                (Form::Unary(_) | Form::Binary(_) | Form::Vectors(_), _) => {
                    unreachable!("operators have as many operands as they take")
                }
            },
            Symbol::At(_) => {
                for (k, value) in components() {
                    owed.add(children[0], k, value);
                }
            }
            Symbol::Part(component) => {
                for (_, value) in components() {
                    owed.add(children[0], component.into(), value);
                }
            }
            Symbol::Many(function, _) => {
                // The operands' components, one after another.
                let all = |&child: &usize| (0..nodes[child].len()).map(move |k| (child, k));
                let joined: Vec<(usize, usize)> = children.iter().flat_map(all).collect();
                for (k, value) in components() {
                    let mut shares: Vec<(usize, usize, Value)> = Vec::new();
                    let b = &mut *owed.b;
                    match function {
                        Variadic::Join => shares.push((joined[k].0, joined[k].1, value)),
                        Variadic::Mean => {
                            let share = b.constant(1.0 / joined.len() as f32);
                            let value = unless_limited(b, nodes[position][k], value);
                            let value = b.product(value, share);
                            shares.extend(joined.iter().map(|&(child, k)| (child, k, value)));
                        }
                        Variadic::Luminance => {
                            let value = unless_limited(b, nodes[position][k], value);
                            for (&(child, k), share) in joined.iter().zip(Variadic::LUMINANCE) {
                                let share = b.constant(share);
                                shares.push((child, k, b.product(value, share)));
                            }
                        }
                        Variadic::Median => {
                            let (median, zero) = (nodes[position][k], b.constant(0.0));
                            let mut rest = value;
                            for &child in children {
                                let x = of(child, k);
                                let share = b.select_lt(median, x, zero, rest);
                                let share = b.select_lt(x, median, zero, share);
                                rest = b.sub(rest, share);
                                shares.push((child, k, share));
                            }
                        }
                        Variadic::Clamp => {
                            let [x, low, high] = [0, 1, 2].map(|n| of(children[n], k));
                            let zero = b.constant(0.0);
                            let raised = b.max(x, low);
                            let to_raised = b.select_lt(raised, high, value, zero);
                            let to_high = b.select_lt(raised, high, zero, value);
                            let to_x = b.select_lt(low, x, to_raised, zero);
                            let to_low = b.select_lt(low, x, zero, to_raised);
                            let all = children.iter().zip([to_x, to_low, to_high]);
                            shares.extend(all.map(|(&child, share)| (child, k, share)));
                        }
                    }
                    for (child, k, share) in shares {
                        if changing[child] {
                            owed.add(child, k, share);
                        }
                    }
                }
            }
            Symbol::Linear(layer) => {
                let x = children[0];
                let outputs: Vec<Option<Value>> = own
                    .iter()
                    .zip(&nodes[position])
                    .map(|(value, &y)| value.map(|value| unless_limited(owed.b, y, value)))
                    .collect();
                if changing[x] {
                    for column in 0..nodes[x].len() {
                        let mut sum: Option<Value> = None;
                        for (row, value) in outputs.iter().enumerate() {
                            let Some(value) = *value else { continue };
                            let weight = at.weight(owed.b, layer, row, column);
                            sum = Some(match sum {
                                Some(sum) => owed.b.fma(weight, value, sum),
                                None => owed.b.product(weight, value),
                            });
                        }
                        owed.add(x, column, sum.expect("something is owed to some result"));
                    }
                }
                adjoints.layers.push(LayerAdjoint { layer, outputs, inputs: nodes[x].clone() });
            }
        }
    }
    adjoints
}
