//! Bodies that are hard on a code generator: too long, too many values at a time,
//! more sums than registers over runs of every length.

use tamis_jit::{Border, Chains, Compiler, Job, Layout, Rect, Run, Side, Width, WindowSpec};

use crate::program::{Node, Program};
use crate::reference::assert_ways_agree;

/// A channel of ones and two features, over runs that are given.
fn check(program: &Program, runs: &[Run], wanted: impl Fn(&Compiler, Chains) -> bool) {
    let layout = Layout::new(37, 2, 6);
    let value =
        |salt: usize| move |x: usize, y: usize| ((x * 31 + y * 17 + salt) % 23) as f32 / 7.0;
    let planes = [
        layout.plane(Border::Zero, |_, _| 1.0),
        layout.plane(Border::Replicate, value(3)),
        layout.plane(Border::Replicate, value(11)),
    ];
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let count: usize = runs.iter().map(|run| run.count).sum();
    let taps: Vec<f32> = (0..2 * count).map(|n| (n % 13) as f32 / 5.0 - 1.0).collect();
    let spec = WindowSpec {
        planes: 3,
        taps: 2,
        channels: 1,
        weights: program.weights,
        absolute: true,
        lone: false,
        mirrored: false,
    };
    let job = Job { layout, planes: &planes, runs, taps: &taps, rect: Rect::all(&layout) };
    assert_ways_agree(spec, program, &job, wanted);
}

/// Numbers that look random.
fn numbers() -> impl FnMut(usize) -> usize {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    move |below| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    }
}

#[test]
fn five_hundred_values_at_a_time() {
    let mut nodes = vec![Node::Plane(1, Side::I), Node::Plane(2, Side::J), Node::Tap(0)];
    for n in 0..500 {
        nodes.push(Node::Fma(n % 3, (n + 1) % 3, nodes.len() - 1));
    }
    // The oldest first, so that all of them are alive.
    let first = nodes.len();
    nodes.push(Node::Constant(0.0));
    for n in 0..500 {
        nodes.push(Node::Sub(3 + n, nodes.len() - 1));
    }
    assert_eq!(nodes.len(), first + 501);
    // Emulation makes twenty instructions of one, and Cranelift takes seconds for them.
    let wanted =
        |compiler: &Compiler, chains| compiler.emulated().is_empty() || chains == Chains::One;
    check(&Program::new(nodes), &Run::square(1), wanted);
}

#[test]
fn ten_thousand_nodes() {
    let mut random = numbers();
    let mut nodes = vec![
        Node::Plane(1, Side::I),
        Node::Plane(1, Side::J),
        Node::Plane(2, Side::J),
        Node::Tap(1),
    ];
    while nodes.len() < 10_000 {
        let last = nodes.len() - 1;
        // Near ones mostly, and far ones that had to leave the registers.
        let mut pick = || match random(8) {
            0 => random(nodes.len()),
            _ => last - random(last.min(40) + 1),
        };
        let [a, b, c, d] = [pick(), pick(), pick(), pick()];
        nodes.push(match random(12) {
            0 => Node::Constant(random(1000) as f32 / 500.0 - 1.0),
            1 => Node::Tap(random(2)),
            2 => Node::Plane(1 + random(2), if random(2) == 0 { Side::I } else { Side::J }),
            3 => Node::Sub(a, b),
            4 => Node::Min(a, b),
            5 => Node::Max(a, b),
            6 => Node::Select(a, b, c, d),
            7 => Node::Round(a),
            8 => Node::Abs(a),
            9 => Node::Fraction(a),
            _ => Node::Fma(a, b, c),
        });
    }
    let program = Program { nodes, weights: 12 };
    // Cranelift takes seconds for it with more chains.
    let wanted =
        |compiler: &Compiler, chains| compiler.width() != Width::Bits128 || chains == Chains::One;
    check(&program, &[Run { dx: -1, dy: 0, count: 3, step: 1 }], wanted);
}

/// Kernels that add up in memory compute two taps at once, and one that is left over;
/// others, of one weight, the second half of each among the first half of the next.
#[test]
fn runs_of_every_length() {
    let mut nodes =
        vec![Node::Plane(1, Side::I), Node::Plane(2, Side::J), Node::Tap(0), Node::Tap(1)];
    nodes.extend((0..24).map(|n| Node::Fma(n, n + 1, n + 2)));
    for weights in [1, 7, 20] {
        let program = Program { nodes: nodes.clone(), weights };
        let run = |count: usize| Run { dx: 6 - count as isize, dy: 0, count, step: 1 };
        for count in 1..=7 {
            check(&program, &[run(count)], |_, _| true);
        }
        let back = |count| Run { dx: 5, dy: 1, count, step: -2 };
        check(&program, &[run(3), back(4), run(0), back(1), run(6)], |_, _| true);
    }
}

/// Constants that are worth registers leave few of them to a selection whose operands
/// all come from memory.
#[test]
fn a_selection_among_many_constants() {
    let mut nodes = vec![Node::Plane(1, Side::I), Node::Tap(0), Node::Tap(1)];
    let constants = 3..43;
    nodes.extend(constants.clone().map(|n| Node::Constant(n as f32 / 8.0)));
    for round in 0..3 {
        for constant in constants.clone() {
            nodes.push(Node::Fma(nodes.len() - 1, constant, (constant + round) % 3));
        }
        nodes.push(Node::Select(1, 2, 2, 1));
    }
    check(&Program::new(nodes), &Run::square(1), |_, _| true);
}
