//! Ctrl-C, for runs that end with what they have by then.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::error::Error;
use super::log::Log;

/// A flag that Ctrl-C raises, saying `what` happens then. The second time it ends the program.
///
/// # Errors
/// If there can be no such handler.
pub(super) fn flag(log: Log, what: &'static str) -> Result<Arc<AtomicBool>, Error> {
    let stop = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        // Whoever asks twice does not want to wait.
        if raised.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        log.say(format_args!("\n{what} (Ctrl-C again to quit at once)"));
    })?;
    Ok(stop)
}
