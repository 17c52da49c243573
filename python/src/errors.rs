//! Errors as Python's exceptions, with the texts of the command line.

use std::error::Error;
use std::io;

use pyo3::prelude::*;
use pyo3::types::PyType;
use tamis::denoise::DenoiseError;
use tamis::evolve;
use tamis::filter::FindError;
use tamis::image::ImageError;
use tamis::report::UnknownForm;
use tamis::tune;

/// What kind of mistake an error is: the exceptions of `tamis._errors`.
#[derive(Clone, Copy)]
pub(crate) enum Kind {
    /// None of the others.
    Other,
    /// A value that makes no sense: a `ValueError`, too.
    Value,
    /// A thing of the wrong type: a `TypeError`, too.
    Type,
    /// A file that is not there: a `FileNotFoundError`, too.
    Missing,
}

impl Kind {
    fn exception(self) -> &'static str {
        match self {
            Self::Other => "Error",
            Self::Value => "InvalidValueError",
            Self::Type => "InvalidTypeError",
            Self::Missing => "MissingFileError",
        }
    }

    fn of(error: &(dyn Error + 'static)) -> Self {
        let mut cause = Some(error);
        while let Some(error) = cause {
            if let Some(io) = error.downcast_ref::<io::Error>()
                && io.kind() == io::ErrorKind::NotFound
            {
                return Self::Missing;
            }
            if is_value(error) {
                return Self::Value;
            }
            cause = error.source();
        }
        Self::Other
    }
}

/// Whether an error is about a value that somebody gave.
fn is_value(error: &(dyn Error + 'static)) -> bool {
    let denoising = error.downcast_ref::<DenoiseError>().is_some_and(|error| {
        matches!(
            error,
            DenoiseError::Filter { .. }
                | DenoiseError::NoBuffer { .. }
                | DenoiseError::NoColor
                | DenoiseError::Size { .. }
                | DenoiseError::Strength(_)
                | DenoiseError::Threads { .. }
                | DenoiseError::View { .. }
        )
    });
    let finding =
        error.downcast_ref::<FindError>().is_some_and(|error| !matches!(error, FindError::File(_)));
    let setting = error
        .downcast_ref::<tune::Error>()
        .is_some_and(|error| matches!(error, tune::Error::Setting { .. }))
        || error
            .downcast_ref::<evolve::Error>()
            .is_some_and(|error| matches!(error, evolve::Error::Setting { .. }));
    let size = error
        .downcast_ref::<ImageError>()
        .is_some_and(|error| matches!(error, ImageError::SizeMismatch { .. }));
    denoising || finding || setting || size || error.is::<UnknownForm>()
}

/// An exception with a text.
pub(crate) fn raise(py: Python<'_>, kind: Kind, text: impl Into<String>) -> PyErr {
    let class = py
        .import("tamis._errors")
        .and_then(|module| module.getattr(kind.exception()))
        .and_then(|class| Ok(class.cast_into::<PyType>()?));
    match class {
        Ok(class) => PyErr::from_type(class, (text.into(),)),
        Err(error) => error,
    }
}

/// An exception for a value that makes no sense.
pub(crate) fn invalid(py: Python<'_>, text: impl Into<String>) -> PyErr {
    raise(py, Kind::Value, text)
}

/// Results whose errors become exceptions.
pub(crate) trait OrRaise<T> {
    /// The value, or the error as an exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T, E: Error + 'static> OrRaise<T> for Result<T, E> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|error| raise(py, Kind::of(&error), evolve::with_causes(&error)))
    }
}
