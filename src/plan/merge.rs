//! Merges exponentials: e^a · e^b becomes e^(a + b), and (x^a)^b becomes x^(a·b)
//! where x, a and b are not negative and x^a is known not to vanish. (Where it may
//! vanish, the two powers have different values at 0. Those still share their
//! logarithm: the builder sees to that.)
//!
//! This is the one pass that works on trees, where exponentials are still
//! recognisable. Filters are products of bumps, so that one exponential often
//! remains of five; on the paper's filter it is worth about a third of the time.
//!
//! **Budget.** The merged argument is rounded once per addition, so that the
//! result's relative error grows by at most (|a| + |b|) · 2^-24 per merged pair:
//! below 1e-5 wherever the weight exceeds e^-87, and a weight that small is
//! itself lost next to the pixel's own. Merging never moves a value across a
//! guard: it happens only where ranges prove that no factor and no intermediate
//! product reaches LIMIT, and that the arguments' positive parts stay below
//! [`HEADROOM`], so that what one factor alone would flush to zero is still
//! negligible (below 1e-29) in the merged result.

use crate::expr::builder::LIMIT;
use crate::expr::interval::Interval;
use crate::expr::op::Op;
use crate::expr::symbol::Symbol;
use crate::expr::tree::Tree;

/// Bound on the sum of the positive parts of merged exponents.
const HEADROOM: f32 = 20.0;

/// A subtree on its way up, with what may still merge above it.
#[derive(Clone)]
struct Piece {
    symbols: Vec<Symbol>,
    range: Interval,
    /// The same value as `rest * exp(argument)`, where it is such a product.
    exponential: Option<Exponential>,
    /// Base and exponent, where the value is a power of two non-negative values.
    power: Option<(Box<Piece>, Box<Piece>)>,
}

#[derive(Clone)]
struct Exponential {
    rest: Option<(Vec<Symbol>, Interval)>,
    argument: Vec<Symbol>,
    range: Interval,
    /// How many exponentials went into the argument.
    count: usize,
}

impl Piece {
    fn plain(symbols: Vec<Symbol>, range: Interval) -> Self {
        Self { symbols, range, exponential: None, power: None }
    }

    /// The symbols to use where nothing can merge any more.
    fn settle(self) -> Vec<Symbol> {
        match self.exponential {
            Some(e) if e.count > 1 => {
                let exp = op(Op::Exp, vec![e.argument]);
                match e.rest {
                    Some((rest, _)) => op(Op::Mul, vec![rest, exp]),
                    None => exp,
                }
            }
            Some(_) | None => self.symbols,
        }
    }

    /// The piece as something that stands beside an exponential.
    fn factor(&self) -> Factor {
        (self.symbols.clone(), self.range)
    }

    fn with_exponential(mut self, exponential: Option<Exponential>) -> Self {
        self.exponential = exponential;
        self
    }
}

impl Exponential {
    /// The same exponential beside something else, if that is permitted.
    #[expect(clippy::option_option, reason = "see `times`")]
    fn beside(&self, rest: Option<Option<Factor>>) -> Option<Self> {
        rest.map(|rest| Self { rest, ..self.clone() })
    }
}

fn op(op: Op, operands: Vec<Vec<Symbol>>) -> Vec<Symbol> {
    let mut symbols = operands.concat();
    symbols.push(Symbol::Op(op));
    symbols
}

/// Merges what can be merged, given the range of every node by position.
pub(super) fn merge(tree: &Tree, ranges: &[Interval]) -> Tree {
    let mut stack: Vec<Piece> = Vec::new();
    for (&symbol, &range) in tree.symbols().iter().zip(ranges) {
        let mut operands = stack.split_off(stack.len() - symbol.arity());
        let piece = match (symbol, operands.len()) {
            (Symbol::Op(Op::Exp), 1) => {
                let argument = operands.remove(0);
                let argument_range = argument.range;
                let argument = argument.settle();
                let exponential = Exponential {
                    rest: None,
                    argument: argument.clone(),
                    range: argument_range,
                    count: 1,
                };
                Piece::plain(op(Op::Exp, vec![argument]), range).with_exponential(Some(exponential))
            }
            (Symbol::Op(Op::Mul), 2) => {
                let right = operands.remove(1);
                let left = operands.remove(0);
                product(left, right, range)
            }
            (Symbol::Op(Op::Pow), 2) => {
                let exponent = operands.remove(1);
                let base = operands.remove(0);
                power(base, exponent, range)
            }
            (symbol, _) => {
                let mut symbols =
                    operands.into_iter().map(Piece::settle).collect::<Vec<_>>().concat();
                symbols.push(symbol);
                Piece::plain(symbols, range)
            }
        };
        stack.push(piece);
    }
    let root = stack.pop().expect("a tree leaves its root on the stack");
    Tree::new(root.settle()).expect("merging keeps the sorts of what it rewrites")
}

fn product(mut left: Piece, mut right: Piece, range: Interval) -> Piece {
    let inside = range.within(LIMIT / 2.0);
    let exponential = match (left.exponential.take(), right.exponential.take()) {
        (Some(a), Some(b)) if inside => {
            let both = join(&a, &b);
            left.exponential = Some(a);
            right.exponential = Some(b);
            both
        }
        (Some(a), None) if inside => {
            let floated = a.beside(times(a.rest.as_ref(), Some(&right.factor())));
            left.exponential = Some(a);
            floated
        }
        (None, Some(b)) if inside => {
            let floated = b.beside(times(Some(&left.factor()), b.rest.as_ref()));
            right.exponential = Some(b);
            floated
        }
        (a, b) => {
            left.exponential = a;
            right.exponential = b;
            None
        }
    };
    let symbols = op(Op::Mul, vec![left.settle(), right.settle()]);
    Piece::plain(symbols, range).with_exponential(exponential)
}

/// `(r e^a) (s e^b) = (r s) e^(a + b)`, if that stays within the budget.
fn join(a: &Exponential, b: &Exponential) -> Option<Exponential> {
    if a.range.hi.max(0.0) + b.range.hi.max(0.0) > HEADROOM {
        return None;
    }
    let rest = times(a.rest.as_ref(), b.rest.as_ref())?;
    Some(Exponential {
        rest,
        argument: op(Op::Add, vec![a.argument.clone(), b.argument.clone()]),
        range: a.range + b.range,
        count: a.count + b.count,
    })
}

type Factor = (Vec<Symbol>, Interval);

/// The product of what stands beside two exponentials; `None` if it could meet
/// a guard that the exponentials kept it from.
#[expect(clippy::option_option, reason = "no factor at all is not the same as no permission")]
fn times(a: Option<&Factor>, b: Option<&Factor>) -> Option<Option<Factor>> {
    match (a, b) {
        (None, None) => Some(None),
        (Some(only), None) | (None, Some(only)) => Some(Some(only.clone())),
        (Some((x, p)), Some((y, q))) => {
            let range = *p * *q;
            range
                .within(LIMIT / 2.0)
                .then(|| Some((op(Op::Mul, vec![x.clone(), y.clone()]), range)))
        }
    }
}

fn power(base: Piece, exponent: Piece, range: Interval) -> Piece {
    let mergeable = exponent.range.lo >= 0.0 && base.range.lo >= 0.0;
    let bounded = base.range.within(LIMIT / 2.0) && base.range.lo >= f32::MIN_POSITIVE;
    let (base, exponent) = match base.power {
        Some((inner, first)) if mergeable && bounded => {
            let product_range = first.range * exponent.range;
            (*inner, product(*first, exponent, product_range))
        }
        power => (Piece { power, ..base }, exponent),
    };
    let symbols = op(Op::Pow, vec![base.clone().settle(), exponent.clone().settle()]);
    let mut piece = Piece::plain(symbols, range);
    if mergeable {
        piece.power = Some((Box::new(base), Box::new(exponent)));
    }
    piece
}

#[cfg(test)]
mod tests {
    use super::*;

    fn merged(text: &str, features: Interval) -> String {
        let tree: Tree = text.parse().expect("valid text");
        let window = crate::filter::Window { radius: 2, dilation: 1 };
        let at = super::super::lower::Surroundings {
            range: &|_| features,
            window: Some(window),
            mirrored: false,
            step: 1,
            precision: crate::plan::Precision::Standard,
            constants: &crate::expr::Constants::default(),
            tuned: false,
            reads: &std::cell::RefCell::default(),
        };
        merge(&tree, &super::super::lower::ranges(&tree, &at)).to_string()
    }

    const UNIT: Interval = Interval { lo: 0.0, hi: 1.0 };

    #[test]
    fn products_of_exponentials_become_one() {
        assert_eq!(
            merged("exp(-wpVariance) * (2 * exp(-nVariance)) * tVariance", UNIT),
            "2 * tVariance * exp(-wpVariance + -nVariance)"
        );
    }

    #[test]
    fn a_lone_exponential_stays_where_it_is() {
        let text = "exp(-wpVariance) * 2 * tVariance";
        assert_eq!(merged(text, UNIT), text);
    }

    #[test]
    fn large_arguments_are_left_alone() {
        let text = "exp(-wpVariance) * exp(nVariance)";
        assert_eq!(merged(text, Interval::new(0.0, 100.0)), text);
    }

    #[test]
    fn powers_of_powers_become_one_where_nothing_is_negative_or_vanishes() {
        let text = "pow(pow(wpVariance, exp(nVariance)), exp(tVariance))";
        assert_eq!(
            merged(text, Interval::new(0.5, 1.0)),
            "pow(wpVariance, exp(nVariance + tVariance))"
        );
        assert_eq!(merged(text, UNIT), text);
        let text = "pow(pow(wpVariance, nVariance), tVariance)";
        assert_eq!(merged(text, Interval::new(-1.0, 1.0)), text);
    }
}
