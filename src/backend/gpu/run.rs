//! Running kernels on a region: tiles up, dispatches, tiles back.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;

use super::slots::{Lease, Needs, SLOTS, Slot, TIMESTAMPS};
use super::tiles::{Tile, tiles};
use super::{GpuError, Opened};
use crate::backend::{BackendError, Filtered, Rect, Watch, tell};
use crate::scene::Scene;
use crate::scene::plane::Layout;

/// Primitives per submission: a tenth of a second at 4e11 per second.
pub(super) const WORK: u64 = 40_000_000_000;

/// Kernels that filter a tile of a scene.
pub(super) trait Kernels: Sync {
    /// How many results there are per pixel.
    fn results(&self) -> usize;

    /// How many stages count the pixels that kept what was to be averaged.
    fn stages(&self) -> usize;

    /// The tile of a rectangle: what is read for it.
    fn tile(&self, rect: Rect, layout: Layout) -> Tile;

    /// What a tile needs.
    fn needs(&self, tile: &Tile) -> Needs;

    /// Bytes that all tiles share, one after the other; and whether no dispatch takes too long.
    fn shared(&self, tile: &Tile) -> (u64, bool);

    /// Writes what a tile reads.
    fn write(&self, tile: &Tile, needs: Needs, out: wgpu::WriteOnly<'_, [u8]>);

    /// Gives the device a tile whose planes have been written.
    fn submit(
        &self,
        slot: &Slot,
        needs: Needs,
        tile: &Tile,
    ) -> Result<wgpu::SubmissionIndex, GpuError>;
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

/// Filters rectangles of a scene.
pub(super) fn run(
    gpu: &Opened,
    kernels: &impl Kernels,
    scene: &Scene,
    region: &[Rect],
    watch: &Watch<'_>,
) -> Result<Vec<Filtered>, BackendError> {
    let tiles = all_tiles(gpu, kernels, scene, region)?;
    let mut starts = Vec::with_capacity(region.len());
    let mut pixels = 0;
    for rect in region {
        starts.push(pixels);
        pixels += rect.pixels();
    }
    let nothing = Filtered { pixels: vec![[0.0; 3]; pixels], kept: vec![0; kernels.stages()] };
    let mut filtered = vec![nothing; kernels.results()];
    let mut rows = Rows { of: region.iter().map(|rect| rect.height).sum(), pixels, done: 0 };
    let mut pending: VecDeque<Pending<'_>> = VecDeque::new();
    for (part, tile) in tiles {
        let needs = kernels.needs(&tile);
        let lease = loop {
            let may_wait = pending.is_empty();
            match gpu.slots.lease(&gpu.device, needs, may_wait)? {
                Some(lease) => break lease,
                None => {
                    let first = pending.pop_front().expect("or waiting would be allowed");
                    let pixels = first.tile.rect.pixels();
                    collect(gpu, first, region, &starts, &mut filtered)?;
                    tell(watch, rows.after(pixels))?;
                }
            }
        };
        pending.push_back(submit(gpu, kernels, part, tile, needs, lease)?);
    }
    for last in pending {
        let pixels = last.tile.rect.pixels();
        collect(gpu, last, region, &starts, &mut filtered)?;
        tell(watch, rows.after(pixels))?;
    }
    Ok(filtered)
}

/// Rows of a region that are done, as far as that can be said of tiles that are narrower.
struct Rows {
    of: usize,
    pixels: usize,
    /// Pixels that are done.
    done: usize,
}

impl Rows {
    /// How many more there are once so many pixels more are done.
    fn after(&mut self, pixels: usize) -> usize {
        let before = self.of * self.done / self.pixels;
        self.done += pixels;
        self.of * self.done / self.pixels - before
    }
}

/// The tiles of all rectangles, each with the rectangle's number.
fn all_tiles(
    gpu: &Opened,
    kernels: &impl Kernels,
    scene: &Scene,
    region: &[Rect],
) -> Result<Vec<(usize, Tile)>, GpuError> {
    let limits = &gpu.device.limits;
    let binding = limits.max_storage_buffer_binding_size;
    let total = |tile: &Tile| SLOTS * kernels.needs(tile).total() + kernels.shared(tile).0;
    let fits = |tile: &Tile| {
        let needs = kernels.needs(tile);
        let (shared, is_short) = kernels.shared(tile);
        is_short
            && total(tile) <= gpu.max_memory
            && needs.upload().max(needs.back()).max(shared) <= limits.max_buffer_size
            && needs.near.max(needs.own).max(needs.result).max(shared) <= binding
    };
    let mut all = Vec::new();
    for (k, &rect) in region.iter().enumerate() {
        let tiles = tiles(rect, |rect| kernels.tile(rect, scene.layout()), &fits);
        let tiles = tiles.map_err(|tile| GpuError::TooLittleMemory {
            available: gpu.max_memory,
            needed: total(&tile).max(most(kernels, rect, scene)),
        })?;
        all.extend(tiles.into_iter().map(|tile| (k, tile)));
    }
    Ok(all)
}

/// What the pixel of a rectangle that needs most of all needs: the one in its middle.
fn most(kernels: &impl Kernels, rect: Rect, scene: &Scene) -> u64 {
    let (x, y) = (rect.x + rect.width / 2, rect.y + rect.height / 2);
    let tile = kernels.tile(Rect { x, y, width: 1, height: 1 }, scene.layout());
    SLOTS * kernels.needs(&tile).total() + kernels.shared(&tile).0
}

/// Packs a tile and gives it to the device.
fn submit<'a>(
    gpu: &Opened,
    kernels: &impl Kernels,
    part: usize,
    tile: Tile,
    needs: Needs,
    lease: Lease<'a>,
) -> Result<Pending<'a>, GpuError> {
    let slot = lease.slot();
    slot.fill(&gpu.device, needs, |out| kernels.write(&tile, needs, out))?;
    let submission = kernels.submit(slot, needs, &tile)?;
    slot.back.slice(..needs.back()).map_async(wgpu::MapMode::Read, |_| {});
    slot.upload.slice(..).map_async(wgpu::MapMode::Write, |_| {});
    Ok(Pending { part, tile, needs, lease, submission })
}

/// Waits for a tile and puts its pixels where they belong.
fn collect(
    gpu: &Opened,
    pending: Pending<'_>,
    region: &[Rect],
    starts: &[usize],
    filtered: &mut [Filtered],
) -> Result<(), GpuError> {
    let Pending { part, tile, needs, lease, submission } = pending;
    let device = &gpu.device;
    device.wait(submission)?;
    let slot = lease.slot();
    {
        let view = slot.back.slice(..needs.back()).get_mapped_range();
        let view = view.map_err(|error| device.lost(&error.to_string()))?;
        let pixels: &[[f32; 4]] = bytemuck::cast_slice(&view[..needs.result as usize]);
        let results = filtered.len();
        let whole = region[part];
        for (y, row) in pixels.chunks_exact(tile.rect.width * results).enumerate() {
            let (x, y) = (tile.rect.x - whole.x, tile.rect.y - whole.y + y);
            let start = starts[part] + y * whole.width + x;
            for (k, filtered) in filtered.iter_mut().enumerate() {
                let places = &mut filtered.pixels[start..start + tile.rect.width];
                let row = row.iter().skip(k).step_by(results);
                for (place, &[r, g, b, kept]) in places.iter_mut().zip(row) {
                    *place = [r, g, b];
                    filtered.kept[0] += usize::from(kept != 0.0);
                }
            }
        }
        let counts = &view[needs.kept_start() as usize..][..needs.kept as usize];
        let counts: &[u32] = bytemuck::cast_slice(counts);
        for filtered in filtered.iter_mut() {
            filtered.kept.iter_mut().zip(counts).for_each(|(kept, &more)| *kept += more as usize);
        }
        if let Some(tick) = device.tick {
            let bytes = &view[needs.timestamps_start() as usize..][..TIMESTAMPS as usize];
            let ticks: &[u64] = bytemuck::cast_slice(bytes);
            let nanoseconds = ticks[1].saturating_sub(ticks[0]) as f64 * f64::from(tick);
            gpu.busy.fetch_add(nanoseconds as u64, Ordering::Relaxed);
        }
    }
    slot.back.unmap();
    lease.give_back();
    Ok(())
}
