//! Images: how far one is from another, and as pictures for people.

use std::path::PathBuf;

use numpy::PyUntypedArray;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use tamis::image::Image;
use tamis::report::{Contrast, Picture, common_window};
use tamis::scene::load_image;

use crate::array::Pixels;
use crate::denoiser::stops;
use crate::errors::OrRaise;

/// An image, wherever it is.
#[derive(FromPyObject)]
pub(crate) enum Source<'py> {
    #[pyo3(transparent)]
    Array(Bound<'py, PyUntypedArray>),
    #[pyo3(transparent)]
    File(PathBuf),
}

impl Source<'_> {
    fn image(self, py: Python<'_>, name: &str, components: &[usize]) -> PyResult<Image> {
        match self {
            Self::Array(array) => Ok(Pixels::of(name, &array, components)?.image(name)),
            Self::File(path) => py.detach(|| load_image(&path)).or_raise(py),
        }
    }
}

/// How far an image is from its reference.
#[pyfunction]
pub(crate) fn compare<'py>(
    py: Python<'py>,
    image: Source<'py>,
    reference: Source<'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let image = image.image(py, "image", &[1, 3, 4])?;
    let reference = reference.image(py, "reference", &[1, 3, 4])?;
    let overlap = common_window(std::slice::from_ref(&image), &reference);
    let contrast = py.detach(|| {
        let [image, reference] = [image, reference].map(|image| match overlap {
            Some(window) => image.within(window),
            None => image,
        });
        Contrast::of("image".to_owned(), image, &reference)
    });
    let contrast = contrast.or_raise(py)?;
    let figures = contrast.figures();
    let compared = PyDict::new(py);
    compared.set_item("rel_mse", figures.metrics.rel_mse)?;
    compared.set_item("trimmed_rel_mse", figures.metrics.trimmed_rel_mse)?;
    compared.set_item("mse", figures.metrics.mse)?;
    compared.set_item("psnr_db", figures.metrics.psnr)?;
    compared.set_item("ssim", figures.ssim)?;
    compared.set_item("flip", figures.flip)?;
    compared.set_item("left_out", contrast.comparison.left_out)?;
    compared.set_item("not_finite", contrast.comparison.bad)?;
    if let Some(window) = overlap {
        compared.set_item("overlap", window.to_string())?;
    }
    Ok(compared)
}

/// An image as a PNG file's bytes, `exposure` stops brighter.
#[pyfunction]
pub(crate) fn png<'py>(
    py: Python<'py>,
    image: Source<'py>,
    exposure: f32,
) -> PyResult<Bound<'py, PyBytes>> {
    stops(py, exposure)?;
    let image = image.image(py, "image", &[1, 3, 4])?;
    let bytes = py.detach(|| Picture::with_alpha(&image, exposure).to_png());
    Ok(PyBytes::new(py, &bytes))
}
