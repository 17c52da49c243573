//! Transposes of linear kernels: every pixel hands back what it was made of.
//!
//! They are computed for whole planes: gradients are of small images.

use super::program::{Engine, ProgramCode, Strip};
use crate::filter::{Grid, Window};
use crate::plan::{Linear, TransposeKernel};

/// A plane without padding.
struct Image {
    width: usize,
    pixels: Vec<f32>,
}

impl Image {
    fn zeros(width: usize, height: usize) -> Self {
        Self { width, pixels: vec![0.0; width * height] }
    }

    fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    fn row(&self, y: usize) -> &[f32] {
        &self.pixels[y * self.width..][..self.width]
    }

    fn row_mut(&mut self, y: usize) -> &mut [f32] {
        &mut self.pixels[y * self.width..][..self.width]
    }
}

impl<E: Engine> ProgramCode<E> {
    /// Computes a whole plane, of kernels that were computed for the whole image.
    pub(super) fn transpose(&self, kernel: &TransposeKernel, strip: &mut Strip<'_>) {
        let layout = strip.layout(kernel.grid);
        let mut result = Image::zeros(layout.width(), layout.height());
        for (k, &plane) in kernel.reads.iter().enumerate() {
            let band = &strip.bands[self.place(plane)];
            let (width, height) = (band.layout.width(), band.layout.height());
            let pixels = (0..height).flat_map(|y| band.pixels(y)).copied().collect();
            let given = Image { width, pixels };
            match &kernel.of {
                Linear::Shifts(shifts) => shift(&given, shifts[k], &mut result),
                Linear::Resample => match kernel.grid {
                    Grid::Full => halved(&given, &mut result),
                    Grid::Half => doubled(&given, &mut result),
                },
                Linear::Box(window) => averaged(&given, *window, &mut result),
            }
        }
        for y in 0..layout.height() {
            strip.bands[self.place(kernel.writes)].write(y, result.row(y));
        }
    }
}

/// Of reading so many columns to the right and rows below, where the edge is repeated.
fn shift(given: &Image, [dx, dy]: [i8; 2], result: &mut Image) {
    let (width, height) = (given.width, given.height());
    let beside = usize::from(dx.unsigned_abs()).min(width);
    for y in 0..height {
        let target = y.saturating_add_signed(dy.into()).min(height - 1);
        let (row, sums) = (given.row(y), result.row_mut(target));
        // What looks beyond the edge looks at the edge.
        let (inside, target, beyond, edge) = match dx >= 0 {
            true => (&row[..width - beside], beside, &row[width - beside..], width - 1),
            false => (&row[beside..], 0, &row[..beside], 0),
        };
        sums[target..].iter_mut().zip(inside).for_each(|(sum, x)| *sum += x);
        sums[edge] += beyond.iter().sum::<f32>();
    }
}

/// Of means of two by two pixels, the last of which may be single.
fn halved(given: &Image, result: &mut Image) {
    let (width, height) = (result.width, result.height());
    for y in 0..height {
        // A single row, or column, counts as both.
        let twice =
            |at: usize, length: usize| if at + 1 == length && length % 2 == 1 { 2.0 } else { 1.0 };
        let share = 0.25 * twice(y, height);
        let sums = result.row_mut(y);
        for (pair, x) in sums.chunks_mut(2).zip(given.row(y / 2)) {
            pair.iter_mut().for_each(|sum| *sum += share * x);
        }
        if width % 2 == 1 {
            sums[width - 1] += share * given.row(y / 2)[width / 2];
        }
    }
}

/// Of interpolating between pixels of half the resolution.
fn doubled(given: &Image, result: &mut Image) {
    let (width, columns) = (given.width, result.width);
    // With zeros before the first pixel and after the last.
    let mut row = vec![0.0; 2 * columns + 2];
    let mut narrow = vec![0.0; columns];
    for y in 0..given.height() {
        row.fill(0.0);
        row[1..=width].copy_from_slice(given.row(y));
        for (sum, around) in narrow.iter_mut().zip(row.windows(4).step_by(2)) {
            *sum = 0.75 * (around[1] + around[2]) + 0.25 * (around[0] + around[3]);
        }
        // What would be interpolated with a pixel beyond the edge is the edge's.
        narrow[0] += 0.25 * row[1];
        if width % 2 == 0 {
            narrow[columns - 1] += 0.25 * row[width];
        }
        let other = if y % 2 == 0 { (y / 2).saturating_sub(1) } else { y / 2 + 1 };
        for (target, share) in [(y / 2, 0.75), (other.min(result.height() - 1), 0.25)] {
            result.row_mut(target).iter_mut().zip(&narrow).for_each(|(sum, x)| *sum += share * x);
        }
    }
}

/// Of means over those pixels of a window that lie in the image.
fn averaged(given: &Image, window: Window, result: &mut Image) {
    let (reach, step) = (window.reach() as usize, window.dilation as usize);
    let inside = |at: usize, end: usize| {
        let taps = (0..window.diameter()).map(move |k| (at + k * step).checked_sub(reach));
        taps.flatten().filter(move |&at| at < end)
    };
    let (width, height) = (given.width, given.height());
    let columns: Vec<f32> = (0..width).map(|x| inside(x, width).count() as f32).collect();
    let mut rows = Image::zeros(width, height);
    for y in 0..height {
        let count = inside(y, height).count() as f32;
        let shares: Vec<f32> = given
            .row(y)
            .iter()
            .zip(&columns)
            .map(|(value, columns)| value / (columns * count))
            .collect();
        let sums = &mut rows.pixels[y * width..][..width];
        for (x, sum) in sums.iter_mut().enumerate() {
            *sum = inside(x, width).map(|x| shares[x]).sum();
        }
    }
    for y in 0..height {
        let sums = &mut result.pixels[y * width..][..width];
        for y in inside(y, height) {
            sums.iter_mut().zip(rows.row(y)).for_each(|(sum, row)| *sum += row);
        }
    }
}
