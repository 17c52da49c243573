//! Denoisers: arrays in, arrays out; files in, files out.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glob::Pattern;
use numpy::PyUntypedArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tamis::backend::Choice;
use tamis::denoise::{self, Applied, Builder, DenoiseError, Feeds, Options};
use tamis::expr::feature::snake_case;
use tamis::expr::{Feature, Quantity};
use tamis::image::exr::Unfinished;
use tamis::plan::{Passes, Precision};
use tamis::report::Form;
use tamis::scene::listing::Aux;
use tamis::scene::mapping::{Said, Selection};
use tamis::scene::{LoadOptions, Note, Repair};

use crate::array::Pixels;
use crate::errors::{Kind, OrRaise, invalid, raise};
use crate::filter::Filter;
use crate::patient::{Told, work};

/// What keeps a back end open, and the filter as code for the latest frame and for those of which
/// the same is known.
#[pyclass(frozen, module = "tamis._tamis")]
pub(crate) struct Denoiser(denoise::Denoiser);

/// What an array is of.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Picture {
    Feature(Feature, Quantity),
    Alpha,
}

impl Picture {
    const COLOR: Self = Self::Feature(Feature::Color, Quantity::Value);

    fn of(py: Python<'_>, name: &str) -> PyResult<Self> {
        if name == "alpha" {
            return Ok(Self::Alpha);
        }
        let found = argument(name).map(|(feature, quantity)| Self::Feature(feature, quantity));
        found.ok_or_else(|| {
            raise(py, Kind::Type, format!("{name}: a frame in memory has no such array"))
        })
    }

    /// How many components its pixels may have.
    fn components(self) -> &'static [usize] {
        let (feature, quantity) = match self {
            Self::Feature(feature, quantity) => (feature.row(), quantity),
            Self::Alpha => return &[1],
        };
        match (feature.channels.len(), feature.variance_channels.len(), quantity) {
            // The alpha may stand beside the colour.
            (3, _, Quantity::Value) => &[3, 4],
            (_, 3, Quantity::Variance) => &[3],
            _ => &[1],
        }
    }
}

#[pymethods]
impl Denoiser {
    #[new]
    #[pyo3(signature = (filter, *, backend, gpu, precision, threads, samples, strength, repair, unfinished, max_memory, map, layers, alpha, view, layer))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords")]
    fn new(
        py: Python<'_>,
        filter: &Bound<'_, Filter>,
        backend: &str,
        gpu: Option<String>,
        precision: &str,
        threads: Option<NonZeroUsize>,
        samples: Option<u32>,
        strength: f32,
        repair: &str,
        unfinished: bool,
        max_memory: Option<u64>,
        map: Vec<String>,
        layers: Vec<String>,
        alpha: &str,
        view: Option<String>,
        layer: Option<String>,
    ) -> PyResult<Self> {
        let choice = named(py, "backend", backend, &Choice::ALL.map(|c| (c.name(), c)))?;
        let precision = named(py, "precision", precision, &Precision::ALL.map(|p| (p.name(), p)))?;
        let repairs =
            [("median", Repair::Median), ("none", Repair::None), ("error", Repair::Error)];
        let repair = named(py, "repair", repair, &repairs)?;
        let unfinished = if unfinished { Unfinished::Zero } else { Unfinished::Refused };
        let said = map.iter().map(|text| {
            Said::read(text).map_err(|reason| invalid(py, format!("map: {text}: {reason}")))
        });
        let said = said.collect::<PyResult<Vec<Said>>>()?;
        let layers = layers.iter().map(|text| {
            Pattern::new(text).map_err(|error| invalid(py, format!("layers: {text}: {error}")))
        });
        let options = Options {
            filter: Some(filter.get().0.clone()),
            passes: Passes { precision, ..Passes::ALL },
            load: LoadOptions { repair, unfinished, samples, ..LoadOptions::default() },
            selection: Selection { view, layer, said, samples: None },
            layers: layers.collect::<PyResult<_>>()?,
            filters_alpha: named(py, "alpha", alpha, &[("keep", false), ("filter", true)])?,
            strength: Some(strength),
            ..Options::default()
        };
        let mut builder = Builder::default().backend(choice).options(options);
        if let Some(threads) = threads {
            builder = builder.threads(threads);
        }
        if let Some(gpu) = gpu {
            builder = builder.gpu(gpu);
        }
        if let Some(bytes) = max_memory {
            builder = builder.max_memory(bytes);
        }
        // A GPU takes a while.
        py.detach(|| builder.build()).or_raise(py).map(Self)
    }

    /// What it filters with.
    #[getter]
    fn filter(&self) -> Filter {
        Filter(self.0.filter_used().clone())
    }

    /// What runs it.
    #[getter]
    fn backend(&self) -> &'static str {
        self.0.backend().name()
    }

    /// Filters arrays by their names into `out`; returns what there is to say.
    #[pyo3(signature = (arrays, out, *, samples, progress))]
    fn denoise<'py>(
        &self,
        py: Python<'py>,
        arrays: Vec<(String, Bound<'py, PyUntypedArray>)>,
        out: &Bound<'py, PyUntypedArray>,
        samples: Option<u32>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut pictures = Vec::with_capacity(arrays.len());
        for (name, array) in &arrays {
            let picture = Picture::of(py, name)?;
            pictures.push((picture, name, Pixels::of(name, array, picture.components())?));
        }
        let color = pictures.iter().find(|(picture, ..)| *picture == Picture::COLOR);
        let color = color.map(|(.., pixels)| (pixels.size(), pixels.components()));
        let (size, components) = color.ok_or(DenoiseError::NoColor).or_raise(py)?;
        for (_, name, pixels) in &pictures {
            pixels.check_size(name, size)?;
        }
        let mut out = Pixels::of("out", out, &[components])?;
        out.check_size("out", size)?;
        // What cannot be written to is refused before the work.
        out.view_mut("out")?;

        let mut frame = self.0.frame(size.0, size.1);
        for (picture, _, pixels) in &pictures {
            frame = match *picture {
                Picture::Feature(feature, quantity) => {
                    frame.feature(feature, quantity, pixels.view(0))
                }
                Picture::Alpha => frame.alpha(pixels.view(0)),
            };
            if *picture == Picture::COLOR && components == 4 {
                frame = frame.alpha(pixels.view(3));
            }
        }
        if let Some(samples) = samples {
            frame = frame.samples(samples);
        }
        let started = Instant::now();
        let filtered = work(py, progress, move |told: &Told| {
            frame.progress(&|done, of| told.tell(done, of)).filter()
        })?;
        let filtered = filtered.or_raise(py)?;
        filtered.write(&mut out.view_mut("out")?).or_raise(py)?;
        let said = &filtered.report;
        let notes: Vec<&Note> = said.notes.iter().collect();
        report(py, started.elapsed(), said.backend, &[&said.applied], &notes)
    }

    /// Filters a file into another, with features of files beside it, as `tamis denoise` does;
    /// returns what there is to say.
    #[pyo3(signature = (input, output, *, beside, exposure, progress))]
    fn denoise_file<'py>(
        &self,
        py: Python<'py>,
        input: PathBuf,
        output: PathBuf,
        beside: Vec<(PathBuf, Option<String>)>,
        exposure: f32,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let form = Form::of(&output).or_raise(py)?;
        stops(py, exposure)?;
        spare_the_input(py, &input, &output)?;
        let aux = beside.into_iter().map(|(path, feature)| {
            let feature = feature.as_deref().and_then(argument).map(|(feature, _)| feature);
            Aux { path, feature }
        });
        let aux: Vec<Aux> = aux.collect();
        let started = Instant::now();
        let done = work(py, progress, |told: &Told| -> Result<_, DenoiseError> {
            let frame = self.0.load(&input, &aux)?;
            let denoised = self.0.filter_watched(frame, &|done, of| told.tell(done, of))?;
            let lost = form.save(&denoised, &output, exposure)?;
            Ok((denoised, lost))
        })?;
        let (denoised, lost) = done.or_raise(py)?;
        let pictures = &denoised.pictures;
        let applied: Vec<&Applied> = pictures.iter().map(|picture| &picture.applied).collect();
        let notes: Vec<&Note> = pictures.iter().flat_map(|picture| &picture.notes).collect();
        let report = report(py, started.elapsed(), self.backend(), &applied, &notes)?;
        let feeds = pictures.iter().map(|picture| Feeds(&picture.target).to_string());
        report.set_item("feeds", feeds.collect::<Vec<String>>())?;
        report.set_item("recompressed", lost.recompressed)?;
        let left_out = match form {
            Form::Exr => Vec::new(),
            Form::Png | Form::Pfm => denoised.beside_the_picture(),
        };
        report.set_item("left_out", left_out)?;
        Ok(report)
    }
}

/// The feature that an argument is: `albedo`, or `albedo_variance`.
fn argument(name: &str) -> Option<(Feature, Quantity)> {
    let stored = Feature::ALL.into_iter().filter(|feature| feature.is_stored());
    let quantities = [Quantity::Value, Quantity::Variance];
    let mut all = stored.flat_map(|feature| quantities.map(|quantity| (feature, quantity)));
    all.find(|&(feature, quantity)| parameter(feature, quantity) == name)
}

/// What a feature's argument is called.
pub(crate) fn parameter(feature: Feature, quantity: Quantity) -> String {
    let name = snake_case(feature.term());
    match quantity {
        Quantity::Value => name,
        Quantity::Gradient => name + "_gradient",
        Quantity::Variance => name + "_variance",
    }
}

/// The one of several things that a text names.
pub(crate) fn named<T: Copy>(
    py: Python<'_>,
    parameter: &str,
    text: &str,
    all: &[(&str, T)],
) -> PyResult<T> {
    let found = all.iter().find(|(name, _)| *name == text).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        invalid(py, format!("{parameter}: there is no `{text}`; there are {}", names.join(", ")))
    })
}

/// Checks a number of photographic stops.
pub(crate) fn stops(py: Python<'_>, exposure: f32) -> PyResult<()> {
    match (-64.0..=64.0).contains(&exposure) {
        true => Ok(()),
        false => {
            let text = format!("exposure: it is {exposure}, but must be from -64 to 64 stops");
            Err(invalid(py, text))
        }
    }
}

/// Checks that a result would not replace its input.
fn spare_the_input(py: Python<'_>, input: &Path, output: &Path) -> PyResult<()> {
    let file = |path: &Path| path.canonicalize().ok();
    match file(output).is_some_and(|output| Some(output) == file(input)) {
        false => Ok(()),
        true => {
            let text =
                format!("{}: this is the input; give the result another name", output.display());
            Err(invalid(py, text))
        }
    }
}

/// What there is to say of a frame, or of a file's pictures.
fn report<'py>(
    py: Python<'py>,
    whole: Duration,
    backend: &str,
    pictures: &[&Applied],
    notes: &[&Note],
) -> PyResult<Bound<'py, PyDict>> {
    let sum = |of: fn(&Applied) -> Duration| -> f64 {
        pictures.iter().map(|applied| of(applied)).sum::<Duration>().as_secs_f64()
    };
    let report = PyDict::new(py);
    report.set_item("seconds", whole.as_secs_f64())?;
    report.set_item("planning_seconds", sum(|applied| applied.planning))?;
    report.set_item("compilation_seconds", sum(|applied| applied.compilation))?;
    report.set_item("filtering_seconds", sum(|applied| applied.filtering))?;
    let kept: usize = pictures.iter().flat_map(|applied| &applied.kept).sum();
    report.set_item("kept_pixels", kept)?;
    let texts = |wanted: bool| -> Vec<String> {
        let notes = notes.iter().filter(|note| note.is_warning() == wanted);
        notes.map(|note| note.to_string()).collect()
    };
    report.set_item("warnings", texts(true))?;
    report.set_item("notes", texts(false))?;
    report.set_item("backend", backend)?;
    Ok(report)
}
