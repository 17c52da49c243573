//! A plan of one window as a pipeline.

use std::sync::Arc;

use super::pack::{Inputs, needs};
use super::run::{Kernels, WORK, run};
use super::slots::{Needs, Slot};
use super::tiles::Tile;
use super::{GpuError, Opened};
use crate::backend::shader::{Loads, Shader};
use crate::backend::{BackendError, Executable, Filtered, Rect, Watch, holds, inside};
use crate::plan::WindowPlan;
use crate::scene::Scene;
use crate::scene::plane::Layout;

/// A kernel's parameters stand this far apart in their buffer.
const PARAMS_STRIDE: usize = 256;

/// A plan as a pipeline.
pub(super) struct ShaderCode {
    pub(super) gpu: Arc<Opened>,
    pub(super) plan: WindowPlan,
    pub(super) loads: Loads,
    pub(super) shader: Shader,
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) taps: wgpu::Buffer,
}

impl Executable for ShaderCode {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        holds(self.plan.facts(), scene)?;
        inside(scene, region)?;
        let inputs = Inputs::of(scene, &self.shader, self.loads)?;
        run(&self.gpu, &ScenePlan { code: self, inputs }, scene, region, watch)
    }
}

/// A plan and what it reads of a scene.
struct ScenePlan<'a> {
    code: &'a ShaderCode,
    inputs: Inputs<'a>,
}

impl Kernels for ScenePlan<'_> {
    fn results(&self) -> usize {
        self.code.weights()
    }

    fn stages(&self) -> usize {
        1
    }

    fn tile(&self, rect: Rect, layout: Layout) -> Tile {
        Tile::of(rect, layout, self.code.plan.support().reach() as usize, 1)
    }

    fn needs(&self, tile: &Tile) -> Needs {
        needs(&self.code.shader, self.code.loads, self.code.weights(), tile)
    }

    /// Dispatches are cut into bands.
    fn shared(&self, _: &Tile) -> (u64, bool) {
        (0, true)
    }

    fn write(&self, tile: &Tile, needs: Needs, out: wgpu::WriteOnly<'_, [u8]>) {
        self.inputs.write(tile, needs, out);
    }

    fn submit(
        &self,
        slot: &Slot,
        needs: Needs,
        tile: &Tile,
    ) -> Result<wgpu::SubmissionIndex, GpuError> {
        self.code.submit(slot, needs, tile)
    }
}

impl ShaderCode {
    fn weights(&self) -> usize {
        self.plan.pair().results().len()
    }

    /// Gives the device a tile, band by band.
    fn submit(
        &self,
        slot: &Slot,
        needs: Needs,
        tile: &Tile,
    ) -> Result<wgpu::SubmissionIndex, GpuError> {
        let device = &self.gpu.device;
        let bands = self.bands(tile);
        let params = device.filled(
            "parameters",
            bytemuck::cast_slice(&params(tile, &bands)),
            wgpu::BufferUsages::UNIFORM,
        )?;
        let commands = device.checked("commands", 0, |device| {
            self.record(device, slot, needs, tile, &bands, &params)
        })?;
        let mut submission = None;
        for band in commands {
            submission = Some(device.queue.submit([band]));
        }
        Ok(submission.expect("a tile has a band"))
    }

    /// Rows of a tile that are dispatched together: where they begin, how many.
    fn bands(&self, tile: &Tile) -> Vec<(usize, usize)> {
        let primitives = self.plan.pair().instrs().len().max(1) as u64;
        let row = tile.rect.width as u64 * self.plan.support().taps() as u64 * primitives;
        let group = self.loads.workgroup()[1] as usize;
        let rows = usize::try_from(WORK / row).unwrap_or(usize::MAX).min(tile.rect.height);
        let rows = rows.next_multiple_of(group).max(group);
        let starts = (0..tile.rect.height).step_by(rows);
        starts.map(|start| (start, rows.min(tile.rect.height - start))).collect()
    }

    /// The commands for a tile, one buffer per band.
    fn record(
        &self,
        device: &wgpu::Device,
        slot: &Slot,
        needs: Needs,
        tile: &Tile,
        bands: &[(usize, usize)],
        params: &wgpu::Buffer,
    ) -> Vec<wgpu::CommandBuffer> {
        let layout = self.pipeline.get_bind_group_layout(0);
        let buffer = |binding, buffer, offset, size| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer,
                offset,
                size: wgpu::BufferSize::new(size),
            }),
        };
        let last = bands.len() - 1;
        let band = |(k, &(_, rows)): (usize, &(usize, usize))| {
            let start = (k * PARAMS_STRIDE) as u64;
            let mut entries = vec![
                buffer(0, params, start, size_of::<Params>() as u64),
                buffer(1, &slot.near, 0, needs.near),
                buffer(4, &slot.result, 0, needs.result),
            ];
            if needs.own > 0 {
                entries.push(buffer(2, &slot.own, 0, needs.own));
            }
            if self.shader.tap_quads > 0 {
                entries.push(buffer(3, &self.taps, 0, self.taps.size()));
            }
            let description =
                wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries };
            let group = device.create_bind_group(&description);
            let mut encoder = device.create_command_encoder(&Default::default());
            if k == 0 {
                encoder.copy_buffer_to_buffer(&slot.upload, 0, &slot.near, 0, needs.near);
                if needs.own > 0 {
                    let start = needs.own_start();
                    encoder.copy_buffer_to_buffer(&slot.upload, start, &slot.own, 0, needs.own);
                }
            }
            let mut pass = slot.pass(&mut encoder, k == 0, k == last);
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            let [columns, lines] = self.loads.workgroup();
            let groups = (tile.rect.width as u32).div_ceil(columns);
            pass.dispatch_workgroups(groups, (rows as u32).div_ceil(lines), 1);
            drop(pass);
            if k == last {
                slot.read_back(&mut encoder, needs);
            }
            encoder.finish()
        };
        bands.iter().enumerate().map(band).collect()
    }
}

/// `Params` of the kernel.
type Params = [i32; 8];

/// The parameters of every band, a stride apart.
fn params(tile: &Tile, bands: &[(usize, usize)]) -> Vec<i32> {
    let Tile { rect, region } = tile;
    let mut params = vec![0; bands.len() * PARAMS_STRIDE / size_of::<i32>()];
    let places = params.chunks_exact_mut(PARAMS_STRIDE / size_of::<i32>());
    for (&(start, rows), place) in bands.iter().zip(places) {
        let band: Params = [
            region.width as i32,
            region.height as i32,
            (rect.x - region.x) as i32,
            (rect.y - region.y + start) as i32,
            rect.width as i32,
            rows as i32,
            (start * rect.width) as i32,
            0,
        ];
        place[..band.len()].copy_from_slice(&band);
    }
    params
}
