//! Sums over windows: borders, ragged widths, dilation, batches, rectangles, and
//! mirrored kernels.

use tamis_jit::{Border, Chains, Job, Layout, Rect, Run, Side, WindowSpec};

use crate::program::{Node, Program};
use crate::reference::{assert_agrees, compilers};

/// A number in -1..1 that looks random, for pixel (x, y) of plane `seed`.
fn noise(seed: u32, x: usize, y: usize) -> f32 {
    let mut bits = seed
        .wrapping_mul(0x9e37_79b9)
        .wrapping_add(x as u32)
        .wrapping_mul(0x85eb_ca6b)
        .wrapping_add(y as u32)
        .wrapping_mul(0xc2b2_ae35);
    bits ^= bits >> 15;
    bits = bits.wrapping_mul(0x2c1b_3c6d);
    bits ^= bits >> 13;
    (bits >> 8) as f32 / (1 << 23) as f32 - 1.0
}

/// Planes 0 and 1 are channels, noise and the constant 1; 2 and 3 are features.
fn planes(layout: &Layout) -> Vec<Vec<f32>> {
    vec![
        layout.plane(Border::Zero, |x, y| noise(1, x, y)),
        layout.plane(Border::Zero, |_, _| 1.0),
        layout.plane(Border::Replicate, |x, y| noise(2, x, y)),
        layout.plane(Border::Replicate, |x, y| noise(3, x, y)),
    ]
}

/// Two weights of either sign that read both sides and both tap values.
fn program() -> Program {
    Program {
        nodes: vec![
            Node::Plane(2, Side::I),
            Node::Plane(2, Side::J),
            Node::Sub(0, 1),
            Node::Mul(2, 2),
            Node::Tap(0),
            Node::Plane(3, Side::J),
            Node::Tap(1),
            Node::Fma(3, 4, 5),
            Node::Fma(6, 5, 0),
        ],
        weights: 2,
    }
}

/// The same where each instruction waits for the one before, from the first to the last
/// of so many: what kernels compute in two halves.
fn long_program(instructions: usize) -> Program {
    let Program { mut nodes, weights } = program();
    for n in 0..instructions {
        let last = nodes.len() - 1;
        // Of the tap or a pixel, all the way: the halves read those of different taps.
        nodes.push(Node::Fma(last, [1, 4, 0, 6, 5][n % 5], 7 + n % 2));
    }
    Program { nodes, weights }
}

/// The rows of a window from the top, each from left to right.
fn grid(radius: [isize; 2], dilation: [isize; 2]) -> Vec<Run> {
    let [rx, ry] = radius;
    let count = 2 * rx as usize + 1;
    let row = |v| Run { dx: -rx * dilation[0], dy: v * dilation[1], count, step: dilation[0] };
    (-ry..=ry).map(row).collect()
}

fn reach(runs: &[Run]) -> usize {
    let last = |run: &Run| run.dx + run.step * (run.count as isize - 1);
    runs.iter().map(|run| run.dx.abs().max(last(run).abs())).max().unwrap_or(0) as usize
}

fn check(width: usize, height: usize, runs: &[Run], rect: Option<Rect>, absolute: bool) {
    let layout = Layout::new(width, height, reach(runs));
    let planes = planes(&layout);
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let count: usize = runs.iter().map(|run| run.count).sum();
    let taps: Vec<f32> = (0..2 * count).map(|n| noise(9, n, 0)).collect();
    let rect = rect.unwrap_or_else(|| Rect::all(&layout));
    let job = Job { layout, planes: &planes, runs, taps: &taps, rect };
    let (planes, taps, channels, weights) = (4, 2, 2, 2);
    for lone in [false, true] {
        let mirrored = false;
        let spec = WindowSpec { planes, taps, channels, weights, absolute, lone, mirrored };
        assert_agrees(spec, &program(), &job);
    }
}

#[test]
fn radii_from_none_to_more_than_the_image() {
    for radius in [0, 1, 2, 3, 8] {
        check(11, 5, &Run::square(radius), None, false);
    }
}

#[test]
fn radii_that_differ_by_axis() {
    for radius in [[0, 3], [3, 0], [2, 1]] {
        check(13, 6, &grid(radius, [1, 1]), None, true);
    }
}

#[test]
fn dilated_taps_skip_pixels() {
    for dilation in [[2, 2], [1, 3], [4, 1], [1, 1000]] {
        check(18, 9, &grid([2, 2], dilation), None, true);
    }
}

#[test]
fn runs_of_any_shape_and_direction() {
    let run = |dx, dy, count, step| Run { dx, dy, count, step };
    for runs in [
        vec![],
        vec![run(3, 0, 0, 1)],
        vec![run(3, 1, 7, -1), run(0, 0, 1, 5), run(-2, -1, 3, 2), run(1, 0, 0, 1)],
        vec![run(2, 0, 4, 0), run(-3, isize::MIN, 2, 1), run(0, isize::MAX, 2, -3)],
    ] {
        check(13, 4, &runs, None, true);
    }
}

#[test]
fn ragged_widths() {
    for width in 1..=40 {
        check(width, 3, &Run::square(1), None, false);
    }
}

#[test]
fn rectangles_inside_the_image() {
    for (x, y) in [(0..1, 0..1), (3..20, 2..5), (22..23, 6..7), (5..5, 0..7), (0..23, 3..3)] {
        check(23, 7, &Run::square(2), Some(Rect { x, y }), true);
    }
}

/// The weights of a program with the pixels exchanged come after themselves.
fn with_mirrored(program: &Program) -> Program {
    let Program { nodes, weights } = program.clone();
    let shift = nodes.len();
    let back = nodes.iter().map(|&node| match node {
        Node::Plane(plane, Side::I) => Node::Plane(plane, Side::J),
        Node::Plane(plane, Side::J) => Node::Plane(plane, Side::I),
        Node::Sub(a, b) => Node::Sub(a + shift, b + shift),
        Node::Mul(a, b) => Node::Mul(a + shift, b + shift),
        Node::Fma(a, b, c) => Node::Fma(a + shift, b + shift, c + shift),
        // What belongs to an offset is the same for the opposite one here.
        Node::Tap(k) => Node::Tap(k),
        other => unreachable!("{other:?} is not in the program"),
    });
    let mut all: Vec<Node> = nodes.iter().copied().chain(back).collect();
    // The weights are the last nodes: + 0 makes nodes of both halves of them.
    let zero = all.len();
    all.push(Node::Constant(0.0));
    all.extend((shift - weights..shift).map(|n| Node::Add(n, zero)));
    all.extend((2 * shift - weights..2 * shift).map(|n| Node::Add(n, zero)));
    Program { nodes: all, weights: 2 * weights }
}

/// Half a window, each row computed once, gives the bits of the whole window: to
/// what its own runs give, a row adds what the rows above it left for it.
#[test]
fn mirrored_halves_make_the_whole() {
    check_mirrored(&program());
    check_mirrored(&long_program(40));
}

fn check_mirrored(program: &Program) {
    for lone in [false, true] {
        let (planes, taps, channels, weights) = (4, 2, 2, 2);
        let (absolute, mirrored) = (true, false);
        let spec = WindowSpec { planes, taps, channels, weights, absolute, lone, mirrored };
        check_mirrored_as(spec, program);
    }
}

fn check_mirrored_as(spec: WindowSpec, program: &Program) {
    const RADIUS: isize = 3;
    let row = |dx, dy, count, step| Run { dx, dy, count, step };
    let half: Vec<Run> = std::iter::once(row(RADIUS, 0, RADIUS as usize, -1))
        .chain((1..=RADIUS).map(|dy| row(RADIUS, dy, 2 * RADIUS as usize + 1, -1)))
        .collect();
    let above = (1..=RADIUS).rev().map(|dy| row(-RADIUS, -dy, 2 * RADIUS as usize + 1, 1));
    let left = row(-RADIUS, 0, RADIUS as usize, 1);
    let whole: Vec<Run> = above.chain(half.iter().copied()).chain([left]).collect();

    // Values of taps that are the same for an offset and its opposite.
    let taps = |runs: &[Run]| -> Vec<f32> {
        let offsets = runs
            .iter()
            .flat_map(|run| (0..run.count as isize).map(|k| [run.dx + k * run.step, run.dy]));
        let seeds = offsets.map(|[dx, dy]| (dx * dx + 31 * dy * dy + 7 * (dx * dy)) as usize);
        seeds.flat_map(|seed| [noise(5, seed, 0), noise(6, seed, 1)]).collect()
    };
    let (whole_taps, half_taps) = (taps(&whole), taps(&half));
    let compilers = compilers();
    for (width, height) in [(1, 1), (5, 9), (33, 8), (70, 3)] {
        let layout = Layout::new(width, height, RADIUS as usize);
        let planes = planes(&layout);
        let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
        let rect = Rect::all(&layout);
        let job = Job { layout, planes: &planes, runs: &whole, taps: &whole_taps, rect };
        assert_agrees(spec, program, &job);
        let plain = compilers[0].compile(spec, Some(Chains::Four), program).expect("compiles");
        let mut expected = vec![0.0; plain.output_shape(&job.rect).len()];
        let expected_shape = plain.run(&job, &mut expected, &mut []).expect("fits");

        let mirrored = WindowSpec { mirrored: true, ..spec };
        let ways = compilers.iter().flat_map(|c| Chains::ALL.map(|chains| (c, chains)));
        for (compiler, chains) in ways {
            let kernel = compiler
                .compile(mirrored, Some(chains), &with_mirrored(program))
                .expect("compiles");
            let all = kernel.output_shape(&job.rect);
            let mut sums = vec![0.0; all.len()];
            for y in 0..height {
                let rect = Rect { x: 0..width, y: y..y + 1 };
                let job = Job { rect, runs: &half, taps: &half_taps, ..job.clone() };
                let shape = kernel.mirror_shape(&job);
                let mut owed = vec![0.0; shape.len()];
                let row = all.row(y, 0).start..all.row(y, spec.results() - 1).start + all.stride;
                kernel.run(&job, &mut sums[row], &mut owed).expect("fits");
                // The row's own left neighbours come last, as in the whole window.
                for (index, run) in half.iter().enumerate() {
                    let target = y + run.dy as usize;
                    for result in 0..if target < height { spec.results() } else { 0 } {
                        let owed = &owed[shape.row(index, result)][layout.pad..][..width];
                        for (sum, owed) in sums[all.row(target, result)].iter_mut().zip(owed) {
                            *sum += owed;
                        }
                    }
                }
            }
            for (y, result) in (0..height).flat_map(|y| (0..spec.results()).map(move |r| (y, r))) {
                let found = &sums[all.row(y, result)];
                assert_eq!(
                    found,
                    &expected[expected_shape.row(y, result)],
                    "{}, {chains:?}, row {y}",
                    compiler.width()
                );
            }
        }
    }
}

#[test]
fn a_batch_larger_than_the_registers() {
    let layout = Layout::new(21, 4, 2);
    let planes = planes(&layout);
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let mut nodes = vec![Node::Plane(2, Side::I), Node::Plane(3, Side::J)];
    nodes.extend((0..24).map(|n| match n % 3 {
        0 => Node::Add(n + 1, n),
        1 => Node::Mul(n + 1, 1),
        _ => Node::Sub(n, n + 1),
    }));
    let program = Program { nodes, weights: 20 };
    let spec = WindowSpec {
        planes: 4,
        taps: 0,
        channels: 2,
        weights: 20,
        absolute: true,
        lone: false,
        mirrored: false,
    };
    let job =
        Job { layout, planes: &planes, runs: &Run::square(2), taps: &[], rect: Rect::all(&layout) };
    assert_agrees(spec, &program, &job);
}
