//! Running a compiled plan: tiles up, bands through, tiles back.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::pack::{Inputs, needs};
use super::slots::{Lease, Needs, SLOTS, TIMESTAMPS};
use super::tiles::{Tile, tiles};
use super::{GpuError, Opened};
use crate::backend::shader::{Loads, Shader};
use crate::backend::{BackendError, Executable, Filtered, Rect, holds, inside};
use crate::plan::WindowPlan;
use crate::scene::Scene;

/// Primitives per submission: a tenth of a second at 4e11 per second.
const WORK: u64 = 40_000_000_000;

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

/// A tile that the device has been given.
struct Pending<'a> {
    /// Which of the region's rectangles it is a part of.
    part: usize,
    tile: Tile,
    needs: Needs,
    lease: Lease<'a>,
    submission: wgpu::SubmissionIndex,
}

impl Executable for ShaderCode {
    fn run(&self, scene: &Scene, region: &[Rect]) -> Result<Vec<Filtered>, BackendError> {
        holds(self.plan.facts(), scene)?;
        inside(scene, region)?;
        let inputs = Inputs::of(scene, &self.shader, self.loads)?;
        let tiles = self.tiles(scene, region)?;
        let weights = self.weights();
        let mut starts = Vec::with_capacity(region.len());
        let mut pixels = 0;
        for rect in region {
            starts.push(pixels);
            pixels += rect.pixels();
        }
        let nothing = Filtered { pixels: vec![[0.0; 3]; pixels], kept: vec![0] };
        let mut filtered = vec![nothing; weights];
        let mut pending: VecDeque<Pending<'_>> = VecDeque::new();
        for (part, tile) in tiles {
            let needs = needs(&self.shader, self.loads, weights, &tile);
            let lease = loop {
                let may_wait = pending.is_empty();
                match self.gpu.slots.lease(&self.gpu.device, needs, may_wait)? {
                    Some(lease) => break lease,
                    None => {
                        let first = pending.pop_front().expect("or waiting would be allowed");
                        self.collect(first, region, &starts, &mut filtered)?;
                    }
                }
            };
            pending.push_back(self.submit(&inputs, part, tile, needs, lease)?);
        }
        for last in pending {
            self.collect(last, region, &starts, &mut filtered)?;
        }
        Ok(filtered)
    }
}

impl ShaderCode {
    fn weights(&self) -> usize {
        self.plan.pair().results().len()
    }

    /// The tiles of all rectangles, each with the rectangle's number.
    fn tiles(&self, scene: &Scene, region: &[Rect]) -> Result<Vec<(usize, Tile)>, GpuError> {
        let limits = &self.gpu.device.limits;
        let available = self.gpu.max_memory / SLOTS;
        let needs = |tile: &Tile| needs(&self.shader, self.loads, self.weights(), tile);
        let fits = |tile: &Tile| {
            let needs = needs(tile);
            let binding = limits.max_storage_buffer_binding_size;
            needs.total() <= available
                && needs.upload().max(needs.back()) <= limits.max_buffer_size
                && needs.near.max(needs.own).max(needs.result) <= binding
        };
        let reach = self.plan.support().reach() as usize;
        let mut all = Vec::new();
        for (k, &rect) in region.iter().enumerate() {
            let tiles = tiles(rect, scene.layout(), reach, &fits);
            let tiles = tiles.map_err(|_| self.too_little_memory(scene, rect))?;
            all.extend(tiles.into_iter().map(|tile| (k, tile)));
        }
        Ok(all)
    }

    /// What the pixel that needs most of all would need.
    fn too_little_memory(&self, scene: &Scene, rect: Rect) -> GpuError {
        let extent = 2 * self.plan.support().reach() as usize + 1;
        let layout = scene.layout();
        let (width, height) = (extent.min(layout.width()), extent.min(layout.height()));
        let rect = Rect { width: 1, height: 1, ..rect };
        let tile = Tile { rect, region: Rect { x: 0, y: 0, width, height } };
        let needs = needs(&self.shader, self.loads, self.weights(), &tile);
        GpuError::TooLittleMemory { available: self.gpu.max_memory, needed: SLOTS * needs.total() }
    }

    /// Packs a tile and gives it to the device.
    fn submit<'a>(
        &self,
        inputs: &Inputs<'_>,
        part: usize,
        tile: Tile,
        needs: Needs,
        lease: Lease<'a>,
    ) -> Result<Pending<'a>, GpuError> {
        let device = &self.gpu.device;
        let slot = lease.slot();
        {
            let range = slot.upload.slice(..needs.upload());
            let view = range.get_mapped_range_mut();
            let mut view = view.map_err(|error| device.lost(&error.to_string()))?;
            inputs.write(&tile, needs, view.slice(..));
        }
        slot.upload.unmap();

        let bands = self.bands(&tile);
        let params = device.filled(
            "parameters",
            bytemuck::cast_slice(&params(&tile, &bands)),
            wgpu::BufferUsages::UNIFORM,
        )?;
        let commands = device.checked("commands", 0, |device| {
            self.record(device, slot, needs, &tile, &bands, &params)
        })?;
        let mut submission = None;
        for band in commands {
            submission = Some(device.queue.submit([band]));
        }
        slot.back.slice(..needs.back()).map_async(wgpu::MapMode::Read, |_| {});
        slot.upload.slice(..).map_async(wgpu::MapMode::Write, |_| {});
        let submission = submission.expect("a tile has a band");
        Ok(Pending { part, tile, needs, lease, submission })
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
        slot: &super::slots::Slot,
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
            let timestamps =
                slot.clock.as_ref().map(|(queries, _)| wgpu::ComputePassTimestampWrites {
                    query_set: queries,
                    beginning_of_pass_write_index: (k == 0).then_some(0),
                    end_of_pass_write_index: (k == last).then_some(1),
                });
            // A pass that writes no timestamp may not say that it does.
            let timestamps = timestamps.filter(|_| k == 0 || k == last);
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: None,
                timestamp_writes: timestamps,
            });
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            let [columns, lines] = self.loads.workgroup();
            let groups = (tile.rect.width as u32).div_ceil(columns);
            pass.dispatch_workgroups(groups, (rows as u32).div_ceil(lines), 1);
            drop(pass);
            if k == last {
                encoder.copy_buffer_to_buffer(&slot.result, 0, &slot.back, 0, needs.result);
                if let Some((queries, resolved)) = &slot.clock {
                    let start = needs.timestamps_start();
                    encoder.resolve_query_set(queries, 0..2, resolved, 0);
                    encoder.copy_buffer_to_buffer(resolved, 0, &slot.back, start, TIMESTAMPS);
                }
            }
            encoder.finish()
        };
        bands.iter().enumerate().map(band).collect()
    }

    /// Waits for a tile and puts its pixels where they belong.
    fn collect(
        &self,
        pending: Pending<'_>,
        region: &[Rect],
        starts: &[usize],
        filtered: &mut [Filtered],
    ) -> Result<(), GpuError> {
        let Pending { part, tile, needs, lease, submission } = pending;
        let device = &self.gpu.device;
        device.wait(submission)?;
        let slot = lease.slot();
        {
            let view = slot.back.slice(..needs.back()).get_mapped_range();
            let view = view.map_err(|error| device.lost(&error.to_string()))?;
            let pixels: &[[f32; 4]] = bytemuck::cast_slice(&view[..needs.result as usize]);
            let weights = filtered.len();
            let whole = region[part];
            for (y, row) in pixels.chunks_exact(tile.rect.width * weights).enumerate() {
                let (x, y) = (tile.rect.x - whole.x, tile.rect.y - whole.y + y);
                let start = starts[part] + y * whole.width + x;
                for (k, filtered) in filtered.iter_mut().enumerate() {
                    let places = &mut filtered.pixels[start..start + tile.rect.width];
                    let row = row.iter().skip(k).step_by(weights);
                    for (place, &[r, g, b, kept]) in places.iter_mut().zip(row) {
                        *place = [r, g, b];
                        filtered.kept[0] += usize::from(kept != 0.0);
                    }
                }
            }
            if let Some(tick) = device.tick {
                let bytes = &view[needs.timestamps_start() as usize..][..TIMESTAMPS as usize];
                let ticks: &[u64] = bytemuck::cast_slice(bytes);
                let nanoseconds = ticks[1].saturating_sub(ticks[0]) as f64 * f64::from(tick);
                self.gpu.busy.fetch_add(nanoseconds as u64, Ordering::Relaxed);
            }
        }
        slot.back.unmap();
        lease.give_back();
        Ok(())
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
