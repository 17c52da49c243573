//! Sums over windows: borders, ragged widths, dilation, batches, rectangles.

use tamis_jit::{Border, Job, Layout, Rect, Side, Window, WindowSpec};

use crate::program::{Node, Program};
use crate::reference::assert_agrees;

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

fn check(width: usize, height: usize, window: Window, rect: Option<Rect>, absolute: bool) {
    let layout = Layout::new(width, height, window.reach());
    let planes = planes(&layout);
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    let taps: Vec<f32> = (0..2 * window.taps()).map(|n| noise(9, n, 0)).collect();
    let spec = WindowSpec { planes: 4, taps: 2, channels: 2, weights: 2, absolute };
    let job = Job {
        layout,
        planes: &planes,
        window,
        taps: &taps,
        rect: rect.unwrap_or_else(|| Rect::all(&layout)),
    };
    assert_agrees(spec, &program(), &job);
}

#[test]
fn radii_from_none_to_more_than_the_image() {
    for radius in [0, 1, 2, 3, 8] {
        check(11, 5, Window::square(radius), None, false);
    }
}

#[test]
fn radii_that_differ_by_axis() {
    for radius in [[0, 3], [3, 0], [2, 1]] {
        let window = Window { radius, dilation: [1, 1] };
        check(13, 6, window, None, true);
    }
}

#[test]
fn dilated_taps_skip_pixels() {
    for dilation in [[2, 2], [1, 3], [4, 1], [1, 1000]] {
        let window = Window { radius: [2, 2], dilation };
        check(18, 9, window, None, true);
    }
}

#[test]
fn ragged_widths() {
    for width in 1..=40 {
        check(width, 3, Window::square(1), None, false);
    }
}

#[test]
fn rectangles_inside_the_image() {
    for (x, y) in [(0..1, 0..1), (3..20, 2..5), (22..23, 6..7), (5..5, 0..7), (0..23, 3..3)] {
        check(23, 7, Window::square(2), Some(Rect { x, y }), true);
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
    let spec = WindowSpec { planes: 4, taps: 0, channels: 2, weights: 20, absolute: true };
    let job = Job {
        layout,
        planes: &planes,
        window: Window::square(2),
        taps: &[],
        rect: Rect::all(&layout),
    };
    assert_agrees(spec, &program, &job);
}
