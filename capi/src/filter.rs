//! Filters: what was set, what of it is committed, and what the latest run said.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::c_int;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use tamis::denoise::Denoiser;
use tamis::expr::Quantity;
use tamis::filter::{self as library, shipped};
use tamis::scene::Repair;

use crate::callback::Monitor;
use crate::device::{Device, Opened};
use crate::error::Failure;
use crate::execution::{Committed, Outcome};
use crate::image::Image;
use crate::lock::try_lock;
use crate::parameter::{BOOL, FLOAT, INT, Parameters, STRING, find, unknown};
use crate::slot::Slot;
use crate::types::TAMIS_QUALITY_FAST;

/// What Open Image Denoise calls its filter for renders.
const RAY_TRACING: &str = "RT";
/// The shipped filter that is fast.
const FAST: &str = "tamis-fast";

/// One of the times that a run tells of.
type Time = fn(&Outcome) -> Duration;

/// All of them, by name.
const TIMES: [(&str, Time); 4] = [
    ("preparingSeconds", |outcome| outcome.preparing),
    ("planningSeconds", |outcome| outcome.planning),
    ("compilationSeconds", |outcome| outcome.compilation),
    ("filteringSeconds", |outcome| outcome.filtering),
];

/// A filter of a device. One thread uses it at a time; a call that finds another one at it fails.
pub struct Filter {
    pub(crate) device: Arc<Device>,
    state: Mutex<State>,
}

struct State {
    program: Program,
    repair: Repair,
    parameters: Parameters,
    images: BTreeMap<Slot, Image>,
    monitor: Monitor,
    committed: Option<(Recipe, Committed)>,
    changed: bool,
    outcome: Option<Outcome>,
}

/// What a denoiser is made with. One is kept, with the code that it made, until this changes.
#[derive(PartialEq)]
struct Recipe {
    program: Program,
    is_fast: bool,
    strength: f32,
    repair: Repair,
}

/// What is computed.
#[derive(Clone, Debug, PartialEq)]
enum Program {
    /// The shipped filter that has the quality.
    Shipped,
    /// A filter that was asked for, whatever the quality.
    Chosen(library::Filter),
}

impl Program {
    fn named(text: &str) -> Result<Self, Failure> {
        if text == RAY_TRACING {
            return Ok(Self::Shipped);
        }
        library::Filter::find(text).map(Self::Chosen).map_err(|error| {
            Failure::argument(format!("{error}\n`{RAY_TRACING}` is the one that ships as the best"))
        })
    }

    fn filter(&self, is_fast: bool) -> library::Filter {
        match self {
            Self::Chosen(filter) => filter.clone(),
            Self::Shipped if is_fast => library::Filter::named(FAST).expect("it ships"),
            Self::Shipped => shipped::best(),
        }
    }
}

impl Filter {
    pub(crate) fn new(device: Arc<Device>, kind: &str) -> Result<Self, Failure> {
        device.opened()?;
        let state = State {
            program: Program::named(kind)?,
            repair: Repair::default(),
            parameters: Parameters::default(),
            images: BTreeMap::new(),
            monitor: Monitor::default(),
            committed: None,
            changed: true,
            outcome: None,
        };
        Ok(Self { device, state: Mutex::new(state) })
    }

    /// Everything that calls change. Nobody waits for it: a progress monitor that asked its own
    /// filter would wait forever.
    fn state(&self) -> Result<MutexGuard<'_, State>, Failure> {
        try_lock(&self.state).ok_or_else(|| {
            Failure::operation(
                "another call is using this filter; one thread may use it at a time, and its \
                 progress monitor may not",
            )
        })
    }

    fn change(
        &self,
        change: impl FnOnce(&mut State) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let mut state = self.state()?;
        change(&mut state)?;
        state.changed = true;
        Ok(())
    }

    pub(crate) fn set_image(&self, slot: Slot, image: Image) -> Result<(), Failure> {
        self.change(|state| {
            state.images.insert(slot, image);
            Ok(())
        })
    }

    pub(crate) fn unset_image(&self, slot: Slot) -> Result<(), Failure> {
        self.change(|state| {
            state.images.remove(&slot);
            Ok(())
        })
    }

    pub(crate) fn set_bool(&self, name: &str, value: bool) -> Result<(), Failure> {
        self.change(|state| state.parameters.set_bool(name, value))
    }

    pub(crate) fn set_int(&self, name: &str, value: c_int) -> Result<(), Failure> {
        self.change(|state| state.parameters.set_int(name, value))
    }

    pub(crate) fn set_float(&self, name: &str, value: f32) -> Result<(), Failure> {
        self.change(|state| state.parameters.set_float(name, value))
    }

    pub(crate) fn set_string(&self, name: &str, value: &str) -> Result<(), Failure> {
        self.change(|state| match name {
            "filter" => {
                state.program = Program::named(value)?;
                Ok(())
            }
            "repair" => {
                let repairs =
                    [("median", Repair::Median), ("error", Repair::Error), ("none", Repair::None)];
                state.repair = find("repair", repairs, value)?;
                Ok(())
            }
            _ => Err(unknown(STRING, name, &["filter", "repair"])),
        })
    }

    /// Takes effect at once, as it is no parameter.
    pub(crate) fn set_monitor(&self, monitor: Monitor) -> Result<(), Failure> {
        self.state()?.monitor = monitor;
        Ok(())
    }

    pub(crate) fn get_bool(&self, name: &str) -> Result<bool, Failure> {
        let mut parameters = self.state()?.parameters;
        find(BOOL, parameters.bools(), name).copied()
    }

    pub(crate) fn get_int(&self, name: &str) -> Result<c_int, Failure> {
        let state = self.state()?;
        if name == "keptPixels" {
            let kept = state.outcome()?.kept;
            return Ok(c_int::try_from(kept).unwrap_or(c_int::MAX));
        }
        let mut parameters = state.parameters;
        let [quality, samples, memory] = parameters.ints();
        find(INT, [quality, samples, memory, ("keptPixels", &mut 0)], name).copied()
    }

    pub(crate) fn get_float(&self, name: &str) -> Result<f32, Failure> {
        let state = self.state()?;
        let mut parameters = state.parameters;
        if let Some((_, value)) = parameters.floats().into_iter().find(|(own, _)| *own == name) {
            return Ok(*value);
        }
        if let Some((_, time)) = TIMES.into_iter().find(|(own, _)| *own == name) {
            return Ok(time(state.outcome()?).as_secs_f32());
        }
        let floats = parameters.floats().map(|(own, _)| own);
        let names: Vec<&str> = floats.into_iter().chain(TIMES.map(|(own, _)| own)).collect();
        Err(unknown(FLOAT, name, &names))
    }

    pub(crate) fn get_string(&self, name: &str) -> Result<String, Failure> {
        let state = self.state()?;
        match name {
            "filter" => Ok(state.recipe().filter().name),
            "notes" => Ok(state.outcome()?.notes.clone()),
            "backend" => Ok(state.outcome()?.backend.to_owned()),
            _ => Err(unknown(STRING, name, &["filter", "notes", "backend"])),
        }
    }

    pub(crate) fn commit(&self) -> Result<(), Failure> {
        let mut state = self.state()?;
        let device = self.device.opened()?;
        state.committed = Some(state.commit(device)?);
        state.changed = false;
        Ok(())
    }

    /// # Safety
    /// As for [`Committed::run`], of the images that are set.
    pub(crate) unsafe fn execute(&self) -> Result<(), Failure> {
        let mut state = self.state()?;
        let current = state.committed.as_ref().filter(|_| !state.changed);
        let (_, committed) = current.ok_or_else(|| {
            Failure::operation(
                "the filter was changed since it was committed, or never was; call \
                 tamisCommitFilter",
            )
        })?;
        // SAFETY: the caller promises it, and what is committed is what is set.
        let outcome = unsafe { committed.run(state.monitor) };
        // A run that failed has nothing to say, and neither has the one before it.
        state.outcome = None;
        state.outcome = Some(outcome?);
        Ok(())
    }
}

impl State {
    fn outcome(&self) -> Result<&Outcome, Failure> {
        self.outcome.as_ref().ok_or_else(|| {
            Failure::operation("the filter was not executed yet, or its latest run failed")
        })
    }

    /// What is to be committed, if it makes sense.
    fn commit(&self, device: Arc<Opened>) -> Result<(Recipe, Committed), Failure> {
        let missing = |slot: Slot, what: &str| {
            let message = format!("there is no image `{slot}`; set it to {what}");
            Failure::operation(message)
        };
        let mut inputs = self.images.clone();
        let output = inputs.remove(&Slot::Output);
        let output = output.ok_or_else(|| missing(Slot::Output, "where the result goes"))?;
        if !inputs.contains_key(&Slot::COLOR) {
            return Err(missing(Slot::COLOR, "the noisy image"));
        }
        for (slot, image) in &inputs {
            let ((width, height), (columns, rows)) = (image.size(), output.size());
            if (width, height) != (columns, rows) {
                return Err(Failure::operation(format!(
                    "`{slot}` has {width} x {height} pixels, but `output` {columns} x {rows}; \
                     images of one frame have one size"
                )));
            }
        }
        if self.parameters.srgb && inputs.contains_key(&Slot::COLOR_VARIANCE) {
            return Err(Failure::operation(format!(
                "`{}` is set and so is `srgb`; variances of encoded colours cannot be used: \
                 unset them, or give linear colours",
                Slot::COLOR_VARIANCE
            )));
        }
        let recipe = self.recipe();
        let denoiser = match &self.committed {
            Some((before, Committed { denoiser, device: on, .. }))
                if *before == recipe && Arc::ptr_eq(on, &device) =>
            {
                denoiser.clone()
            }
            _ => Arc::new(recipe.denoiser(&device)?),
        };
        let absent = absent(denoiser.filter_used(), &inputs);
        if !absent.is_empty() {
            return Err(Failure::operation(format!(
                "filter `{}` cannot do without images that are not set: {}; set them, or take \
                 another filter",
                denoiser.filter_used().name,
                absent.join(", ")
            )));
        }
        let parameters = self.parameters;
        Ok((recipe, Committed { denoiser, device, inputs, output, parameters }))
    }

    fn recipe(&self) -> Recipe {
        Recipe {
            program: self.program.clone(),
            is_fast: self.parameters.quality == TAMIS_QUALITY_FAST,
            strength: self.parameters.strength,
            repair: self.repair,
        }
    }
}

/// The images that a filter cannot do without, and that are not there.
fn absent(filter: &library::Filter, inputs: &BTreeMap<Slot, Image>) -> Vec<String> {
    let checked = filter.check().expect("a denoiser was made of it");
    let required = checked.required();
    let planes = required.named().into_iter().flatten();
    // Whatever no image holds is made, variances that are not set among it.
    let planes =
        planes.filter(|plane| plane.feature.is_stored() && plane.quantity != Quantity::Variance);
    let slots: BTreeSet<Slot> =
        planes.map(|plane| Slot::Feature(plane.feature, Quantity::Value)).collect();
    slots.iter().filter(|slot| !inputs.contains_key(slot)).map(Slot::to_string).collect()
}

impl Recipe {
    fn filter(&self) -> library::Filter {
        self.program.filter(self.is_fast)
    }

    fn denoiser(&self, device: &Opened) -> Result<Denoiser, Failure> {
        let builder = Denoiser::builder()
            .filter(self.filter())
            .on(device.backend.clone())
            .precision(device.precision)
            .strength(self.strength)
            .repair(self.repair);
        Ok(builder.build()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Layout;
    use crate::types::{TAMIS_DEVICE_TYPE_CPU, TAMIS_FORMAT_FLOAT3};

    fn filter() -> Filter {
        let device = Device::new(TAMIS_DEVICE_TYPE_CPU).expect("a type");
        device.commit().expect("the processor is there");
        Filter::new(Arc::new(device), RAY_TRACING).expect("it ships")
    }

    fn set(filter: &Filter, slot: Slot, (width, height): (usize, usize)) {
        let format = TAMIS_FORMAT_FLOAT3;
        let layout =
            Layout { format, width, height, byte_offset: 0, pixel_stride: 0, row_stride: 0 };
        // Nothing is executed: the memory is never looked at.
        let memory = std::ptr::without_provenance_mut(4096);
        let image = Image::new("image", 3, memory, layout).expect("it makes sense");
        filter.set_image(slot, image).expect("nobody else uses it");
    }

    #[test]
    fn code_is_kept_until_what_it_is_made_with_changes() {
        let filter = filter();
        let denoiser = || -> Arc<Denoiser> {
            filter.commit().expect("it makes sense");
            let state = filter.state().expect("nobody else uses it");
            state.committed.as_ref().expect("it is committed").1.denoiser.clone()
        };
        set(&filter, Slot::COLOR, (8, 4));
        set(&filter, Slot::Output, (8, 4));
        let first = denoiser();
        set(&filter, Slot::Output, (8, 4));
        filter.set_bool("hdr", false).expect("a parameter");
        assert!(Arc::ptr_eq(&first, &denoiser()), "images and ranges are not compiled");
        filter.set_int("quality", TAMIS_QUALITY_FAST).expect("a parameter");
        let fast = denoiser();
        assert_eq!(fast.filter_used().name, FAST);
        filter.set_string("filter", "tamis-formula").expect("it ships");
        assert_eq!(denoiser().filter_used().name, "tamis-formula");
    }

    #[test]
    fn what_is_missing_or_does_not_fit_is_refused_at_the_commit() {
        let filter = filter();
        let refused = |said: &str| {
            let failure = filter.commit().unwrap_err();
            assert!(failure.message.contains(said), "{failure:?}");
        };
        refused("no image `output`");
        set(&filter, Slot::Output, (8, 4));
        refused("no image `color`");
        set(&filter, Slot::COLOR, (4, 8));
        refused("`color` has 4 x 8 pixels, but `output` 8 x 4");
        set(&filter, Slot::COLOR, (8, 4));
        set(&filter, Slot::COLOR_VARIANCE, (8, 4));
        filter.set_bool("srgb", true).expect("a parameter");
        refused("variances of encoded colours");
        filter.unset_image(Slot::COLOR_VARIANCE).expect("nobody else uses it");
        filter.commit().expect("it makes sense now");
    }
}
