//! Files that go away unless they are kept, even if a signal ends the process.

use std::collections::BTreeSet;
use std::fs::{self, File, Permissions};
use std::io;
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::{Builder, NamedTempFile};

use super::leftovers;

/// The temporary files that there are.
static LIVE: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn live() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    // A set of paths is whole, wherever a thread that held it stopped.
    LIVE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes every [`Temporary`] file there is, and keeps others from being made: whoever
/// tries waits for ever. For handlers of signals, which end the process afterwards.
pub fn remove_temporary_files() {
    let live = live();
    for path in &*live {
        // One that was just renamed is no longer there, and that is as well.
        let _ = fs::remove_file(path);
    }
    mem::forget(live);
}

/// A file that is removed when this goes, when [`remove_temporary_files`] is called, or, if
/// the process is killed, by the next one that makes such a file in the folder.
#[derive(Debug)]
pub struct Temporary {
    file: NamedTempFile,
    /// Goes after the file.
    entry: Entry,
}

/// A path in the list of those that are to be removed.
#[derive(Debug)]
struct Entry(PathBuf);

impl Drop for Entry {
    fn drop(&mut self) {
        live().remove(&self.0);
    }
}

impl Temporary {
    /// A file in a folder that nobody else may read.
    ///
    /// # Errors
    /// If none can be made.
    pub fn private(folder: &Path) -> io::Result<Self> {
        Self::make(folder, None)
    }

    /// A file in a folder that those may read who may read new files.
    pub(super) fn public(folder: &Path) -> io::Result<Self> {
        #[cfg(unix)]
        let permissions = Some(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        #[cfg(not(unix))]
        let permissions = None;
        Self::make(folder, permissions)
    }

    fn make(folder: &Path, permissions: Option<Permissions>) -> io::Result<Self> {
        leftovers::sweep(folder);
        let prefix = leftovers::prefix();
        let mut builder = Builder::new();
        builder.prefix(&prefix);
        if let Some(permissions) = permissions {
            builder.permissions(permissions);
        }
        // Made and listed at once, as a signal may come in between.
        let mut live = live();
        let file = builder.tempfile_in(folder)?;
        leftovers::claim(file.as_file());
        let entry = Entry(file.path().to_owned());
        live.insert(entry.0.clone());
        drop(live);
        Ok(Self { file, entry })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// The file itself.
    pub fn file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Renames it, once it is on the disk: a name never stands for a file that a power cut
    /// would empty.
    pub(super) fn persist(self, path: &Path) -> io::Result<()> {
        let Self { file, entry } = self;
        file.as_file().sync_all()?;
        file.persist(path).map_err(|error| error.error)?;
        drop(entry);
        Ok(())
    }
}
