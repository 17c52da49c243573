//! Constants of filters, tuned on scenes.

use pyo3::prelude::*;
use tamis::backend::{Backend, Differentiator, Interpreter, Jit};
use tamis::filter;
use tamis::tune::{Control, Error, Event, Settings, Tuner};

use crate::denoiser::named;
use crate::errors::{OrRaise, invalid};
use crate::filter::Filter;
use crate::patient::{Told, work};
use crate::scenes::{Place, load};

/// A back end that differentiates.
#[derive(Clone, Copy)]
pub(crate) enum Processor {
    /// Machine code.
    Jit,
    /// The interpreter.
    Interp,
}

impl Processor {
    /// The one of a name.
    pub(crate) fn named(py: Python<'_>, name: &str) -> PyResult<Self> {
        named(py, "backend", name, &[("jit", Self::Jit), ("interp", Self::Interp)])
    }
}

/// The parameters of tuning as they are by default, as JSON.
#[pyfunction]
pub(crate) fn settings() -> String {
    serde_json::to_string(&Settings::default()).expect("settings have text for keys")
}

/// Reads parameters as they are written as JSON.
pub(crate) fn parsed<T: serde::de::DeserializeOwned>(py: Python<'_>, text: &str) -> PyResult<T> {
    serde_json::from_str(text).map_err(|error| invalid(py, format!("a parameter: {error}")))
}

/// A filter with tuned constants.
#[pyfunction]
#[pyo3(signature = (filter, scenes, validate, *, settings, backend, progress))]
pub(crate) fn tune(
    py: Python<'_>,
    filter: &Bound<'_, Filter>,
    scenes: Vec<Place>,
    validate: Vec<Place>,
    settings: &str,
    backend: &str,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Filter> {
    let settings: Settings = parsed(py, settings)?;
    settings.validate().or_raise(py)?;
    let processor = Processor::named(py, backend)?;
    let filter = filter.get().0.clone();
    let tuned = work(py, progress, |told| {
        let run = Run { filter, scenes: &scenes, validate: &validate, settings };
        match processor {
            Processor::Jit => run.on(&Jit::new()?, told),
            Processor::Interp => run.on(&Interpreter, told),
        }
    })?;
    tuned.or_raise(py).map(Filter)
}

struct Run<'a> {
    filter: filter::Filter,
    scenes: &'a [Place],
    validate: &'a [Place],
    settings: Settings,
}

impl Run<'_> {
    fn on(
        self,
        backend: &(impl Backend + Differentiator),
        told: &Told,
    ) -> Result<filter::Filter, Error> {
        let checked = self.filter.check().expect("only filters that make sense get here");
        let (needs, reach) = (checked.needs(), checked.reach());
        let training = load(self.scenes, &needs, reach)?;
        let validation = load(self.validate, &needs, reach)?;
        let mut tuner =
            Tuner::new(self.filter.clone(), self.settings, &training, &validation, backend)?;
        let control = Control { stop: told.stop().clone(), ..Control::default() };
        let outcome = tuner.run(&control, &mut |event| {
            if let Event::Step { step, of } = event {
                // The run looks at the flag itself.
                let _ = told.tell(step as usize, of as usize);
            }
        })?;
        Ok(outcome.filter)
    }
}
