//! One tree for all trees that differ in the order of commuting operands only.
//!
//! Children are often their parents with two operands exchanged. The memo keys
//! on the canonical tree, and it is the canonical tree that gets evaluated, so
//! that the value remembered does not depend on which variant came first: a
//! back end that fuses `a * b + c * d` may round it differently from
//! `c * d + a * b`.

use crate::expr::{Op, Symbol, Tree};

/// Whether an operator's operands may be exchanged. The vector operators'
/// cannot: one is read at pixel i, the other at j.
fn commutes(op: Op) -> bool {
    matches!(op, Op::Add | Op::Mul | Op::Min | Op::Max)
}

/// The tree with the operands of every commuting operator in order: the
/// smaller first, and at equal size by the order of trees.
pub fn canonical(tree: &Tree) -> Tree {
    let mut stack: Vec<Vec<Symbol>> = Vec::new();
    for &symbol in tree.symbols() {
        let mut operands = stack.split_off(stack.len() - symbol.arity());
        if let Symbol::Op(op) = symbol
            && commutes(op)
        {
            operands.sort_by(|a, b| a.len().cmp(&b.len()).then_with(|| a.cmp(b)));
        }
        // Appending to the first operand copies no long chain of unary operators.
        let whole = operands.into_iter().reduce(|mut whole, operand| {
            whole.extend(operand);
            whole
        });
        let mut whole = whole.unwrap_or_default();
        whole.push(symbol);
        stack.push(whole);
    }
    Tree::new(stack.concat()).expect("exchanging operands of one sort keeps a tree well-formed")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::evolve::materials::Materials;
    use crate::evolve::mutation::mutate;
    use crate::evolve::settings::Preset;
    use crate::expr::op::Form;
    use crate::tune::stream;

    #[test]
    fn exactly_the_operators_that_commute_are_said_to() {
        let probes = [-2.0, -0.5, 0.0, 0.3, 1.0, 3.0];
        for &op in Op::ALL {
            if let Form::Binary(f) = op.row().form {
                let symmetric = probes
                    .iter()
                    .all(|&x| probes.iter().all(|&y| (f.meaning)(x, y) == (f.meaning)(y, x)));
                assert_eq!(commutes(op), symmetric, "{op:?}");
            } else {
                assert!(!commutes(op), "{op:?}");
            }
        }
    }

    #[test]
    fn operands_are_put_in_order_at_every_level() {
        let canonical = |text: &str| canonical(&text.parse().unwrap()).to_string();
        for variant in ["(1 + 2) * 3", "(2 + 1) * 3", "3 * (1 + 2)", "3 * (2 + 1)"] {
            assert_eq!(canonical(variant), "3 * (1 + 2)");
        }
        for fixed in ["2 - 1", "2 / 1", "pow(2, 1)", "dot(texture, normal)"] {
            assert_eq!(canonical(fixed), fixed);
        }
    }

    proptest! {
        #[test]
        fn a_canonical_tree_means_the_same(seed in 0..u64::MAX) {
            let settings = Preset::Weights.settings();
            let materials = Materials::new(&settings).unwrap();
            let mut rng = stream(seed, 0, 0, 0);
            let mut tree = materials.initial().clone();
            for _ in 0..20 {
                tree = mutate(&tree, &materials, &settings, &mut rng);
            }
            let meaning = |t: &Tree| {
                t.meaning(|plane, _| f64::from(plane.component) + 0.1 * plane.feature as u8 as f64)
            };
            prop_assert_eq!(meaning(&canonical(&tree)), meaning(&tree));
            prop_assert_eq!(canonical(&canonical(&tree)), canonical(&tree));
        }
    }

    #[test]
    fn depth_is_no_danger() {
        let mut symbols = vec![Symbol::constant(1.0)];
        symbols.extend(std::iter::repeat_n(Symbol::Op(Op::Neg), 100_000));
        let tree = Tree::new(symbols).unwrap();
        assert_eq!(canonical(&tree), tree);
    }
}
