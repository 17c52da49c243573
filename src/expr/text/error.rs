//! What can be wrong with a text, and where.

use std::fmt;

use crate::expr::feature::{Feature, Quantity};
use crate::expr::op::{Op, Sort, Syntax};
use crate::expr::symbol::{Symbol, Variadic};

use super::scope::{Reads, Scope};
use super::{MINUS, PI, VARIANCE};

/// A text that is no expression: the place, and the [`Problem`] there.
///
/// Its [`Display`](fmt::Display) shows the line with a caret under the place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextError {
    line: usize,
    column: usize,
    excerpt: String,
    caret: usize,
    problem: Problem,
}

/// What is wrong with a text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Problem {
    /// Something else was needed at this place.
    #[error("expected {expected}, found {found}")]
    Unexpected {
        /// What could have stood here.
        expected: String,
        /// What does.
        found: String,
    },
    /// A character that no expression contains.
    #[error("`{0}` has no meaning in an expression")]
    Character(char),
    /// A number beyond the range of `f32`.
    #[error("`{0}` is out of range: numbers are 32-bit floats, from 1e-45 to 3.4e38")]
    Range(String),
    /// A name that is neither a function nor a feature.
    #[error("there is no {} `{name}`", if *.call { "function" } else { "feature or constant" })]
    Unknown {
        /// The name as written.
        name: String,
        /// Whether it is written like a function.
        call: bool,
        /// The spelling that it is closest to, if any is close.
        nearest: Option<String>,
    },
    /// The name of a stage that comes later.
    #[error("stage `{0}` is not computed yet: a stage reads only those before it")]
    Later(String),
    /// The variance of a stage that has none.
    #[error("stage `{0}` has no variance: it is no gather, or names none to take along")]
    NoVariance(String),
    /// Operands whose widths do not fit.
    #[error("{what} does not take {}", widths(.operands))]
    Widths {
        /// The operator, function or layer, with what it takes.
        what: String,
        /// Components of its operands.
        operands: Vec<usize>,
    },
    /// A place that the formula cannot look at.
    #[error("{0}")]
    Place(&'static str),
    /// A vector where a number is needed, or the reverse.
    #[error("{} needs {}, but `{found}` is {}", needs(*.by), named(*.wanted), named(other(*.wanted)))]
    Sort {
        /// The operator that needs it; `None` for the whole expression.
        by: Option<Op>,
        /// What is needed.
        wanted: Sort,
        /// What stands there.
        found: String,
        /// The spelling of what was probably meant, if the feature has it.
        instead: Option<&'static str>,
    },
    /// A function with too few or too many operands.
    #[error("`{}` takes {}, not {}", .op.name(), operands(.op.arity()), .given)]
    Arity {
        /// The function.
        op: Op,
        /// How many operands it is given; one more than it takes where counting stopped.
        given: usize,
    },
    /// A parenthesis that is never closed.
    #[error("this parenthesis is never closed: expected {expected} before the end of the text")]
    Unclosed {
        /// What would have closed it.
        expected: &'static str,
    },
}

impl TextError {
    /// Longest stretch of a line that is shown on either side of the caret.
    const REACH: usize = 36;

    /// The problem at a byte offset of the text.
    pub(super) fn new(text: &str, at: usize, problem: Problem) -> Self {
        let start = text[..at].rfind('\n').map_or(0, |newline| newline + 1);
        let end = text[at..].find('\n').map_or(text.len(), |length| at + length);
        let before = text[start..at].chars().count();
        let skipped = before.saturating_sub(Self::REACH);
        let shown = text[start..end].chars().skip(skipped).take(2 * Self::REACH);
        // A caret lines up only under characters one column wide.
        let mut excerpt: String = shown.map(|c| if c.is_control() { ' ' } else { c }).collect();
        excerpt.truncate(excerpt.trim_end().len());
        Self {
            line: text[..start].matches('\n').count() + 1,
            column: before + 1,
            excerpt,
            caret: before - skipped,
            problem,
        }
    }

    /// The line, counted from 1.
    pub fn line(&self) -> usize {
        self.line
    }

    /// The column in characters, counted from 1.
    pub fn column(&self) -> usize {
        self.column
    }

    /// What is wrong there.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }
}

impl fmt::Display for TextError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "line {}, column {}: {}", self.line, self.column, self.problem)?;
        writeln!(f, "{}", format!("  | {}", self.excerpt).trim_end())?;
        write!(f, "  | {:caret$}^", "", caret = self.caret)?;
        match self.problem.help() {
            Some(help) => write!(f, "\n  = {help}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for TextError {}

impl Problem {
    /// What to write instead, where that can be said.
    fn help(&self) -> Option<String> {
        match self {
            Self::Character('^') => Some(format!("powers are written {}(a, b)", Op::Pow.name())),
            Self::Character('π') => Some(format!("did you mean `{PI}`?")),
            Self::Character('−' | '–') => Some(format!("did you mean `{MINUS}`?")),
            Self::Character('·' | '×') => Some(format!("did you mean `{}`?", Op::Mul.name())),
            Self::Unknown { nearest: Some(nearest), .. } => {
                Some(format!("did you mean `{nearest}`?"))
            }
            Self::Unknown { call: true, nearest: None, .. } => {
                Some(format!("functions: {}", functions().collect::<Vec<_>>().join(" ")))
            }
            Self::Unknown { call: false, nearest: None, .. } => {
                Some(format!("features: {}", terms(|_| true).collect::<Vec<_>>().join(" ")))
            }
            Self::Sort { wanted: Sort::Vector, instead: None, .. } => Some(format!(
                "vectors: {}",
                terms(|symbol| symbol.sort() == Sort::Vector).collect::<Vec<_>>().join(" ")
            )),
            Self::Sort { wanted: Sort::Vector, instead: Some(instead), .. } => {
                Some(format!("did you mean the feature, `{instead}`?"))
            }
            Self::Sort { wanted: Sort::Scalar, found, instead, .. } => {
                let distance = Op::Distance2.name();
                let variance = instead.map_or(String::new(), |v| format!(", and so is `{v}`"));
                Some(format!("`{distance}({found}, {found})` is a number{variance}"))
            }
            Self::Unexpected { .. }
            | Self::Character(_)
            | Self::Range(_)
            | Self::Arity { .. }
            | Self::Later(_)
            | Self::NoVariance(_)
            | Self::Widths { .. }
            | Self::Place(_)
            | Self::Unclosed { .. } => None,
        }
    }

    /// The problem with a name that is in no row, and none of the scope's.
    pub(super) fn unknown(name: &str, call: bool, scope: &Scope<'_>) -> Self {
        if scope.later.iter().any(|later| later == name) {
            return Self::Later(shortened(name));
        }
        if let Some(stage) = name.strip_suffix(VARIANCE) {
            return Self::NoVariance(shortened(stage));
        }
        let further: &[Variadic] = match scope.reads {
            Reads::Paper => &[],
            Reads::Pair | Reads::Pixel => &Variadic::ALL,
        };
        let functions = functions().chain(further.iter().map(|function| function.name()));
        let nearest = if call {
            nearest(name, functions)
        } else {
            let mut known: Vec<&str> = scope.names().collect();
            for name in terms(|_| true).chain([PI]).chain(functions) {
                known.push(name);
            }
            nearest(name, known.into_iter())
        };
        Self::Unknown { name: shortened(name), call, nearest }
    }

    /// The problem with an operand of the other sort.
    pub(super) fn sort(by: Option<Op>, wanted: Sort, text: &str, symbol: Symbol) -> Self {
        let found = match symbol.op() {
            Some(op) if op.row().syntax == Syntax::Call => format!("{text}(…)"),
            Some(_) => format!("{text}…"),
            None => shortened(text),
        };
        let instead = symbol.reads().and_then(|(feature, _)| {
            feature.spelling(match wanted {
                Sort::Scalar => Quantity::Variance,
                Sort::Vector => Quantity::Value,
            })
        });
        Self::Sort { by, wanted, found, instead }
    }
}

/// A stretch of text, short enough for a message.
pub(super) fn shortened(text: &str) -> String {
    const LONGEST: usize = 32;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

fn functions() -> impl Iterator<Item = &'static str> {
    Op::ALL.iter().filter(|op| op.row().syntax == Syntax::Call).map(|op| op.name())
}

fn terms(keep: impl Fn(Symbol) -> bool) -> impl Iterator<Item = &'static str> {
    Feature::terms()
        .filter(move |&(feature, quantity)| Symbol::of(feature, quantity).is_some_and(&keep))
        .filter_map(|(feature, quantity)| feature.spelling(quantity))
}

fn needs(by: Option<Op>) -> String {
    by.map_or("the expression".to_owned(), |op| format!("`{}`", op.name()))
}

fn named(sort: Sort) -> &'static str {
    match sort {
        Sort::Scalar => "a number",
        Sort::Vector => "a vector",
    }
}

fn other(sort: Sort) -> Sort {
    match sort {
        Sort::Scalar => Sort::Vector,
        Sort::Vector => Sort::Scalar,
    }
}

fn widths(operands: &[usize]) -> String {
    let width = |&width: &usize| match width {
        1 => "a number".to_owned(),
        width => format!("{width} components"),
    };
    operands.iter().map(width).collect::<Vec<_>>().join(" and ")
}

fn operands(count: usize) -> String {
    format!("{count} operand{}", if count == 1 { "" } else { "s" })
}

/// The candidate with the fewest edits, if those are few for a name this long.
/// Case does not count as an edit.
fn nearest<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<String> {
    let tolerated = (name.len() / 3).clamp(1, 4);
    candidates
        .filter(|candidate| candidate.len().abs_diff(name.len()) <= tolerated)
        .map(|candidate| (edits(name, candidate), candidate))
        .filter(|&(edits, candidate)| edits <= tolerated && edits < candidate.len())
        .min_by_key(|&(edits, _)| edits)
        .map(|(_, candidate)| candidate.to_owned())
}

/// Insertions, deletions, substitutions and exchanges of neighbours that turn
/// one name into the other (restricted Damerau-Levenshtein distance).
fn edits(a: &str, b: &str) -> usize {
    let (a, b) = (a.to_ascii_lowercase().into_bytes(), b.to_ascii_lowercase().into_bytes());
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    rows[0] = (0..=b.len()).collect();
    for i in 1..=a.len() {
        rows[i][0] = i;
        for j in 1..=b.len() {
            let substituted = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut least = substituted.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                least = least.min(rows[i - 2][j - 2] + 1);
            }
            rows[i][j] = least;
        }
    }
    rows[a.len()][b.len()]
}
