//! From text to tokens.

use std::f32::consts;

use crate::expr::op::{Op, Syntax};

use super::error::{Problem, TextError, shortened};
use super::{PI, VARIANCE};

/// A piece of text with its meaning.
#[derive(Clone, Copy)]
pub(super) struct Token<'t> {
    /// Where it starts, in bytes.
    pub(super) at: usize,
    pub(super) text: &'t str,
    pub(super) kind: Kind,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Number(f32),
    /// Of a function or a feature, or of neither.
    Name,
    /// The spelling of infix or prefix operators.
    Sign,
    Open,
    Close,
    Comma,
    /// `[`, after what is looked at elsewhere.
    OpenBracket,
    CloseBracket,
    End,
}

impl Token<'_> {
    /// What an error message calls it.
    pub(super) fn describe(self) -> String {
        match self.kind {
            Kind::End => "the end of the text".to_owned(),
            Kind::Number(_)
            | Kind::Name
            | Kind::Sign
            | Kind::Open
            | Kind::Close
            | Kind::Comma
            | Kind::OpenBracket
            | Kind::CloseBracket => {
                format!("`{}`", shortened(self.text))
            }
        }
    }
}

/// Cuts a text into tokens, skipping layout and comments.
pub(super) struct Lexer<'t> {
    pub(super) text: &'t str,
    at: usize,
}

impl<'t> Lexer<'t> {
    pub(super) fn new(text: &'t str) -> Self {
        Self { text, at: 0 }
    }

    /// The next token; [`Kind::End`] again and again once the text is used up.
    pub(super) fn next(&mut self) -> Result<Token<'t>, TextError> {
        let text = self.text;
        loop {
            self.at = text.len() - text[self.at..].trim_start().len();
            if !text[self.at..].starts_with('#') {
                break;
            }
            self.at = text[self.at..].find('\n').map_or(text.len(), |length| self.at + length);
        }
        let rest = &text[self.at..];
        let (kind, length) = match rest.bytes().next() {
            None => (Kind::End, 0),
            Some(b'(') => (Kind::Open, 1),
            Some(b')') => (Kind::Close, 1),
            Some(b',') => (Kind::Comma, 1),
            Some(b'[') => (Kind::OpenBracket, 1),
            Some(b']') => (Kind::CloseBracket, 1),
            Some(b'0'..=b'9' | b'.') if number_length(rest) > 0 => {
                let length = number_length(rest);
                (Kind::Number(self.number(&rest[..length])?), length)
            }
            Some(b'a'..=b'z' | b'A'..=b'Z' | b'_') => {
                let is_inside = |c: char| c.is_ascii_alphanumeric() || c == '_';
                let length = rest.find(|c| !is_inside(c)).unwrap_or(rest.len());
                let variance = rest[length..].starts_with(VARIANCE)
                    && !rest[length + VARIANCE.len()..].starts_with(is_inside);
                let length = if variance { length + VARIANCE.len() } else { length };
                let kind =
                    if &rest[..length] == PI { Kind::Number(consts::PI) } else { Kind::Name };
                (kind, length)
            }
            Some(_) => match signs().filter(|s| rest.starts_with(s)).map(str::len).max() {
                Some(length) => (Kind::Sign, length),
                None => {
                    let character = rest.chars().next().expect("the rest is not empty");
                    return Err(TextError::new(text, self.at, Problem::Character(character)));
                }
            },
        };
        let token = Token { at: self.at, text: &rest[..length], kind };
        self.at += length;
        Ok(token)
    }

    fn number(&self, digits: &str) -> Result<f32, TextError> {
        let x: f32 = digits.parse().expect("number_length() finds what f32 parses");
        let mantissa = digits.split(['e', 'E']).next().unwrap_or(digits);
        let vanishes = x == 0.0 && mantissa.contains(|c: char| matches!(c, '1'..='9'));
        if x.is_finite() && !vanishes {
            Ok(x)
        } else {
            Err(TextError::new(self.text, self.at, Problem::Range(shortened(digits))))
        }
    }
}

/// How many bytes a number at the start of a text takes; 0 if there is none.
fn number_length(text: &str) -> usize {
    let digits = |from: usize| text[from..].bytes().take_while(u8::is_ascii_digit).count();
    let whole = digits(0);
    let mut end = whole;
    if text[end..].starts_with('.') {
        end += 1 + digits(end + 1);
        if end == whole + 1 && whole == 0 {
            return 0;
        }
    }
    if text[end..].starts_with(['e', 'E']) {
        let sign = usize::from(text[end + 1..].starts_with(['+', '-']));
        let exponent = digits(end + 1 + sign);
        if exponent > 0 {
            end += 1 + sign + exponent;
        }
    }
    end
}

/// The spellings of infix and prefix operators.
fn signs() -> impl Iterator<Item = &'static str> {
    Op::ALL.iter().filter(|op| op.row().syntax != Syntax::Call).map(|op| op.name())
}
