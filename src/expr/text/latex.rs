//! From tree to LaTeX, by the rows' patterns.
//!
//! A pattern says nothing about parentheses, so they are read off its braces: an
//! operand that the pattern encloses, as in `\sqrt{#1}`, needs none; the base of
//! a power needs them unless it is a single thing; and one that stands open, as
//! in `#1 + #2`, needs them where it binds weaker than the operator around it.

use std::f32::consts;

use crate::expr::op::{Op, Sort, Syntax};
use crate::expr::symbol::Symbol;
use crate::expr::tree::Tree;

use super::print::{operands, starts};
use super::scope::Scope;

/// What callers see to.
const PAPER_ALONE: &str = "expressions of the paper's grammar alone are typeset";

/// The expression in LaTeX's mathematical mode. A vector carries the pixel that
/// it is read at as its index, as in the paper.
///
/// # Panics
/// If the expression is not one of the paper's grammar: see [`Tree::is_paper`].
pub fn latex(tree: &Tree) -> String {
    typeset(tree, &starts(tree), tree.root(), Around::Enclosed)
}

/// The factors of a product in order, each with the parentheses that it needs
/// beside a `\cdot`, for products that are set on several lines. What is no
/// product is one factor.
pub fn latex_factors(tree: &Tree) -> Vec<String> {
    let starts = starts(tree);
    let Syntax::Infix(strength) = Op::Mul.row().syntax else { return vec![latex(tree)] };
    let mut factors = Vec::new();
    let mut left = vec![tree.root()];
    while let Some(position) = left.pop() {
        if tree.symbols()[position] == Symbol::Op(Op::Mul) {
            left.extend(operands(Op::Mul, position, &starts).into_iter().rev());
            continue;
        }
        let around = match (factors.is_empty(), left.is_empty()) {
            (true, true) => Around::Enclosed,
            (true, false) => Around::Left(strength),
            (false, _) => Around::Right(strength),
        };
        factors.push(typeset(tree, &starts, position, around));
    }
    factors
}

fn typeset(tree: &Tree, starts: &[usize], root: usize, around: Around) -> String {
    let mut text = String::new();
    let mut pieces = vec![Piece::Subtree(root, around, "")];
    while let Some(piece) = pieces.pop() {
        let (position, around, index) = match piece {
            Piece::Text(piece) => {
                text.push_str(piece);
                continue;
            }
            Piece::Subtree(position, around, index) => (position, around, index),
        };
        let symbol = tree.symbols()[position];
        if needs_parentheses(symbol, around) {
            text.push_str(r"\left(");
            pieces.push(Piece::Text(r"\right)"));
        }
        match symbol {
            Symbol::Const(literal) => text.push_str(&number(literal.value())),
            Symbol::Variance(_) | Symbol::Vector(_) | Symbol::Gradient(_) => {
                let name = Scope::PAPER.spelling(symbol);
                text.push_str(&format!(r"\mathrm{{{name}}}{index}"));
            }
            Symbol::Op(op) => {
                let roots = operands(op, position, starts);
                pieces.extend(pattern(op).into_iter().rev().map(|piece| match piece {
                    Part::Text(piece) => Piece::Text(piece),
                    Part::Operand(k, around) => {
                        let index = match (op.operands()[k], k) {
                            (Sort::Scalar, _) => "",
                            (Sort::Vector, 0) => "_i",
                            (Sort::Vector, _) => "_j",
                        };
                        Piece::Subtree(roots[k], around, index)
                    }
                }));
            }
            _ => unreachable!("{PAPER_ALONE}"),
        }
    }
    text
}

/// What is left to print.
enum Piece {
    Text(&'static str),
    /// The subtree at a position, and the index that it carries if it is a vector.
    Subtree(usize, Around, &'static str),
}

/// A part of an operator's pattern.
enum Part {
    Text(&'static str),
    Operand(usize, Around),
}

/// What a pattern puts around an operand.
#[derive(Clone, Copy, PartialEq)]
enum Around {
    /// Braces, bars or parentheses.
    Enclosed,
    /// Nothing, on the left of an infix operator of this strength.
    Left(u8),
    /// Nothing, on its right.
    Right(u8),
    /// A sign before it.
    Sign,
    /// The name of a function before it.
    Name,
    /// An exponent above it.
    Base,
}

fn pattern(op: Op) -> Vec<Part> {
    let mut parts = Vec::new();
    let mut rest = op.row().latex;
    let mut before = None;
    while let Some(mark) = rest.find('#') {
        let (text, operand) = rest.split_at(mark);
        let after = &operand[2..];
        let k = usize::from(operand.as_bytes()[1] - b'1');
        before = text.chars().last().or(before);
        let around = match (before, op.row().syntax) {
            (Some('{'), _) if after.starts_with("}^") => Around::Base,
            (Some('{' | '('), _) => Around::Enclosed,
            (_, Syntax::Infix(strength)) if k == 0 => Around::Left(strength),
            (_, Syntax::Infix(strength)) => Around::Right(strength),
            (_, Syntax::Prefix) => Around::Sign,
            (_, Syntax::Call) => Around::Name,
        };
        parts.extend([Part::Text(text), Part::Operand(k, around)]);
        rest = after;
    }
    parts.push(Part::Text(rest));
    parts
}

fn needs_parentheses(symbol: Symbol, around: Around) -> bool {
    let row = match symbol {
        // Vectors stand alone in whatever encloses them.
        Symbol::Vector(_) | Symbol::Gradient(_) => return false,
        Symbol::Variance(_) => return around == Around::Name,
        Symbol::Const(literal) => {
            let signed = literal.value().is_sign_negative();
            let scaled = number(literal.value()).contains('^');
            return match around {
                Around::Enclosed | Around::Left(_) => false,
                Around::Right(_) | Around::Sign => signed,
                Around::Base => signed || scaled,
                Around::Name => true,
            };
        }
        Symbol::Op(op) => op.row(),
        _ => unreachable!("{PAPER_ALONE}"),
    };
    // A pattern that starts or ends with an operand is open to its surroundings.
    let open = row.latex.starts_with('#') || row.latex.ends_with(char::is_numeric);
    match (around, row.syntax) {
        (Around::Enclosed, _) | (Around::Left(_), Syntax::Prefix) => false,
        (Around::Name, _) | (Around::Right(_) | Around::Sign, Syntax::Prefix) => true,
        (Around::Base, _) => open || row.latex.contains('^') || row.latex.starts_with(r"\frac"),
        (Around::Left(strength), Syntax::Infix(own)) => open && own < strength,
        (Around::Right(strength), Syntax::Infix(own)) => open && own <= strength,
        (Around::Sign, Syntax::Infix(_)) => open,
        // The operand after a function's name has its own parentheses.
        (Around::Left(_) | Around::Right(_) | Around::Sign, Syntax::Call) => {
            row.latex.starts_with('#')
        }
    }
}

/// Decimal, as the text form has it, with its exponent as a power of ten.
fn number(x: f32) -> String {
    let text = Tree::constant(x).to_string();
    if x.abs() == consts::PI {
        return text.replace(super::PI, r"\pi");
    }
    match text.split_once('e') {
        Some((mantissa, exponent)) => format!(r"{mantissa} \cdot 10^{{{exponent}}}"),
        None => text,
    }
}
