//! From tree to LaTeX, by the rows' patterns.
//!
//! A pattern says nothing about parentheses, so they are read off its braces: an
//! operand that the pattern encloses, as in `\sqrt{#1}`, needs none; the base of
//! a power needs them unless it is a single thing; and one that stands open, as
//! in `#1 + #2`, needs them where it binds weaker than the operator around it.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::f32::consts;

use crate::expr::op::{Op, Sort, Syntax};
use crate::expr::symbol::{Place, Symbol, Variadic};
use crate::expr::tape::Side;
use crate::expr::tree::Tree;

use super::print::{operands_of, starts};
use super::scope::{Reads, Scope};

/// The expression in LaTeX's mathematical mode. A vector carries the pixel that
/// it is read at as its index, as in the paper.
pub fn latex(tree: &Tree) -> String {
    Typesetter::new(tree, Scope::PAPER).text(tree.root(), Around::Enclosed)
}

/// The factors of a product in order, each with the parentheses that it needs
/// beside a `\cdot`, for products that are set on several lines. What is no
/// product is one factor.
pub fn latex_factors(tree: &Tree) -> Vec<String> {
    let typesetter = Typesetter::new(tree, Scope::PAPER);
    let Syntax::Infix(strength) = Op::Mul.row().syntax else { return vec![latex(tree)] };
    let mut factors = Vec::new();
    let mut left = vec![tree.root()];
    while let Some(position) = left.pop() {
        if tree.symbols()[position] == Symbol::Op(Op::Mul) {
            left.extend(typesetter.operands(position).into_iter().rev());
            continue;
        }
        let around = match (factors.is_empty(), left.is_empty()) {
            (true, true) => Around::Enclosed,
            (true, false) => Around::Left(strength),
            (false, _) => Around::Right(strength),
        };
        factors.push(typesetter.text(position, around));
    }
    factors
}

/// A formula of a program, typeset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Formula {
    /// The formula; of a long sum line by line, each but the first with a sign before it.
    pub lines: Vec<String>,
    /// Long sums inside of it: what stands there for them, and their lines likewise.
    pub sums: Vec<(String, Vec<String>)>,
}

/// A formula of a program in mathematical mode. Long sums are set apart: they stand in
/// exponents and under roots, where no line can be broken. What is read carries its pixel as
/// its index, but for a map's own one. The sums are called E, with numbers behind `first`.
pub fn latex_formula(tree: &Tree, scope: &Scope<'_>, first: usize) -> Formula {
    let mut typesetter = Typesetter::new(tree, *scope);
    let sums = typesetter.long_sums();
    let apart = sums.iter().filter(|&&position| position != tree.root());
    typesetter.replaced =
        apart.zip(first + 1..).map(|(&position, k)| (position, format!("E_{{{k}}}"))).collect();
    let lines = match sums.contains(&tree.root()) {
        true => typesetter.lines(tree.root()),
        false => vec![typesetter.text(tree.root(), Around::Enclosed)],
    };
    let name = |position| typesetter.replaced.get(position).cloned();
    let sums =
        sums.iter().filter_map(|position| Some((name(position)?, typesetter.lines(*position))));
    Formula { lines, sums: sums.collect() }
}

/// A name as upright letters, in mathematical mode.
pub fn latex_name(name: &str) -> String {
    format!(r"\mathrm{{{}}}", name.replace('_', r"\_"))
}

/// Sums whose text is longer than this are set on several lines.
const LONG: usize = 230;

/// Operands of a function that stand in a row.
const ROW: usize = 3;

/// A tree, ready to be typeset from any of its nodes.
struct Typesetter<'a> {
    tree: &'a Tree,
    scope: Scope<'a>,
    starts: Vec<usize>,
    /// Of a program's formula: where every node is looked at.
    places: Vec<Place>,
    /// By position, what stands there instead.
    replaced: BTreeMap<usize, String>,
}

impl<'a> Typesetter<'a> {
    fn new(tree: &'a Tree, scope: Scope<'a>) -> Self {
        let places = match scope.reads {
            Reads::Paper => Vec::new(),
            Reads::Pair => tree.places(false),
            Reads::Pixel => tree.places(true),
        };
        Self { tree, scope, starts: starts(tree), places, replaced: BTreeMap::new() }
    }

    fn operands(&self, position: usize) -> Vec<usize> {
        operands_of(self.tree.symbols()[position].arity(), position, &self.starts)
    }

    /// The outermost sums that are long; and within a term of theirs that is too long for a
    /// line, those that are half as long.
    fn long_sums(&self) -> Vec<usize> {
        let mut found = Vec::new();
        let mut left = vec![(self.tree.root(), LONG)];
        while let Some((position, limit)) = left.pop() {
            let length = |position| self.text(position, Around::Enclosed).len();
            let is_sum = matches!(self.tree.symbols()[position], Symbol::Op(Op::Add | Op::Sub));
            if !is_sum || length(position) <= limit {
                left.extend(self.operands(position).into_iter().rev().map(|k| (k, limit)));
                continue;
            }
            found.push(position);
            let long = self.terms(position).into_iter().filter(|&(_, term)| length(term) > LONG);
            left.extend(long.map(|(_, term)| (term, LONG / 2)));
        }
        found
    }

    /// The terms of a sum, the last first, and what stands before each.
    fn terms(&self, sum: usize) -> Vec<(&'static str, usize)> {
        let mut terms = Vec::new();
        let mut position = sum;
        while let Symbol::Op(op @ (Op::Add | Op::Sub)) = self.tree.symbols()[position] {
            let operands = self.operands(position);
            terms.push((op.name(), operands[1]));
            position = operands[0];
        }
        terms.push(("", position));
        terms
    }

    /// The lines of a sum, each but the first with a sign before it.
    fn lines(&self, sum: usize) -> Vec<String> {
        let Syntax::Infix(strength) = Op::Add.row().syntax else { return Vec::new() };
        let mut lines: Vec<String> = Vec::new();
        for (sign, term) in self.terms(sum).into_iter().rev() {
            let term = match sign {
                "" => self.text(term, Around::Left(strength)),
                sign => format!("{sign} {}", self.text(term, Around::Right(strength))),
            };
            match lines.last_mut().filter(|line| line.len() + term.len() <= LONG) {
                Some(line) => {
                    line.push(' ');
                    line.push_str(&term);
                }
                None => lines.push(term),
            }
        }
        lines
    }

    /// The pixel that a node of a program's formula is read at, as an index.
    fn index(&self, position: usize) -> String {
        match (self.places.get(position), self.scope.reads) {
            (None, _) | (Some(Place::Side(_)), Reads::Paper | Reads::Pixel) => String::new(),
            (Some(Place::Side(Side::I)), Reads::Pair) => "_i".to_owned(),
            (Some(Place::Side(Side::J)), Reads::Pair) => "_j".to_owned(),
            (Some(Place::Shift(dx, dy)), _) => format!("_{{i+({dx},{dy})}}"),
        }
    }

    fn text(&self, root: usize, around: Around) -> String {
        let mut text = String::new();
        let mut pieces = vec![Piece::Subtree(root, around, "")];
        while let Some(piece) = pieces.pop() {
            let (position, around, index) = match piece {
                Piece::Text(piece) => {
                    text.push_str(&piece);
                    continue;
                }
                Piece::Subtree(position, around, index) => (position, around, index),
            };
            if let Some(name) = self.replaced.get(&position) {
                text.push_str(name);
                continue;
            }
            let symbol = self.tree.symbols()[position];
            if needs_parentheses(symbol, around) {
                text.push_str(r"\left(");
                pieces.push(Piece::Text(r"\right)".into()));
            }
            let called = |open: &'static str, close: &'static str, between: &'static str| {
                let mut pieces = vec![Piece::Text(close.into())];
                for (k, operand) in self.operands(position).into_iter().enumerate().rev() {
                    pieces.push(Piece::Subtree(operand, Around::Enclosed, ""));
                    if k > 0 {
                        pieces.push(Piece::Text(between.into()));
                    }
                }
                pieces.push(Piece::Text(open.into()));
                pieces
            };
            match symbol {
                Symbol::Const(literal) => text.push_str(&number(literal.value())),
                Symbol::Variance(_)
                | Symbol::Vector(_)
                | Symbol::Gradient(_)
                | Symbol::Stage(_)
                | Symbol::Param(_)
                | Symbol::Offset => {
                    text.push_str(&latex_name(&self.scope.spelling(symbol)));
                    text.push_str(index);
                    if !matches!(symbol, Symbol::Param(_) | Symbol::Offset) {
                        text.push_str(&self.index(position));
                    }
                }
                Symbol::Op(op) => {
                    let roots = self.operands(position);
                    pieces.extend(pattern(op).into_iter().rev().map(|piece| match piece {
                        Part::Text(piece) => Piece::Text(piece.into()),
                        Part::Operand(k, around) => {
                            let index = match (op.operands()[k], k, self.scope.reads) {
                                (Sort::Vector, 0, Reads::Paper) => "_i",
                                (Sort::Vector, _, Reads::Paper) => "_j",
                                (Sort::Scalar | Sort::Vector, ..) => "",
                            };
                            Piece::Subtree(roots[k], around, index)
                        }
                    }));
                }
                // The leaves below carry the place.
                Symbol::At(_) => pieces.push(Piece::Subtree(position - 1, around, "")),
                Symbol::Part(k) => {
                    pieces.push(Piece::Text(format!("[{k}]").into()));
                    pieces.push(Piece::Subtree(position - 1, Around::Base, ""));
                }
                Symbol::Many(Variadic::Join, operands) => {
                    // What is long stands in a column.
                    pieces.extend(match self.extent(position) > 8 * usize::from(operands) {
                        true => called(r"\begin{pmatrix}", r"\end{pmatrix}", r" \\ "),
                        false => called(r"\left(", r"\right)", r",\, "),
                    });
                }
                Symbol::Many(function, _) => {
                    let name = function.name();
                    text.push_str(&format!(r"\operatorname{{{name}}}"));
                    // What is many stands in rows.
                    pieces.extend(match self.operands(position).len() > ROW {
                        true => rows(self.operands(position)),
                        false => called(r"\left(", r"\right)", r",\, "),
                    });
                }
                Symbol::Linear(_) => {
                    let name = self.scope.spelling(symbol).replace('_', r"\_");
                    text.push_str(&format!(r"\operatorname{{{name}}}"));
                    pieces.extend(called(r"\left(", r"\right)", ""));
                }
            }
        }
        text
    }

    /// How many nodes a subtree has.
    fn extent(&self, position: usize) -> usize {
        position + 1 - self.starts[position]
    }
}

/// Operands in parentheses, so many to a row.
fn rows(operands: Vec<usize>) -> Vec<Piece> {
    let mut pieces = vec![Piece::Text(r"\end{gathered}\right)".into())];
    for (k, operand) in operands.into_iter().enumerate().rev() {
        pieces.push(Piece::Subtree(operand, Around::Enclosed, ""));
        match k % ROW {
            _ if k == 0 => {}
            0 => pieces.push(Piece::Text(r",\\ ".into())),
            _ => pieces.push(Piece::Text(r",\, ".into())),
        }
    }
    pieces.push(Piece::Text(r"\left(\begin{gathered}".into()));
    pieces
}

/// What is left to print.
enum Piece {
    Text(Cow<'static, str>),
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
        // Names, and what has parentheses of its own.
        Symbol::Stage(_)
        | Symbol::Param(_)
        | Symbol::Offset
        | Symbol::Part(_)
        | Symbol::Many(..)
        | Symbol::Linear(_) => return false,
        // Its operand says.
        Symbol::At(_) => return false,
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
