//! Standard input and standard output as the files of a frame. Images are read out of
//! order, and written that way, which pipes cannot do: both go through temporary files.

use std::env;
use std::fs::File;
use std::io::{self, IsTerminal, Write};
use std::path::Path;

use super::files::Frame;
use super::inputs::is_stream;
use crate::cli::error::Error;
use crate::image::Temporary;

/// The files in the streams' place. They go when this does.
#[derive(Debug)]
pub(super) struct Streams {
    input: Option<Temporary>,
    output: Option<Temporary>,
}

impl Streams {
    /// Reads all of standard input, if it is the frame's input, and makes a file for the
    /// result, if that goes to standard output.
    pub(super) fn open(frame: &Frame) -> Result<Self, Error> {
        let temporary = || Temporary::private(&env::temp_dir()).map_err(Error::Stream);
        let mut input = None;
        if is_stream(&frame.input) {
            let mut file = temporary()?;
            io::copy(&mut io::stdin().lock(), file.file()).map_err(Error::Stream)?;
            input = Some(file);
        }
        let output = is_stream(&frame.output).then(|| match io::stdout().is_terminal() {
            true => Err(Error::Usage(
                "--output -: the terminal cannot show an image; redirect standard output to a \
                 file or a program"
                    .to_owned(),
            )),
            false => temporary(),
        });
        Ok(Self { input, output: output.transpose()? })
    }

    /// The file to read for a frame.
    pub(super) fn source<'a>(&'a self, frame: &'a Frame) -> &'a Path {
        self.input.as_ref().map_or(&frame.input, Temporary::path)
    }

    /// The file to write for a frame.
    pub(super) fn target<'a>(&'a self, frame: &'a Frame) -> &'a Path {
        self.output.as_ref().map_or(&frame.output, Temporary::path)
    }

    /// Sends the result on, if standard output is where it goes.
    pub(super) fn deliver(&self) -> Result<(), Error> {
        let Some(output) = &self.output else { return Ok(()) };
        let mut stdout = io::stdout().lock();
        let mut sent =
            File::open(output.path()).and_then(|mut file| io::copy(&mut file, &mut stdout));
        if sent.is_ok() {
            sent = stdout.flush().map(|()| 0);
        }
        match sent {
            // Whoever reads has read enough.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            sent => sent.map(|_| ()).map_err(Error::Stdout),
        }
    }

    /// An error that names the streams, not the files in their place.
    pub(super) fn named(&self, error: Error) -> Error {
        let mut text = error.with_causes();
        let mut renamed = false;
        for (file, name) in [(&self.input, "standard input"), (&self.output, "standard output")] {
            let Some(file) = file else { continue };
            let path = file.path().display().to_string();
            renamed |= text.contains(&path);
            text = text.replace(&path, name);
        }
        match renamed {
            true => Error::Renamed { text, status: error.status() },
            false => error,
        }
    }
}
