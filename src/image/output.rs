//! Files that appear whole or not at all.

use std::fs;
use std::io::{self, BufWriter, Cursor, Seek, Write};
use std::path::Path;

use super::ImageError;

/// Writes `bytes` to `path` through a temporary file in the same folder and a
/// rename: whoever looks sees the old file or the new one, and a run that fails
/// or is killed leaves no half of one.
///
/// What exists and is no regular file (`/dev/stdout`, a named pipe) is written
/// into, as a rename would replace it.
///
/// # Errors
/// If the folder does not exist or cannot be written.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), ImageError> {
    write_through(path, |file| file.write_all(bytes).map_err(|source| failed(path, source)))
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
    let mut builder = tempfile::Builder::new();
    builder.prefix(".tamis-");
    // Temporary files are private by default; results follow the umask.
    #[cfg(unix)]
    let builder = {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666))
    };
    let mut file = BufWriter::new(builder.tempfile_in(folder).map_err(io)?);
    write(&mut file)?;
    let file = file.into_inner().map_err(|error| io(error.into_error()))?;
    file.persist(&target).map_err(|error| io(error.error))?;
    Ok(())
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

    #[test]
    fn a_missing_folder_is_an_error_that_names_the_file() {
        let error = write_atomically(Path::new("/no/such/folder/out.exr"), b"").unwrap_err();
        assert!(error.to_string().contains("/no/such/folder/out.exr"), "{error}");
    }
}
