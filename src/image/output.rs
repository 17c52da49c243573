//! Files that appear whole or not at all.

use std::fs;
use std::io::{self, BufWriter, Cursor, Seek, Write};
use std::path::Path;

use super::ImageError;
use super::temporary::Temporary;

/// Writes `bytes` to `path` through a temporary file in the same folder and a
/// rename: whoever looks sees the old file or the new one, and a run that fails
/// or is killed leaves no half of one. The new file has the old one's permissions.
///
/// What exists and is no regular file (`/dev/stdout`, a named pipe) is written
/// into, as a rename would replace it.
///
/// # Errors
/// If the folder does not exist or cannot be written.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), ImageError> {
    write_through(path, |file| file.write_all(bytes).map_err(|source| failed(path, source)))
}

/// Checks that files can be written into a folder, before anybody does work whose result is to
/// go there. What killed runs left in it is removed on the way.
///
/// # Errors
/// If it does not exist or cannot be written.
pub fn check_folder(folder: &Path) -> Result<(), ImageError> {
    match Temporary::private(folder) {
        Ok(_) => Ok(()),
        Err(source) => Err(failed(folder, source)),
    }
}

/// What files are written through.
pub(super) trait Target: Write + Seek {}

impl<T: Write + Seek> Target for T {}

/// The same, by who writes piece by piece.
pub(super) fn write_through(
    path: &Path,
    write: impl FnOnce(&mut dyn Target) -> Result<(), ImageError>,
) -> Result<(), ImageError> {
    let io = |source| failed(path, source);
    if fs::metadata(path).is_ok_and(|target| !target.is_file()) {
        let mut bytes = Cursor::new(Vec::new());
        write(&mut bytes)?;
        return fs::write(path, bytes.get_ref()).map_err(io);
    }
    // A link keeps pointing where it does; the file it names is replaced.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let folder = match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        Some(_) | None => Path::new("."),
    };
    let mut temporary = Temporary::public(folder).map_err(io)?;
    // Before anything is in it, as the old file may be private.
    #[cfg(unix)]
    if let Ok(old) = fs::metadata(&target) {
        temporary.file().set_permissions(old.permissions()).map_err(io)?;
    }
    let mut file = BufWriter::new(temporary.file());
    write(&mut file)?;
    file.flush().map_err(io)?;
    drop(file);
    temporary.persist(&target).map_err(io)
}

fn failed(path: &Path, source: io::Error) -> ImageError {
    ImageError::Io { path: path.to_owned(), action: "write", source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_file_replaces_the_old_one_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("out.txt");
        write_atomically(&path, b"old").expect("writable");
        write_atomically(&path, b"new").expect("writable");
        assert_eq!(fs::read(&path).expect("written"), b"new");
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_replaced_file_keeps_its_permissions_and_its_links() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (path, link) = (folder.path().join("out.txt"), folder.path().join("link.txt"));
        std::os::unix::fs::symlink("out.txt", &link).expect("a writable folder");
        for mode in [None, Some(0o600), Some(0o664), Some(0o444)] {
            if let Some(mode) = mode {
                fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("ours");
            }
            write_atomically(if mode.is_none() { &path } else { &link }, b"new").expect("writable");
            let found = fs::metadata(&path).expect("written").permissions().mode() & 0o777;
            assert!(mode.is_none_or(|mode| mode == found), "{found:o} is not {mode:?}");
            assert!(mode.is_some() || found & 0o600 == 0o600, "{found:o}");
        }
        assert_eq!(fs::read_link(&link).expect("a link"), Path::new("out.txt"));
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 2);
    }

    #[test]
    fn a_folder_is_checked_without_a_trace_and_swept() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let left = folder.path().join(format!(".tamis-{}-Xyz123", u32::MAX));
        fs::write(&left, "left").expect("a writable folder");
        check_folder(folder.path()).expect("it is writable");
        let kept = fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(kept, usize::from(cfg!(not(target_os = "linux"))));
        let gone = folder.path().join("gone");
        let error = check_folder(&gone).unwrap_err().to_string();
        assert!(error.contains("gone: cannot write"), "{error}");
    }

    #[test]
    fn a_missing_folder_is_an_error_that_names_the_file() {
        let error = write_atomically(Path::new("/no/such/folder/out.exr"), b"").unwrap_err();
        assert!(error.to_string().contains("/no/such/folder/out.exr"), "{error}");
    }
}
