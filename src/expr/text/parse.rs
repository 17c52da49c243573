//! From text to tree: operator precedence with an explicit stack.
//!
//! Symbols go to the output in postfix order, which is how trees are kept, so
//! parsing needs no tree of its own. What is still open (a parenthesis, a call,
//! an operator that waits for its right operand) stands on a stack. The parser
//! alternates between two places: where an operand must come, and after one.

use crate::expr::feature::Feature;
use crate::expr::op::{Op, Sort, Syntax};
use crate::expr::tree::{Symbol, Tree};

use super::MINUS;
use super::error::{Problem, TextError};
use super::lexer::{Kind, Lexer, Token};

/// Parses an expression, of a certain sort if one is wanted.
pub(super) fn parse(text: &str, wanted: Option<Sort>) -> Result<Tree, TextError> {
    let mut lexer = Lexer::new(text);
    let token = lexer.next()?;
    let (output, open) = (Vec::new(), Vec::new());
    let mut parser = Parser { lexer, token, output, open, wanted, leaf: token };
    parser.operand()?;
    while parser.continues()? {
        parser.operand()?;
    }
    Ok(Tree::new(parser.output).expect("the parser checked every operand's sort and count"))
}

fn prefix(sign: &str) -> Option<Op> {
    Op::ALL.iter().copied().find(|op| op.name() == sign && op.row().syntax == Syntax::Prefix)
}

fn infix(sign: &str) -> Option<(Op, u8)> {
    Op::ALL.iter().filter(|op| op.name() == sign).find_map(|&op| match op.row().syntax {
        Syntax::Infix(strength) => Some((op, strength)),
        Syntax::Call | Syntax::Prefix => None,
    })
}

/// What has begun and waits for more.
#[derive(Clone, Copy)]
enum Open<'t> {
    /// `(`, with the sort that must come of it and the operator that needs it.
    Parenthesis(Token<'t>, Option<Sort>, Option<Op>),
    /// A call, with its parenthesis and the number of operands that are complete.
    Call(Op, Token<'t>, usize),
    /// An operator that waits for its right operand, with its strength.
    Operator(Op, u8),
}

/// Stronger than every infix operator.
const PREFIX_STRENGTH: u8 = u8::MAX;

struct Parser<'t> {
    lexer: Lexer<'t>,
    /// The next token, not yet used.
    token: Token<'t>,
    output: Vec<Symbol>,
    open: Vec<Open<'t>>,
    /// The sort of the whole, if it matters.
    wanted: Option<Sort>,
    /// Where the last leaf stands.
    leaf: Token<'t>,
}

impl<'t> Parser<'t> {
    fn take(&mut self) -> Result<Token<'t>, TextError> {
        let next = self.lexer.next()?;
        Ok(std::mem::replace(&mut self.token, next))
    }

    fn error(&self, token: Token<'t>, problem: Problem) -> TextError {
        TextError::new(self.lexer.text, token.at, problem)
    }

    fn unexpected(&self, token: Token<'t>, expected: impl Into<String>) -> TextError {
        let found = token.describe();
        self.error(token, Problem::Unexpected { expected: expected.into(), found })
    }

    /// The sort that is needed here, and by which operator.
    fn wanted(&self) -> (Option<Sort>, Option<Op>) {
        match self.open.last() {
            None => (self.wanted, None),
            Some(&Open::Parenthesis(_, wanted, by)) => (wanted, by),
            Some(&Open::Call(op, _, complete)) => (Some(op.operands()[complete]), Some(op)),
            Some(&Open::Operator(op, _)) => (op.operands().last().copied(), Some(op)),
        }
    }

    /// Refuses a token that begins an operand of another sort than the needed.
    fn check(&self, token: Token<'t>, symbol: Symbol) -> Result<(), TextError> {
        match self.wanted() {
            (Some(wanted), by) if wanted != symbol.sort() => {
                Err(self.error(token, Problem::sort(by, wanted, token.text, symbol)))
            }
            (Some(_) | None, _) => Ok(()),
        }
    }

    /// Reads whatever may open an operand, up to and including one leaf.
    fn operand(&mut self) -> Result<(), TextError> {
        loop {
            let token = self.take()?;
            match token.kind {
                Kind::Number(x) => return self.leaf(token, Symbol::constant(x)),
                Kind::Open => {
                    let (wanted, by) = self.wanted();
                    self.open.push(Open::Parenthesis(token, wanted, by));
                }
                Kind::Name => {
                    if let Some(op) = Op::parse_call(token.text) {
                        self.check(token, Symbol::Op(op))?;
                        let parenthesis = self.take()?;
                        if parenthesis.kind != Kind::Open {
                            let expected = format!("`(` and the operands of `{}`", op.name());
                            return Err(self.unexpected(parenthesis, expected));
                        }
                        self.open.push(Open::Call(op, parenthesis, 0));
                    } else if let Some((feature, quantity)) = Feature::parse(token.text) {
                        let symbol = Symbol::of(feature, quantity).expect("the spelling exists");
                        return self.leaf(token, symbol);
                    } else {
                        let call = self.token.kind == Kind::Open;
                        return Err(self.error(token, Problem::unknown(token.text, call)));
                    }
                }
                Kind::Sign => {
                    let Some(op) = prefix(token.text) else {
                        return Err(self.expected_operand(token));
                    };
                    self.check(token, Symbol::Op(op))?;
                    if let (MINUS, Kind::Number(x)) = (token.text, self.token.kind) {
                        let number = self.take()?;
                        return self.leaf(number, Symbol::constant(-x));
                    }
                    self.open.push(Open::Operator(op, PREFIX_STRENGTH));
                }
                Kind::Close | Kind::Comma | Kind::End => {
                    return Err(self.expected_operand(token));
                }
            }
        }
    }

    fn expected_operand(&self, token: Token<'t>) -> TextError {
        self.unexpected(
            token,
            match self.wanted() {
                (Some(Sort::Scalar), _) => "a number",
                (Some(Sort::Vector), _) => "a vector",
                (None, _) => "an expression",
            },
        )
    }

    fn leaf(&mut self, token: Token<'t>, symbol: Symbol) -> Result<(), TextError> {
        self.check(token, symbol)?;
        self.leaf = token;
        self.output.push(symbol);
        Ok(())
    }

    /// Reads what may follow an operand; whether another one must come.
    fn continues(&mut self) -> Result<bool, TextError> {
        loop {
            let token = self.take()?;
            match token.kind {
                Kind::Sign => {
                    let Some((op, strength)) = infix(token.text) else {
                        return Err(self.expected_operator(token));
                    };
                    self.complete(strength);
                    let (left, wanted) = (self.left(), op.operands()[0]);
                    if left.sort() != wanted {
                        // Only a leaf can be a vector: the one that was read last.
                        let problem = Problem::sort(Some(op), wanted, self.leaf.text, left);
                        return Err(self.error(self.leaf, problem));
                    }
                    self.open.push(Open::Operator(op, strength));
                    return Ok(true);
                }
                Kind::Comma => {
                    self.comma(token)?;
                    return Ok(true);
                }
                Kind::Close => self.close(token)?,
                Kind::End => {
                    self.end()?;
                    return Ok(false);
                }
                Kind::Number(_) | Kind::Name | Kind::Open => {
                    return Err(self.expected_operator(token));
                }
            }
        }
    }

    /// The operand of a call is complete, and another one follows.
    fn comma(&mut self, token: Token<'t>) -> Result<(), TextError> {
        self.complete(0);
        match self.open.last_mut() {
            Some(Open::Call(op, _, complete)) if *complete + 1 < op.arity() => {
                *complete += 1;
                Ok(())
            }
            Some(&mut Open::Call(op, _, complete)) => {
                Err(self.error(token, Problem::Arity { op, given: complete + 2 }))
            }
            Some(Open::Parenthesis(..) | Open::Operator(..)) | None => {
                Err(self.expected_operator(token))
            }
        }
    }

    /// A parenthesis or a call is complete.
    fn close(&mut self, token: Token<'t>) -> Result<(), TextError> {
        self.complete(0);
        match self.open.pop() {
            Some(Open::Parenthesis(..)) => Ok(()),
            Some(Open::Call(op, _, complete)) if complete + 1 == op.arity() => {
                self.output.push(Symbol::Op(op));
                Ok(())
            }
            Some(Open::Call(op, _, complete)) => {
                Err(self.error(token, Problem::Arity { op, given: complete + 1 }))
            }
            Some(Open::Operator(..)) | None => Err(self.expected_operator(token)),
        }
    }

    /// The whole is complete, unless something is still open.
    fn end(&mut self) -> Result<(), TextError> {
        self.complete(0);
        let (opened, expected) = match self.open.last() {
            None => return Ok(()),
            Some(&Open::Call(op, opened, complete)) if complete + 1 < op.arity() => (opened, "`,`"),
            Some(&(Open::Call(_, opened, _) | Open::Parenthesis(opened, ..))) => (opened, "`)`"),
            Some(Open::Operator(..)) => unreachable!("complete(0) closes operators"),
        };
        Err(self.error(opened, Problem::Unclosed { expected }))
    }

    /// The root of the operand that is complete.
    fn left(&self) -> Symbol {
        *self.output.last().expect("an operand was read")
    }

    /// Gives waiting operators their right operand, as far as they bind at
    /// least as strongly as the one that follows.
    fn complete(&mut self, strength: u8) {
        while let Some(&Open::Operator(op, waiting)) = self.open.last()
            && waiting >= strength
        {
            self.open.pop();
            self.output.push(Symbol::Op(op));
        }
    }

    /// The token cannot follow an operand: says what can.
    fn expected_operator(&self, token: Token<'t>) -> TextError {
        let closing = self.open.iter().rev().find_map(|open| match *open {
            Open::Parenthesis(..) => Some("`)`"),
            Open::Call(op, _, complete) if complete + 1 < op.arity() => Some("`,`"),
            Open::Call(..) => Some("`)`"),
            Open::Operator(..) => None,
        });
        let closing = closing.unwrap_or("the end of the text");
        let operators: Vec<String> = Op::ALL
            .iter()
            .filter(|op| infix(op.name()).is_some_and(|(infix, _)| infix == **op))
            .map(|op| format!("`{}`", op.name()))
            .collect();
        let expected = match self.left().sort() {
            Sort::Scalar => format!("{} or {closing}", operators.join(" ")),
            // No infix operator takes vectors.
            Sort::Vector => closing.to_owned(),
        };
        self.unexpected(token, expected)
    }
}
