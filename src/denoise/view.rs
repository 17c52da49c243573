//! Images in other people's memory, where they lie.
//!
//! A [`View`] is read and a [`ViewMut`] written, sample by sample: 32 or 16 bits wide,
//! interleaved (R, G, B of a pixel side by side), planar (all of R, then all of G) or at any
//! distances. Nothing is copied to make one.

use std::fmt;

use bytemuck::{Pod, cast_slice, cast_slice_mut};
use half::f16;

/// What a sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SampleType {
    /// 32 bits.
    F32,
    /// 16 bits. What is beyond ±65504 is written as that.
    F16,
}

impl SampleType {
    /// Bytes of a sample.
    pub fn size(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
        }
    }
}

/// The numbers that images can be made of.
pub trait Sample: Pod {
    /// As a value.
    const TYPE: SampleType;
}

impl Sample for f32 {
    const TYPE: SampleType = SampleType::F32;
}

impl Sample for f16 {
    const TYPE: SampleType = SampleType::F16;
}

/// Where samples lie: distances in bytes, of which those between samples may be negative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strides {
    /// From the first byte to the first sample of the first pixel.
    pub offset: usize,
    /// From a pixel to the one on its right.
    pub pixel: isize,
    /// From a pixel to the one below.
    pub row: isize,
    /// From a component to the next of the same pixel.
    pub component: isize,
}

/// How an image lies, before its size is known.
#[derive(Clone, Copy, Debug)]
enum Order {
    /// Pixel by pixel; of so many components, or of as many as there is room for.
    Interleaved(Option<usize>),
    /// Component by component.
    Planar,
    /// Anyhow.
    Strided(Strides),
}

/// Why an image in memory cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ViewError {
    /// It does not have the samples that its size asks for.
    #[error("it has {found} samples, but {expected} are {width} x {height} pixels of {components}")]
    Length {
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
        /// Pixels per row.
        width: usize,
        /// Rows.
        height: usize,
        /// Samples per pixel.
        components: usize,
    },
    /// Its pixels have too few components.
    #[error("its pixels have {found} components, but {expected} are read")]
    Components {
        /// How many they have.
        found: usize,
        /// How many are needed.
        expected: usize,
    },
    /// Its distances lead out of the memory that it was given.
    #[error(
        "its samples lie in bytes {first} to {end} of the memory that was given, which has {bytes}"
    )]
    Outside {
        /// The first byte of any.
        first: i128,
        /// The byte after the last of any.
        end: i128,
        /// How many bytes there are.
        bytes: usize,
    },
}

/// What an image's memory is, for views that read and that write.
#[derive(Clone, Copy, Debug)]
struct Shape {
    sample: SampleType,
    order: Order,
    bytes: usize,
}

/// An image of some size whose samples all lie within its memory.
#[derive(Clone, Copy)]
struct Placed {
    sample: SampleType,
    strides: Strides,
}

impl Shape {
    /// Finds where the first `components` of every pixel lie.
    fn place(
        self,
        (width, height): (usize, usize),
        components: usize,
    ) -> Result<Placed, ViewError> {
        let size = self.sample.size();
        let pixels = width * height;
        let found = self.bytes / size;
        let has = |of: usize| match of * pixels == found {
            true => Ok(()),
            false => {
                let expected = of * pixels;
                Err(ViewError::Length { found, expected, width, height, components: of })
            }
        };
        // Sizes of images in memory are far from the limits of `isize`.
        let strides = match self.order {
            Order::Interleaved(stated) => {
                let of = stated.unwrap_or(components);
                has(of)?;
                if of < components {
                    return Err(ViewError::Components { found: of, expected: components });
                }
                let pixel = of * size;
                Strides {
                    offset: 0,
                    pixel: pixel as isize,
                    row: (width * pixel) as isize,
                    component: size as isize,
                }
            }
            Order::Planar => {
                has(components)?;
                Strides {
                    offset: 0,
                    pixel: size as isize,
                    row: (width * size) as isize,
                    component: (pixels * size) as isize,
                }
            }
            Order::Strided(strides) => strides,
        };
        let steps =
            [(strides.pixel, width), (strides.row, height), (strides.component, components)];
        let (mut first, mut end) = (strides.offset as i128, (strides.offset + size) as i128);
        for (stride, count) in steps {
            let last = stride as i128 * (count as i128 - 1);
            first += last.min(0);
            end += last.max(0);
        }
        if first < 0 || end > self.bytes as i128 {
            return Err(ViewError::Outside { first, end, bytes: self.bytes });
        }
        Ok(Placed { sample: self.sample, strides })
    }
}

impl Placed {
    /// Where a sample begins.
    fn at(self, x: usize, y: usize, component: usize) -> usize {
        let Strides { offset, pixel, row, component: next } = self.strides;
        let from = offset as isize + y as isize * row + component as isize * next;
        // It lies within the memory, as was checked.
        (from + x as isize * pixel) as usize
    }
}

/// An image that is read.
#[derive(Clone, Copy)]
pub struct View<'a> {
    bytes: &'a [u8],
    shape: Shape,
}

impl<'a> View<'a> {
    fn new<S: Sample>(samples: &'a [S], order: Order) -> Self {
        Self::of_bytes(cast_slice(samples), S::TYPE, order)
    }

    fn of_bytes(bytes: &'a [u8], sample: SampleType, order: Order) -> Self {
        Self { bytes, shape: Shape { sample, order, bytes: bytes.len() } }
    }

    /// Pixel by pixel, row by row, each of so many components. What is read are the first of
    /// these: three of the four of an image with an alpha.
    pub fn interleaved<S: Sample>(samples: &'a [S], components: usize) -> Self {
        Self::new(samples, Order::Interleaved(Some(components)))
    }

    /// Component by component, each row by row.
    pub fn planar<S: Sample>(samples: &'a [S]) -> Self {
        Self::new(samples, Order::Planar)
    }

    /// At any distances. Samples need not be aligned, and may coincide.
    pub fn strided(bytes: &'a [u8], sample: SampleType, strides: Strides) -> Self {
        Self::of_bytes(bytes, sample, Order::Strided(strides))
    }

    /// Checks that it is an image of this size with at least so many components.
    pub(super) fn check(&self, size: (usize, usize), components: usize) -> Result<(), ViewError> {
        self.shape.place(size, components).map(|_| ())
    }

    /// The first components of all pixels, each row by row, as f32.
    ///
    /// # Errors
    /// If it is no image of that size with that many components.
    pub fn read(
        &self,
        (width, height): (usize, usize),
        components: usize,
    ) -> Result<Vec<Vec<f32>>, ViewError> {
        let placed = self.shape.place((width, height), components)?;
        let mut planes: Vec<Vec<f32>> =
            (0..components).map(|_| Vec::with_capacity(width * height)).collect();
        // Row by row, so that a row of pixels is read while it is near.
        for y in 0..height {
            for (k, plane) in planes.iter_mut().enumerate() {
                self.row(placed, (y, k), width, plane);
            }
        }
        Ok(planes)
    }

    /// Adds a component of a row to a plane.
    fn row(&self, placed: Placed, (y, k): (usize, usize), width: usize, plane: &mut Vec<f32>) {
        let (start, step) = (placed.at(0, y, k), placed.strides.pixel);
        let size = placed.sample.size();
        let value = |bytes: &[u8]| match placed.sample {
            SampleType::F32 => f32::from_ne_bytes(bytes.try_into().expect("four bytes")),
            SampleType::F16 => f16::from_ne_bytes(bytes.try_into().expect("two bytes")).to_f32(),
        };
        match usize::try_from(step) {
            Ok(step) if step >= size => {
                let pixels = self.bytes[start..].chunks(step).take(width);
                plane.extend(pixels.map(|pixel| value(&pixel[..size])));
            }
            Ok(_) | Err(_) => {
                let places = (0..width).map(|x| placed.at(x, y, k));
                plane.extend(places.map(|at| value(&self.bytes[at..at + size])));
            }
        }
    }
}

impl fmt::Debug for View<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("View").field(&self.shape).finish()
    }
}

/// Pixel by pixel, of as many components as the image has.
impl<'a, S: Sample> From<&'a [S]> for View<'a> {
    fn from(samples: &'a [S]) -> Self {
        Self::new(samples, Order::Interleaved(None))
    }
}

impl<'a, S: Sample> From<&'a Vec<S>> for View<'a> {
    fn from(samples: &'a Vec<S>) -> Self {
        samples.as_slice().into()
    }
}

/// An image that is written.
pub struct ViewMut<'a> {
    bytes: &'a mut [u8],
    shape: Shape,
}

impl<'a> ViewMut<'a> {
    fn new<S: Sample>(samples: &'a mut [S], order: Order) -> Self {
        Self::of_bytes(cast_slice_mut(samples), S::TYPE, order)
    }

    fn of_bytes(bytes: &'a mut [u8], sample: SampleType, order: Order) -> Self {
        let shape = Shape { sample, order, bytes: bytes.len() };
        Self { bytes, shape }
    }

    /// Pixel by pixel, row by row, each of so many components, of which the first are written
    /// and the others stay.
    pub fn interleaved<S: Sample>(samples: &'a mut [S], components: usize) -> Self {
        Self::new(samples, Order::Interleaved(Some(components)))
    }

    /// Component by component, each row by row.
    pub fn planar<S: Sample>(samples: &'a mut [S]) -> Self {
        Self::new(samples, Order::Planar)
    }

    /// At any distances. Samples need not be aligned.
    pub fn strided(bytes: &'a mut [u8], sample: SampleType, strides: Strides) -> Self {
        Self::of_bytes(bytes, sample, Order::Strided(strides))
    }

    /// Checks that it is an image of this size with three components.
    pub(super) fn check(&self, size: (usize, usize)) -> Result<(), ViewError> {
        self.shape.place(size, 3).map(|_| ())
    }

    /// Writes colours, row by row.
    pub(super) fn write(
        &mut self,
        (width, height): (usize, usize),
        pixels: &[[f32; 3]],
    ) -> Result<(), ViewError> {
        let placed = self.shape.place((width, height), 3)?;
        let dense = Strides { offset: 0, pixel: 12, row: 12 * width as isize, component: 4 };
        if placed.sample == SampleType::F32 && placed.strides == dense {
            self.bytes[..12 * pixels.len()].copy_from_slice(cast_slice(pixels));
            return Ok(());
        }
        for (n, pixel) in pixels.iter().enumerate() {
            for (k, &sample) in pixel.iter().enumerate() {
                let at = placed.at(n % width, n / width, k);
                match placed.sample {
                    SampleType::F32 => {
                        self.bytes[at..at + 4].copy_from_slice(&sample.to_ne_bytes());
                    }
                    SampleType::F16 => {
                        let largest = f16::MAX.to_f32();
                        let half = f16::from_f32(sample.clamp(-largest, largest));
                        self.bytes[at..at + 2].copy_from_slice(&half.to_ne_bytes());
                    }
                }
            }
        }
        Ok(())
    }
}

impl fmt::Debug for ViewMut<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("ViewMut").field(&self.shape).finish()
    }
}

/// Pixel by pixel, of three components.
impl<'a, S: Sample> From<&'a mut [S]> for ViewMut<'a> {
    fn from(samples: &'a mut [S]) -> Self {
        Self::new(samples, Order::Interleaved(None))
    }
}

impl<'a, S: Sample> From<&'a mut Vec<S>> for ViewMut<'a> {
    fn from(samples: &'a mut Vec<S>) -> Self {
        samples.as_mut_slice().into()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Any image of 3 x 2 pixels is read alike however it lies.
    #[test]
    fn the_same_image_is_read_however_it_lies() {
        let size = (3, 2);
        let value = |x: usize, y: usize, k: usize| (100 * k + 10 * y + x) as f32;
        let of = |order: &[(usize, usize, usize)]| -> Vec<f32> {
            order.iter().map(|&(x, y, k)| value(x, y, k)).collect()
        };
        let places = |y: usize| (0..3).map(move |x| (x, y));
        let pixels: Vec<(usize, usize)> = (0..2).flat_map(places).collect();
        let components = |n: usize| {
            move |&(x, y): &(usize, usize)| (0..n).map(|k| (x, y, k)).collect::<Vec<_>>()
        };
        let interleaved = of(&pixels.iter().flat_map(components(3)).collect::<Vec<_>>());
        let with_alpha = of(&pixels.iter().flat_map(components(4)).collect::<Vec<_>>());
        let plane = |k| pixels.iter().map(move |&(x, y)| (x, y, k)).collect::<Vec<_>>();
        let planar = of(&(0..3).flat_map(plane).collect::<Vec<_>>());
        let expected: Vec<Vec<f32>> = (0..3).map(|k| of(&plane(k))).collect();
        // Upside down and mirrored, behind a byte that shifts everything.
        let mut turned: Vec<u8> = vec![0];
        turned.extend(interleaved.iter().rev().flat_map(|x| x.to_ne_bytes()));
        let last = turned.len() - 4;
        let strides = Strides { offset: last, pixel: -12, row: -36, component: -4 };
        let halves: Vec<f16> = interleaved.iter().map(|&x| f16::from_f32(x)).collect();
        let views = [
            View::from(&interleaved),
            View::interleaved(&interleaved, 3),
            View::interleaved(&with_alpha, 4),
            View::planar(&planar),
            View::strided(&turned, SampleType::F32, strides),
            View::from(&halves),
        ];
        for view in views {
            assert_eq!(view.read(size, 3).expect("it fits"), expected, "{view:?}");
        }
    }

    #[test]
    fn what_is_written_is_read_back_and_nothing_else_is_touched() {
        let pixels: Vec<[f32; 3]> = (0..6).map(|k| [k as f32, 0.5, -1e6]).collect();
        let mut with_alpha = vec![7.0f32; 24];
        ViewMut::interleaved(&mut with_alpha, 4).write((3, 2), &pixels).expect("it fits");
        for (four, pixel) in with_alpha.chunks(4).zip(&pixels) {
            assert_eq!((&four[..3], four[3]), (&pixel[..], 7.0));
        }
        let mut halves = vec![f16::ZERO; 18];
        ViewMut::planar(&mut halves).write((3, 2), &pixels).expect("it fits");
        let read = View::planar(&halves).read((3, 2), 3).expect("it fits");
        assert_eq!(read[0], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(read[2], [-65504.0; 6], "halves end there");
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let samples = [0.0f32; 17];
        let error = View::from(&samples[..]).read((3, 2), 3).unwrap_err();
        assert!(error.to_string().contains("17 samples, but 18"), "{error}");
        let grey = [0.0f32; 6];
        let error = View::interleaved(&grey, 1).read((3, 2), 3).unwrap_err();
        assert_eq!(error, ViewError::Components { found: 1, expected: 3 });
    }

    proptest! {
        /// Whatever the distances, a view is refused or read without a panic.
        #[test]
        fn no_distances_lead_outside(
            offset in 0usize..64, pixel in -40isize..40, row in -40isize..40,
            component in -40isize..40, bytes in 0usize..80, is_half: bool,
        ) {
            let memory = vec![0u8; bytes];
            let sample = if is_half { SampleType::F16 } else { SampleType::F32 };
            let strides = Strides { offset, pixel, row, component };
            let _ = View::strided(&memory, sample, strides).read((3, 2), 3);
        }
    }
}
