//! Other people's programs: starting them, and saying what went wrong.

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use tempfile::TempDir;

use crate::cli::error::Error;
use crate::image::ImageError;

/// Lines of a program's complaint that are passed on.
const LINES: usize = 6;

/// Finds out whether a program that an option names can be started at all.
pub(super) fn check(program: &Path, option: &'static str, argument: &str) -> Result<(), Error> {
    let mut command = Command::new(program);
    command.arg(argument).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    match command.status() {
        Ok(_) => Ok(()),
        Err(source) => {
            Err(Error::NoProgram { option, program: program.display().to_string(), source })
        }
    }
}

/// The program of a name on the `PATH`.
pub(super) fn on_the_path(name: &str) -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    std::env::split_paths(&folders).map(|folder| folder.join(name)).find(|path| path.is_file())
}

/// Runs a program to its end; that it reports a failure is an error.
pub(super) fn run(command: &mut Command, doing: &'static str) -> Result<Output, Error> {
    let output = command
        .stdin(Stdio::null())
        .output()
        .map_err(|error| failed(command, doing, &error.to_string()))?;
    if output.status.success() {
        return Ok(output);
    }
    // Some complain on stdout.
    let said = [output.stderr, output.stdout].map(|bytes| said(&bytes)).concat();
    Err(failed(command, doing, &format!("{}{said}", output.status)))
}

/// The error of a program that failed.
pub(super) fn failed(command: &Command, doing: &'static str, reason: &str) -> Error {
    let program = command.get_program().to_string_lossy().into_owned();
    Error::Program { program, doing, reason: reason.to_owned() }
}

/// A folder for files that programs exchange; it goes when it is dropped.
pub(super) fn folder() -> Result<TempDir, Error> {
    tempfile::tempdir().map_err(file(&std::env::temp_dir(), "make a folder in"))
}

/// The error of a file that a program should read or has written.
pub(super) fn file(path: &Path, action: &'static str) -> impl FnOnce(io::Error) -> Error {
    move |source| ImageError::Io { path: path.to_owned(), action, source }.into()
}

/// The first lines of what a program printed, to be appended to a sentence.
fn said(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    let lines = text.lines().map(str::trim_end).filter(|line| !line.is_empty());
    lines.take(LINES).map(|line| format!("\n  {line}")).collect()
}
