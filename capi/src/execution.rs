//! One run of a filter.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use tamis::denoise::{Denoiser, Report};
use tamis::image::metric;

use crate::callback::{Monitor, Watched};
use crate::device::Opened;
use crate::error::Failure;
use crate::image::Image;
use crate::parameter::Parameters;
use crate::slot::Slot;

/// A filter with everything that was committed.
pub(crate) struct Committed {
    pub(crate) denoiser: Arc<Denoiser>,
    pub(crate) device: Arc<Opened>,
    pub(crate) inputs: BTreeMap<Slot, Image>,
    pub(crate) output: Image,
    pub(crate) parameters: Parameters,
}

/// What there is to say of a run.
pub(crate) struct Outcome {
    pub(crate) preparing: Duration,
    pub(crate) planning: Duration,
    pub(crate) compilation: Duration,
    pub(crate) filtering: Duration,
    /// Pixels that kept what was to be averaged, each counted once per stage.
    pub(crate) kept: usize,
    pub(crate) notes: String,
    pub(crate) backend: &'static str,
}

impl Committed {
    /// Filters the images, and writes the result when all of them are read.
    ///
    /// # Safety
    /// The memory of the inputs can be read and that of the output written to, and nobody else
    /// writes to the former or uses the latter, until this function returns. They may overlap.
    pub(crate) unsafe fn run(&self, monitor: Monitor) -> Result<Outcome, Failure> {
        let parameters = self.parameters;
        let watched = Watched::new(monitor);
        let progress = |done: usize, of: usize| watched.tell(done as f64 / of as f64);
        let (width, height) = self.output.size();
        let mut frame = self.denoiser.frame(width, height).progress(&progress);
        for (&slot, image) in &self.inputs {
            // SAFETY: the caller promises that it can be read and that nobody else writes to it;
            // this function does when the frame and its views are gone.
            let view = unsafe { image.view() };
            frame = match slot {
                Slot::Feature(feature, quantity) => frame.feature(feature, quantity, view),
                Slot::Alpha => frame.alpha(view),
                Slot::Output => frame,
            };
        }
        if parameters.srgb {
            frame = frame.decoded(|sample| metric::linear(f64::from(sample)) as f32);
        }
        if let Some(samples) = u32::try_from(parameters.samples).ok().filter(|&samples| samples > 0)
        {
            frame = frame.samples(samples);
        }
        if watched.tell(0.0).is_break() {
            return Err(Failure::cancelled());
        }
        let pixels = self.device.within(|| frame.filter())?;
        watched.finish()?;
        let outcome = Outcome::of(&pixels.report);
        let pixels = match parameters {
            Parameters { srgb: true, .. } => {
                pixels.map(|color| color.map(|sample| metric::srgb(f64::from(sample)) as f32))
            }
            Parameters { hdr: false, .. } => {
                pixels.map(|color| color.map(|sample| sample.min(1.0)))
            }
            _ => pixels,
        };
        // SAFETY: the caller promises that it can be written to and that nobody else uses it; the
        // frame, which had the views of the inputs, is gone.
        let mut out = unsafe { self.output.view_mut() };
        pixels.write(&mut out)?;
        Ok(outcome)
    }
}

impl Outcome {
    fn of(report: &Report) -> Self {
        let notes: Vec<String> = report.notes.iter().map(ToString::to_string).collect();
        Self {
            preparing: report.preparing,
            planning: report.applied.planning,
            compilation: report.applied.compilation,
            filtering: report.applied.filtering,
            kept: report.applied.kept.iter().sum(),
            notes: notes.join("\n"),
            backend: report.backend,
        }
    }
}
