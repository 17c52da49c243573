//! Filters: found by name, shown, exported, kept.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use pyo3::types::PyTuple;
use tamis::export::{Export, Language, Options, export};
use tamis::expr::text::latex;
use tamis::filter::{self, reads, show};
use tamis::image::write_atomically;

use crate::errors::OrRaise;

/// A filter: what `tamis.denoise` computes, as formulas that can be read, kept and exported.
///
/// `Filter(text)` takes a filter's name (`tamis.filters()` lists them), a filter file, or a weight
/// such as `"exp(-distance2(normal, normal) / 0.1)"`. Filters do not change; they can be compared,
/// pickled, and used as keys.
#[pyclass(frozen, module = "tamis")]
pub(crate) struct Filter(pub(crate) filter::Filter);

impl Filter {
    fn exported(&self, py: Python<'_>, language: Language) -> PyResult<String> {
        let exported = export(&self.0, language, &Options::default()).or_raise(py)?;
        let bytes = match exported {
            Export::Single(bytes) | Export::WithHeader { code: bytes, .. } => bytes,
            Export::Folder(_) => unreachable!("only shaders are folders"),
        };
        Ok(String::from_utf8(bytes).expect("texts are UTF-8"))
    }
}

#[pymethods]
impl Filter {
    #[new]
    fn new(py: Python<'_>, text: &str) -> PyResult<Self> {
        filter::Filter::find(text).map(Self).or_raise(py)
    }

    /// Reads a filter file.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        filter::Filter::read(&path).map(Self).or_raise(py)
    }

    /// Reads the text of a filter file.
    #[staticmethod]
    fn from_toml(py: Python<'_>, text: &str) -> PyResult<Self> {
        filter::Filter::parse(text, Path::new("the filter's text")).map(Self).or_raise(py)
    }

    /// What people call it.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// What a reader has to read: nodes of all formulas, and numbers of layers.
    #[getter]
    fn nodes(&self) -> usize {
        self.0.size()
    }

    /// How many stages it has: 1 for a single weight.
    #[getter]
    fn stages(&self) -> usize {
        self.0.stages.len()
    }

    /// The names of the features that it reads, the colour among them.
    #[getter]
    fn features(&self) -> Vec<&'static str> {
        let checked = self.0.check().expect("only filters that make sense get here");
        reads(&checked).into_iter().map(|(feature, _)| feature.term()).collect()
    }

    /// What it computes, stage by stage, as `tamis filters show` prints it: features, formulas,
    /// constants.
    fn formulas(&self) -> String {
        show(&self.0.check().expect("only filters that make sense get here"))
    }

    /// Its equations as LaTeX, for a document that loads amsmath: a page for a program.
    fn latex(&self, py: Python<'_>) -> PyResult<String> {
        self.exported(py, Language::Latex)
    }

    /// It as a Python module of NumPy functions, which says what it means, and is slow.
    fn to_python(&self, py: Python<'_>) -> PyResult<String> {
        self.exported(py, Language::Python)
    }

    /// It as C99, to the bits of `tamis.denoise(backend="interp")`.
    fn to_c(&self, py: Python<'_>) -> PyResult<String> {
        self.exported(py, Language::C)
    }

    /// It as the text of a filter file.
    fn to_toml(&self) -> String {
        self.0.to_toml(toml::Table::new())
    }

    /// Writes it as a filter file, which `tamis denoise --filter` takes: whole or not at all.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        write_atomically(&path, self.to_toml().as_bytes()).or_raise(py)
    }

    /// The weight as an equation, if it is a single one; notebooks show it.
    fn _repr_latex_(&self) -> Option<String> {
        self.0.paper().map(|gather| format!("$w(i, j) = {}$", latex(&gather.weight)))
    }

    fn __repr__(&self) -> String {
        match self.0.paper() {
            Some(gather) => format!(
                "<tamis.Filter '{}': {}, radius {}>",
                self.0.name, gather.weight, gather.window.radius
            ),
            None => format!(
                "<tamis.Filter '{}': {} stages, {} nodes>",
                self.0.name,
                self.0.stages.len(),
                self.0.size()
            ),
        }
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().0 == self.0)
    }

    fn __hash__(&self) -> u64 {
        self.0.fingerprint()
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let make = this.py().import("tamis._filters")?.getattr("from_toml")?;
        (make, (this.get().to_toml(),)).into_pyobject(this.py())
    }
}

/// The names of the filters that have one.
#[pyfunction]
pub(crate) fn names() -> Vec<String> {
    filter::names()
}
