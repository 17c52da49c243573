//! Expressions as people write them: `exp(-distance2(normal, normal) / 0.1)`.
//!
//! [`Tree`] is parsed with [`FromStr`] and printed with
//! [`Display`](fmt::Display). Both read the operators' and the features' rows
//! and hold no list of their own:
//!
//! ```text
//! expression  = operand { infix operand }          usual precedence, from the left
//! operand     = number | feature | "-" operand | "(" expression ")"
//!             | function "(" expression { "," expression } ")"
//! number      = [ "-" ] ( decimal [ exponent ] | "pi" )
//! ```
//!
//! A program's formulas ([`parse_formula`]) have more: names of earlier stages and of
//! constants, functions of any number of operands, operators on vectors component by
//! component, and places.
//!
//! ```text
//! operand     = … | stage [ ".variance" ] | constant | "offset" | layer "(" expression ")"
//!             | operand "[" place "]"
//! place       = "i" | "j"                          an end of the pair, in weights
//!             | integer "," integer                columns to the right, rows below, in maps
//!             | integer                            no place: a component, from 0
//! ```
//!
//! Spaces and line breaks are free, and `#` starts a comment that ends with the
//! line. A minus sign that stands before a number belongs to the number: `-2`
//! is the constant, `-(2)` the negation of 2, and `--2` the negation of -2.
//!
//! # Promises
//! * Printing and parsing give the same tree back, with the same bits in every
//!   constant. Text is printed with as few parentheses as that allows.
//! * Neither recurses, and both take time and memory in proportion to the text.
//!   So neither depth nor size needs a limit, and a hundred thousand open
//!   parentheses are merely an error about the first that nobody closed.
//! * Numbers that `f32` cannot hold are refused, at either end of its range.
//!
//! # What it does not know
//! What an expression is for: `normal` alone is a tree, though no weight.
//! [`parse_scalar`] is for callers that need a number.

mod error;
mod latex;
mod lexer;
mod parse;
mod print;
mod scope;

use std::fmt;
use std::str::FromStr;

use super::op::Sort;
use super::tree::Tree;

pub use error::{Problem, TextError};
pub use latex::{Formula, latex, latex_factors, latex_formula, latex_name};
pub use scope::{Declared, Reads, Scope, is_free};

/// The sign of negative numbers, which is also the spelling of negation.
const MINUS: &str = "-";

/// The one constant that has a name.
const PI: &str = "pi";

/// How far pixel j is from pixel i, in weights of programs.
const OFFSET: &str = "offset";

/// What follows a stage's name where the variance of its mean is meant.
const VARIANCE: &str = ".variance";

/// Parses an expression that must be a number, such as a filter's weight.
pub fn parse_scalar(text: &str) -> Result<Tree, TextError> {
    parse::parse(text, Some(Sort::Scalar), &Scope::PAPER)
}

/// Parses a formula of a program.
pub fn parse_formula(text: &str, scope: &Scope<'_>) -> Result<Tree, TextError> {
    parse::parse(text, None, scope)
}

/// Prints a formula of a program, so that [`parse_formula`] reads it back.
pub fn print_formula(tree: &Tree, scope: &Scope<'_>) -> String {
    struct Shown<'a>(&'a Tree, &'a Scope<'a>);
    impl fmt::Display for Shown<'_> {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            print::print(self.0, self.1, f)
        }
    }
    Shown(tree, scope).to_string()
}

impl FromStr for Tree {
    type Err = TextError;

    fn from_str(text: &str) -> Result<Self, TextError> {
        parse::parse(text, None, &Scope::PAPER)
    }
}

impl fmt::Display for Tree {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        print::print(self, &Scope::PAPER, f)
    }
}

#[cfg(test)]
mod tests;
