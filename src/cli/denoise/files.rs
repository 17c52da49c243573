//! Which files a run reads and which it writes: all that can be found out about
//! them before the work, rather than after it.

use std::collections::{HashMap, HashSet};
use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf, is_separator};

use super::form::Form;
use crate::cli::error::Error;
use crate::image::ImageError;
use crate::report::number;

/// Every input with the place of its result.
#[derive(Debug)]
pub(super) struct Files {
    frames: Vec<Frame>,
    form: Form,
    /// The results' folder, if it is yet to be made.
    to_make: Option<PathBuf>,
}

/// One input and the place of its result.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) input: PathBuf,
    pub(super) output: PathBuf,
}

impl Files {
    /// What the command line names; nothing is read or made yet.
    pub(super) fn of(
        inputs: &[PathBuf],
        output: &Path,
        format: Option<Form>,
    ) -> Result<Self, Error> {
        let folder = output.is_dir() || ends_in_separator(output);
        let files = match inputs {
            [input] if !folder => Self::one(input, output, format)?,
            inputs if folder => Self::below(output, inputs, format.unwrap_or(Form::Exr))?,
            inputs => {
                return Err(Error::Usage(format!(
                    "{}: the results of {} need a folder; name one that exists, or end the name \
                     in / to have it made",
                    output.display(),
                    number::plural(inputs.len(), "input"),
                )));
            }
        };
        files.spare_the_inputs()?;
        // What is wrong with a single file its reader says best.
        if files.len() > 1 {
            files.find_the_inputs()?;
        }
        Ok(files)
    }

    fn one(input: &Path, output: &Path, format: Option<Form>) -> Result<Self, Error> {
        let Some(form) = Form::of(output) else {
            return Err(Error::Usage(format!(
                "{}: results are written as .exr (linear) or .png (tone-mapped); \
                 give the output one of these endings",
                output.display()
            )));
        };
        if let Some(format) = format.filter(|&format| format != form) {
            return Err(Error::Usage(format!(
                "--format {}: {} has another ending; change that, or leave --format out",
                format.ending(),
                output.display()
            )));
        }
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder
            && let Err(source) = fs::metadata(folder)
        {
            return Err(ImageError::Io {
                path: output.to_owned(),
                action: "write (its folder cannot be used)",
                source,
            }
            .into());
        }
        let frame = Frame { input: input.to_owned(), output: output.to_owned() };
        Ok(Self { frames: vec![frame], form, to_make: None })
    }

    fn below(folder: &Path, inputs: &[PathBuf], form: Form) -> Result<Self, Error> {
        let mut frames = Vec::with_capacity(inputs.len());
        let mut taken: HashMap<OsString, &Path> = HashMap::with_capacity(inputs.len());
        for input in inputs {
            let named = input.with_extension(form.ending());
            let Some(name) = named.file_name().filter(|_| input.file_name().is_some()) else {
                return Err(Error::Usage(format!(
                    "{}: this names no file whose name the result could have",
                    input.display()
                )));
            };
            let output = folder.join(name);
            if let Some(other) = taken.insert(name.to_owned(), input) {
                return Err(Error::Usage(format!(
                    "{} and {}: both results would be {}; write them into different folders, in \
                     two runs",
                    other.display(),
                    input.display(),
                    output.display()
                )));
            }
            frames.push(Frame { input: input.clone(), output });
        }
        let to_make = match fs::metadata(folder) {
            Ok(found) if found.is_dir() => None,
            Ok(_) => return Err(no_folder(folder, io::ErrorKind::NotADirectory.into())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Some(folder.to_owned()),
            Err(error) => return Err(no_folder(folder, error)),
        };
        Ok(Self { frames, form, to_make })
    }

    /// Checks that no result would replace an input.
    fn spare_the_inputs(&self) -> Result<(), Error> {
        let inputs: HashSet<PathBuf> =
            self.frames.iter().filter_map(|frame| frame.input.canonicalize().ok()).collect();
        let replaced = self
            .frames
            .iter()
            .find(|frame| frame.output.canonicalize().is_ok_and(|output| inputs.contains(&output)));
        let Some(Frame { output, .. }) = replaced else { return Ok(()) };
        Err(Error::Usage(if self.len() == 1 {
            format!("{}: this is the input; give the result another name", output.display())
        } else {
            format!(
                "{}: this is one of the inputs; write the results into another folder",
                output.display()
            )
        }))
    }

    /// Checks that every input is there.
    fn find_the_inputs(&self) -> Result<(), Error> {
        let missing = self.frames.iter().filter_map(|Frame { input, .. }| {
            let error = fs::metadata(input).err()?;
            Some(format!("\n  {}: {error}", input.display()))
        });
        let missing: Vec<String> = missing.collect();
        if missing.is_empty() {
            return Ok(());
        }
        Err(Error::MissingInputs {
            missing: missing.len(),
            of: self.len(),
            listing: missing.concat(),
        })
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.frames.len()
    }

    /// What the results are written as.
    pub(super) fn form(&self) -> Form {
        self.form
    }

    /// The files of a frame.
    pub(super) fn frame(&self, frame: usize) -> &Frame {
        &self.frames[frame]
    }

    /// Makes the folder for the results, if that is left to the program. To be
    /// called when there is a result: a run that has none leaves no folder.
    pub(super) fn make_folder(&self) -> Result<(), Error> {
        let Some(folder) = &self.to_make else { return Ok(()) };
        fs::create_dir_all(folder).map_err(|source| no_folder(folder, source))
    }
}

fn no_folder(folder: &Path, source: io::Error) -> Error {
    Error::Folder { path: folder.display().to_string(), option: "--output", source }
}

/// Whether a path is written like a folder's. [`Path`] itself does not tell:
/// `clean` and `clean/` are equal to it.
fn ends_in_separator(path: &Path) -> bool {
    let last = path.as_os_str().as_encoded_bytes().last();
    last.is_some_and(|&byte| is_separator(char::from(byte)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outputs(inputs: &[&str], output: &str, format: Option<Form>) -> Result<Vec<String>, Error> {
        let inputs: Vec<PathBuf> = inputs.iter().map(PathBuf::from).collect();
        let files = Files::of(&inputs, Path::new(output), format)?;
        Ok(files.frames.iter().map(|frame| frame.output.display().to_string()).collect())
    }

    #[test]
    fn results_in_folders_have_their_inputs_names() {
        assert_eq!(outputs(&["in/a.7.exr"], "no/", None).expect("one"), ["no/a.7.exr"]);
        assert_eq!(outputs(&["in/a.EXR"], "no/", Some(Form::Png)).expect("one"), ["no/a.png"]);
        assert_eq!(outputs(&["a.exr"], "b.PNG", Some(Form::Png)).expect("one"), ["b.PNG"]);
        assert_eq!(outputs(&["a.exr"], "src", None).expect("a folder"), ["src/a.exr"]);
    }

    #[test]
    fn results_without_a_place_are_refused() {
        let error = |inputs: &[&str], output| {
            let error = outputs(inputs, output, None).expect_err("it makes no sense");
            (error.status(), error.to_string())
        };
        let (status, text) = error(&["a.exr", "b.exr"], "clean");
        assert!(status == 2 && text.contains("2 inputs"), "{text}");
        let (status, text) = error(&["x/a.exr", "b.exr", "y/a.exr"], "clean/");
        assert!(status == 2 && text.contains("x/a.exr and y/a.exr"), "{text}");
        let (status, text) = error(&[".."], "clean/");
        assert!(status == 2 && text.contains(".."), "{text}");
        let (status, text) = error(&["a.exr"], "Cargo.toml/");
        assert!(status == 1 && text.contains("Cargo.toml"), "{text}");
    }
}
