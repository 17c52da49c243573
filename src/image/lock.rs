//! Files that say that somebody is at work, so that two runs never write over each other.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

use super::ImageError;

/// A lock, held until this goes. The system releases it when the process ends, however that
/// comes: a file that a killed run left keeps nobody out.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    /// What the system's lock is on.
    file: File,
}

/// Why a lock cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another run has it.
    #[error(
        "{path}: another run{} is writing here; wait until it ends, or write elsewhere",
        process.map(|id| format!(" (process {id})")).unwrap_or_default(),
        path = path.display()
    )]
    Held {
        /// The lock's file.
        path: PathBuf,
        /// Which process, as far as it can be told.
        process: Option<u32>,
    },
    /// The lock's file cannot be made.
    #[error(transparent)]
    File(#[from] ImageError),
}

impl Lock {
    /// Takes the lock that a file stands for. The file is made, holds the number of this
    /// process, and is removed with the lock. On file systems that know no locks nobody is
    /// kept out.
    ///
    /// # Errors
    /// If another run holds the lock, or the file cannot be made.
    pub fn take(path: &Path) -> Result<Self, LockError> {
        let failed =
            |source| ImageError::Io { path: path.to_owned(), action: "lock the folder", source };
        loop {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false);
            let mut file = options.open(path).map_err(failed)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(LockError::Held { path: path.to_owned(), process: holder(file) });
                }
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(error)) => return Err(failed(error).into()),
            }
            // Whoever held it may have removed the file since it was opened.
            if !is_at(&file, path) {
                continue;
            }
            let id = std::process::id();
            let written = file.set_len(0).and_then(|()| writeln!(file, "{id}"));
            let lock = Self { path: path.to_owned(), file };
            return written.map(|()| lock).map_err(|source| failed(source).into());
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // While it is still locked, so that nobody takes it in between. Elsewhere files
        // cannot be removed that are open; there it stays.
        if cfg!(unix) {
            let _ = fs::remove_file(&self.path);
        }
        let _ = self.file.unlock();
    }
}

/// Which process wrote its number into a lock's file.
fn holder(mut file: File) -> Option<u32> {
    let mut text = String::new();
    file.rewind().and_then(|()| file.read_to_string(&mut text)).ok()?;
    text.trim().parse().ok()
}

/// Whether a path leads to a file that is open.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let place = |found: io::Result<fs::Metadata>| found.map(|found| (found.dev(), found.ino()));
    matches!((place(file.metadata()), place(fs::metadata(path))), (Ok(a), Ok(b)) if a == b)
}

#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_had_once_at_a_time_and_says_by_whom() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("run.lock");
        let lock = Lock::take(&path).expect("nobody has it");
        let error = Lock::take(&path).unwrap_err();
        let text = error.to_string();
        assert!(matches!(error, LockError::Held { .. }), "{text}");
        assert!(text.contains("run.lock"), "{text}");
        if cfg!(unix) {
            assert!(text.contains(&format!("process {}", std::process::id())), "{text}");
        }
        drop(lock);
        assert_eq!(path.exists(), cfg!(not(unix)));
        Lock::take(&path).expect("it was given back");
    }

    #[test]
    fn what_a_killed_run_left_keeps_nobody_out() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("run.lock");
        fs::write(&path, "1234567 and more\n").expect("a writable folder");
        let lock = Lock::take(&path).expect("nobody has it");
        if cfg!(unix) {
            let text = fs::read_to_string(&path).expect("it is there");
            assert_eq!(text, format!("{}\n", std::process::id()));
        }
        drop(lock);
    }

    /// Everybody who has the lock has it alone, though its file comes and goes.
    #[test]
    fn a_lock_is_never_had_twice() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("run.lock");
        let (inside, had) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..500 {
                        let Ok(lock) = Lock::take(&path) else { continue };
                        assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                        had.fetch_add(1, Ordering::SeqCst);
                        inside.fetch_sub(1, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
        assert!(had.into_inner() > 0);
    }

    #[test]
    fn a_missing_folder_is_an_error_that_names_it() {
        let error = Lock::take(Path::new("/no/such/folder/run.lock")).unwrap_err().to_string();
        assert!(error.contains("/no/such/folder/run.lock"), "{error}");
    }
}
