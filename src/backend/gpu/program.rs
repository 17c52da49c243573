//! Programs as pipelines, one per kernel.
//!
//! A tile's kernels run one after the other over its whole region, in one buffer of planes
//! that all tiles share: the device works on one tile at a time. So what a tile gives is
//! handed over while no other tile's commands come between ([`Opened::planes`]).

use std::ops::Range;
use std::sync::{Arc, PoisonError};

use rayon::prelude::*;

use super::pack::Features;
use super::run::{Kernels, WORK, run};
use super::slots::{Needs, Slot};
use super::tiles::Tile;
use super::{Device, GpuError, Opened};
use crate::backend::shader::QUAD;
use crate::backend::shader::program::{KernelShader, ProgramShader, WORKGROUP};
use crate::backend::{BackendError, Executable, Filtered, Rect, Watch, holds, inside};
use crate::filter::Grid;
use crate::plan::Program;
use crate::scene::plane::Layout;
use crate::scene::{ColorScale, Scene};

/// Regions begin at even pixels, so that pixels of half the resolution are those of the image.
const STEP: usize = 2;

/// A program as pipelines.
pub(super) struct ProgramCode {
    gpu: Arc<Opened>,
    program: Program,
    shader: ProgramShader,
    pipelines: Vec<wgpu::ComputePipeline>,
    taps: wgpu::Buffer,
}

impl ProgramCode {
    pub(super) fn new(gpu: Arc<Opened>, program: &Program) -> Result<Self, GpuError> {
        let shader = ProgramShader::new(program, gpu.style.dialect);
        let pipelines = shader.kernels.par_iter();
        let pipelines =
            pipelines.map(|kernel| gpu.pipeline(&shader.module(kernel), &kernel.name, true));
        let pipelines = pipelines.collect::<Result<_, _>>()?;
        let usage = wgpu::BufferUsages::STORAGE;
        let contents = bytemuck::cast_slice(&shader.taps);
        let taps = gpu.device.filled("the table of offsets", contents, usage)?;
        Ok(Self { gpu, program: program.clone(), shader, pipelines, taps })
    }

    /// The program over a scene.
    pub(super) fn over<'a>(&'a self, scene: &'a Scene) -> Result<SceneProgram<'a>, BackendError> {
        let features = Features::of(scene, &self.shader.features)?;
        let exposure = scene.normalization().exposure;
        Ok(SceneProgram { code: self, features, exposure, first_row: scene.top() })
    }

    /// Its kernels.
    pub(super) fn kernels(&self) -> &[KernelShader] {
        &self.shader.kernels
    }
}

impl Executable for ProgramCode {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        holds(&self.program.facts, scene)?;
        inside(scene, region)?;
        if scene.normalization().color_scale != ColorScale::Linear {
            return Err(BackendError::ColorScale);
        }
        run(&self.gpu, &self.over(scene)?, scene, region, watch)
    }
}

/// A program and what it reads of a scene.
pub(super) struct SceneProgram<'a> {
    code: &'a ProgramCode,
    features: Features<'a>,
    exposure: f32,
    /// Where the scene's first row stands, if it is a part of an image.
    first_row: usize,
}

/// The buffer between kernels, made anew if it has fewer bytes than that.
pub(super) fn enough<'a>(
    planes: &'a mut Option<wgpu::Buffer>,
    device: &Device,
    bytes: u64,
) -> Result<&'a wgpu::Buffer, GpuError> {
    // What still runs keeps the old one until it ends.
    let old = planes.take().filter(|buffer| buffer.size() >= bytes);
    let usage = wgpu::BufferUsages::STORAGE;
    let buffer = match old {
        Some(buffer) => buffer,
        None => device.buffer("planes between kernels", bytes, usage, false)?,
    };
    Ok(planes.insert(buffer))
}

/// Columns and rows of a grid over a rectangle.
fn on_grid(rect: Rect, grid: Grid) -> [usize; 2] {
    [rect.width, rect.height].map(|length| grid.along(length))
}

impl Kernels for SceneProgram<'_> {
    fn results(&self) -> usize {
        self.code.shader.results
    }

    fn stages(&self) -> usize {
        self.code.shader.stages
    }

    fn tile(&self, rect: Rect, layout: Layout) -> Tile {
        Tile::of(rect, layout, self.code.shader.halo, STEP)
    }

    fn needs(&self, tile: &Tile) -> Needs {
        let ProgramShader { features, stages, results, .. } = &self.code.shader;
        let number = size_of::<f32>();
        Needs {
            near: (tile.region.pixels() * features.len() * number) as u64,
            own: 0,
            result: (tile.rect.pixels() * results * QUAD * number) as u64,
            kept: (stages * size_of::<u32>()) as u64,
        }
    }

    fn shared(&self, tile: &Tile) -> (u64, bool) {
        let shader = &self.code.shader;
        let planes = [(shader.full, Grid::Full), (shader.half, Grid::Half)];
        let numbers = planes.map(|(planes, grid)| {
            planes as u64 * on_grid(tile.region, grid).map(|n| n as u64).iter().product::<u64>()
        });
        let bytes = numbers.iter().sum::<u64>() * size_of::<f32>() as u64;
        let longest = shader.kernels.iter().map(|kernel| kernel.work).max().unwrap_or(0);
        (bytes, longest * tile.region.pixels() as u64 <= WORK)
    }

    fn write(&self, tile: &Tile, needs: Needs, mut out: wgpu::WriteOnly<'_, [u8]>) {
        let near = out.split_off(..needs.near as usize).expect("room for all features");
        self.features.write(tile.region, near);
    }

    fn submit(
        &self,
        slot: &Slot,
        needs: Needs,
        tile: &Tile,
    ) -> Result<wgpu::SubmissionIndex, GpuError> {
        let gpu = &self.code.gpu;
        let device = &gpu.device;
        let params = self.params(tile)?;
        let (bytes, _) = self.shared(tile);
        let mut planes = gpu.planes.lock().unwrap_or_else(PoisonError::into_inner);
        let buffer = enough(&mut planes, device, bytes)?;
        let commands = device.checked("commands", 0, |device| {
            self.record(device, slot, needs, tile, &params, (buffer, bytes))
        })?;
        let mut submission = None;
        for part in commands {
            submission = Some(device.queue.submit([part]));
        }
        Ok(submission.expect("a program has a kernel"))
    }
}

impl SceneProgram<'_> {
    /// `Params` of the kernels.
    pub(super) fn params(&self, tile: &Tile) -> Result<wgpu::Buffer, GpuError> {
        let Tile { rect, region } = *tile;
        let pairs = [
            on_grid(region, Grid::Full),
            on_grid(region, Grid::Half),
            [region.x, self.first_row + region.y],
            [rect.x - region.x, rect.y - region.y],
            [rect.width, rect.height],
        ];
        let mut params = [0; 12];
        for (place, number) in params.iter_mut().zip(pairs.into_iter().flatten()) {
            *place = u32::try_from(number).expect("images have fewer columns and rows");
        }
        params[10] = self.exposure.to_bits();
        let usage = wgpu::BufferUsages::UNIFORM;
        self.code.gpu.device.filled("parameters", bytemuck::cast_slice(&params), usage)
    }

    /// The commands for a tile, in parts of so much work as a watchdog lets pass.
    fn record(
        &self,
        device: &wgpu::Device,
        slot: &Slot,
        needs: Needs,
        tile: &Tile,
        params: &wgpu::Buffer,
        (planes, bytes): (&wgpu::Buffer, u64),
    ) -> Vec<wgpu::CommandBuffer> {
        let group = self.bindings(device, slot, needs, params, (planes, bytes));
        let parts = self.parts(tile);
        let last = parts.len() - 1;
        let part = |(k, kernels): (usize, Range<usize>)| {
            let mut encoder = device.create_command_encoder(&Default::default());
            if k == 0 {
                encoder.copy_buffer_to_buffer(&slot.upload, 0, &slot.near, 0, needs.near);
                encoder.clear_buffer(&slot.kept, 0, None);
            }
            let mut pass = slot.pass(&mut encoder, k == 0, k == last);
            pass.set_bind_group(0, &group, &[]);
            kernels.for_each(|k| self.dispatch(&mut pass, k, tile));
            drop(pass);
            if k == last {
                slot.read_back(&mut encoder, needs);
            }
            encoder.finish()
        };
        parts.into_iter().enumerate().map(part).collect()
    }

    /// What the kernels of a tile read and write.
    pub(super) fn bindings(
        &self,
        device: &wgpu::Device,
        slot: &Slot,
        needs: Needs,
        params: &wgpu::Buffer,
        (planes, bytes): (&wgpu::Buffer, u64),
    ) -> wgpu::BindGroup {
        let code = self.code;
        let entry = |binding, buffer, size: u64| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer,
                offset: 0,
                size: wgpu::BufferSize::new(size.max(LEAST)),
            }),
        };
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &code.gpu.layout.group,
            entries: &[
                entry(0, params, params.size()),
                entry(1, &slot.near, needs.near),
                entry(2, &code.taps, code.taps.size()),
                entry(3, planes, bytes),
                entry(4, &slot.kept, needs.kept),
                entry(5, &slot.result, needs.result),
            ],
        })
    }

    /// Columns and rows of the pixels that a kernel computes.
    pub(super) fn extent(&self, k: usize, tile: &Tile) -> [usize; 2] {
        match self.code.shader.kernels[k].grid {
            Some(grid) => on_grid(tile.region, grid),
            None => [tile.rect.width, tile.rect.height],
        }
    }

    /// Runs a kernel over a tile.
    pub(super) fn dispatch(&self, pass: &mut wgpu::ComputePass<'_>, k: usize, tile: &Tile) {
        pass.set_pipeline(&self.code.pipelines[k]);
        let extent = self.extent(k, tile).into_iter().zip(WORKGROUP);
        let groups: Vec<u32> =
            extent.map(|(pixels, size)| (pixels as u32).div_ceil(size)).collect();
        pass.dispatch_workgroups(groups[0], groups[1], 1);
    }

    /// The kernels that are submitted together.
    fn parts(&self, tile: &Tile) -> Vec<Range<usize>> {
        let pixels = tile.region.pixels() as u64;
        let kernels = &self.code.shader.kernels;
        let mut parts = Vec::new();
        let (mut start, mut work) = (0, 0);
        for (k, kernel) in kernels.iter().enumerate() {
            let more = kernel.work * pixels;
            if work + more > WORK && k > start {
                parts.push(start..k);
                (start, work) = (k, 0);
            }
            work += more;
        }
        parts.push(start..kernels.len());
        parts
    }
}

/// Bytes of the smallest binding: a buffer is never empty.
const LEAST: u64 = 16;

/// The bindings that the kernels of all programs share.
pub(super) struct ProgramLayout {
    group: wgpu::BindGroupLayout,
    pub(super) pipeline: wgpu::PipelineLayout,
}

impl ProgramLayout {
    pub(super) fn new(device: &Device) -> Result<Self, GpuError> {
        use wgpu::BufferBindingType as Kind;
        let storage = |read_only| Kind::Storage { read_only };
        let kinds = [
            Kind::Uniform,
            storage(true),
            storage(true),
            storage(false),
            storage(false),
            storage(false),
        ];
        let entry = |(binding, ty)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let entries: Vec<_> = (0..).zip(kinds).map(entry).collect();
        device.checked("the layout of kernels", 0, |device| {
            let group = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: None,
                entries: &entries,
            });
            let pipeline = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: &[Some(&group)],
                ..wgpu::PipelineLayoutDescriptor::default()
            });
            Self { group, pipeline }
        })
    }
}
