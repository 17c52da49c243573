//! One scalar image in the form that filters read: padded rows, or a constant.
//!
//! A window loop asks for the sample at `x + dx` for every `dx` of its window,
//! several `x` at a time. So that it never has to ask whether that sample
//! exists, every row carries [`Layout::pad`] further samples on both sides and
//! slack after the right one. Rows themselves are not padded above and below:
//! whether a whole row of the window exists is one test per row, not per pixel.
//!
//! What stands in the padding is the maker's choice ([`Edge`]): planes that
//! weights look at repeat the edge, so that the padding holds no value that
//! the image does not; planes that are summed hold zero there, so that a tap
//! outside the image adds nothing.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// Samples that a lane group may read past the last padded sample of a row.
const SLACK: usize = 64;
/// Rows start at multiples of this many samples (one 512-bit register).
const ALIGN: usize = 16;

/// Where the samples of a plane stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Layout {
    width: usize,
    height: usize,
    pad: usize,
    stride: usize,
}

impl Layout {
    /// The layout of a `width` x `height` image for windows of radius `pad` at least:
    /// the padding is rounded up, so that column 0 is at a multiple of 16 samples, where
    /// rows start.
    pub fn new(width: usize, height: usize, pad: usize) -> Self {
        let pad = pad.next_multiple_of(ALIGN);
        let stride = (width + 2 * pad + SLACK).next_multiple_of(ALIGN);
        Self { width, height, pad, stride }
    }

    /// The layout of so many rows of the same image.
    #[must_use]
    pub fn with_height(self, height: usize) -> Self {
        Self { height, ..self }
    }

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Padding columns on the left, and on the right before the slack: the
    /// greatest window radius that these planes serve, a multiple of 16.
    pub fn pad(&self) -> usize {
        self.pad
    }

    /// Samples from one row's start to the next's: a multiple of 16 and at least
    /// `width + 2 * pad + 64`.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Pixels of the image, padding not counted.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Samples of a padded plane.
    pub fn samples(&self) -> usize {
        self.stride * self.height
    }

    /// Position of pixel (x, y) in a padded plane.
    pub fn index(&self, x: usize, y: usize) -> usize {
        y * self.stride + self.pad + x
    }
}

/// Samples that begin where a cache line does: as rows are whole lines, and padding too,
/// vectors of pixels side by side lie in one line each, and are read in two thirds of the
/// time that they take in two.
#[derive(Debug)]
pub struct Lines {
    data: Vec<f32>,
    start: usize,
    length: usize,
}

impl Lines {
    /// So many zeros.
    pub fn zeros(length: usize) -> Self {
        let data = vec![0.0; length + ALIGN - 1];
        let start = data.as_ptr().align_offset(ALIGN * size_of::<f32>());
        Self { data, start, length }
    }

    /// So many samples, which `fill` adds: nothing is written twice. Whatever it leaves out is
    /// zero.
    fn filled(length: usize, fill: impl FnOnce(&mut Vec<f32>)) -> Self {
        let mut data: Vec<f32> = Vec::with_capacity(length + ALIGN - 1);
        let start = data.as_ptr().align_offset(ALIGN * size_of::<f32>());
        data.resize(start, 0.0);
        fill(&mut data);
        debug_assert!(data.len() <= start + length, "no more than there is room for");
        data.resize(start + length, 0.0);
        Self { data, start, length }
    }
}

impl Deref for Lines {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.data[self.start..][..self.length]
    }
}

impl DerefMut for Lines {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.data[self.start..][..self.length]
    }
}

impl PartialEq for Lines {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

/// What stands in the padding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// The row's first and last sample, repeated.
    Replicate,
    /// Zero.
    Zero,
}

/// A padded plane. Cloning shares the samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    layout: Layout,
    data: Arc<Lines>,
}

impl Samples {
    /// Pads an image given row by row without padding.
    ///
    /// # Panics
    /// If `pixels` does not hold exactly `layout.pixels()` values.
    pub fn new(layout: Layout, pixels: &[f32], edge: Edge) -> Self {
        assert_eq!(pixels.len(), layout.pixels(), "one value per pixel of the layout");
        let data = Lines::filled(layout.samples(), |data| {
            for row in pixels.chunks_exact(layout.width.max(1)) {
                let (before, after) = match edge {
                    Edge::Replicate => (row[0], row[row.len() - 1]),
                    Edge::Zero => (0.0, 0.0),
                };
                data.extend(std::iter::repeat_n(before, layout.pad));
                data.extend_from_slice(row);
                let right = layout.stride - layout.pad - row.len();
                data.extend(std::iter::repeat_n(after, right));
            }
        });
        Self { layout, data: Arc::new(data) }
    }

    /// Where the samples stand.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// All samples, padding included.
    pub fn as_slice(&self) -> &[f32] {
        &self.data
    }

    /// Row `y` with its padding: `stride` samples, pixel x at `pad + x`.
    pub fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.layout.stride..(y + 1) * self.layout.stride]
    }

    /// The pixels of row `y`, without the padding.
    pub fn pixels(&self, y: usize) -> &[f32] {
        &self.row(y)[self.layout.pad..self.layout.pad + self.layout.width]
    }

    /// The sample of pixel (x, y).
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.data[self.layout.index(x, y)]
    }
}

/// A plane that weights look at.
#[derive(Clone, Debug, PartialEq)]
pub enum Plane {
    /// Every pixel has this value: nothing is stored, and whatever depends on it
    /// alone can be computed before the first pixel.
    Constant(f32),
    /// One sample per pixel, the edges repeated into the padding.
    Samples(Samples),
}

impl Plane {
    /// Makes the plane of an image given row by row without padding; an image of
    /// one value becomes [`Plane::Constant`] (-0 and +0 count as one value).
    ///
    /// # Panics
    /// If `pixels` does not hold exactly `layout.pixels()` values.
    pub fn new(layout: Layout, pixels: &[f32]) -> Self {
        assert_eq!(pixels.len(), layout.pixels(), "one value per pixel of the layout");
        match constant(pixels) {
            Some(value) => Self::Constant(value),
            None => Self::Samples(Samples::new(layout, pixels, Edge::Replicate)),
        }
    }

    /// The value at pixel (x, y).
    pub fn at(&self, x: usize, y: usize) -> f32 {
        match self {
            Self::Constant(value) => *value,
            Self::Samples(samples) => samples.at(x, y),
        }
    }

    /// The padded row `y`; `None` for a constant, which has no rows.
    pub fn row(&self, y: usize) -> Option<&[f32]> {
        match self {
            Self::Constant(_) => None,
            Self::Samples(samples) => Some(samples.row(y)),
        }
    }
}

/// The one value of all pixels, if there is but one (-0 and +0 count as one); zero of none.
pub(super) fn constant(pixels: &[f32]) -> Option<f32> {
    match pixels.split_first() {
        None => Some(0.0),
        // Adding zero turns -0 into +0.
        Some((&first, rest)) => rest.iter().all(|&x| x == first).then_some(first + 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_leave_room_for_the_window_and_for_a_lane_group_beyond_it() {
        for (width, pad) in [(1, 0), (1, 10), (15, 1), (336, 10), (1920, 32)] {
            let layout = Layout::new(width, 2, pad);
            assert_eq!(layout.stride() % 16, 0);
            assert!(layout.stride() >= width + 2 * pad + 64);
        }
    }

    #[test]
    fn pixels_begin_with_a_cache_line() {
        for (width, pad) in [(1, 0), (17, 1), (40, 16), (336, 17)] {
            let layout = Layout::new(width, 2, pad);
            let samples = Samples::new(layout, &vec![0.5; 2 * width], Edge::Replicate);
            for y in 0..2 {
                assert_eq!(samples.pixels(y).as_ptr().align_offset(64), 0, "{width}, {pad}");
            }
        }
    }

    #[test]
    fn edges_are_repeated_or_zero_all_the_way_to_the_end_of_the_row() {
        let layout = Layout::new(2, 2, 3);
        let pad = layout.pad();
        let pixels = [1.0, 2.0, 3.0, 4.0];
        let replicated = Samples::new(layout, &pixels, Edge::Replicate);
        assert_eq!(replicated.row(1)[..pad], vec![3.0; pad]);
        assert_eq!(replicated.row(1)[pad..pad + 3], [3.0, 4.0, 4.0]);
        assert_eq!(replicated.row(1)[layout.stride() - 1], 4.0);
        let zero = Samples::new(layout, &pixels, Edge::Zero);
        assert_eq!(zero.row(0)[..pad], vec![0.0; pad]);
        assert_eq!(zero.row(0)[pad..pad + 3], [1.0, 2.0, 0.0]);
        assert_eq!(zero.row(0)[layout.stride() - 1], 0.0);
        assert_eq!(zero.pixels(1), &[3.0, 4.0]);
        assert_eq!(replicated.at(1, 0), 2.0);
    }

    #[test]
    fn an_image_of_one_value_is_a_constant_whatever_its_zeros_signs() {
        let layout = Layout::new(2, 1, 1);
        assert_eq!(Plane::new(layout, &[0.5, 0.5]), Plane::Constant(0.5));
        let Plane::Constant(zero) = Plane::new(layout, &[-0.0, 0.0]) else { panic!("constant") };
        assert!(zero == 0.0 && zero.is_sign_positive());
        assert!(Plane::new(layout, &[0.5, 0.25]).row(0).is_some());
        // A NaN equals nothing, itself included: never a constant.
        assert!(matches!(Plane::new(layout, &[f32::NAN; 2]), Plane::Samples(_)));
    }
}
