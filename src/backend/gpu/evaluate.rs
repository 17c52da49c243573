//! A tape on the GPU, element by element: how the operators themselves are
//! measured there, and what the device's arithmetic is found out with.

use askama::Template;

use super::device::Device;
use super::error::GpuError;
use crate::backend::shader::wgsl::{Arithmetic, Dialect, Statements, functions, statements};
use crate::expr::builder::{Builder, Rules};
use crate::expr::interval::Interval;
use crate::expr::tape::{Input, Prim, Side, Tape};
use crate::plan::Precision;

/// Invocations per workgroup.
const WORKGROUP: usize = 64;

/// Elements per dispatch: well below the 65,535 workgroups that are granted.
const BATCH: usize = 1 << 20;

#[derive(Template)]
#[template(path = "evaluate.wgsl", escape = "none")]
struct EvaluateTemplate {
    inputs: usize,
    workgroup: usize,
    functions: String,
    lines: String,
    results: Vec<String>,
}

/// Evaluates a tape whose inputs are `PerPixel(k)`, given as `inputs[k]`, slices
/// of one length. Returns one vector per result.
pub(super) fn evaluate(
    device: &Device,
    tape: &Tape,
    dialect: Dialect,
    inputs: &[&[f32]],
) -> Result<Vec<Vec<f32>>, GpuError> {
    let Statements { lines, results } = statements(tape, dialect, |input| match input {
        Input::PerPixel(k, _) => format!("inputs[{k}u * params.count + n]"),
        Input::Plane(..)
        | Input::Offset(_)
        | Input::PerTap(_)
        | Input::Signal(..)
        | Input::Constant(_) => {
            unreachable!("elementwise tapes read PerPixel values")
        }
    });
    let kernel = EvaluateTemplate {
        inputs: inputs.len(),
        workgroup: WORKGROUP,
        functions: functions(&lines, dialect),
        lines,
        results,
    };
    let text = kernel.render().expect("writing to a string cannot fail");
    let pipeline = device.pipeline(&text, "main", None)?;
    let count = inputs.first().map_or(0, |input| input.len());
    let mut all = vec![Vec::with_capacity(count); tape.results().len()];
    for start in (0..count).step_by(BATCH) {
        let batch: Vec<&[f32]> =
            inputs.iter().map(|input| &input[start..count.min(start + BATCH)]).collect();
        let results = run(device, &pipeline, &batch, all.len())?;
        for (all, part) in all.iter_mut().zip(results.chunks_exact(batch[0].len())) {
            all.extend_from_slice(part);
        }
    }
    Ok(all)
}

fn run(
    device: &Device,
    pipeline: &wgpu::ComputePipeline,
    inputs: &[&[f32]],
    results: usize,
) -> Result<Vec<f32>, GpuError> {
    let count = inputs[0].len();
    let params = [count as u32, 0];
    let params =
        device.filled("parameters", bytemuck::cast_slice(&params), wgpu::BufferUsages::UNIFORM)?;
    let contents = inputs.concat();
    let contents =
        device.filled("elements", bytemuck::cast_slice(&contents), wgpu::BufferUsages::STORAGE)?;
    let bytes = (count * results * size_of::<f32>()) as u64;
    let made = device.buffer(
        "results",
        bytes,
        wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        false,
    )?;
    let back = device.buffer(
        "results",
        bytes,
        wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        false,
    )?;
    let commands = device.checked("commands", 0, |device| {
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[(0, &params), (1, &contents), (2, &made)].map(|(binding, buffer)| {
                wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
            }),
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(count.div_ceil(WORKGROUP) as u32, 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&made, 0, &back, 0, bytes);
        encoder.finish()
    })?;
    let submission = device.queue.submit([commands]);
    let range = back.slice(..bytes);
    range.map_async(wgpu::MapMode::Read, |_| {});
    device.wait(submission)?;
    let view = range.get_mapped_range().map_err(|error| device.lost(&error.to_string()))?;
    Ok(bytemuck::pod_collect_to_vec(&view))
}

/// Finds out what the device rounds correctly, by trying. (What WGSL promises is
/// little, and what drivers do is more, but differs.)
pub(super) fn probe(device: &Device) -> Result<Arithmetic, GpuError> {
    let mut b = Builder::new(Rules::NONE);
    let [x, y, z] = [0, 1, 2].map(|k| b.input(Input::PerPixel(k, Side::I), Interval::ENTIRE));
    let (fma, quotient, root) = (b.fma(x, y, z), b.div(x, y), b.sqrt(x));
    let tape = b.finish(&[fma, quotient, root]);

    // Significands of all sorts and moderate exponents, by a linear congruence.
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f32::from_bits((state >> 9) | 0x3f80_0000) * [0.25, 1.0, 8.0][(state >> 30) as usize % 3]
    };
    let xs: Vec<f32> = (0..ELEMENTS).map(|_| random()).collect();
    let ys: Vec<f32> = (0..ELEMENTS).map(|_| random()).collect();
    // What the product's rounding leaves is all that is left of these sums.
    let zs: Vec<f32> = xs.iter().zip(&ys).map(|(x, y)| -(x * y)).collect();

    let dialect = Dialect { precision: Precision::Fast, arithmetic: Arithmetic::IEEE };
    let results = evaluate(device, &tape, dialect, &[&xs, &ys, &zs])?;
    let right = |result: usize, prim: Prim| {
        (0..ELEMENTS).all(|k| prim.eval([xs[k], ys[k], zs[k], 0.0]) == results[result][k])
    };
    Ok(Arithmetic {
        fused: right(0, Prim::Fma),
        quotients: right(1, Prim::Div),
        roots: right(2, Prim::Sqrt),
    })
}

/// Enough that a unit that is off by one in a thousand is found out.
const ELEMENTS: usize = 1 << 14;
