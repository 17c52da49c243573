//! NumPy's arrays as the library's views of memory: where they lie, whatever their strides.

use half::f16;
use numpy::{
    Element, PyArray1, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
    dtype,
};
use pyo3::prelude::*;
use tamis::denoise::{Sample, SampleType, Strides, View, ViewMut};
use tamis::image::Image;

use crate::errors::{Kind, invalid, raise};

/// An array of rows of pixels.
pub(crate) struct Pixels<'py> {
    array: Bound<'py, PyUntypedArray>,
    sample: SampleType,
    /// Rows, columns, components.
    shape: [usize; 3],
    /// From one of each to the next, in bytes.
    strides: [isize; 3],
}

impl<'py> Pixels<'py> {
    /// Takes an array of shape (H, W, components) or, if one component is enough, (H, W).
    ///
    /// # Errors
    /// If it is none, has another shape, or its samples are no floats of 32 or 16 bits.
    pub(crate) fn of(
        name: &str,
        array: &Bound<'py, PyUntypedArray>,
        components: &[usize],
    ) -> PyResult<Self> {
        let py = array.py();
        let sample = sample(array).ok_or_else(|| {
            let text = format!(
                "{name}: its samples are {}, but must be float32 or float16; convert it with \
                 {name}.astype(numpy.float32)",
                array.dtype()
            );
            raise(py, Kind::Type, text)
        })?;
        let refuse = || invalid(py, misshapen(name, array.shape(), components));
        let (shape, strides) = match (array.shape(), array.strides()) {
            (&[rows, columns], &[row, column]) if components.contains(&1) => {
                ([rows, columns, 1], [row, column, 0])
            }
            (&[rows, columns, of], &[row, column, component]) if components.contains(&of) => {
                ([rows, columns, of], [row, column, component])
            }
            _ => return Err(refuse()),
        };
        if shape[0] == 0 || shape[1] == 0 {
            return Err(invalid(py, format!("{name}: it has no pixels")));
        }
        Ok(Self { array: array.clone(), sample, shape, strides })
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.shape[1], self.shape[0])
    }

    /// How many components its pixels have.
    pub(crate) fn components(&self) -> usize {
        self.shape[2]
    }

    /// Checks that it has the size of the frame that it belongs to.
    pub(crate) fn check_size(&self, name: &str, size: (usize, usize)) -> PyResult<()> {
        if self.size() == size {
            return Ok(());
        }
        let [(width, height), own] = [size, self.size()];
        let text = format!(
            "{name}: it has {} rows of {} pixels, but color has {height} of {width}",
            own.1, own.0
        );
        Err(invalid(self.array.py(), text))
    }

    /// The bytes before the first sample, and of all from the one that lies first.
    fn extent(&self) -> (usize, usize) {
        let (mut before, mut after) = (0, self.sample.size());
        for (stride, count) in self.strides.into_iter().zip(self.shape) {
            let last = stride.unsigned_abs() * (count - 1);
            if stride < 0 { before += last } else { after += last }
        }
        (before, before + after)
    }

    fn place(&self, component: usize) -> Strides {
        let [row, pixel, next] = self.strides;
        // Components lie within the extent, before the first sample or after it.
        let offset = self.extent().0 as isize + component as isize * next;
        Strides { offset: offset as usize, pixel, row, component: next }
    }

    fn first_byte(&self) -> *mut u8 {
        // SAFETY: the array is alive, and so is what its object says of it.
        let data = unsafe { (*self.array.as_array_ptr()).fields.data };
        data.cast::<u8>().wrapping_sub(self.extent().0)
    }

    /// Its samples from a component on, as they lie. Whoever writes to the array while they are
    /// read changes what is read; the documentation asks people not to.
    pub(crate) fn view(&self, component: usize) -> View<'_> {
        // SAFETY: an array owns, or keeps alive, all bytes between the samples that lie furthest
        // apart, which is what the extent spans; `self` keeps the array.
        let bytes = unsafe { std::slice::from_raw_parts(self.first_byte(), self.extent().1) };
        View::strided(bytes, self.sample, self.place(component))
    }

    /// Its samples, to be written to, if they may be.
    ///
    /// # Errors
    /// If NumPy says that they may not.
    pub(crate) fn view_mut(&mut self, name: &str) -> PyResult<ViewMut<'_>> {
        let flags = self.array.getattr("flags")?;
        if !flags.getattr("writeable")?.extract::<bool>()? {
            let text = format!("{name}: it cannot be written to; give an array that can");
            return Err(invalid(self.array.py(), text));
        }
        // SAFETY: as above; NumPy lets it be written to, nothing else of this module looks at
        // memory while it is, and Python's lock is held.
        let bytes = unsafe { std::slice::from_raw_parts_mut(self.first_byte(), self.extent().1) };
        Ok(ViewMut::strided(bytes, self.sample, self.place(0)))
    }

    /// A copy as an image: grey if it has one component, with an alpha if it has four.
    pub(crate) fn image(&self, name: &str) -> Image {
        let (width, height) = self.size();
        let planes = self.view(0).read(self.size(), self.components());
        let mut planes = planes.expect("its samples lie within its memory");
        let alpha = (planes.len() == 4).then(|| planes.remove(3));
        let rgb = match <[Vec<f32>; 3]>::try_from(planes) {
            Ok(rgb) => rgb,
            Err(grey) => [0; 3].map(|k| grey[k].clone()),
        };
        let image = Image::new(name, width, height, rgb).expect("a sample per pixel");
        image.with_alpha(alpha)
    }
}

/// What its samples are, if they can be read.
fn sample(array: &Bound<'_, PyUntypedArray>) -> Option<SampleType> {
    fn is<S: Sample + Element>(array: &Bound<'_, PyUntypedArray>) -> Option<SampleType> {
        array.dtype().is_equiv_to(&dtype::<S>(array.py())).then_some(S::TYPE)
    }
    is::<f32>(array).or_else(|| is::<f16>(array))
}

/// What is wrong with a shape.
fn misshapen(name: &str, shape: &[usize], components: &[usize]) -> String {
    let wanted = components.iter().map(|of| match of {
        1 => "(H, W)".to_owned(),
        of => format!("(H, W, {of})"),
    });
    let wanted = wanted.collect::<Vec<String>>().join(" or ");
    let sizes = shape.iter().map(usize::to_string).collect::<Vec<String>>().join(", ");
    let comma = if shape.len() == 1 { "," } else { "" };
    let is_colorful = components.iter().any(|&of| of > 1);
    let advice = match *shape {
        [1, _, last] if last > 4 && !is_colorful => format!("; take {name}[0]"),
        [2..=4, _, last] if last > 4 && is_colorful => format!(
            "; its channels come first, and must come last: give numpy.moveaxis({name}, 0, -1), \
             which copies nothing"
        ),
        _ => String::new(),
    };
    format!("{name}: its shape is ({sizes}{comma}), but must be {wanted}{advice}")
}

/// Planes as an array of shape (H, W), or (H, W, components) of several.
pub(crate) fn array<'py>(
    py: Python<'py>,
    (width, height): (usize, usize),
    planes: &[Vec<f32>],
) -> PyResult<Bound<'py, PyAny>> {
    let pixels = 0..width * height;
    let samples: Vec<f32> = pixels.flat_map(|k| planes.iter().map(move |plane| plane[k])).collect();
    let samples = PyArray1::from_vec(py, samples);
    Ok(match planes.len() {
        1 => samples.reshape([height, width])?.into_any(),
        of => samples.reshape([height, width, of])?.into_any(),
    })
}
