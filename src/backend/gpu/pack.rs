//! A scene's planes in the order in which kernels read them.

use rayon::prelude::*;

use super::slots::Needs;
use super::tiles::Tile;
use crate::backend::shader::{COLOR, Loads, QUAD, Shader};
use crate::backend::{BackendError, Rect};
use crate::expr::PlaneId;
use crate::scene::Scene;
use crate::scene::plane::{Plane, Samples};

/// One channel of a tile.
enum Channel<'a> {
    Samples(&'a Samples),
    /// A plan for several scenes reads planes that are constant in this one.
    Constant(f32),
}

impl Channel<'_> {
    fn of(scene: &Scene, plane: PlaneId) -> Result<Channel<'_>, BackendError> {
        match scene.plane(plane) {
            None => Err(BackendError::NotLoaded(plane)),
            Some(Plane::Samples(samples)) => Ok(Channel::Samples(samples)),
            Some(Plane::Constant(x)) => Ok(Channel::Constant(*x)),
        }
    }

    /// Writes part of a row, every `step`-th number of `out`.
    fn copy(&self, x: usize, y: usize, out: &mut [f32], step: usize) {
        let out = out.iter_mut().step_by(step);
        match self {
            Channel::Samples(samples) => {
                out.zip(&samples.pixels(y)[x..]).for_each(|(out, sample)| *out = *sample);
            }
            Channel::Constant(value) => out.for_each(|out| *out = *value),
        }
    }
}

/// What a program's kernels read of a scene.
pub(super) struct Features<'a>(Vec<Channel<'a>>);

impl<'a> Features<'a> {
    pub(super) fn of(scene: &'a Scene, planes: &[PlaneId]) -> Result<Self, BackendError> {
        let channels = planes.iter().map(|&plane| Channel::of(scene, plane));
        Ok(Self(channels.collect::<Result<_, _>>()?))
    }

    /// Writes those of a region.
    pub(super) fn write(&self, region: Rect, out: wgpu::WriteOnly<'_, [u8]>) {
        planar(&self.0, region, out);
    }
}

/// What a plan's kernel reads of a scene.
pub(super) struct Inputs<'a> {
    loads: Loads,
    near: Vec<Channel<'a>>,
    own: Vec<Channel<'a>>,
}

impl<'a> Inputs<'a> {
    pub(super) fn of(
        scene: &'a Scene,
        shader: &Shader,
        loads: Loads,
    ) -> Result<Self, BackendError> {
        let color = scene.color().each_ref().map(Channel::Samples);
        let planes = shader.near.iter().map(|&plane| Channel::of(scene, plane));
        let near = color.into_iter().map(Ok).chain(planes).collect::<Result<_, _>>()?;
        let own = shader.own.iter().map(|&plane| Channel::of(scene, plane));
        Ok(Self { loads, near, own: own.collect::<Result<_, _>>()? })
    }

    /// Writes a tile: `near` of its region, then `own` of its pixels.
    pub(super) fn write(&self, tile: &Tile, needs: Needs, out: wgpu::WriteOnly<'_, [u8]>) {
        let (near, rest) = out.split_at(needs.near as usize);
        let own = rest.into_slice((needs.own_start() - needs.near) as usize..);
        match self.loads {
            Loads::Packed | Loads::Tiled => interleave(&self.near, tile.region, near),
            Loads::Planar => planar(&self.near, tile.region, near),
        }
        interleave(&self.own, tile.rect, own);
    }
}

/// One channel after the other.
fn planar(channels: &[Channel<'_>], rect: Rect, mut out: wgpu::WriteOnly<'_, [u8]>) {
    let plane = rect.pixels() * size_of::<f32>();
    for channel in channels {
        let part = out.split_off(..plane).expect("a plane per channel");
        interleave_by(std::slice::from_ref(channel), 1, rect, part);
    }
}

/// The channels of each pixel side by side, in whole vectors.
fn interleave(channels: &[Channel<'_>], rect: Rect, out: wgpu::WriteOnly<'_, [u8]>) {
    interleave_by(channels, channels.len().next_multiple_of(QUAD), rect, out);
}

fn interleave_by(
    channels: &[Channel<'_>],
    step: usize,
    rect: Rect,
    mut out: wgpu::WriteOnly<'_, [u8]>,
) {
    if channels.is_empty() {
        return;
    }
    // Mapped memory can only be written, by one thread and in order; so rows are
    // packed by all threads beside it.
    let numbers = rect.width * step;
    let mut packed = vec![0.0; numbers * rect.height.min(ROWS)];
    for first in (0..rect.height).step_by(ROWS) {
        let packed = &mut packed[..numbers * ROWS.min(rect.height - first)];
        packed.par_chunks_exact_mut(numbers).enumerate().for_each(|(row, packed)| {
            for (k, channel) in channels.iter().enumerate() {
                channel.copy(rect.x, rect.y + first + row, &mut packed[k..], step);
            }
        });
        let bytes = bytemuck::cast_slice(packed);
        out.split_off(..bytes.len()).expect("there is room for every row").copy_from_slice(bytes);
    }
}

/// Rows that are packed before they are copied: few enough to stay in the cache.
const ROWS: usize = 16;

/// What a tile needs, for a plan of some weights.
pub(super) fn needs(shader: &Shader, loads: Loads, weights: usize, tile: &Tile) -> Needs {
    let quad = (QUAD * size_of::<f32>()) as u64;
    let (region, rect) = (tile.region.pixels() as u64, tile.rect.pixels() as u64);
    let near = match loads {
        Loads::Planar => region * ((COLOR + shader.near.len()) * size_of::<f32>()) as u64,
        Loads::Packed | Loads::Tiled => region * shader.near_quads() as u64 * quad,
    };
    Needs {
        near,
        own: rect * shader.own_quads() as u64 * quad,
        result: rect * weights as u64 * quad,
        kept: 0,
    }
}
