//! Denoisers, as programs ask for them.

use std::num::NonZeroUsize;
use std::sync::Arc;

use super::{DenoiseError, Denoiser, Options};
use crate::backend::{Backend, Choice, Opening};
use crate::filter::Filter;
use crate::plan::{Passes, Precision};
use crate::scene::Repair;

/// What a [`Denoiser`] is to be. Whatever nobody asks for is as `tamis denoise` has it.
#[derive(Clone, Default)]
#[must_use = "`build` makes a denoiser of it"]
pub struct Builder {
    options: Options,
    backend: Source,
    opening: Opening,
    threads: Option<NonZeroUsize>,
}

/// Where the back end comes from.
#[derive(Clone)]
enum Source {
    Opened(Choice),
    Given(Arc<dyn Backend>),
}

impl Default for Source {
    fn default() -> Self {
        Self::Opened(Choice::default())
    }
}

impl Builder {
    /// With what is filtered; with `tamis` if nothing is said.
    pub fn filter(mut self, filter: Filter) -> Self {
        self.options.filter = Some(filter);
        self
    }

    /// What runs the filter: machine code if nothing is said.
    pub fn backend(mut self, choice: Choice) -> Self {
        self.backend = Source::Opened(choice);
        self
    }

    /// A back end that is open already; several denoisers may share it.
    pub fn on(mut self, backend: Arc<dyn Backend>) -> Self {
        self.backend = Source::Given(backend);
        self
    }

    /// Which GPU, if one is used: an index or a part of its name.
    pub fn gpu(mut self, name: impl Into<String>) -> Self {
        self.opening.gpu = Some(name.into());
        self
    }

    /// How accurate the result is: within 1e-5 of the filter's exact meaning if nothing is said.
    pub fn precision(mut self, precision: Precision) -> Self {
        self.options.passes = Passes { precision, ..self.options.passes };
        self
    }

    /// So many threads of its own; those of the global rayon pool if nothing is said. No result
    /// depends on them.
    pub fn threads(mut self, threads: NonZeroUsize) -> Self {
        self.threads = Some(threads);
        self
    }

    /// How much of the result is taken, from 0 to 1; the rest is the noisy colour.
    pub fn strength(mut self, strength: f32) -> Self {
        self.options.strength = Some(strength);
        self
    }

    /// What becomes of pixels that are no numbers: they are repaired if nothing is said.
    pub fn repair(mut self, repair: Repair) -> Self {
        self.options.load.repair = repair;
        self
    }

    /// Memory for what is made of files, in bytes, and for buffers on a GPU. Larger files are
    /// filtered part by part, to the same bits; frames in memory are not.
    pub fn max_memory(mut self, bytes: u64) -> Self {
        self.options.max_memory = Some(bytes);
        self.opening.gpu_memory = bytes;
        self
    }

    /// Who is told which back end [`Choice::Auto`] takes, and when a GPU failed on the way.
    pub fn remarks(mut self, remarks: impl Fn(&str) + Send + Sync + 'static) -> Self {
        self.opening.remarks = Arc::new(remarks);
        self
    }

    /// Everything that files can be denoised with; replaces what was said so far of filter,
    /// precision, strength, repair and memory.
    pub fn options(mut self, options: Options) -> Self {
        self.options = options;
        self
    }

    /// Opens the back end.
    ///
    /// # Errors
    /// If this computer does not have it, threads cannot be started, the filter makes no sense,
    /// or the strength is no share.
    pub fn build(mut self) -> Result<Denoiser, DenoiseError> {
        if let Some(filter) = &self.options.filter {
            let check = filter.check().map(|_| ());
            check.map_err(|source| DenoiseError::Filter {
                filter: filter.name.clone(),
                source: Box::new(source),
            })?;
        }
        if let Some(strength) = self.options.strength
            && !(0.0..=1.0).contains(&strength)
        {
            return Err(DenoiseError::Strength(strength));
        }
        let backend = match self.backend {
            Source::Given(backend) => backend,
            Source::Opened(choice) => {
                self.opening.precision = self.options.passes.precision;
                choice.open(&self.opening).map_err(DenoiseError::Backend)?.into()
            }
        };
        let threads = self.threads.map(|threads| {
            let pool = rayon::ThreadPoolBuilder::default().num_threads(threads.get()).build();
            pool.map_err(|source| DenoiseError::Threads { threads, source })
        });
        let threads = threads.transpose()?;
        Ok(Denoiser { threads, ..Denoiser::new(backend, self.options) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_makes_no_sense_is_refused_when_it_is_built() {
        let error = |builder: Builder| builder.build().err().expect("refused").to_string();
        assert!(error(Builder::default().strength(f32::NAN)).contains("from 0 to 1"));
        let nothing = Filter { stages: Vec::new(), ..crate::filter::shipped::best() };
        assert!(error(Builder::default().filter(nothing)).contains("tamis"));
    }

    #[cfg(not(feature = "gpu"))]
    #[test]
    fn a_back_end_that_was_not_built_is_named_with_its_feature() {
        let error = Builder::default().backend(Choice::Gpu).build().err().expect("there is none");
        assert!(error.to_string().contains("feature `gpu`"), "{error}");
    }
}
