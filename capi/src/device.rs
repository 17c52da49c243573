//! Devices: what runs filters, and on how many threads.

use std::ffi::c_int;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex};

use rayon::{ThreadPool, ThreadPoolBuilder};
use tamis::backend::{Backend, Choice, Opening};
use tamis::plan::Precision;

use crate::error::Failure;
use crate::lock::lock;
use crate::parameter::{BOOL, INT, STRING, find, unknown};
use crate::reports::Errors;
use crate::types::{
    TAMIS_DEVICE_TYPE_AUTO, TAMIS_DEVICE_TYPE_CPU, TAMIS_DEVICE_TYPE_DEFAULT,
    TAMIS_DEVICE_TYPE_GPU, TAMIS_ERROR_UNKNOWN, TAMIS_ERROR_UNSUPPORTED_HARDWARE, TAMIS_VERSION,
    TamisDeviceType,
};

/// The most threads that a device may have.
const MOST_THREADS: c_int = 4096;

/// The memory for buffers on a GPU, in MiB, if nobody says how much.
const GPU_MEMORY: c_int = 1024;

/// What runs filters. Several threads may use one at a time.
pub struct Device {
    pub(crate) errors: Errors,
    state: Mutex<State>,
}

struct State {
    settings: Settings,
    /// What runs filters with the settings that were committed last.
    opened: Option<Arc<Opened>>,
    changed: bool,
}

#[derive(Clone)]
struct Settings {
    choice: Choice,
    gpu: Option<String>,
    precision: Precision,
    /// 0 for as many as the processor has.
    threads: c_int,
    /// For buffers on a GPU.
    gpu_memory: c_int,
    /// Without effect.
    affinity: bool,
}

/// A device that is ready.
pub(crate) struct Opened {
    pub(crate) backend: Arc<dyn Backend>,
    pub(crate) precision: Precision,
    /// Threads of its own.
    threads: Option<ThreadPool>,
    /// What the back end had to say.
    remarks: Arc<Mutex<Vec<String>>>,
}

impl Device {
    pub(crate) fn new(kind: TamisDeviceType) -> Result<Self, Failure> {
        let choice = match kind {
            TAMIS_DEVICE_TYPE_DEFAULT | TAMIS_DEVICE_TYPE_CPU => Choice::default(),
            TAMIS_DEVICE_TYPE_GPU => Choice::Gpu,
            TAMIS_DEVICE_TYPE_AUTO => Choice::Auto,
            _ => {
                return Err(Failure::argument(format!(
                    "{kind} is no type of device; take one of TAMIS_DEVICE_TYPE_DEFAULT (0), \
                     CPU (1), GPU (2), AUTO (3)"
                )));
            }
        };
        let precision = Precision::default();
        let settings = Settings {
            choice,
            gpu: None,
            precision,
            threads: 0,
            gpu_memory: GPU_MEMORY,
            affinity: true,
        };
        let state = State { settings, opened: None, changed: true };
        Ok(Self { errors: Errors::default(), state: Mutex::new(state) })
    }

    fn change(
        &self,
        change: impl FnOnce(&mut Settings) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let mut state = lock(&self.state);
        change(&mut state.settings)?;
        state.changed = true;
        Ok(())
    }

    pub(crate) fn set_int(&self, name: &str, value: c_int) -> Result<(), Failure> {
        self.change(|settings| {
            let ints = [
                ("numThreads", (&mut settings.threads, 0..=MOST_THREADS)),
                ("gpuMemoryMB", (&mut settings.gpu_memory, 1..=c_int::MAX)),
            ];
            let (slot, range) = find(INT, ints, name)?;
            if !range.contains(&value) {
                let (least, most) = (range.start(), range.end());
                let message = format!("`{name}` is {value}; it must be from {least} to {most}");
                return Err(Failure::argument(message));
            }
            *slot = value;
            Ok(())
        })
    }

    pub(crate) fn set_bool(&self, name: &str, value: bool) -> Result<(), Failure> {
        self.change(|settings| {
            *find(BOOL, [("setAffinity", &mut settings.affinity)], name)? = value;
            Ok(())
        })
    }

    pub(crate) fn set_string(&self, name: &str, value: &str) -> Result<(), Failure> {
        self.change(|settings| match name {
            "backend" => {
                let names = Choice::ALL.map(Choice::name);
                settings.choice =
                    Choice::named(value).ok_or_else(|| unknown("back end", value, &names))?;
                Ok(())
            }
            "gpu" => {
                settings.gpu = Some(value.to_owned()).filter(|gpu| !gpu.is_empty());
                Ok(())
            }
            "precision" => {
                let names = Precision::ALL.map(Precision::name);
                settings.precision =
                    Precision::named(value).ok_or_else(|| unknown("precision", value, &names))?;
                Ok(())
            }
            _ => Err(unknown(STRING, name, &["backend", "gpu", "precision"])),
        })
    }

    pub(crate) fn get_int(&self, name: &str) -> Result<c_int, Failure> {
        let state = lock(&self.state);
        let Settings { threads, gpu_memory, .. } = state.settings;
        let ints =
            [("version", TAMIS_VERSION), ("numThreads", threads), ("gpuMemoryMB", gpu_memory)];
        find(INT, ints, name)
    }

    pub(crate) fn get_string(&self, name: &str) -> Result<String, Failure> {
        let what = find(STRING, [("backend", true), ("remarks", false)], name)?;
        let opened = self.opened()?;
        Ok(match what {
            true => opened.backend.name().to_owned(),
            false => lock(&opened.remarks).join("\n"),
        })
    }

    /// Opens the back end and starts the threads, if anything changed.
    pub(crate) fn commit(&self) -> Result<(), Failure> {
        // Whoever else commits waits for it: a back end is opened once.
        let mut state = lock(&self.state);
        if state.changed {
            state.opened = Some(Arc::new(Opened::new(&state.settings)?));
            state.changed = false;
        }
        Ok(())
    }

    /// The device as it was committed.
    pub(crate) fn opened(&self) -> Result<Arc<Opened>, Failure> {
        let state = lock(&self.state);
        match &state.opened {
            Some(opened) if !state.changed => Ok(opened.clone()),
            _ => Err(Failure::operation(
                "the device was changed since it was committed, or never was; call \
                 tamisCommitDevice",
            )),
        }
    }
}

impl Opened {
    fn new(settings: &Settings) -> Result<Self, Failure> {
        let remarks: Arc<Mutex<Vec<String>>> = Arc::default();
        let heard = remarks.clone();
        let opening = Opening {
            precision: settings.precision,
            gpu: settings.gpu.clone(),
            gpu_memory: u64::from(settings.gpu_memory.cast_unsigned()) << 20,
            remarks: Arc::new(move |remark| lock(&heard).push(remark.to_owned())),
        };
        let backend = settings.choice.open(&opening).map_err(|error| {
            let name = settings.choice.name();
            let message = format!("the back end `{name}` cannot be opened: {error}");
            Failure::new(TAMIS_ERROR_UNSUPPORTED_HARDWARE, message)
        })?;
        let threads = usize::try_from(settings.threads).ok().and_then(NonZeroUsize::new);
        let threads = threads.map(|threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads.get()).build();
            pool.map_err(|error| {
                let message = format!("cannot start {threads} threads: {error}; ask for fewer");
                Failure::new(TAMIS_ERROR_UNKNOWN, message)
            })
        });
        let (precision, threads) = (settings.precision, threads.transpose()?);
        Ok(Self { backend: backend.into(), precision, threads, remarks })
    }

    /// Does something on the device's threads.
    pub(crate) fn within<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.threads {
            Some(threads) => threads.install(work),
            None => work(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_is_the_packages() {
        let parts: Vec<c_int> = env!("CARGO_PKG_VERSION")
            .split('.')
            .map(|part| part.parse().expect("a number"))
            .collect();
        assert_eq!(TAMIS_VERSION, 10000 * parts[0] + 100 * parts[1] + parts[2]);
    }

    #[test]
    fn a_change_asks_for_a_commit() {
        let device = Device::new(TAMIS_DEVICE_TYPE_CPU).expect("a type");
        assert!(device.opened().is_err());
        device.commit().expect("the processor is there");
        let opened = device.opened().expect("it is committed");
        device.commit().expect("nothing changed");
        assert!(Arc::ptr_eq(&opened, &device.opened().expect("it still is")));
        device.set_int("numThreads", 3).expect("a number");
        assert!(device.opened().is_err());
        device.commit().expect("three threads");
        assert_eq!(device.opened().expect("committed").within(rayon::current_num_threads), 3);
        assert_eq!(device.get_string("backend").expect("committed"), Choice::default().name());
    }
}
