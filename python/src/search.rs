//! Searches for programs.

use std::time::Duration;

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use tamis::backend::{Backend, Differentiator, Interpreter, Jit};
use tamis::evolve;
use tamis::evolve::programs::{Event, Finalist, Judge, Outcome, Search, Settings, seed};
use tamis::filter;
use tamis::scene::Needs;
use tamis::tune::{self, Control};

use crate::denoiser::named;
use crate::errors::{OrRaise, invalid};
use crate::filter::Filter;
use crate::patient::{Told, work};
use crate::scenes::{Place, load};
use crate::tuning::{Processor, parsed};

/// The parameters of a named search, as JSON.
#[pyfunction]
pub(crate) fn preset(py: Python<'_>, name: &str) -> PyResult<String> {
    let presets =
        [("quick", Settings::quick as fn() -> Settings), ("programs", Settings::thorough)];
    let settings = named(py, "preset", name, &presets)?();
    Ok(serde_json::to_string(&settings).expect("settings have text for keys"))
}

/// Why a search ended without a result.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Scenes(#[from] tune::Error),
    #[error(transparent)]
    Search(#[from] evolve::Error),
}

/// What a search finds: the best program, and those of which none is better by all goals.
#[pyfunction]
#[pyo3(signature = (initial, scenes, validate, *, settings, backend, max_seconds, progress))]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub(crate) fn search<'py>(
    py: Python<'py>,
    initial: Option<&Bound<'py, Filter>>,
    scenes: Vec<Place>,
    validate: Vec<Place>,
    settings: &str,
    backend: &str,
    max_seconds: Option<f64>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyList>)> {
    let settings: Settings = parsed(py, settings)?;
    settings.validate().or_raise(py)?;
    let processor = Processor::named(py, backend)?;
    let time_limit = max_seconds.map(Duration::try_from_secs_f64).transpose().map_err(|_| {
        invalid(py, format!("max_seconds: {max_seconds:?} is no time; give seconds, 0 or more"))
    })?;
    let initial = initial.map_or_else(seed, |filter| filter.get().0.clone());
    let found = work(py, progress, |told| {
        let run = Run { initial, scenes: &scenes, validate: &validate, settings, time_limit };
        match processor {
            Processor::Jit => run.on(&Jit::new().map_err(tune::Error::from)?, told),
            Processor::Interp => run.on(&Interpreter, told),
        }
    })?;
    let Outcome { best, front, .. } = found.or_raise(py)?;
    let front = front.iter().zip(1..);
    let front = front.map(|(finalist, k)| row(py, finalist, &format!("front-{k:02}")));
    let front = front.collect::<PyResult<Vec<_>>>()?;
    Ok((row(py, &best, "best")?, PyList::new(py, front)?))
}

struct Run<'a> {
    initial: filter::Filter,
    scenes: &'a [Place],
    validate: &'a [Place],
    settings: Settings,
    time_limit: Option<Duration>,
}

impl Run<'_> {
    fn on(
        self,
        backend: &(impl Backend + Differentiator),
        told: &Told,
    ) -> Result<Outcome, Failure> {
        let Self { initial, scenes, validate, settings, time_limit } = self;
        let checked = initial.check().expect("only filters that make sense get here");
        let needs = Needs::terms(settings.vocabulary()?).union(checked.needs());
        let reach = checked.reach().max(settings.max_reach);
        let (training, validation) = (load(scenes, &needs, reach)?, load(validate, &needs, reach)?);
        let generations = settings.generations as usize + 1;
        let judge = Judge::new(settings, &training, &validation, backend)?;
        let control = Control { stop: told.stop().clone(), time_limit, ..Control::default() };
        let outcome = Search::new(initial, judge)?.run(&control, &|event| {
            if let Event::Child { generation, judged, of } = event {
                // The search looks at the flag itself.
                let _ = told.tell(generation as usize * of + judged, generations * of);
            }
        })?;
        Ok(outcome)
    }
}

/// A program with how it does.
fn row<'py>(py: Python<'py>, finalist: &Finalist, name: &str) -> PyResult<Bound<'py, PyDict>> {
    let Finalist { judged, validation, .. } = finalist;
    let filter = filter::Filter { name: name.to_owned(), ..judged.genome.filter().clone() };
    let row = PyDict::new(py);
    row.set_item("complexity", judged.genome.size())?;
    row.set_item("nanoseconds_per_pixel", judged.cost)?;
    row.set_item("loss", judged.error)?;
    row.set_item("validation_loss", validation.map(|[loss, ..]| loss))?;
    row.set_item("rel_mse", validation.map(|[_, rel_mse, _]| rel_mse))?;
    row.set_item("trimmed_rel_mse", validation.map(|[.., trimmed]| trimmed))?;
    let stages = filter::stages(&filter.check().expect("genomes make sense"));
    row.set_item("equation", stages)?;
    row.set_item("filter", Bound::new(py, Filter(filter))?)?;
    Ok(row)
}
