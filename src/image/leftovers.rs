//! Temporary files of runs that were killed, found by the next run that writes into the
//! same folder.
//!
//! A temporary file is called `.tamis-PROCESS-RANDOM`, and locked as long as it is written.
//! One that can be locked is left over if its process is gone or it is a day old. The lock
//! tells of processes that this one cannot see: those of other machines and containers that
//! write into a shared folder. Where files cannot be locked, age alone counts.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// What the names of temporary files begin with.
const PREFIX: &str = ".tamis-";

/// Nothing is written for so long.
const OLD: Duration = Duration::from_hours(24);

/// Longer than it takes to lock a file that was just made.
#[cfg(unix)]
const SETTLED: Duration = Duration::from_mins(1);

/// Folders that were looked through: once per process is enough.
static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// What the name of this process' temporary files begins with.
pub(super) fn prefix() -> String {
    format!("{PREFIX}{}-", std::process::id())
}

/// Keeps others from taking a file for left over as long as it is open.
pub(super) fn claim(file: &File) {
    // Elsewhere a lock would keep this process' other readers out.
    #[cfg(unix)]
    // Without a lock it takes a day until anybody takes the file for left over.
    let _ = file.try_lock();
    #[cfg(not(unix))]
    let _ = file;
}

/// Removes what killed runs left in a folder. That it cannot be read or changed is no
/// error here: writing will tell.
pub(super) fn sweep(folder: &Path) {
    let mut swept = SWEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if !swept.insert(folder.to_owned()) {
        return;
    }
    drop(swept);
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        if name.to_str().is_some_and(|name| is_left(&entry.path(), name)) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn is_left(path: &Path, name: &str) -> bool {
    let Some(rest) = name.strip_prefix(PREFIX) else { return false };
    let Ok(found) = fs::symlink_metadata(path) else { return false };
    if !found.is_file() {
        return false;
    }
    let age = found.modified().ok().and_then(|time| time.elapsed().ok()).unwrap_or_default();
    let process = rest.split_once('-').and_then(|(process, _)| process.parse().ok());
    age > OLD && !is_locked(path) || process.is_some_and(|process| is_abandoned(path, process, age))
}

/// Whether somebody has a file locked, as far as that can be told.
fn is_locked(path: &Path) -> bool {
    let file = OpenOptions::new().write(true).open(path);
    file.is_ok_and(|file| matches!(file.try_lock(), Err(fs::TryLockError::WouldBlock)))
}

/// Whether a file is certainly nobody's: it can be locked, and its process is gone.
#[cfg(unix)]
fn is_abandoned(path: &Path, process: u32, age: Duration) -> bool {
    let gone = match Path::new("/proc/self").exists() {
        true => !Path::new("/proc").join(process.to_string()).exists(),
        // Processes cannot be seen.
        false => process != std::process::id() && age > SETTLED,
    };
    let file = OpenOptions::new().write(true).open(path);
    gone && file.is_ok_and(|file| file.try_lock().is_ok())
}

#[cfg(not(unix))]
fn is_abandoned(_: &Path, _: u32, _: Duration) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;

    /// No process has such a number.
    const NOBODY: u32 = u32::MAX;

    #[test]
    fn what_is_left_goes_and_what_is_written_stays() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let make = |name: &str| {
            let file = File::create(folder.path().join(name)).expect("a writable folder");
            (name.to_owned(), file)
        };
        let aged = |(name, file): (String, File)| {
            let before = SystemTime::now() - 2 * OLD;
            file.set_modified(before).expect("a file of ours");
            (name, file)
        };
        let others = make("shot.exr");
        let young = make(".tamis-Xyz123");
        let mine = make(&format!("{}Xyz123", prefix()));
        let written = aged(make(&format!(".tamis-{NOBODY}-locked")));
        claim(&written.1);
        let mut kept = vec![others, young, mine];
        if cfg!(unix) {
            kept.push(written);
        }
        let abandoned = make(&format!(".tamis-{NOBODY}-Xyz123"));
        let old = [aged(make(".tamis-Abc123")), aged(make(&format!("{}Abc123", prefix())))];
        if cfg!(not(target_os = "linux")) {
            kept.push(abandoned);
        }
        drop(old);
        sweep(folder.path());
        let mut left: Vec<String> = fs::read_dir(folder.path())
            .expect("readable")
            .map(|entry| entry.expect("readable").file_name().into_string().expect("UTF-8"))
            .collect();
        let mut expected: Vec<String> = kept.iter().map(|(name, _)| name.clone()).collect();
        left.sort();
        expected.sort();
        assert_eq!(left, expected);
    }
}
