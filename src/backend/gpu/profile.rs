//! What the kernels of a program take, each on its own; and how fast a device copies, to hold
//! that against.

use std::sync::PoisonError;
use std::time::Duration;

use super::device::Device;
use super::program::{ProgramCode, SceneProgram, enough};
use super::run::Kernels;
use super::slots::Slot;
use super::tiles::Tile;
use super::{Gpu, GpuError};
use crate::backend::shader::program::KernelShader;
use crate::backend::{BackendError, Rect};
use crate::plan::Program;
use crate::scene::Scene;

/// Bytes that are copied to see how fast that is: more than caches hold.
const COPIED: u64 = 96 << 20;

/// How often; the fastest counts.
const COPIES: usize = 5;

/// Workgroups that copy.
const COPY_GROUPS: u32 = 4096;

const COPY: &str = "
@group(0) @binding(0) var<storage, read> from_here: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> to_there: array<vec4<f32>>;

@compute @workgroup_size(256)
fn copy(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let count = arrayLength(&from_here);
    for (var k = id.x; k < count; k += 256u * groups.x) {
        to_there[k] = from_here[k];
    }
}
";

/// What a kernel took.
#[derive(Clone, Debug)]
pub struct KernelTime {
    /// What it is called in the shader.
    pub name: String,
    /// Columns and rows of the pixels that it computed.
    pub extent: [usize; 2],
    /// How long it took.
    pub time: Duration,
    /// About how many operations that were.
    pub operations: f64,
    /// Bytes of the planes that it read and wrote, each plane once.
    pub bytes: f64,
}

impl Gpu {
    /// Filters a whole image in one piece, and returns what each kernel took, in order; `None`
    /// if the device has no clock.
    ///
    /// # Errors
    /// If the scene lacks what the program reads, or the device fails or has too little memory.
    pub fn profile(
        &self,
        program: &Program,
        scene: &Scene,
    ) -> Result<Option<Vec<KernelTime>>, BackendError> {
        let Some(tick) = self.0.device.tick else { return Ok(None) };
        let code = ProgramCode::new(self.0.clone(), program)?;
        let over = code.over(scene)?;
        let tile = over.tile(Rect::whole(scene), scene.layout());
        let spans = self.spans(&over, code.kernels().len(), &tile)?;
        let kernels = code.kernels().iter().zip(spans).enumerate();
        let times = kernels.map(|(k, (KernelShader { name, work, traffic, .. }, ticks))| {
            let extent = over.extent(k, &tile);
            let pixels = (extent[0] * extent[1]) as f64;
            KernelTime {
                name: name.clone(),
                extent,
                time: elapsed(ticks, tick),
                operations: *work as f64 * pixels,
                bytes: traffic * pixels * size_of::<f32>() as f64,
            }
        });
        Ok(Some(times.collect()))
    }

    /// Bytes per second that the device reads and writes where it only copies; `None` if it has
    /// no clock.
    ///
    /// # Errors
    /// If the device fails or has too little memory.
    pub fn copy_bandwidth(&self) -> Result<Option<f64>, GpuError> {
        let device = &self.0.device;
        let Some(tick) = device.tick else { return Ok(None) };
        let pipeline = device.pipeline(COPY, "copy", None)?;
        let usage = wgpu::BufferUsages::STORAGE;
        let from = device.buffer("a copy", COPIED, usage, false)?;
        let to = device.buffer("a copy", COPIED, usage, false)?;
        let group = device.checked("commands", 0, |device| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: from.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 1, resource: to.as_entire_binding() },
                ],
            })
        })?;
        let copy = |_, pass: &mut wgpu::ComputePass<'_>| {
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(COPY_GROUPS, 1, 1);
        };
        let spans = clocked(device, COPIES, |_| {}, copy)?;
        let fastest = spans.into_iter().map(|ticks| elapsed(ticks, tick)).min();
        let seconds = fastest.expect("it copied").as_secs_f64();
        Ok(Some(2.0 * COPIED as f64 / seconds))
    }

    /// The ticks that each kernel took over a tile.
    fn spans(
        &self,
        over: &SceneProgram<'_>,
        kernels: usize,
        tile: &Tile,
    ) -> Result<Vec<u64>, GpuError> {
        let device = &self.0.device;
        let needs = over.needs(tile);
        let slot = Slot::new(device, needs)?;
        slot.fill(device, needs, |out| over.write(tile, needs, out))?;
        let params = over.params(tile)?;
        let (bytes, _) = over.shared(tile);
        let mut planes = self.0.planes.lock().unwrap_or_else(PoisonError::into_inner);
        let buffer = enough(&mut planes, device, bytes)?;
        let group = device.checked("commands", 0, |device| {
            over.bindings(device, &slot, needs, &params, (buffer, bytes))
        })?;
        let load = |encoder: &mut wgpu::CommandEncoder| {
            encoder.copy_buffer_to_buffer(&slot.upload, 0, &slot.near, 0, needs.near);
            encoder.clear_buffer(&slot.kept, 0, None);
        };
        clocked(device, kernels, load, |k, pass| {
            pass.set_bind_group(0, &group, &[]);
            over.dispatch(pass, k, tile);
        })
    }
}

fn elapsed(ticks: u64, tick: f32) -> Duration {
    Duration::from_nanos((ticks as f64 * f64::from(tick)) as u64)
}

/// Runs passes, one after the other, behind what prepares them. Returns the ticks that each
/// took.
fn clocked(
    device: &Device,
    passes: usize,
    prepare: impl FnOnce(&mut wgpu::CommandEncoder),
    run: impl Fn(usize, &mut wgpu::ComputePass<'_>),
) -> Result<Vec<u64>, GpuError> {
    let count = 2 * passes as u32;
    let bytes = u64::from(count) * size_of::<u64>() as u64;
    let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
    let resolved = device.buffer("a clock", bytes, usage, false)?;
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let back = device.buffer("a clock", bytes, usage, false)?;
    let commands = device.checked("commands", 0, |device| {
        let queries = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        prepare(&mut encoder);
        for k in 0..passes {
            let first = 2 * k as u32;
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: None,
                timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                    query_set: &queries,
                    beginning_of_pass_write_index: Some(first),
                    end_of_pass_write_index: Some(first + 1),
                }),
            });
            run(k, &mut pass);
        }
        encoder.resolve_query_set(&queries, 0..count, &resolved, 0);
        encoder.copy_buffer_to_buffer(&resolved, 0, &back, 0, bytes);
        encoder.finish()
    })?;
    let submission = device.queue.submit([commands]);
    back.slice(..).map_async(wgpu::MapMode::Read, |_| {});
    device.wait(submission)?;
    let view = back.slice(..).get_mapped_range();
    let view = view.map_err(|error| device.lost(&error.to_string()))?;
    let ticks: &[u64] = bytemuck::cast_slice(&view[..bytes as usize]);
    Ok(ticks.chunks_exact(2).map(|ticks| ticks[1].saturating_sub(ticks[0])).collect())
}
