//! Files that hold a run: JSON with a checksum, so that a damaged one is never gone on from.
//!
//! A file is one JSON object, `{"format":"NAME","checksum":"HEX","content":…}`. The checksum is
//! the CRC-32 of the content's bytes as they stand in the file.

use std::io;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::image::{ImageError, write_atomically};

/// Why such a file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum SealedError {
    /// The system refused to read it.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It is none.
    #[error(
        "{} is not a checkpoint; name the folder of a run, or start anew", path.display()
    )]
    Other {
        /// The file.
        path: PathBuf,
    },
    /// It is laid out as another version does.
    #[error(
        "{} is a checkpoint of another version ({found}; this one reads {read}): resume it with \
         the version that wrote it, or start anew", path.display()
    )]
    Format {
        /// The file.
        path: PathBuf,
        /// The layout's name.
        found: String,
        /// The one that was to be read.
        read: &'static str,
    },
    /// It is not what was written.
    #[error(
        "{} is damaged: its contents do not have the checksum that they were written with; \
         bring back a copy of the file, or start anew", path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
    },
    /// It is what was written, and no run can be in such a state.
    #[error("{} is not a checkpoint that this version can resume", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Where it stops making sense.
        source: serde_json::Error,
    },
    /// It cannot be written.
    #[error(transparent)]
    Write(#[from] ImageError),
}

/// The one member that every version of every such file has.
#[derive(Deserialize)]
struct Label {
    format: String,
}

/// What stands before the checksum.
fn opening(format: &str) -> String {
    format!("{{\"format\":\"{format}\",\"checksum\":\"")
}

/// What stands between the checksum and the content.
const MIDDLE: &str = "\",\"content\":";

/// What stands after the content.
const END: &str = "}\n";

fn checksum(content: &[u8]) -> String {
    format!("{:08x}", crc32fast::hash(content))
}

/// Writes a file of this format; one of that name stays whole until the new one is.
///
/// # Errors
/// If it cannot be written.
pub fn write_sealed(
    path: &Path,
    format: &'static str,
    content: &impl Serialize,
) -> Result<(), SealedError> {
    let content = serde_json::to_vec(content)
        .map_err(|source| SealedError::Content { path: path.to_owned(), source })?;
    let mut file = (opening(format) + &checksum(&content) + MIDDLE).into_bytes();
    file.extend_from_slice(&content);
    file.extend_from_slice(END.as_bytes());
    Ok(write_atomically(path, &file)?)
}

/// Reads a file of this format.
///
/// # Errors
/// If it cannot be read, is of another format, or is not as it was written.
pub fn read_sealed<T: DeserializeOwned>(
    path: &Path,
    format: &'static str,
) -> Result<T, SealedError> {
    let path = || path.to_owned();
    let file =
        std::fs::read(path()).map_err(|source| SealedError::Read { path: path(), source })?;
    let Some(rest) = file.strip_prefix(opening(format).as_bytes()) else {
        return Err(match serde_json::from_slice(&file) {
            Ok(Label { format: found }) if found != format => {
                SealedError::Format { path: path(), found, read: format }
            }
            Ok(_) | Err(_) => SealedError::Other { path: path() },
        });
    };
    let parts = rest.split_at_checked(checksum(b"").len());
    let content = parts.and_then(|(written, rest)| {
        let content = rest.strip_prefix(MIDDLE.as_bytes())?.strip_suffix(END.as_bytes())?;
        (checksum(content).as_bytes() == written).then_some(content)
    });
    let content = content.ok_or_else(|| SealedError::Damaged { path: path() })?;
    serde_json::from_slice(content).map_err(|source| SealedError::Content { path: path(), source })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FORMAT: &str = "tamis-test-2";

    #[test]
    fn every_damaged_byte_is_found() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("run.json");
        let content = vec![("one".to_owned(), 0.1), ("two".to_owned(), 1e-300)];
        write_sealed(&path, FORMAT, &content).expect("writable");
        type Content = Vec<(String, f64)>;
        assert_eq!(read_sealed::<Content>(&path, FORMAT).expect("sound"), content);

        let whole = std::fs::read(&path).expect("readable");
        // Every other program can read it, too.
        assert!(serde_json::from_slice::<serde_json::Value>(&whole).is_ok());
        let begun = opening(FORMAT).len();
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 1;
            std::fs::write(&path, &damaged).expect("writable");
            let error = read_sealed::<Content>(&path, FORMAT).expect_err("it is damaged");
            let text = error.to_string();
            assert!(text.contains("run.json") && text.contains("start anew"), "{text}");
            assert!(at < begun || matches!(error, SealedError::Damaged { .. }), "{at}: {text}");

            std::fs::write(&path, &whole[..at]).expect("writable");
            let error = read_sealed::<Content>(&path, FORMAT).expect_err("it is not whole");
            assert!(at < begun || matches!(error, SealedError::Damaged { .. }), "{at}: {error}");
        }
    }

    #[test]
    fn another_version_is_told_from_what_is_none() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("run.json");
        let read = || read_sealed::<Vec<u8>>(&path, FORMAT).expect_err("it is not of the format");
        assert!(matches!(read(), SealedError::Read { .. }));
        std::fs::write(&path, "{}").expect("writable");
        assert!(matches!(read(), SealedError::Other { .. }));
        std::fs::write(&path, r#"{ "format": "tamis-test-1", "more": 1 }"#).expect("writable");
        let text = read().to_string();
        assert!(text.contains("tamis-test-1") && text.contains(FORMAT), "{text}");
        write_sealed(&path, FORMAT, &"text").expect("writable");
        assert!(matches!(read(), SealedError::Content { .. }));
    }

    proptest! {
        #[test]
        fn numbers_come_back_to_the_bit(bits in prop::collection::vec(any::<u64>(), 64)) {
            let numbers: Vec<f64> =
                bits.into_iter().map(f64::from_bits).filter(|x| x.is_finite()).collect();
            let written = serde_json::to_vec(&numbers).expect("numbers");
            let read: Vec<f64> = serde_json::from_slice(&written).expect("numbers");
            prop_assert!(read.iter().map(|x| x.to_bits()).eq(numbers.iter().map(|x| x.to_bits())));
        }
    }
}
