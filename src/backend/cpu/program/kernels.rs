//! What each kind of kernel does with some rows of a strip.

use std::borrow::Cow;
use std::ops::Range;

use super::super::rows::{Add, Double, Halve, Mean, Trust};
use super::super::sums::{Frame, Owed, Sums};
use super::{Engine, MapBlock, Mapper, ProgramCode, RESULTS, Scratch, Strip};
use crate::backend::{BackendError, Rect};
use crate::expr::Feature;
use crate::expr::feature::PlaneId;
use crate::expr::symbol::{Source, StagePlane};
use crate::filter::Grid;
use crate::plan::{BoxKernel, GatherKernel, MapKernel, PairLoop, Read, ResampleKernel, SumKernel};
use crate::scene::plane::Plane;

impl<E: Engine> ProgramCode<E> {
    pub(super) fn map(
        &self,
        kernel: &MapKernel,
        (code, uniform): (&E::Map, &[f32]),
        rows: Range<usize>,
        strip: &mut Strip<'_>,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        let layout = strip.layout(kernel.grid);
        let (width, stride, pad) = (layout.width(), layout.stride(), layout.pad());
        strip.make_ones(kernel.grid, rows.len());
        // Planes that are one number everywhere have no rows.
        let flat: Vec<Option<Vec<f32>>> = kernel
            .reads
            .iter()
            .map(|read| match read.source {
                Source::Feature(id) => match strip.scene.plane(id) {
                    Some(Plane::Constant(x)) => Some(vec![*x; stride * rows.len()]),
                    Some(Plane::Samples(_)) | None => None,
                },
                Source::Stage(_) => None,
            })
            .collect();
        // Rows whose surroundings lie inside of the image are computed in one go; what
        // stands beside the first pixel of all, or the last, is in no row.
        let shifts = || kernel.reads.iter().map(|read| read.shift);
        let beside = usize::from(shifts().any(|[dx, _]| dx != 0));
        let [above, below] = [-1, 1].map(|sign| {
            let far = shifts().map(|[_, dy]| (sign * i32::from(dy)).max(0)).max();
            far.unwrap_or(0) as usize
        });
        let middle = above + beside..layout.height().saturating_sub(below + beside);
        let results = width.next_multiple_of(code.step());
        let most = (RESULTS / (kernel.writes.len() * results)).max(1);
        let mut y = rows.start;
        while y < rows.end {
            let count = match middle.contains(&y) {
                true => (middle.end.min(rows.end) - y).min(most),
                false => 1,
            };
            // A single row begins with its first pixel, several with their padding: a plane
            // may end with the last one's.
            let skipped = if count == 1 { pad } else { 0 };
            let inputs = kernel.reads.iter().zip(&flat).map(|(read, flat)| {
                let Read { source, shift: [dx, dy] } = *read;
                let row = y.saturating_add_signed(dy.into()).min(layout.height() - 1);
                let beside = |start: usize| (start + skipped).wrapping_add_signed(dx.into());
                match (source, flat) {
                    (_, Some(flat)) => flat.as_slice(),
                    (Source::Feature(id), None) => {
                        let Some(Plane::Samples(samples)) = strip.scene.plane(id) else {
                            unreachable!("run() asked for every plane, and flat ones are apart")
                        };
                        &samples.as_slice()[beside(row * stride)..]
                    }
                    (Source::Stage(plane), None) => {
                        let band = &strip.bands[self.place(plane)];
                        &band.looked_at()[beside(band.start(row))..]
                    }
                }
            });
            let ones = &strip.ones(kernel.grid)[skipped..];
            let inputs: Vec<&[f32]> = std::iter::once(ones).chain(inputs).collect();
            let outputs = &mut scratch.outputs;
            outputs.clear();
            outputs.resize(count * kernel.writes.len() * results, 0.0);
            let block = MapBlock { layout, rows: count, pad: pad - skipped };
            code.rows(&inputs, uniform, block, &mut scratch.maps, outputs)?;
            let mut outputs = outputs.chunks_exact(results);
            for row in y..y + count {
                for (&plane, pixels) in kernel.writes.iter().zip(&mut outputs) {
                    strip.bands[self.place(plane)].write(row, &pixels[..width]);
                }
            }
            y += count;
        }
        Ok(())
    }

    pub(super) fn gather(
        &self,
        kernel: &GatherKernel,
        (code, sums, per_tap): (&E::Gather, &Sums, &[f32]),
        rows: Range<usize>,
        strip: &mut Strip<'_>,
        owed: &mut Owed,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        let averaged = kernel.channels.iter().copied();
        let variance = kernel.variance.map(|(source, ..)| source);
        let (frame, rect) =
            self.frame(&kernel.pairs, kernel.grid, averaged, variance, &rows, strip)?;
        let width = rect.width;
        let shape = sums.add(code, &frame, per_tap, rect, Some(owed), &mut scratch.gathers)?;

        let results = sums.results();
        let made = scratch.gathers.sums();
        let count = kernel.channels.len();
        let step = kernel.grid.step();
        let mut means = vec![0.0f32; width];
        let mut trusted = vec![false; width];
        for y in rows.clone() {
            let result = |number: usize| {
                let start = ((y - rows.start) * results + number) * shape.stride + shape.first;
                &made[start..start + width]
            };
            let total = result(count);
            let magnitude = if kernel.signed { result(count + 1) } else { total };
            let trust = Trust { totals: total, magnitudes: magnitude, trusted: &mut trusted };
            pulp::Arch::new().dispatch(trust);
            let Rect { x, y: top, width, height } = strip.rect;
            if (top..top + height).contains(&(y * step)) {
                let columns = x.div_ceil(step)..(x + width).div_ceil(step);
                let untrusted = trusted[columns].iter().filter(|&&trusted| !trusted);
                let count = untrusted.count();
                kernel.stages.iter().for_each(|&stage| strip.kept[stage] += count);
            }
            let planes = kernel.channels.iter().zip(&kernel.writes).enumerate();
            let planes = planes.map(|(k, (&own, &(plane, range)))| (k, own, plane, range, false));
            let variance = kernel.variance.iter().map(|&(own, plane, range)| {
                (count + 1 + usize::from(kernel.signed), own, plane, range, true)
            });
            for (number, own, plane, range, squared) in planes.chain(variance) {
                let own = strip.bands[self.place(own)].pixels(y);
                let (sums, totals, trusted, means) =
                    (result(number), total, &trusted, &mut means[..]);
                let mean = Mean { sums, totals, squared, own, trusted, range, means };
                pulp::Arch::new().dispatch(mean);
                strip.bands[self.place(plane)].write(y, means);
            }
            if let Some(inverse) = kernel.inverse {
                for ((inverse, total), trusted) in means.iter_mut().zip(total).zip(&trusted) {
                    *inverse = if *trusted { 1.0 / total } else { 0.0 };
                }
                strip.bands[self.place(inverse)].write(y, &means);
            }
        }
        Ok(())
    }

    pub(super) fn sum(
        &self,
        kernel: &SumKernel,
        (code, sums, per_tap): (&E::Gather, &Sums, &[f32]),
        rows: Range<usize>,
        strip: &mut Strip<'_>,
        owed: &mut Owed,
        scratch: &mut Scratch<E>,
    ) -> Result<(), BackendError> {
        let nothing = std::iter::empty();
        let (frame, rect) = self.frame(&kernel.pairs, kernel.grid, nothing, None, &rows, strip)?;
        let width = rect.width;
        let shape = sums.add(code, &frame, per_tap, rect, Some(owed), &mut scratch.gathers)?;
        let made = scratch.gathers.sums().chunks_exact(shape.stride);
        let ways = rows.flat_map(|y| kernel.writes.iter().map(move |&plane| (y, plane)));
        for ((y, plane), sums) in ways.zip(made) {
            strip.bands[self.place(plane)].write(y, &sums[shape.first..][..width]);
        }
        Ok(())
    }

    /// What a loop over pairs reads for some rows, and where those stand in it: the rows that
    /// its window reaches are an image of their own.
    fn frame<'f>(
        &self,
        pairs: &PairLoop,
        grid: Grid,
        averaged: impl Iterator<Item = StagePlane>,
        variance: Option<StagePlane>,
        rows: &Range<usize>,
        strip: &'f mut Strip<'_>,
    ) -> Result<(Frame<'f>, Rect), BackendError> {
        let whole = strip.layout(grid);
        let (width, stride) = (whole.width(), whole.stride());
        let top = rows.start.saturating_sub(pairs.reach);
        let layout = whole.with_height((rows.end + pairs.reach).min(whole.height()) - top);
        strip.make_ones(grid, layout.height());
        let strip: &'f Strip<'_> = strip;
        let window = top * stride..(top + layout.height()) * stride;
        let plane = |id: PlaneId| match strip.scene.plane(id) {
            Some(Plane::Samples(samples)) => {
                Ok((id, Cow::Borrowed(&samples.as_slice()[window.clone()])))
            }
            Some(Plane::Constant(x)) => Ok((id, Cow::Owned(vec![*x; layout.samples()]))),
            None => Err(BackendError::NotLoaded(id)),
        };
        let planes = pairs.planes().into_iter().map(plane).collect::<Result<_, _>>()?;
        let of_mean = |plane: StagePlane| {
            let band = &strip.bands[self.place(plane)];
            &band.averaged()[band.start(top)..]
        };
        let mut channels: Vec<&[f32]> = averaged.map(of_mean).collect();
        channels.push(strip.ones(grid));
        channels.extend(variance.map(of_mean));
        let signal = |&plane: &StagePlane| {
            let band = &strip.bands[self.place(plane)];
            &band.looked_at()[band.start(top)..]
        };
        let frame = Frame {
            layout,
            channels,
            planes,
            signals: pairs.reads.iter().map(signal).collect(),
            per_pixel: Vec::new(),
            per_tap: Vec::new(),
        };
        Ok((frame, Rect { x: 0, y: rows.start - top, width, height: rows.len() }))
    }

    pub(super) fn mean(&self, kernel: &BoxKernel, rows: Range<usize>, strip: &mut Strip<'_>) {
        let layout = strip.layout(kernel.grid);
        let (width, height, pad) = (layout.width(), layout.height(), layout.pad());
        let (reach, step) = (kernel.window.reach() as usize, kernel.window.dilation as usize);
        let inside = |at: usize, end: usize| {
            let taps =
                (0..kernel.window.diameter()).map(move |k| (at + k * step).checked_sub(reach));
            taps.flatten().filter(move |&at| at < end)
        };
        let columns: Vec<f32> = (0..width).map(|x| inside(x, width).count() as f32).collect();
        let (mut sums, mut means) = (vec![0.0; width + 2 * reach], vec![0.0; width]);
        for y in rows {
            let count = inside(y, height).count() as f32;
            for (&channel, &(plane, range)) in kernel.channels.iter().zip(&kernel.writes) {
                let band = &strip.bands[self.place(channel)];
                sums.fill(0.0);
                for y in inside(y, height) {
                    let row = &band.averaged()[band.start(y) + pad - reach..];
                    pulp::Arch::new().dispatch(Add { to: &mut sums, from: row });
                }
                means.fill(0.0);
                for first in (0..kernel.window.diameter()).map(|k| k * step) {
                    pulp::Arch::new().dispatch(Add { to: &mut means, from: &sums[first..] });
                }
                for (mean, columns) in means.iter_mut().zip(&columns) {
                    *mean = (*mean / (columns * count)).clamp(range.lo, range.hi);
                }
                strip.bands[self.place(plane)].write(y, &means);
            }
        }
    }

    pub(super) fn resample(
        &self,
        kernel: &ResampleKernel,
        rows: Range<usize>,
        strip: &mut Strip<'_>,
    ) {
        let layout = strip.layout(kernel.grid);
        let source = strip.layout(match kernel.grid {
            Grid::Full => Grid::Half,
            Grid::Half => Grid::Full,
        });
        let last = source.height() - 1;
        let mut pixels = vec![0.0f32; layout.width()];
        let mut between = vec![0.0f32; source.width() + 2];
        for y in rows {
            let row = |y: usize| match kernel.reads {
                Source::Stage(plane) => {
                    let band = &strip.bands[self.place(plane)];
                    Some(&band.looked_at()[band.start(y.min(last)) + source.pad() - 1..])
                }
                Source::Feature(id) => match strip.scene.plane(id) {
                    Some(Plane::Samples(samples)) => {
                        Some(&samples.as_slice()[source.index(0, y.min(last)) - 1..])
                    }
                    Some(Plane::Constant(_)) | None => None,
                },
            };
            match kernel.grid {
                Grid::Half => match kernel.reads {
                    // The middle of two pixels, also where there is one.
                    Source::Feature(PlaneId { feature: Feature::Pixel, component, .. }) => {
                        let y = strip.scene.top() / 2 + y;
                        for (x, pixel) in pixels.iter_mut().enumerate() {
                            *pixel = 2.0 * [x, y][usize::from(component)] as f32 + 0.5;
                        }
                    }
                    Source::Feature(id)
                        if matches!(strip.scene.plane(id), Some(Plane::Constant(_))) =>
                    {
                        let Some(&Plane::Constant(x)) = strip.scene.plane(id) else {
                            unreachable!()
                        };
                        pixels.fill(x);
                    }
                    Source::Feature(_) | Source::Stage(_) => {
                        let [upper, lower] = [2 * y, 2 * y + 1].map(|y| row(y).expect("samples"));
                        let (upper, lower, pixels) = (&upper[1..], &lower[1..], &mut pixels);
                        pulp::Arch::new().dispatch(Halve { upper, lower, pixels });
                    }
                },
                Grid::Full => {
                    // Pixels of half the resolution whose middles lie around this one's.
                    let nearest = y / 2;
                    let other = if y % 2 == 0 { nearest.saturating_sub(1) } else { nearest + 1 };
                    let [nearest, other] = [nearest, other].map(|y| row(y).expect("samples"));
                    let (between, pixels) = (&mut between, &mut pixels);
                    pulp::Arch::new().dispatch(Double { nearest, other, between, pixels });
                }
            }
            strip.bands[self.place(kernel.writes)].write(y, &pixels);
        }
    }
}
