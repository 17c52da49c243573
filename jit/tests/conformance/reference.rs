//! The windowed sum as plain loops over [`Scalar`] lanes.

use tamis_jit::{
    Body, Chains, CompileError, Compiler, CpuFeatures, Job, Scalar, Width, WindowSpec,
};

/// All results of one pixel, in the order of [`WindowSpec::result`].
fn pixel<B: Body>(spec: &WindowSpec, body: &B, job: &Job<'_>, x: usize, y: usize) -> Vec<f32> {
    let layout = job.layout;
    let at = |column: isize, row: usize| -> Vec<f32> {
        let index = row * layout.stride + (layout.pad as isize + column) as usize;
        job.planes.iter().map(|plane| plane[index]).collect()
    };
    let i = at(x as isize, y);
    let mut sums = vec![0.0f32; spec.results()];
    let mut first = 0;
    for run in job.runs {
        let row = (y as isize).saturating_add(run.dy);
        let inside = (0..layout.height as isize).contains(&row);
        let mut partials = vec![0.0f32; spec.results()];
        for k in 0..run.count as isize {
            let tap = &job.taps[first..first + spec.taps];
            first += spec.taps;
            if !inside {
                continue;
            }
            let j = at(x as isize + run.dx + k * run.step, row as usize);
            let weights = body.emit(&mut Scalar { i: &i, j: &j, tap });
            for (k, weight) in weights.into_iter().take(spec.weights).enumerate() {
                let common = spec.channels - usize::from(spec.lone);
                if spec.lone && k + 1 == spec.weights {
                    let p = &mut partials[spec.result(k, common)];
                    *p = weight.mul_add(j[common], *p);
                    continue;
                }
                for c in 0..common {
                    let p = &mut partials[spec.result(k, c)];
                    *p = weight.mul_add(j[c], *p);
                }
                if spec.absolute {
                    let p = &mut partials[spec.result(k, common)];
                    *p = weight.abs().mul_add(j[common - 1], *p);
                }
            }
        }
        if inside {
            for (sum, partial) in sums.iter_mut().zip(partials) {
                *sum += partial;
            }
        }
    }
    sums
}

/// Bits, with all NaNs made one: their sign and payload are not part of the promise.
fn bits(value: f32) -> u32 {
    if value.is_nan() { f32::NAN.to_bits() } else { value.to_bits() }
}

/// Compilers of all widths that this host has, and of processors that have less: SSE2
/// alone, SSE4.1, and AVX without fused multiply-add.
pub(crate) fn compilers() -> Vec<Compiler> {
    let width = |width| match Compiler::with_width(width) {
        Err(CompileError::Width(_)) if width != Width::Bits128 => None,
        made => Some(made.expect("the tests need a host with machine code")),
    };
    let sse2 = CpuFeatures::default();
    let sse41 = CpuFeatures { sse41: true, ..sse2 };
    let lesser = [sse2, sse41, CpuFeatures { avx: true, ..sse41 }];
    // Elsewhere than on x86-64 there are no such processors.
    let lesser = lesser.into_iter().filter(|_| cfg!(target_arch = "x86_64"));
    let lesser = lesser.map(|features| Compiler::with_features(features).expect("it needs less"));
    Width::ALL.into_iter().filter_map(width).chain(lesser).collect()
}

/// Compiles `body` for every width and number of chains, runs it on `job`, and
/// compares every result of every pixel with the reference.
pub(crate) fn assert_agrees<B: Body>(spec: WindowSpec, body: &B, job: &Job<'_>) {
    assert_ways_agree(spec, body, job, |_, _| true);
}

/// The same for some compilers and numbers of chains.
pub(crate) fn assert_ways_agree<B: Body>(
    spec: WindowSpec,
    body: &B,
    job: &Job<'_>,
    wanted: impl Fn(&Compiler, Chains) -> bool,
) {
    let expected: Vec<Vec<f32>> = job
        .rect
        .y
        .clone()
        .flat_map(|y| job.rect.x.clone().map(move |x| (x, y)))
        .map(|(x, y)| pixel(&spec, body, job, x, y))
        .collect();
    let compilers = compilers();
    let ways = compilers.iter().flat_map(|c| Chains::ALL.map(|chains| (c, chains)));
    for (compiler, chains) in ways.filter(|(c, chains)| wanted(c, *chains)) {
        let (width, emulated) = (compiler.width(), compiler.emulated());
        let kernel = compiler.compile(spec, Some(chains), body).expect("compiles");
        let mut out = vec![0.0; kernel.output_shape(&job.rect).len()];
        let shape = kernel.run(job, &mut out, &mut []).expect("fits");
        for (n, sums) in expected.iter().enumerate() {
            let (row, column) = (n / shape.columns, n % shape.columns);
            for (result, &sum) in sums.iter().enumerate() {
                let found = out[shape.row(row, result)][column];
                assert_eq!(
                    bits(found),
                    bits(sum),
                    "{width} emulating {emulated:?}, {chains:?}, row {row}, column {column}, result {result}: {found:e}, \
                     not {sum:e}"
                );
            }
        }
    }
}
