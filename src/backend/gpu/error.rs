//! What can go wrong with a GPU, and what to do about it.

use bytesize::ByteSize;

/// Why a filter could not run on a GPU. Every message ends with the way out.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// There is no adapter at all.
    #[error(
        "no GPU was found: no driver for Vulkan, Metal or Direct3D 12 answers; \
         `--backend jit` runs on the processor"
    )]
    NoAdapter,
    /// No adapter is called that.
    #[error(
        "there is no GPU `{wanted}`; `tamis gpus` lists them: {}; `--backend jit` runs on the \
         processor", available.join(", ")
    )]
    NoSuchAdapter {
        /// What was asked for.
        wanted: String,
        /// The names of those that there are.
        available: Vec<String>,
    },
    /// Several adapters are called that.
    #[error("`{wanted}` fits several GPUs: {}; give an index of `tamis gpus`", fitting.join(", "))]
    Ambiguous {
        /// What was asked for.
        wanted: String,
        /// Those that it fits.
        fitting: Vec<String>,
    },
    /// The adapter cannot do what every WebGPU adapter can.
    #[error(
        "{adapter} is too small: {limit} is {has}, at least {needs} is needed; `--backend jit` runs on the processor"
    )]
    Limits {
        /// The adapter's name.
        adapter: String,
        /// Which limit.
        limit: &'static str,
        /// What it is.
        has: u64,
        /// What it must be.
        needs: u64,
    },
    /// The adapter could not be opened.
    #[error("{adapter} could not be opened: {reason}; `--backend jit` runs on the processor")]
    Open {
        /// The adapter's name.
        adapter: String,
        /// What its driver said.
        reason: String,
    },
    /// The driver refused a shader or a command: an error of ours, or of the driver.
    #[error("{adapter} refused {what}: {reason}; `--backend jit` runs on the processor")]
    Refused {
        /// The adapter's name.
        adapter: String,
        /// What it was given.
        what: &'static str,
        /// What was said.
        reason: String,
    },
    /// A buffer could not be allocated.
    #[error(
        "{adapter} is out of memory: {} for {what}; give it less at a time \
         (`--max-memory 256M`), or use `--backend jit`",
        ByteSize(*bytes)
    )]
    OutOfMemory {
        /// The adapter's name.
        adapter: String,
        /// What the memory was for.
        what: &'static str,
        /// How much.
        bytes: u64,
    },
    /// Not even the smallest piece of the image fits.
    #[error(
        "{} of GPU memory are too few: one pixel and its window need {}; raise `--max-memory`, or \
         use `--backend jit`",
        ByteSize(*available), ByteSize(*needed)
    )]
    TooLittleMemory {
        /// What is allowed.
        available: u64,
        /// What is needed.
        needed: u64,
    },
    /// The device is gone: a reset, a removed card, a driver that gave up.
    #[error("{adapter} was lost while it worked: {reason}; run again, or use `--backend jit`")]
    Lost {
        /// The adapter's name.
        adapter: String,
        /// What is known of it.
        reason: String,
    },
}
