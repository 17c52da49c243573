//! Data that do not fit, and bodies that do not keep their word, are refused.

use tamis_jit::{
    Body, Border, Chains, CompileError, Compiler, Job, Lanes, Layout, Rect, Routine, Run,
    ShapeError, Side, Width, WindowSpec,
};

const SPEC: WindowSpec = WindowSpec {
    planes: 2,
    taps: 1,
    channels: 1,
    weights: 1,
    absolute: false,
    lone: false,
    mirrored: false,
};

/// Reads `plane` and tap value `tap`, and returns `weights` copies of the sum.
struct Reads {
    plane: usize,
    tap: usize,
    weights: usize,
}

const HONEST: Reads = Reads { plane: 1, tap: 0, weights: 1 };

impl Body for Reads {
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
        let (feature, tap) = (lanes.plane(self.plane, Side::J), lanes.tap(self.tap));
        vec![lanes.add(feature, tap); self.weights]
    }
}

fn compile(spec: WindowSpec, body: &impl Body) -> Result<Routine, CompileError> {
    // Eight pixels per step, whatever the host.
    let compiler =
        Compiler::with_width(Width::Bits128).expect("the tests need a host with machine code");
    compiler.compile(spec, Some(Chains::Two), body)
}

/// Runs an honest kernel on data that fit but for what `change` does to them.
fn run(change: impl FnOnce(&mut Job<'_>, &mut Vec<f32>)) -> Result<Vec<f32>, ShapeError> {
    let kernel = compile(SPEC, &HONEST).expect("compiles");
    let layout = Layout::new(20, 10, 2);
    let plane = layout.plane(Border::Zero, |_, _| 1.0);
    let taps = vec![0.0; 25];
    let runs = Run::square(2);
    let mut job = Job {
        layout,
        planes: &[&plane, &plane],
        runs: &runs,
        taps: &taps,
        rect: Rect { x: 2..18, y: 1..9 },
    };
    let mut out = vec![0.0; kernel.output_shape(&job.rect).len()];
    change(&mut job, &mut out);
    kernel.run(&job, &mut out, &mut []).map(|_| out)
}

#[test]
fn data_that_fit_are_taken() {
    let out = run(|_, _| {}).expect("fits");
    // 5 × 5 taps less the row above the image; the right border is far away.
    assert_eq!(out[..16], [vec![20.0; 16]].concat());
}

#[test]
fn an_empty_rectangle_computes_nothing() {
    for rect in [Rect { x: 7..7, y: 1..9 }, Rect { x: 2..18, y: 10..10 }] {
        let out = run(|job, out| {
            job.rect = rect;
            out.clear();
        });
        assert_eq!(out, Ok(Vec::new()));
    }
}

#[test]
fn wrong_planes() {
    let few = run(|job, _| job.planes = &job.planes[..1]);
    assert_eq!(few, Err(ShapeError::PlaneCount { expected: 2, found: 1 }));
    let short = run(|job, _| job.planes = &[&[0.0; 3000], &[0.0; 10]]);
    assert!(matches!(short, Err(ShapeError::PlaneLength { index: 1, found: 10, .. })));
}

#[test]
fn wrong_layouts() {
    // One value short of width + 2 × pad + step - 1.
    let narrow = run(|job, _| job.layout.stride = 20 + 4 + 6);
    assert_eq!(narrow, Err(ShapeError::Stride { expected: 31, found: 30 }));
    let tall = run(|job, _| job.layout.height = usize::MAX);
    assert!(matches!(tall, Err(ShapeError::Size { .. })));
    for field in [
        |layout: &mut Layout| layout.width = usize::MAX,
        |layout: &mut Layout| layout.pad = usize::MAX / 2,
        |layout: &mut Layout| (layout.stride, layout.pad) = (usize::MAX, usize::MAX),
    ] {
        let huge = run(|job, _| field(&mut job.layout));
        assert!(matches!(huge, Err(ShapeError::Stride { .. })), "{huge:?}");
    }
}

#[test]
fn wrong_windows() {
    let run = |dx, count, step| Run { dx, dy: 0, count, step };
    for (wide, pad) in [
        (run(-3, 1, 1), 2),
        (run(3, 1, 1), 2),
        (run(-2, 6, 1), 2),
        (run(2, 6, -1), 2),
        (run(isize::MIN, 1, 0), 2),
        (run(0, usize::MAX, isize::MAX), 2),
    ] {
        let found = run_with(&[run(0, 1, 1), wide]);
        assert_eq!(found, Err(ShapeError::Reach { index: 1, pad }), "{wide:?}");
    }
    for count in [1, usize::MAX] {
        let other = run_with(&[run(0, count, 0)]);
        assert_eq!(other, Err(ShapeError::TapCount { expected: count, found: 25 }));
    }
    let few = self::run(|job, _| job.taps = &job.taps[1..]);
    assert_eq!(few, Err(ShapeError::TapCount { expected: 25, found: 24 }));
}

/// An honest kernel over a window that may not be.
fn run_with(runs: &[Run]) -> Result<Vec<f32>, ShapeError> {
    let runs = runs.to_vec().leak();
    run(|job, _| job.runs = runs)
}

#[test]
fn runs_beyond_the_image_are_left_out() {
    let far = [isize::MIN, -1000, 0, 1000, isize::MAX];
    let runs: Vec<Run> = far.map(|dy| Run { dx: -2, dy, count: 5, step: 1 }).into();
    assert_eq!(run_with(&runs).expect("fits")[..16], [5.0; 16]);
}

#[test]
fn wrong_mirrored_sums() {
    let spec = WindowSpec { mirrored: true, ..SPEC };
    let kernel = compile(spec, &Reads { weights: 2, ..HONEST }).expect("compiles");
    let layout = Layout::new(20, 10, 2);
    let plane = layout.plane(Border::Zero, |_, _| 1.0);
    let runs = [Run { dx: 2, dy: 0, count: 2, step: -1 }, Run { dx: 2, dy: 1, count: 5, step: -1 }];
    let run = |rows: std::ops::Range<usize>, mirrored: usize| {
        let rect = Rect { x: 0..20, y: rows };
        let job = Job { layout, planes: &[&plane, &plane], runs: &runs, taps: &[0.0; 7], rect };
        let mut out = vec![0.0; kernel.output_shape(&job.rect).len()];
        kernel.run(&job, &mut out, &mut vec![0.0; mirrored]).map(|_| ())
    };
    let expected = 2 * layout.stride;
    assert_eq!(run(3..4, expected), Ok(()));
    assert_eq!(run(3..5, expected), Err(ShapeError::MirroredRows { found: 2 }));
    for found in [0, expected - 1, expected + 1] {
        assert_eq!(run(3..4, found), Err(ShapeError::Mirror { expected, found }));
    }
    let one = compile(spec, &HONEST);
    assert!(matches!(one, Err(CompileError::Weights { expected: 2, found: 1 })));
}

#[test]
#[expect(clippy::reversed_empty_ranges, reason = "they are what is tested")]
fn wrong_rectangles() {
    for (x, y) in
        [(2..21, 1..9), (2..18, 1..11), (9..8, 1..9), (2..18, 9..8), (usize::MAX..usize::MAX, 1..9)]
    {
        let found = run(|job, _| job.rect = Rect { x, y });
        assert!(matches!(found, Err(ShapeError::Rect { width: 20, height: 10, .. })), "{found:?}");
    }
}

#[test]
fn wrong_outputs() {
    for length in [0, 127, 129] {
        let found = run(|_, out| out.resize(length, 0.0));
        assert_eq!(found, Err(ShapeError::Output { expected: 128, found: length }));
    }
}

#[test]
fn bodies_that_reach_too_far() {
    let plane = compile(SPEC, &Reads { plane: 2, ..HONEST });
    assert!(matches!(plane, Err(CompileError::Plane { index: 2, planes: 2 })));
    let tap = compile(SPEC, &Reads { tap: usize::MAX, ..HONEST });
    assert!(matches!(tap, Err(CompileError::Tap { index: usize::MAX, taps: 1 })));
    for found in [0, 2] {
        let weights = compile(SPEC, &Reads { weights: found, ..HONEST });
        assert!(
            matches!(weights, Err(CompileError::Weights { expected: 1, found: n }) if n == found)
        );
    }
}

#[test]
fn specifications_out_of_range() {
    let huge = WindowSpec::LIMIT + 1;
    for spec in [
        WindowSpec { planes: 0, ..SPEC },
        WindowSpec { planes: huge, ..SPEC },
        WindowSpec { taps: huge, ..SPEC },
        WindowSpec { weights: 0, ..SPEC },
        WindowSpec { weights: usize::MAX, absolute: true, ..SPEC },
        // One is not enough for a weight and a channel of their own beside others.
        WindowSpec { lone: true, ..SPEC },
        WindowSpec { weights: 2, lone: true, ..SPEC },
        WindowSpec { channels: 2, lone: true, ..SPEC },
    ] {
        assert!(matches!(compile(spec, &HONEST), Err(CompileError::Spec { .. })), "{spec:?}");
    }
    for channels in [0, 3] {
        let spec = WindowSpec { channels, absolute: true, ..SPEC };
        assert!(matches!(compile(spec, &HONEST), Err(CompileError::Channels { planes: 2, .. })));
    }
}

/// In either code generator, with half of a kernel made.
#[test]
fn a_panic_costs_one_kernel() {
    struct Panics;
    impl Body for Panics {
        fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
            let (feature, tap) = (lanes.plane(1, Side::J), lanes.tap(0));
            lanes.fma(feature, tap, tap);
            panic!("no weight today")
        }
    }
    for width in Width::ALL {
        let Ok(compiler) = Compiler::with_width(width) else { continue };
        for chains in Chains::ALL {
            let found = compiler.compile(SPEC, Some(chains), &Panics);
            assert!(matches!(found, Err(CompileError::Panic(why)) if why == "no weight today"));
            assert!(compiler.compile(SPEC, Some(chains), &HONEST).is_ok());
        }
    }
}

#[test]
fn kernels_are_shared_between_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<Routine>();
    shared::<Compiler>();
}
