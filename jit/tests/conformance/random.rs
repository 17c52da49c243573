//! Random straight-line programs on random data.

use proptest::prelude::*;
use tamis_jit::{Border, Job, Layout, Rect, Run, Side, WindowSpec};

use crate::program::{Node, Program};
use crate::reference::assert_agrees;

/// Finite values over the whole range, most of them of ordinary size.
fn value() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -8.0f32..8.0,
        1 => prop::num::f32::NORMAL | prop::num::f32::SUBNORMAL | prop::num::f32::ZERO,
    ]
}

fn node() -> impl Strategy<Value = Node> {
    let n = || 0..1000usize;
    let side = prop_oneof![Just(Side::I), Just(Side::J)];
    prop_oneof![
        value().prop_map(Node::Constant),
        (0..3usize, side).prop_map(|(index, side)| Node::Plane(index, side)),
        (0..2usize).prop_map(Node::Tap),
        n().prop_map(Node::Neg),
        n().prop_map(Node::Abs),
        n().prop_map(Node::Sqrt),
        n().prop_map(Node::Round),
        n().prop_map(Node::Exp2i),
        n().prop_map(Node::Exponent),
        n().prop_map(Node::Fraction),
        (n(), n()).prop_map(|(a, b)| Node::Add(a, b)),
        (n(), n()).prop_map(|(a, b)| Node::Sub(a, b)),
        (n(), n()).prop_map(|(a, b)| Node::Mul(a, b)),
        (n(), n()).prop_map(|(a, b)| Node::Div(a, b)),
        (n(), n()).prop_map(|(a, b)| Node::Min(a, b)),
        (n(), n()).prop_map(|(a, b)| Node::Max(a, b)),
        (n(), n(), n()).prop_map(|(a, b, c)| Node::Fma(a, b, c)),
        (n(), n(), n(), n()).prop_map(|(a, b, c, d)| Node::Select(a, b, c, d)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn programs_agree(
        nodes in prop::collection::vec(node(), 1..60),
        data in prop::collection::vec(value(), 2 * 19 * 3),
        taps in prop::collection::vec(value(), 2 * 9),
    ) {
        let layout = Layout::new(19, 3, 1);
        let pick = |plane: usize| {
            let data = &data;
            move |x: usize, y: usize| data[(plane * 3 + y) * 19 + x]
        };
        let one = layout.plane(Border::Zero, |_, _| 1.0);
        let first = layout.plane(Border::Replicate, pick(0));
        let second = layout.plane(Border::Replicate, pick(1));
        // A first node that needs no operand, so that every other finds one.
        let program = Program::new(std::iter::once(Node::Plane(1, Side::J)).chain(nodes));
        let spec = WindowSpec { planes: 3, taps: 2, channels: 1, weights: 1, absolute: true, lone: false, mirrored: false };
        let job = Job {
            layout,
            planes: &[&one, &first, &second],
            runs: &Run::square(1),
            taps: &taps,
            rect: Rect::all(&layout),
        };
        assert_agrees(spec, &program, &job);
    }
}
