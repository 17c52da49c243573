//! What can go wrong on the command line.

use std::io;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use crate::backend::BackendError;
use crate::denoise::DenoiseError;
use crate::evolve::{self, programs};
use crate::explain;
use crate::export::ExportError;
use crate::filter::{FilterFileError, ResizeError};
use crate::image::{ImageError, LockError};
use crate::scene::SceneError;
use crate::tune;

/// Why a command could not do its work.
#[derive(Debug, thiserror::Error)]
pub(super) enum Error {
    /// The command line asks for what makes no sense.
    #[error("{0}\nFor more information, try '--help'.")]
    Usage(String),
    /// A scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An image, or a file.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// What `--scenes` names is not there.
    #[error(
        "{path}: no such file or folder; name folders with 4spp.exr and reference.exr in them, or \
         NOISY.exr,REFERENCE.exr"
    )]
    NoSuchScenes {
        /// The argument.
        path: String,
    },
    /// A filter file.
    #[error(transparent)]
    FilterFile(Box<FilterFileError>),
    /// The search.
    #[error(transparent)]
    Search(#[from] evolve::Error),
    /// A worker of a search.
    #[error(transparent)]
    Worker(#[from] programs::ServeError),
    /// Tuning.
    #[error(transparent)]
    Tuning(Box<tune::Error>),
    /// The search failed on the way, and can go on later.
    #[error(
        "the search stopped, as expressions could not be judged: {source}; what was judged \
         before is in {checkpoint}: `tamis evolve --resume` with the same --out goes on from \
         there",
        checkpoint = checkpoint.display()
    )]
    Interrupted {
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
        /// Where it stands.
        checkpoint: PathBuf,
    },
    /// A filter cannot be explained.
    #[error(transparent)]
    Explain(#[from] explain::Error),
    /// An image cannot be filtered.
    #[error(transparent)]
    Denoise(#[from] DenoiseError),
    /// A filter has no such radius.
    #[error(transparent)]
    Radius(#[from] ResizeError),
    /// There is no machine code on this computer.
    #[error("no machine code can be made on this computer ({reason}); use `--backend interp`")]
    NoMachineCode {
        /// What is missing.
        reason: String,
    },
    /// There is no code for GPUs in this program.
    #[cfg(not(feature = "gpu"))]
    #[error("the program was built without the feature `gpu`; use `--backend jit`")]
    NoGpu,
    /// A back end cannot be used.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// Results of an older run would be replaced.
    #[error(
        "{run}: there is an older run here; go on with it (--resume), write elsewhere \
         ({option}), or replace it (--overwrite)"
    )]
    OlderRun {
        /// Its folder, or its checkpoint.
        run: String,
        /// The option that names where results go.
        option: &'static str,
    },
    /// The list of a run's scenes cannot be read.
    #[error("{path}: not the list of a run's scenes: {source}; name them with --scenes")]
    Recall {
        /// The file.
        path: String,
        /// Why not.
        source: serde_json::Error,
    },
    /// Some of several inputs are not there.
    #[error("nothing was done, as {missing} of {of} inputs cannot be found:{listing}")]
    MissingInputs {
        /// How many.
        missing: usize,
        /// Of how many.
        of: usize,
        /// Each with the system's reason, on a line of its own.
        listing: String,
    },
    /// What an argument stands for is not there.
    #[error("{name}: nothing was found: {reason}")]
    NothingFound {
        /// The argument.
        name: String,
        /// Why.
        reason: String,
    },
    /// Frames that were asked for are not there.
    #[error(
        "{name}: nothing was done, as there are no frames {frames}, which --frames names; \
         --keep-going goes on without them"
    )]
    MissingFrames {
        /// The argument.
        name: String,
        /// Their numbers.
        frames: String,
    },
    /// Some of several frames failed, each with an error of its own.
    #[error("{failed} of {of} frames failed:{listing}")]
    Frames {
        /// How many.
        failed: usize,
        /// Of how many.
        of: usize,
        /// Each with its reason, on a line of its own.
        listing: String,
    },
    /// An error about a file that nobody named, with the name that people know.
    #[error("{text}")]
    Renamed {
        /// What the error says, causes included.
        text: String,
        /// Its exit status.
        status: u8,
    },
    /// Standard input could not be kept, or no place made for a result that goes to
    /// standard output.
    #[error(
        "{folder}: cannot keep what goes through standard input or output: {0}; set TMPDIR to \
         another folder",
        folder = std::env::temp_dir().display()
    )]
    Stream(io::Error),
    /// A filter could not be exported.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// A program that an option names is not there.
    #[error("{option} {program}: it cannot be started: {source}; name a program that can")]
    NoProgram {
        /// The option.
        option: &'static str,
        /// The program.
        program: String,
        /// Why not.
        source: io::Error,
    },
    /// A program failed.
    #[error("{program} {doing}: {reason}")]
    Program {
        /// The program.
        program: String,
        /// At what.
        doing: &'static str,
        /// How it ended, and what it said.
        reason: String,
    },
    /// The folder for results cannot be made.
    #[error("{path}: cannot make the folder: {source}; choose another with {option}")]
    Folder {
        /// The folder.
        path: String,
        /// The option that names it.
        option: &'static str,
        /// Why.
        source: io::Error,
    },
    /// The folder of a page is not there.
    #[error(
        "--html {}: there is no folder {}; make it first, or name another file",
        page.display(), folder.display()
    )]
    NoFolder {
        /// The page.
        page: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },
    /// Nothing can be written into the folder for results.
    #[error("{source}; choose another folder with {option}")]
    Unwritable {
        /// The option that names it.
        option: &'static str,
        /// Why not.
        source: ImageError,
    },
    /// Another run writes where this one is to.
    #[error("{source} ({option})")]
    Locked {
        /// The option that names the place.
        option: &'static str,
        /// Who.
        source: LockError,
    },
    /// Signals cannot be caught.
    #[error("cannot listen for signals such as Ctrl-C: {0}")]
    Signal(io::Error),
    /// The threads could not be started.
    #[error("cannot start {threads} threads: {source}; ask for fewer with --threads")]
    Threads {
        /// How many were asked for.
        threads: NonZeroUsize,
        /// Why not.
        source: rayon::ThreadPoolBuildError,
    },
    /// A thread beside those could not be started.
    #[error("cannot start a thread: {0}; end other programs, or raise the limit (ulimit -u)")]
    Thread(io::Error),
    /// The results could not be printed.
    #[error("cannot write to stdout: {0}")]
    Stdout(io::Error),
}

impl From<FilterFileError> for Error {
    fn from(error: FilterFileError) -> Self {
        Self::FilterFile(Box::new(error))
    }
}

impl From<tune::Error> for Error {
    fn from(error: tune::Error) -> Self {
        Self::Tuning(Box::new(error))
    }
}

impl Error {
    /// What went wrong with its causes, as far as it does not name them itself.
    pub(super) fn with_causes(&self) -> String {
        evolve::with_causes(self)
    }

    /// The exit status that says so.
    pub(super) fn status(&self) -> u8 {
        match self {
            #[cfg(not(feature = "gpu"))]
            Self::NoGpu => 1,
            Self::Usage(_) | Self::Radius(_) | Self::Search(evolve::Error::Setting { .. }) => 2,
            Self::Renamed { status, .. } => *status,
            Self::Tuning(error) if matches!(**error, tune::Error::Setting { .. }) => 2,
            Self::Scene(_)
            | Self::Image(_)
            | Self::NoSuchScenes { .. }
            | Self::FilterFile(_)
            | Self::Search(_)
            | Self::Worker(_)
            | Self::Tuning(_)
            | Self::Interrupted { .. }
            | Self::Explain(_)
            | Self::Denoise(_)
            | Self::Backend(_)
            | Self::NoMachineCode { .. }
            | Self::MissingInputs { .. }
            | Self::OlderRun { .. }
            | Self::Recall { .. }
            | Self::NothingFound { .. }
            | Self::MissingFrames { .. }
            | Self::Frames { .. }
            | Self::Stream(_)
            | Self::Export(_)
            | Self::NoProgram { .. }
            | Self::Program { .. }
            | Self::Folder { .. }
            | Self::NoFolder { .. }
            | Self::Unwritable { .. }
            | Self::Locked { .. }
            | Self::Signal(_)
            | Self::Threads { .. }
            | Self::Thread(_)
            | Self::Stdout(_) => 1,
        }
    }
}
