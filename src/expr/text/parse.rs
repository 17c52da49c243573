//! From text to tree: operator precedence with an explicit stack.
//!
//! Symbols go to the output in postfix order, which is how trees are kept, so
//! parsing needs no tree of its own. What is still open (a parenthesis, a call,
//! an operator that waits for its right operand) stands on a stack. The parser
//! alternates between two places: where an operand must come, and after one.

use crate::expr::op::{Op, Sort, Syntax};
use crate::expr::symbol::{LayerRef, Place, Symbol, Variadic};
use crate::expr::tape::Side;
use crate::expr::tree::Tree;

use super::MINUS;
use super::error::{Problem, TextError};
use super::lexer::{Kind, Lexer, Token};
use super::scope::{Reads, Scope};

/// Parses an expression, of a certain sort if one is wanted. The paper's expressions are
/// held to their grammar's sorts, the formulas of programs to widths.
pub(super) fn parse(
    text: &str,
    wanted: Option<Sort>,
    scope: &Scope<'_>,
) -> Result<Tree, TextError> {
    let mut lexer = Lexer::new(text);
    let token = lexer.next()?;
    let (output, widths, open) = (Vec::new(), Vec::new(), Vec::new());
    let mut parser = Parser { lexer, token, output, widths, open, wanted, leaf: token, scope };
    parser.operand()?;
    while parser.continues()? {
        parser.operand()?;
    }
    Ok(Tree::new(parser.output).expect("the parser checked every operand's width and count"))
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
    Call(Function, Token<'t>, usize),
    /// An operator that waits for its right operand, with its strength.
    Operator(Op, u8, Token<'t>),
}

/// What can be called.
#[derive(Clone, Copy)]
enum Function {
    Op(Op),
    Many(Variadic),
    Layer(LayerRef),
}

impl Function {
    /// How many operands it takes; `None` for one or more.
    fn arity(self) -> Option<usize> {
        match self {
            Self::Op(op) => Some(op.arity()),
            Self::Many(_) => None,
            Self::Layer(_) => Some(1),
        }
    }

    /// Whether it takes more than so many operands.
    fn takes_more(self, operands: usize) -> bool {
        self.arity().is_none_or(|arity| operands < arity)
    }

    /// Whether it may end after so many operands.
    fn may_end(self, operands: usize) -> bool {
        self.arity().is_none_or(|arity| operands == arity)
    }

    /// The function of so many operands.
    fn symbol(self, operands: usize) -> Symbol {
        match self {
            Self::Op(op) => Symbol::Op(op),
            Self::Many(function) => Symbol::Many(function, operands as u8),
            Self::Layer(layer) => Symbol::Linear(layer),
        }
    }
}

/// Stronger than every infix operator.
const PREFIX_STRENGTH: u8 = u8::MAX;

struct Parser<'t> {
    lexer: Lexer<'t>,
    /// The next token, not yet used.
    token: Token<'t>,
    output: Vec<Symbol>,
    /// The widths of the operands that are complete and wait.
    widths: Vec<usize>,
    open: Vec<Open<'t>>,
    /// The sort of the whole, if it matters.
    wanted: Option<Sort>,
    /// Where the last leaf stands.
    leaf: Token<'t>,
    scope: &'t Scope<'t>,
}

impl<'t> Parser<'t> {
    fn is_paper(&self) -> bool {
        self.scope.reads == Reads::Paper
    }

    /// Puts a symbol behind its operands, if it takes their widths.
    fn emit(&mut self, symbol: Symbol, token: Token<'t>) -> Result<(), TextError> {
        let first = self.widths.len() - symbol.arity();
        let operands = self.widths.split_off(first);
        let Some(width) = symbol.width(&operands) else {
            let what = match symbol {
                Symbol::Linear(layer) => {
                    format!("layer `{}`, of {} inputs,", token.text, layer.columns)
                }
                Symbol::Part(k) => format!("`[{k}]`, the component {k} counted from 0,"),
                _ => format!("`{}`", token.text),
            };
            return Err(self.error(token, Problem::Widths { what, operands }));
        };
        self.output.push(symbol);
        self.widths.push(width);
        Ok(())
    }

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
        if !self.is_paper() {
            return (None, None);
        }
        match self.open.last() {
            None => (self.wanted, None),
            Some(&Open::Parenthesis(_, wanted, by)) => (wanted, by),
            Some(&Open::Call(Function::Op(op), _, complete)) => {
                (Some(op.operands()[complete]), Some(op))
            }
            Some(Open::Call(Function::Many(_) | Function::Layer(_), ..)) => (None, None),
            Some(&Open::Operator(op, ..)) => (op.operands().last().copied(), Some(op)),
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
                Kind::Name => match self.function(token) {
                    Some(function) => {
                        self.check(token, function.symbol(0))?;
                        let parenthesis = self.take()?;
                        if parenthesis.kind != Kind::Open {
                            let expected = format!("`(` and the operands of `{}`", token.text);
                            return Err(self.unexpected(parenthesis, expected));
                        }
                        self.open.push(Open::Call(function, parenthesis, 0));
                    }
                    None => match self.scope.symbol(token.text) {
                        Some(symbol) => return self.leaf(token, symbol),
                        None => {
                            let call = self.token.kind == Kind::Open;
                            let problem = Problem::unknown(token.text, call, self.scope);
                            return Err(self.error(token, problem));
                        }
                    },
                },
                Kind::Sign => {
                    let Some(op) = prefix(token.text) else {
                        return Err(self.expected_operand(token));
                    };
                    self.check(token, Symbol::Op(op))?;
                    if let (MINUS, Kind::Number(x)) = (token.text, self.token.kind) {
                        let number = self.take()?;
                        return self.leaf(number, Symbol::constant(-x));
                    }
                    self.open.push(Open::Operator(op, PREFIX_STRENGTH, token));
                }
                Kind::Close | Kind::Comma | Kind::OpenBracket | Kind::CloseBracket | Kind::End => {
                    return Err(self.expected_operand(token));
                }
            }
        }
    }

    /// The function of a name.
    fn function(&self, token: Token<'t>) -> Option<Function> {
        if let Some(op) = Op::parse_call(token.text) {
            return Some(Function::Op(op));
        }
        if self.is_paper() {
            return None;
        }
        let many = Variadic::ALL.into_iter().find(|function| function.name() == token.text);
        let layer = || Some(Function::Layer(self.scope.layer(token.text)?));
        many.map(Function::Many).or_else(layer)
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
        self.emit(symbol, token)
    }

    /// Reads `i]`, `j]`, `columns, rows]` or `component]`, and applies it to the operand
    /// before it.
    fn bracket(&mut self, opened: Token<'t>) -> Result<(), TextError> {
        const PLACE: &str = "`i`, `j`, an offset such as `1, -2`, or the number of a component";
        let token = self.take()?;
        let symbol = match (token.kind, token.text) {
            (Kind::Name, "i") => Symbol::At(Place::Side(Side::I)),
            (Kind::Name, "j") if self.scope.reads == Reads::Pair => {
                Symbol::At(Place::Side(Side::J))
            }
            (Kind::Name, "j") => {
                let problem = "a map looks at pixel i alone: there is no pixel j";
                return Err(self.error(token, Problem::Place(problem)));
            }
            (Kind::Number(_) | Kind::Sign, _) => {
                let first = self.integer(token)?;
                if self.token.kind == Kind::Comma {
                    let comma = self.take()?;
                    if self.scope.reads != Reads::Pixel {
                        let problem = "a weight looks at the pixels i and j alone; let a map \
                                       look beside them, and read the map";
                        return Err(self.error(comma, Problem::Place(problem)));
                    }
                    let next = self.take()?;
                    let second = self.integer(next)?;
                    let offset = [first, second].map(i8::try_from);
                    let [Ok(dx), Ok(dy)] = offset else {
                        let problem = "offsets reach 127 pixels at most";
                        return Err(self.error(token, Problem::Place(problem)));
                    };
                    Symbol::At(Place::Shift(dx, dy))
                } else {
                    let Ok(component) = u16::try_from(first) else {
                        return Err(self.unexpected(token, PLACE));
                    };
                    Symbol::Part(component)
                }
            }
            _ => return Err(self.unexpected(token, PLACE)),
        };
        let closing = self.take()?;
        if closing.kind != Kind::CloseBracket {
            return Err(self.unexpected(closing, "`]`"));
        }
        self.emit(symbol, opened)
    }

    /// A whole number, which may have a sign.
    fn integer(&mut self, token: Token<'t>) -> Result<i32, TextError> {
        let (negative, digits) = match (token.kind, token.text) {
            (Kind::Sign, MINUS) => (true, self.take()?),
            _ => (false, token),
        };
        match digits.text.parse::<i32>() {
            Ok(number) => Ok(if negative { -number } else { number }),
            Err(_) => Err(self.unexpected(digits, "a whole number")),
        }
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
                    self.complete(strength)?;
                    let (left, wanted) = (self.left(), op.operands()[0]);
                    if self.is_paper() && left.sort() != wanted {
                        // Only a leaf can be a vector: the one that was read last.
                        let problem = Problem::sort(Some(op), wanted, self.leaf.text, left);
                        return Err(self.error(self.leaf, problem));
                    }
                    self.open.push(Open::Operator(op, strength, token));
                    return Ok(true);
                }
                Kind::Comma => {
                    self.comma(token)?;
                    return Ok(true);
                }
                Kind::Close => self.close(token)?,
                Kind::OpenBracket if !self.is_paper() => self.bracket(token)?,
                Kind::End => {
                    self.end()?;
                    return Ok(false);
                }
                Kind::Number(_)
                | Kind::Name
                | Kind::Open
                | Kind::OpenBracket
                | Kind::CloseBracket => {
                    return Err(self.expected_operator(token));
                }
            }
        }
    }

    /// The operand of a call is complete, and another one follows.
    fn comma(&mut self, token: Token<'t>) -> Result<(), TextError> {
        self.complete(0)?;
        match self.open.last_mut() {
            Some(Open::Call(function, _, complete)) if function.takes_more(*complete + 1) => {
                if *complete + 1 == usize::from(u8::MAX) {
                    let problem = "a function takes at most 255 operands";
                    return Err(self.error(token, Problem::Place(problem)));
                }
                *complete += 1;
                Ok(())
            }
            Some(&mut Open::Call(function, _, complete)) => {
                Err(self.arity(token, function, complete + 2))
            }
            Some(Open::Parenthesis(..) | Open::Operator(..)) | None => {
                Err(self.expected_operator(token))
            }
        }
    }

    fn arity(&self, token: Token<'t>, function: Function, given: usize) -> TextError {
        match function {
            Function::Op(op) => self.error(token, Problem::Arity { op, given }),
            Function::Many(_) | Function::Layer(_) => self.unexpected(token, "`)`"),
        }
    }

    /// A parenthesis or a call is complete.
    fn close(&mut self, token: Token<'t>) -> Result<(), TextError> {
        self.complete(0)?;
        match self.open.pop() {
            Some(Open::Parenthesis(..)) => Ok(()),
            Some(Open::Call(function, opened, complete)) if function.may_end(complete + 1) => {
                // The function's name stands right before its parenthesis.
                let before = self.lexer.text[..opened.at].trim_end();
                let inside = |c: char| c.is_ascii_alphanumeric() || c == '_';
                let at = before.trim_end_matches(inside).len();
                let name = Token { at, text: &before[at..], kind: Kind::Name };
                self.emit(function.symbol(complete + 1), name)
            }
            Some(Open::Call(function, _, complete)) => {
                Err(self.arity(token, function, complete + 1))
            }
            Some(Open::Operator(..)) | None => Err(self.expected_operator(token)),
        }
    }

    /// The whole is complete, unless something is still open.
    fn end(&mut self) -> Result<(), TextError> {
        self.complete(0)?;
        let (opened, expected) = match self.open.last() {
            None => return Ok(()),
            Some(&Open::Call(function, opened, complete)) if !function.may_end(complete + 1) => {
                (opened, "`,`")
            }
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
    fn complete(&mut self, strength: u8) -> Result<(), TextError> {
        while let Some(&Open::Operator(op, waiting, token)) = self.open.last()
            && waiting >= strength
        {
            self.open.pop();
            self.emit(Symbol::Op(op), token)?;
        }
        Ok(())
    }

    /// The token cannot follow an operand: says what can.
    fn expected_operator(&self, token: Token<'t>) -> TextError {
        let closing = self.open.iter().rev().find_map(|open| match *open {
            Open::Parenthesis(..) => Some("`)`"),
            Open::Call(function, _, complete) if !function.may_end(complete + 1) => Some("`,`"),
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
            Sort::Scalar | Sort::Vector if !self.is_paper() => {
                format!("{} `[` or {closing}", operators.join(" "))
            }
            Sort::Scalar => format!("{} or {closing}", operators.join(" ")),
            // No infix operator takes vectors.
            Sort::Vector => closing.to_owned(),
        };
        self.unexpected(token, expected)
    }
}
