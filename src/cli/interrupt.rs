//! Signals that end the program: temporary files go first, and some runs end with what they
//! have by then.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::error::Error;
use super::log::Log;
use crate::image::remove_temporary_files;

/// What a signal does before one ends the program.
static FIRST: Mutex<Option<First>> = Mutex::new(None);

struct First {
    log: Log,
    what: &'static str,
    raised: Arc<AtomicBool>,
}

/// From now on Ctrl-C raises a flag, saying `what` happens then. The second time it ends the
/// program.
pub(super) fn raise(flag: &Arc<AtomicBool>, log: Log, what: &'static str) {
    let first = First { log, what, raised: Arc::clone(flag) };
    *FIRST.lock().unwrap_or_else(PoisonError::into_inner) = Some(first);
}

/// Whether the program is to end.
fn ends() -> bool {
    let first = FIRST.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(First { log, what, raised }) = &*first else { return true };
    // Whoever asks twice does not want to wait.
    if raised.swap(true, Ordering::Relaxed) {
        return true;
    }
    log.say(format_args!("\n{what} (Ctrl-C again to quit at once)"));
    false
}

/// Listens from now on.
///
/// # Errors
/// If there can be no such handler.
#[cfg(unix)]
pub(super) fn listen() -> Result<(), Error> {
    use signal_hook::iterator::Signals;
    use signal_hook::low_level::exit;

    let mut signals = Signals::new(heard()).map_err(Error::Signal)?;
    let wait = move || {
        for signal in signals.forever() {
            if ends() {
                remove_temporary_files();
                // At once: threads that are at work may stand in the way of anything else.
                exit(128 + signal);
            }
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(wait).map_err(Error::Signal)?;
    Ok(())
}

/// The signals to listen to. The end of the terminal is none of them if the program was started
/// to ignore it, as `nohup` does. Ctrl-C is, though shells have what they start in the
/// background ignore it: whoever sends it there by hand means it.
#[cfg(unix)]
fn heard() -> Vec<i32> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

    // Linux tells what is ignored; elsewhere the terminal's end stays unheard.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    match ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()) {
        Some(mask) if mask >> (SIGHUP - 1) & 1 == 0 => vec![SIGINT, SIGTERM, SIGHUP],
        _ => vec![SIGINT, SIGTERM],
    }
}

/// Listens from now on.
///
/// # Errors
/// If there can be no such handler.
#[cfg(not(unix))]
pub(super) fn listen() -> Result<(), Error> {
    ctrlc::set_handler(|| {
        if ends() {
            remove_temporary_files();
            std::process::exit(130);
        }
    })
    .map_err(|error| Error::Signal(std::io::Error::other(error)))
}
