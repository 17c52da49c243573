//! Every instruction on the values where it could go wrong.
//!
//! A sum hides the sign of a zero, so each program also returns the reciprocal
//! of its result, which is an infinity of the same sign.

use tamis_jit::{Job, Layout, Rect, Run, Side, WindowSpec};

use crate::program::{Node, Program};
use crate::reference::assert_agrees;

/// `value` and the floats next to it, of both signs.
fn around(value: f32) -> [f32; 6] {
    let bits = value.to_bits();
    let [below, above] = [bits.saturating_sub(1), bits + 1].map(f32::from_bits);
    [below, value, above, -below, -value, -above]
}

/// Zeros, subnormals, breakpoints, limits.
fn probes() -> Vec<f32> {
    let centres = [
        f32::from_bits(1),
        f32::MIN_POSITIVE,
        f32::EPSILON,
        0.1,
        0.5,
        1.0,
        1.5,
        2.0,
        2.5,
        3.0,
        126.0,
        127.0,
        4_194_303.5,
        8_388_607.5,
        8_388_608.0,
        12_583_039.0,
        16_777_216.0,
        1e20,
        f32::MAX,
    ];
    let mut probes: Vec<f32> = centres.into_iter().flat_map(around).collect();
    probes.push(f32::NAN);
    probes
}

/// Runs `nodes` on tuples of values: operand k of every tuple is node k.
fn check(tuples: &[[f32; 3]], node: Node) {
    check_last(tuples, &[node]);
}

/// The same for the last of several nodes, which follow operands and the constant 1.
fn check_last(tuples: &[[f32; 3]], under_test: &[Node]) {
    let layout = Layout::new(tuples.len(), 1, 0);
    let one = vec![1.0; layout.stride];
    let operands: Vec<Vec<f32>> = (0..3)
        .map(|k| {
            let mut plane: Vec<f32> = tuples.iter().map(|tuple| tuple[k]).collect();
            plane.resize(layout.stride, 0.0);
            plane
        })
        .collect();
    let mut nodes = vec![
        Node::Plane(1, Side::I),
        Node::Plane(2, Side::J),
        Node::Plane(3, Side::J),
        Node::Constant(1.0),
    ];
    nodes.extend(under_test);
    let last = nodes.len() - 1;
    nodes.extend([Node::Div(3, last), Node::Abs(last), Node::Add(last, 3)]);
    let program = Program { nodes, weights: 4 };
    // The last four nodes are weights: what is under test, its reciprocal, and
    // two uses that invite a code generator to merge it with what follows.
    let spec = WindowSpec {
        planes: 4,
        taps: 0,
        channels: 1,
        weights: 4,
        absolute: false,
        lone: false,
        mirrored: false,
    };
    let job = Job {
        layout,
        planes: &[&one, &operands[0], &operands[1], &operands[2]],
        runs: &Run::square(0),
        taps: &[],
        rect: Rect::all(&layout),
    };
    assert_agrees(spec, &program, &job);
}

fn singles(values: &[f32]) -> Vec<[f32; 3]> {
    values.iter().map(|&x| [x, 0.0, 0.0]).collect()
}

fn pairs() -> Vec<[f32; 3]> {
    let probes = probes();
    let pair = |&x: &f32| probes.iter().map(move |&y| [x, y, 0.0]).collect::<Vec<_>>();
    probes.iter().flat_map(pair).collect()
}

#[test]
fn one_operand() {
    let tuples = singles(&probes());
    for node in [
        Node::Neg(0),
        Node::Abs(0),
        Node::Sqrt(0),
        Node::Round(0),
        Node::Exp2i(0),
        Node::Exponent(0),
        Node::Fraction(0),
    ] {
        check(&tuples, node);
    }
}

#[test]
fn round_breaks_ties_to_even() {
    let ties: Vec<f32> = (-200..200).map(|n| n as f32 + 0.5).collect();
    check(&singles(&ties), Node::Round(0));
}

#[test]
fn exp2i_over_its_whole_domain() {
    let whole: Vec<f32> = (-127..=127).map(|n| n as f32).collect();
    check(&singles(&whole), Node::Exp2i(0));
}

#[test]
fn exponent_and_fraction_of_every_binade() {
    // In each, numbers below and above the root that divides one from the next.
    let fields = [0x12_3456, 0x35_04f3, 0x35_04f4];
    let numbers: Vec<f32> = (0..=0xff)
        .flat_map(|e: u32| fields.map(|field| f32::from_bits((e << 23) | field)))
        .flat_map(|x| [x, -x])
        .collect();
    check(&singles(&numbers), Node::Exponent(0));
    check(&singles(&numbers), Node::Fraction(0));
}

#[test]
fn two_operands() {
    let tuples = pairs();
    for node in [
        Node::Add(0, 1),
        Node::Sub(0, 1),
        Node::Mul(0, 1),
        Node::Div(0, 1),
        Node::Min(0, 1),
        Node::Max(0, 1),
        Node::Select(0, 1, 3, 0),
    ] {
        check(&tuples, node);
    }
}

/// Code generators may let sums do what a negation before them does. Zeros tell whether
/// they kept the signs apart.
#[test]
fn negations_before_sums() {
    let few: Vec<f32> = probes().into_iter().step_by(5).chain([0.0, -0.0, 1.0]).collect();
    let mut tuples = Vec::new();
    for &x in &few {
        for &y in &few {
            tuples.extend([x * y, -(x * y), 0.0, -0.0, 1.0].map(|z| [x, y, z]));
        }
    }
    // Nodes 4 to 6: what may be negated.
    let negated = [Node::Neg(0), Node::Neg(1), Node::Neg(2)];
    for signs in 0..8 {
        let [x, y, z] = [0, 1, 2].map(|k| if signs >> k & 1 == 1 { k + 4 } else { k });
        for sum in [Node::Fma(x, y, z), Node::Add(x, y), Node::Sub(x, y)] {
            check_last(&tuples, &[&negated[..], &[sum]].concat());
        }
    }
}

#[test]
fn select_moves_bits() {
    let mut tuples = pairs();
    for (n, tuple) in tuples.iter_mut().enumerate() {
        tuple[2] = [-0.0, f32::NAN, 1e-45, f32::INFINITY][n % 4];
    }
    check(&tuples, Node::Select(0, 1, 2, 0));
    // The shapes of min and max, which may become those instructions.
    check(&tuples, Node::Select(0, 1, 0, 1));
    check(&tuples, Node::Select(0, 1, 1, 0));
}

#[test]
fn fma_rounds_once() {
    let probes = probes();
    let mut tuples = Vec::new();
    for (n, &x) in probes.iter().enumerate() {
        for &y in probes.iter().skip(n % 3).step_by(3) {
            // -(x × y) rounded: what is left is the error of the product.
            tuples.extend([x * -y, 1.0, -f32::MIN_POSITIVE, 1e30].map(|z| [x, y, z]));
        }
    }
    check(&tuples, Node::Fma(0, 1, 2));
}

/// Sums that are off the middle between two floats by less than an f64 shows: rounded
/// to f64 first they would be that middle, and then be rounded to even.
#[test]
fn fma_rounds_once_beside_a_tie() {
    let mut tuples = Vec::new();
    // Products of 25 bits, the last of them set, are such middles; z tips the scales.
    let odd = |n: u32| ((1 << 12) | (n.wrapping_mul(0x9e37_79b9) >> 20) | 1) as f32;
    let factors = (0..1000).map(|n| [odd(n), odd(n ^ 0x5555)]);
    for [x, y] in factors.filter(|[x, y]| x * y < (1 << 25) as f32) {
        for (scale, little) in [(0, -40), (0, -100), (60, -80), (-60, -120), (-60, -149)] {
            let (x, z) = (x * 2f32.powi(scale), 2f32.powi(little));
            tuples.extend([[x, y, z], [x, y, -z], [-x, y, z], [-x, y, -z]]);
        }
    }
    tuples.extend(half_of_the_last_place(1 << 23, [0, 0]));
    check(&tuples, Node::Fma(0, 1, 2));
}

/// The same where floats lie further apart than their size says.
#[test]
fn fma_rounds_once_beside_a_subnormal_tie() {
    check(&half_of_the_last_place(1 << 22, [-75, -74]), Node::Fma(0, 1, 2));
}

/// Products that are half of z's last place, less a little: the scales are powers of
/// two for both factors.
fn half_of_the_last_place(first: u32, scales: [i32; 2]) -> Vec<[f32; 3]> {
    let unit = 2f32.powi(scales[0] + scales[1]);
    let [of_x, of_y] = scales.map(|n| 2f32.powi(n));
    let mut tuples = Vec::new();
    for n in 0..40 {
        let z = (first + n) as f32 * unit;
        for little in [-20, -22].map(|n| 2f32.powi(n)) {
            let (x, y) = ((0.5 + 0.5 * little) * of_x, (1.0 - little) * of_y);
            tuples.extend([[x, y, z], [-x, y, z], [x, -y, -z], [x, y, -z]]);
        }
    }
    tuples
}

#[test]
fn constants_keep_their_bits() {
    for value in probes() {
        check(&singles(&[0.0; 5]), Node::Constant(value));
    }
}
