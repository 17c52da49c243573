//! Which files a run reads and which it writes: all that can be found out about
//! them before the work, rather than after it.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf, is_separator};

use super::inputs::{Input, is_stream};
use super::pattern::Pattern;
use super::shard::Shard;
use crate::cli::error::Error;
use crate::image::ImageError;
use crate::report::{Form, number};

/// Every input with the place of its result.
#[derive(Debug)]
pub(super) struct Files {
    frames: Vec<Frame>,
    form: Form,
    /// The results' folder, if it is yet to be made.
    to_make: Option<PathBuf>,
}

/// One input and the place of its result; `-` is standard input, or output.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) number: Option<u64>,
    pub(super) input: PathBuf,
    pub(super) output: PathBuf,
}

impl Frame {
    fn new(input: &Input, output: PathBuf) -> Self {
        Self { number: input.number, input: input.path.clone(), output }
    }

    /// What the input is called where people read.
    pub(super) fn input_name(&self) -> String {
        match is_stream(&self.input) {
            true => "standard input".to_owned(),
            false => self.input.display().to_string(),
        }
    }

    /// What the result is called.
    pub(super) fn output_name(&self) -> String {
        match is_stream(&self.output) {
            true => "standard output".to_owned(),
            false => self.output.display().to_string(),
        }
    }
}

impl Files {
    /// Where the results of inputs go; nothing is read or made yet.
    pub(super) fn of(inputs: &[Input], output: &Path, format: Option<Form>) -> Result<Self, Error> {
        let folder = output.is_dir() || ends_in_separator(output);
        // A file of exactly that name is that file, as it is among the inputs.
        let pattern = Pattern::of(output).filter(|_| !folder && !output.is_file());
        let files = match (inputs, pattern) {
            ([input], _) if is_stream(output) => Self::to_stream(input, format),
            (inputs, _) if folder => Self::below(output, inputs, format.unwrap_or(Form::Exr))?,
            (inputs, Some(pattern)) => {
                Self::numbered(&pattern, inputs, written_as(output, format)?)?
            }
            ([input], None) => Self::one(input, output, format)?,
            (inputs, None) => {
                return Err(Error::Usage(format!(
                    "{}: the results of {} need a folder, or a name with a place for the \
                     frame's number such as clean.####.exr; name a folder that exists, or end \
                     the name in / to have it made",
                    output.display(),
                    number::plural(inputs.len(), "input"),
                )));
            }
        };
        files.spare_the_inputs()?;
        Ok(files)
    }

    fn to_stream(input: &Input, format: Option<Form>) -> Self {
        let form = format.unwrap_or(Form::Exr);
        Self { frames: vec![Frame::new(input, "-".into())], form, to_make: None }
    }

    fn one(input: &Input, output: &Path, format: Option<Form>) -> Result<Self, Error> {
        let form = written_as(output, format)?;
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
        Ok(Self { frames: vec![Frame::new(input, output.to_owned())], form, to_make: None })
    }

    fn numbered(pattern: &Pattern, inputs: &[Input], form: Form) -> Result<Self, Error> {
        let path = |input: &Input| {
            input.number.map(|number| pattern.path(number)).ok_or_else(|| {
                Error::Usage(format!(
                    "{}: its name has no number that the result's could have; write the results \
                     into a folder",
                    Frame::new(input, PathBuf::new()).input_name(),
                ))
            })
        };
        let frames = placed(inputs, path)?;
        Ok(Self { frames, form, to_make: to_make(pattern.folder())? })
    }

    fn below(folder: &Path, inputs: &[Input], form: Form) -> Result<Self, Error> {
        let path = |input: &Input| {
            let named = input.path.with_extension(form.ending());
            let has_name = input.path.file_name().is_some() && !is_stream(&input.path);
            named.file_name().filter(|_| has_name).map(|name| folder.join(name)).ok_or_else(|| {
                Error::Usage(format!(
                    "{}: this names no file whose name the result could have",
                    Frame::new(input, PathBuf::new()).input_name(),
                ))
            })
        };
        let frames = placed(inputs, path)?;
        Ok(Self { frames, form, to_make: to_make(folder)? })
    }

    /// Checks that no result would replace an input.
    fn spare_the_inputs(&self) -> Result<(), Error> {
        let file = |path: &Path| path.canonicalize().ok().filter(|_| !is_stream(path));
        let inputs: HashSet<PathBuf> =
            self.frames.iter().filter_map(|frame| file(&frame.input)).collect();
        let replaced = self
            .frames
            .iter()
            .find(|frame| file(&frame.output).is_some_and(|output| inputs.contains(&output)));
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

    /// Checks that the input of every frame is there, and the files `beside` it, but for
    /// frames that are not `wanted`. What is wrong with a single frame's its reader says best.
    pub(super) fn find_the_inputs(
        &self,
        wanted: impl Fn(&Frame) -> bool,
        beside: impl Fn(&Frame) -> Result<Vec<PathBuf>, Error>,
    ) -> Result<(), Error> {
        if self.len() == 1 {
            return Ok(());
        }
        // A file beside all frames counts once.
        let mut needed: Vec<PathBuf> = Vec::new();
        let mut known = HashSet::new();
        for frame in self.frames.iter().filter(|frame| wanted(frame)) {
            let files = std::iter::once(frame.input.clone()).chain(beside(frame)?);
            needed.extend(files.filter(|file| known.insert(file.clone())));
        }
        let missing = needed.iter().filter_map(|file| {
            let error = fs::metadata(file).err()?;
            Some(format!("\n  {}: {error}", file.display()))
        });
        let missing: Vec<String> = missing.collect();
        if missing.is_empty() {
            return Ok(());
        }
        let (of, listing) = (needed.len(), missing.concat());
        Err(Error::MissingInputs { missing: missing.len(), of, listing })
    }

    /// The frames of one share.
    pub(super) fn share(mut self, shard: Shard) -> Self {
        let mut position = 0..;
        self.frames.retain(|_| position.next().is_some_and(|position| shard.has(position)));
        self
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

/// Every input with its result's path; no path twice.
fn placed(
    inputs: &[Input],
    path: impl Fn(&Input) -> Result<PathBuf, Error>,
) -> Result<Vec<Frame>, Error> {
    let mut taken: HashMap<PathBuf, &Path> = HashMap::with_capacity(inputs.len());
    let mut frames = Vec::with_capacity(inputs.len());
    for input in inputs {
        let output = path(input)?;
        if let Some(other) = taken.insert(output.clone(), &input.path) {
            return Err(Error::Usage(format!(
                "{} and {}: both results would be {}; write them into different folders, in two \
                 runs",
                other.display(),
                input.path.display(),
                output.display()
            )));
        }
        frames.push(Frame::new(input, output));
    }
    Ok(frames)
}

/// What an output's name asks for, unless `format` contradicts it.
fn written_as(output: &Path, format: Option<Form>) -> Result<Form, Error> {
    let form = Form::of(output).map_err(|error| Error::Usage(error.to_string()))?;
    match format.filter(|&format| format != form) {
        None => Ok(form),
        Some(format) => Err(Error::Usage(format!(
            "--format {}: {} has another ending; change that, or leave --format out",
            format.ending(),
            output.display()
        ))),
    }
}

/// A folder, if it is yet to be made.
fn to_make(folder: &Path) -> Result<Option<PathBuf>, Error> {
    match fs::metadata(folder) {
        Ok(found) if found.is_dir() => Ok(None),
        Ok(_) => Err(no_folder(folder, io::ErrorKind::NotADirectory.into())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Some(folder.to_owned())),
        Err(error) => Err(no_folder(folder, error)),
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
    use super::super::pattern::last_number;
    use super::*;

    fn outputs(inputs: &[&str], output: &str, format: Option<Form>) -> Result<Vec<String>, Error> {
        let input = |&path: &&str| Input { path: path.into(), number: last_number(path.as_ref()) };
        let inputs: Vec<Input> = inputs.iter().map(input).collect();
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
    fn results_of_a_pattern_have_their_frames_numbers() {
        let found = outputs(&["in/a.7.exr", "b12.exr"], "no/c_%03d.png", None).expect("numbers");
        assert_eq!(found, ["no/c_007.png", "no/c_012.png"]);
        let error = |inputs: &[&str], output, format| {
            let error = outputs(inputs, output, format).expect_err("it makes no sense");
            assert_eq!(error.status(), 2);
            error.to_string()
        };
        assert!(error(&["x/a.7.exr", "b.exr"], "c.##.exr", None).starts_with("b.exr"));
        let text = error(&["a.7.exr", "b.07.exr"], "c.##.exr", None);
        assert!(text.contains("a.7.exr and b.07.exr") && text.contains("c.07.exr"), "{text}");
        assert!(error(&["a.7.exr"], "c.##.exr", Some(Form::Png)).contains("--format png"));
        assert!(error(&["a.7.exr"], "c.##.jpg", None).contains("c.##.jpg"));
        assert!(error(&["-"], "c.##.exr", None).starts_with("standard input"));
    }

    #[test]
    fn standard_output_takes_one_result() {
        assert_eq!(outputs(&["a.exr"], "-", Some(Form::Png)).expect("one"), ["-"]);
        assert!(outputs(&["a.exr", "b.exr"], "-", None).is_err_and(|error| error.status() == 2));
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
        let (status, text) = error(&["-"], "clean/");
        assert!(status == 2 && text.contains("standard input"), "{text}");
        let (status, text) = error(&["a.exr"], "Cargo.toml/");
        assert!(status == 1 && text.contains("Cargo.toml"), "{text}");
    }
}
