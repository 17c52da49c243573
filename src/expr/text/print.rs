//! From tree to text, without recursion and in linear time.

use std::f32::consts;
use std::fmt;

use crate::expr::op::{Op, Syntax};
use crate::expr::symbol::{Literal, Place, Symbol};
use crate::expr::tape::Side;
use crate::expr::tree::Tree;

use super::PI;
use super::scope::Scope;

/// What stands around an operand, and may tear it apart.
#[derive(Clone, Copy)]
enum Around {
    /// Nothing: the operand is the whole, or stands between `(`, `,` and `)`.
    Nothing,
    /// A sign before it.
    Sign,
    /// An infix operator that operands weaker than this cannot stand beside.
    Infix(u8),
    /// A place or a component after it.
    Index,
}

/// What is left to print.
enum Piece {
    Text(&'static str),
    /// A place or the number of a component.
    Index(String),
    /// The subtree at a position.
    Subtree(usize, Around),
}

/// Prints a tree, with the names of a scope.
pub(super) fn print(tree: &Tree, scope: &Scope<'_>, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let starts = starts(tree);
    // Last in, first out: the pieces of a node are pushed from right to left.
    let mut pieces = vec![Piece::Subtree(tree.root(), Around::Nothing)];
    while let Some(piece) = pieces.pop() {
        let (position, around) = match piece {
            Piece::Text(text) => {
                f.write_str(text)?;
                continue;
            }
            Piece::Index(text) => {
                f.write_str(&text)?;
                continue;
            }
            Piece::Subtree(position, around) => (position, around),
        };
        let symbol = tree.symbols()[position];
        if needs_parentheses(symbol, around) {
            f.write_str("(")?;
            pieces.push(Piece::Text(")"));
        }
        match symbol {
            Symbol::Const(literal) => number(literal, f)?,
            Symbol::Variance(_)
            | Symbol::Vector(_)
            | Symbol::Gradient(_)
            | Symbol::Stage(_)
            | Symbol::Param(_)
            | Symbol::Offset => f.write_str(&scope.spelling(symbol))?,
            Symbol::Op(op) => operator(op, position, &starts, &mut pieces),
            Symbol::At(place) => {
                let index = match place {
                    Place::Side(Side::I) => "[i]".to_owned(),
                    Place::Side(Side::J) => "[j]".to_owned(),
                    Place::Shift(dx, dy) => format!("[{dx}, {dy}]"),
                };
                pieces.push(Piece::Index(index));
                pieces.push(Piece::Subtree(position - 1, Around::Index));
            }
            Symbol::Part(k) => {
                pieces.push(Piece::Index(format!("[{k}]")));
                pieces.push(Piece::Subtree(position - 1, Around::Index));
            }

            Symbol::Many(function, count) => {
                f.write_str(function.name())?;
                let operands = operands_of(usize::from(count), position, &starts);
                arguments(&operands, &mut pieces);
            }
            Symbol::Linear(_) => {
                f.write_str(&scope.spelling(symbol))?;
                arguments(&[position - 1], &mut pieces);
            }
        }
    }
    Ok(())
}

/// Pushes the pieces of an operator with its operands.
fn operator(op: Op, position: usize, starts: &[usize], pieces: &mut Vec<Piece>) {
    let operands = operands_of(op.arity(), position, starts);
    match (op.row().syntax, operands.as_slice()) {
        (Syntax::Infix(strength), &[left, right]) => {
            // From the left: an equally strong operator on the right needs parentheses.
            pieces.push(Piece::Subtree(right, Around::Infix(strength + 1)));
            pieces.extend([" ", op.name(), " "].map(Piece::Text));
            pieces.push(Piece::Subtree(left, Around::Infix(strength)));
        }
        (Syntax::Prefix, &[operand]) => {
            pieces.push(Piece::Subtree(operand, Around::Sign));
            pieces.push(Piece::Text(op.name()));
        }
        (Syntax::Call | Syntax::Prefix | Syntax::Infix(_), operands) => {
            arguments(operands, pieces);
            pieces.push(Piece::Text(op.name()));
        }
    }
}

/// Pushes the pieces of operands in parentheses.
fn arguments(operands: &[usize], pieces: &mut Vec<Piece>) {
    pieces.push(Piece::Text(")"));
    for (k, &operand) in operands.iter().enumerate().rev() {
        pieces.push(Piece::Subtree(operand, Around::Nothing));
        pieces.push(Piece::Text(if k > 0 { ", " } else { "(" }));
    }
}

fn needs_parentheses(symbol: Symbol, around: Around) -> bool {
    let infix = symbol.op().and_then(|op| match op.row().syntax {
        Syntax::Infix(strength) => Some(strength),
        Syntax::Prefix | Syntax::Call => None,
    });
    match (around, infix) {
        (Around::Nothing, _) => false,
        (Around::Index, Some(_)) => true,
        // A sign binds less than an index does, and a number has none.
        (Around::Index, None) => match symbol {
            Symbol::Op(op) => op.row().syntax == Syntax::Prefix,
            Symbol::Const(_) => true,
            _ => false,
        },
        (Around::Infix(least), infix) => infix.is_some_and(|strength| strength < least),
        (Around::Sign, Some(_)) => true,
        // A sign before a number would become the number's own.
        (Around::Sign, None) => {
            matches!(symbol, Symbol::Const(literal) if literal.value().is_sign_positive())
        }
    }
}

/// Where the subtree at each position starts. [`Tree::extent`] finds one of
/// them in time proportional to the subtree; all of them together are as cheap.
pub(super) fn starts(tree: &Tree) -> Vec<usize> {
    let mut starts: Vec<usize> = Vec::with_capacity(tree.len());
    for (position, symbol) in tree.symbols().iter().enumerate() {
        let mut start = position;
        for _ in 0..symbol.arity() {
            start = starts[start - 1];
        }
        starts.push(start);
    }
    starts
}

/// The positions of so many operands before a position, in order.
pub(super) fn operands_of(count: usize, position: usize, starts: &[usize]) -> Vec<usize> {
    let mut roots = Vec::with_capacity(count);
    let mut end = position;
    for _ in 0..count {
        roots.push(end - 1);
        end = starts[end - 1];
    }
    roots.reverse();
    roots
}

/// The shortest decimal that parses to the same bits; with an exponent outside
/// [1e-4, 1e7).
fn number(literal: Literal, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let x = literal.value();
    let magnitude = x.abs();
    if magnitude == consts::PI {
        write!(f, "{}{PI}", if x < 0.0 { "-" } else { "" })
    } else if magnitude == 0.0 || (1e-4..1e7).contains(&magnitude) {
        write!(f, "{x}")
    } else {
        write!(f, "{x:e}")
    }
}
