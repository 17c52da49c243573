//! Which taps can count at all: those whose weight is not proved to be zero.
//!
//! A Gaussian of the distance in pixels is flushed to zero soon enough, and a
//! biweight kernel ends by itself; beyond, nothing need be computed. The proof is
//! by intervals, on the tree: what depends on the offset is known exactly for a
//! tap, everything else is whatever it can be in the scene. Taps are tried from
//! the outside, so that a weight without a support costs a few tries only.

use std::borrow::Borrow;

use super::lower::{Surroundings, ranges};
use crate::expr::builder::LIMIT;
use crate::expr::feature::Feature;
use crate::expr::interval::Interval;
use crate::expr::op::Form;
use crate::expr::symbol::Symbol;
use crate::expr::tree::Tree;
use crate::filter::Window;

/// What a value computed in another order, or with fused operations, may be off.
const ROUNDING: f32 = 1e-6;

/// The extents that [`Taps`](super::Taps) takes: for the rows v above and v below
/// pixel i, how far to either side some weight may differ from zero.
pub(super) fn extents(
    weights: &[impl Borrow<Tree>],
    window: Window,
    at: &Surroundings<'_>,
) -> Vec<Option<u32>> {
    let weights: Vec<Weight<'_>> = weights.iter().map(|w| Weight::new(w.borrow(), at)).collect();
    let dilation = window.dilation as i32;
    let counts = |u: u32, v: u32| {
        let (dx, dy) = (u as i32 * dilation, v as i32 * dilation);
        let opposite = [[dx, dy], [-dx, dy], [dx, -dy], [-dx, -dy]];
        weights.iter().any(|weight| opposite.iter().any(|&tap| !weight.is_zero_at(tap)))
    };
    (0..=window.radius).map(|v| (0..=window.radius).rev().find(|&u| counts(u, v))).collect()
}

/// Every tap of a window.
pub(super) fn whole(window: Window) -> Vec<Option<u32>> {
    vec![Some(window.radius); window.radius as usize + 1]
}

/// A weight with what is known of its parts wherever j is.
struct Weight<'a> {
    tree: &'a Tree,
    at: &'a Surroundings<'a>,
    /// By position; of scalars only.
    known: Vec<Interval>,
    looks_at_offset: bool,
}

impl<'a> Weight<'a> {
    fn new(tree: &'a Tree, at: &'a Surroundings<'a>) -> Self {
        let offsets = [Symbol::Vector(Feature::Pixel), Symbol::Offset];
        let looks_at_offset = tree.symbols().iter().any(|symbol| offsets.contains(symbol));
        let known = if looks_at_offset { ranges(tree, at) } else { Vec::new() };
        Self { tree, at, known, looks_at_offset }
    }

    /// Whether the weight is zero for every pair of pixels so far apart.
    fn is_zero_at(&self, offset: [i32; 2]) -> bool {
        self.looks_at_offset && self.range_at(offset) == Interval::point(0.0)
    }

    fn range_at(&self, offset: [i32; 2]) -> Interval {
        let pairs = offset.map(|along| (0.0, f64::from(along * self.at.step)));
        let mut stack: Vec<Interval> = Vec::new();
        for (position, &symbol) in self.tree.symbols().iter().enumerate() {
            let operands = stack.split_off(stack.len() - symbol.arity());
            let coordinates = Symbol::Vector(Feature::Pixel);
            let range = match symbol {
                Symbol::Op(op) => match (self.at.form(op), operands.as_slice()) {
                    (Form::Unary(f), &[x]) => rounded((f.range)(x)),
                    (Form::Binary(f), &[x, y]) => rounded((f.range)(x, y)),
                    (Form::Vectors(f), _)
                        if f.differences
                            && self.tree.symbols()[..position].ends_with(&[coordinates; 2]) =>
                    {
                        let distance = (f.meaning)(&pairs) as f32;
                        rounded(Interval::point(distance))
                    }
                    (Form::Vectors(_), _) => self.known[position],
                    (Form::Unary(_) | Form::Binary(_), _) => {
                        unreachable!("a Tree is well-formed, so {op:?} finds its operands")
                    }
                },
                // Of several components, what holds of all.
                Symbol::At(_) => operands[0],
                _ => self.known[position],
            };
            stack.push(range);
        }
        stack.pop().expect("a tree leaves its root on the stack")
    }
}

fn rounded(range: Interval) -> Interval {
    range.widened(ROUNDING, 0.0).clamped(-LIMIT, LIMIT)
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;
    use crate::expr::Constants;
    use crate::plan::Precision;

    /// The extents of a weight in scenes whose features are within ±1.
    fn of(text: &str, radius: u32) -> Vec<Option<u32>> {
        let window = Window::dense(radius);
        let range = |_| Interval::new(-1.0, 1.0);
        let at = Surroundings {
            range: &range,
            window: Some(window),
            mirrored: false,
            step: 1,
            precision: Precision::Standard,
            constants: &Constants::default(),
            tuned: false,
            reads: &RefCell::default(),
        };
        extents(&[text.parse::<Tree>().expect("parses")], window, &at)
    }

    #[test]
    fn kernels_end_where_they_are_zero() {
        let disc = [Some(3), Some(3), Some(3), Some(2), None, None];
        let texts = [
            "biweight(distance2(pixel, pixel) / 3.7)",
            "0.5 * tricube(distance2(pixel, pixel) / 3.7) * distance2(normal, normal)",
            "exp(-distance2(normal, normal) - (5 * distance2(pixel, pixel)) * 88 / 18.5)",
        ];
        for text in texts {
            assert_eq!(of(text, 5), disc, "{text}");
        }
        let square = of("epanechnikov(distanceMax(pixel, pixel) / 1.9)", 4);
        assert_eq!(square, [Some(1), Some(1), None, None, None]);
    }

    #[test]
    fn what_may_count_stays() {
        for text in [
            "1",
            "0",
            "exp(-distance2(normal, normal) / 0.001)",
            "exp(-distance2(pixel, pixel))",
            "biweight(distance2(pixel, pixel) / 3) + 0.001",
            "biweight(distance2(pixel, pixel) / 3 - distance2(normal, normal))",
            "mitchell(dot(pixel, pixel))",
        ] {
            assert_eq!(of(text, 3), whole(Window::dense(3)), "{text}");
        }
    }

    #[test]
    fn weights_of_one_plan_share_the_widest_support() {
        let window = Window::dense(4);
        let range = |_| Interval::new(0.0, 1.0);
        let at = Surroundings {
            range: &range,
            window: Some(window),
            mirrored: false,
            step: 1,
            precision: Precision::Standard,
            constants: &Constants::default(),
            tuned: false,
            reads: &RefCell::default(),
        };
        let trees: Vec<Tree> = [2.5, 1.5]
            .map(|r| format!("biweight(distance1(pixel, pixel) / {r})").parse().expect("parses"))
            .into();
        assert_eq!(extents(&trees, window, &at), [Some(2), Some(1), Some(0), None, None]);
    }
}
