//! Expressions as immutable trees.
//!
//! A [`Tree`] is kept as its symbols in postfix order: operands first, then the
//! operator. A subtree is then a contiguous run that ends at its root, so that
//! copying, replacing, comparing and hashing subtrees are operations on slices,
//! and nothing recurses: a tree ten thousand levels deep is as safe as a flat
//! one. Positions in a tree are indices into that order; the root is the last.

use std::ops::Range;
use std::sync::Arc;

use super::feature::{Feature, PlaneId, Quantity};
use super::op::{Form, Op, Sort};
use super::symbol::{Place, Symbol};
use super::tape::Side;

/// A well-formed expression: every operator finds operands whose widths it takes.
/// Cloning is cheap.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tree {
    symbols: Arc<[Symbol]>,
}

/// Why symbols in postfix order are no tree.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    /// An operator lacks operands, or their widths do not fit.
    #[error("symbol {at} ({symbol:?}) does not find the operands it takes")]
    Operands {
        /// Where in postfix order.
        at: usize,
        /// The operator.
        symbol: Symbol,
    },
    /// More or less than one value is left at the end.
    #[error("the symbols leave {0} expressions instead of one")]
    Count(usize),
}

impl Tree {
    /// A tree from its symbols in postfix order.
    pub fn new(symbols: impl Into<Arc<[Symbol]>>) -> Result<Self, Malformed> {
        let symbols = symbols.into();
        match widths(&symbols)?.len() {
            1 => Ok(Self { symbols }),
            roots => Err(Malformed::Count(roots)),
        }
    }

    /// How many components the expression has.
    pub fn width(&self) -> usize {
        widths(&self.symbols).expect("checked when the tree was made")[0]
    }

    /// How many components every node has, by position.
    pub fn widths(&self) -> Vec<usize> {
        let mut widths: Vec<usize> = Vec::with_capacity(self.len());
        let mut stack: Vec<usize> = Vec::new();
        for &symbol in self.symbols.iter() {
            let operands = stack.split_off(stack.len() - symbol.arity());
            let width = symbol.width(&operands).expect("checked when the tree was made");
            stack.push(width);
            widths.push(width);
        }
        widths
    }

    /// Whether the paper's grammar makes the expression: vectors stand as operands of
    /// functions of two vectors and nowhere else.
    pub fn is_paper(&self) -> bool {
        let mut stack: Vec<Sort> = Vec::new();
        for &symbol in self.symbols.iter() {
            let wanted = symbol.operands();
            if !symbol.is_paper() || !stack.ends_with(wanted) {
                return false;
            }
            stack.truncate(stack.len() - wanted.len());
            stack.push(symbol.sort());
        }
        true
    }

    /// Where every node is looked at, by position, if the whole is looked at at pixel i.
    /// In a map, functions of two pixels have both operands at pixel i.
    pub fn places(&self, map: bool) -> Vec<Place> {
        let mut places = vec![Place::Side(Side::I); self.len()];
        for position in (0..self.len()).rev() {
            let at = places[position];
            let (operand, place) = match self.symbols[position] {
                Symbol::At(place) => (position - 1, place.from(at)),
                Symbol::Op(op) if !map && matches!(op.row().form, Form::Vectors(_)) => {
                    // The second operand ends where the operator stands.
                    (position - 1, Place::Side(Side::J))
                }
                _ => continue,
            };
            places[self.extent(operand)].fill(place);
        }
        places
    }

    /// A leaf.
    pub fn leaf(symbol: Symbol) -> Result<Self, Malformed> {
        Self::new([symbol].as_slice())
    }

    /// A constant.
    pub fn constant(x: f32) -> Self {
        Self { symbols: [Symbol::constant(x)].into() }
    }

    /// An operator on operands.
    pub fn apply(op: Op, operands: &[&Self]) -> Result<Self, Malformed> {
        let mut symbols: Vec<Symbol> =
            operands.iter().flat_map(|t| t.symbols.iter().copied()).collect();
        symbols.push(Symbol::Op(op));
        Self::new(symbols)
    }

    /// The symbols in postfix order.
    pub fn symbols(&self) -> &[Symbol] {
        &self.symbols
    }

    /// Number of nodes.
    #[expect(clippy::len_without_is_empty, reason = "a tree has at least one node")]
    pub fn len(&self) -> usize {
        self.symbols.len()
    }

    /// The position of the root.
    pub fn root(&self) -> usize {
        self.symbols.len() - 1
    }

    /// What the whole tree stands for.
    pub fn sort(&self) -> Sort {
        self.symbols[self.root()].sort()
    }

    /// Number of levels; 1 for a leaf.
    pub fn depth(&self) -> usize {
        let mut stack: Vec<usize> = Vec::new();
        for symbol in self.symbols.iter() {
            let operands = stack.split_off(stack.len() - symbol.arity());
            stack.push(1 + operands.into_iter().max().unwrap_or(0));
        }
        stack[0]
    }

    /// The run of symbols that the subtree rooted at a position takes.
    pub fn extent(&self, position: usize) -> Range<usize> {
        let mut start = position;
        let mut missing = self.symbols[position].arity();
        while missing > 0 {
            start -= 1;
            missing = missing - 1 + self.symbols[start].arity();
        }
        start..position + 1
    }

    /// The positions of the operands of the node at a position, in order.
    pub fn operands(&self, position: usize) -> Vec<usize> {
        let mut roots = Vec::new();
        let mut end = position;
        for _ in 0..self.symbols[position].arity() {
            roots.push(end - 1);
            end = self.extent(end - 1).start;
        }
        roots.reverse();
        roots
    }

    /// The subtree rooted at a position.
    pub fn subtree(&self, position: usize) -> Self {
        Self { symbols: self.symbols[self.extent(position)].into() }
    }

    /// The tree with the subtree at a position replaced by another of its sort.
    pub fn replace(&self, position: usize, by: &Self) -> Result<Self, Malformed> {
        let extent = self.extent(position);
        let symbols: Vec<Symbol> = self.symbols[..extent.start]
            .iter()
            .chain(by.symbols.iter())
            .chain(&self.symbols[extent.end..])
            .copied()
            .collect();
        Self::new(symbols)
    }

    /// The tree with one node replaced by another that takes the same operands.
    pub fn with_symbol(&self, position: usize, symbol: Symbol) -> Result<Self, Malformed> {
        let mut symbols = self.symbols.to_vec();
        symbols[position] = symbol;
        Self::new(symbols)
    }

    /// The tree with two subtrees exchanged; `None` if one holds the other.
    pub fn swap(&self, first: usize, second: usize) -> Option<Result<Self, Malformed>> {
        let (low, high) = (first.min(second), first.max(second));
        let (a, b) = (self.extent(low), self.extent(high));
        if b.start <= low {
            return None;
        }
        let s = &self.symbols;
        let symbols: Vec<Symbol> =
            [&s[..a.start], &s[b.clone()], &s[a.end..b.start], &s[a], &s[b.end..]].concat();
        Some(Self::new(symbols))
    }

    /// The planes that the expression reads, each once, in a fixed order.
    ///
    /// The pixel's coordinates are among them only if the expression looks at
    /// more than their difference, which the window itself provides: see
    /// [`Tree::is_stationary`].
    pub fn planes(&self) -> Vec<PlaneId> {
        let coordinates = Symbol::Vector(Feature::Pixel);
        let mut offset = vec![false; self.len()];
        for (at, &symbol) in self.symbols.iter().enumerate() {
            // Two bare leaves stand right before their function.
            if let Symbol::Op(op) = symbol
                && let Form::Vectors(function) = op.row().form
                && function.differences
                && self.symbols[..at].ends_with(&[coordinates; 2])
            {
                offset[at - 2..at].fill(true);
            }
        }
        let symbols = self.symbols.iter().zip(offset).filter(|(_, offset)| !offset);
        let mut planes: Vec<PlaneId> = symbols
            .filter_map(|(symbol, _)| symbol.reads())
            .flat_map(|(feature, quantity)| PlaneId::of(feature, quantity))
            .collect();
        planes.sort_unstable();
        planes.dedup();
        planes
    }

    /// Whether the expression is the same all over the image: it looks at the
    /// pixels' coordinates through their difference alone.
    pub fn is_stationary(&self) -> bool {
        self.planes().iter().all(|plane| plane.feature != Feature::Pixel)
    }
}

/// The widths of the expressions that symbols in postfix order leave.
fn widths(symbols: &[Symbol]) -> Result<Vec<usize>, Malformed> {
    let mut stack: Vec<usize> = Vec::new();
    for (at, &symbol) in symbols.iter().enumerate() {
        let malformed = Malformed::Operands { at, symbol };
        let Some(first) = stack.len().checked_sub(symbol.arity()) else { return Err(malformed) };
        let Some(width) = symbol.width(&stack[first..]) else { return Err(malformed) };
        stack.truncate(first);
        stack.push(width);
    }
    Ok(stack)
}

/// Pairs the components of a vector at i with those of a vector at j; where one
/// is narrower its missing components are zero (`None`).
pub fn component_pairs(
    a: (Feature, Quantity),
    b: (Feature, Quantity),
) -> impl Iterator<Item = (Option<PlaneId>, Option<PlaneId>)> {
    let width = PlaneId::components(a.0, a.1).max(PlaneId::components(b.0, b.1));
    let mut left = PlaneId::of(a.0, a.1);
    let mut right = PlaneId::of(b.0, b.1);
    (0..width).map(move |_| (left.next(), right.next()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaf(symbol: Symbol) -> Tree {
        Tree::leaf(symbol).expect("a leaf is well-formed")
    }

    /// exp(-distance2(normal, normal)) * 2
    fn sample() -> Tree {
        let normal = leaf(Symbol::Vector(Feature::Normal));
        let distance = Tree::apply(Op::Distance2, &[&normal, &normal]).unwrap();
        let minus = Tree::apply(Op::Neg, &[&distance]).unwrap();
        let exp = Tree::apply(Op::Exp, &[&minus]).unwrap();
        Tree::apply(Op::Mul, &[&exp, &Tree::constant(2.0)]).unwrap()
    }

    #[test]
    fn subtrees_are_runs_that_end_at_their_root() {
        let tree = sample();
        assert_eq!(tree.len(), 7);
        assert_eq!(tree.depth(), 5);
        assert_eq!(tree.operands(tree.root()), vec![4, 5]);
        assert_eq!(tree.extent(4), 0..5);
        assert_eq!(tree.subtree(2).symbols()[2], Symbol::Op(Op::Distance2));
    }

    #[test]
    fn widths_must_fit_and_the_paper_has_vectors_in_functions_of_two_alone() {
        let tree = sample();
        assert!(tree.is_paper() && tree.width() == 1);
        let sum = tree.with_symbol(2, Symbol::Op(Op::Add)).expect("three components each");
        assert!(!sum.is_paper() && sum.width() == 3);
        assert!(!tree.replace(0, &Tree::constant(1.0)).expect("one and three").is_paper());
        assert!(tree.with_symbol(2, Symbol::Op(Op::Dot)).is_ok_and(|dot| dot.is_paper()));
        let (pixel, normal) =
            (leaf(Symbol::Vector(Feature::Pixel)), leaf(Symbol::Vector(Feature::Normal)));
        assert!(Tree::apply(Op::Add, &[&pixel, &normal]).is_err(), "two and three components");
        assert_eq!(sum.widths(), [3, 3, 3, 3, 3, 1, 3]);
    }

    #[test]
    fn places_are_inherited_until_something_looks_elsewhere() {
        use Place::{Shift, Side as At};
        let depth = Symbol::Vector(Feature::Depth);
        let symbols = [
            depth,
            Symbol::At(Shift(1, 0)),
            depth,
            Symbol::Op(Op::Add),
            depth,
            Symbol::At(At(Side::I)),
            Symbol::Op(Op::Distance2),
        ];
        let tree = Tree::new(symbols.as_slice()).expect("one component everywhere");
        let (i, j, right) = (At(Side::I), At(Side::J), Shift(1, 0));
        assert_eq!(tree.places(false), [right, i, i, i, i, j, i]);
        assert_eq!(tree.places(true), [right, i, i, i, i, i, i]);
        assert_eq!(Shift(1, -2).from(Shift(3, 3)), Shift(4, 1));
    }

    #[test]
    fn swapping_never_takes_a_node_with_its_own_subtree() {
        let tree = sample();
        assert!(tree.swap(2, 4).is_none());
        let swapped = tree.swap(4, 5).expect("siblings").unwrap();
        assert_eq!(swapped.symbols()[0], Symbol::constant(2.0));
        assert_eq!(swapped.len(), tree.len());
        assert_eq!(swapped.swap(0, 5).unwrap().unwrap(), tree);
    }

    #[test]
    fn the_meaning_is_the_formula() {
        let got = sample().meaning(|plane, side| match (plane.component, side) {
            (0, Side::I) => 1.0,
            (1, Side::J) => 1.0,
            _ => 0.0,
        });
        assert!((got - 2.0 * (-(2f64.sqrt())).exp()).abs() < 1e-12);
    }

    #[test]
    fn a_narrow_vector_is_padded_with_zeros() {
        let depth = leaf(Symbol::Vector(Feature::Depth));
        let normal = leaf(Symbol::Vector(Feature::Normal));
        let distance = Tree::apply(Op::Distance1, &[&depth, &normal]).unwrap();
        assert_eq!(distance.meaning(|_, side| if side == Side::I { 5.0 } else { 1.0 }), 6.0);
    }

    #[test]
    fn coordinates_are_read_only_where_more_than_the_offset_counts() {
        let pixel = leaf(Symbol::Vector(Feature::Pixel));
        let color = leaf(Symbol::Vector(Feature::Color));
        let offset = Tree::apply(Op::Distance1, &[&pixel, &pixel]).unwrap();
        assert!(offset.is_stationary() && offset.planes().is_empty());
        let product = Tree::apply(Op::Dot, &[&pixel, &pixel]).unwrap();
        let mixed = Tree::apply(Op::Distance1, &[&color, &pixel]).unwrap();
        assert!(!product.is_stationary() && !mixed.is_stationary());
        assert_eq!(mixed.planes().len(), 5);
    }

    #[test]
    fn depth_is_no_danger() {
        let mut symbols = vec![Symbol::constant(1.0)];
        symbols.extend(std::iter::repeat_n(Symbol::Op(Op::Neg), 100_000));
        let tree = Tree::new(symbols).unwrap();
        assert_eq!(tree.depth(), 100_001);
        assert_eq!(tree.meaning(|_, _| 0.0), 1.0);
    }
}
