//! What is in files: channels and their meaning, and features as arrays.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use tamis::expr::Quantity;
use tamis::report::Findings;
use tamis::report::score::json;
use tamis::scene::inspect::Inspection;
use tamis::scene::{LoadOptions, Needs, RawScene, SceneError};

use crate::array::array;
use crate::denoiser::parameter;
use crate::errors::OrRaise;

/// What is in a file and what becomes of it, as JSON.
#[pyfunction]
pub(crate) fn inspect(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let findings = py.detach(|| -> Result<_, SceneError> {
        let inspection = Inspection::of(&path)?;
        Ok(json(&Findings::of(&inspection, &inspection.scan()?)))
    });
    findings.or_raise(py)
}

/// The features of a file as arrays, by the names of `denoise`'s arguments.
#[pyfunction]
pub(crate) fn read(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let read = py.detach(|| RawScene::read(&path, &Needs::everything(), &LoadOptions::default()));
    let RawScene { width, height, features, samples, alpha, .. } = read.or_raise(py)?;
    let size = (width, height);
    let read = PyDict::new(py);
    // The colour first, as people think of it.
    let mut features: Vec<_> = features.into_iter().collect();
    features.sort_by_key(|((feature, quantity), _)| parameter(*feature, *quantity) != "color");
    for ((feature, quantity), planes) in features {
        let wanted = match quantity {
            Quantity::Value => feature.row().channels.len(),
            Quantity::Variance | Quantity::Gradient => feature.row().variance_channels.len(),
        };
        let planes = if planes.len() == wanted { planes } else { vec![mean(&planes)] };
        read.set_item(parameter(feature, quantity), array(py, size, &planes)?)?;
    }
    if let Some(alpha) = alpha {
        read.set_item("alpha", array(py, size, &[alpha])?)?;
    }
    if let Some(samples) = samples {
        read.set_item("samples", samples)?;
    }
    Ok(read)
}

/// One variance for the components of a feature: the mean of theirs.
fn mean(planes: &[Vec<f32>]) -> Vec<f32> {
    let mean = |k: usize| planes.iter().map(|plane| plane[k]).sum::<f32>() / planes.len() as f32;
    (0..planes[0].len()).map(mean).collect()
}
