//! What the arguments of `denoise` stand for: files, patterns, globs and folders become
//! a list of frames. Folders are listed, and nothing is opened.

use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::numbers::Numbers;
use super::pattern::{Pattern, last_number};
use crate::cli::error::Error;
use crate::image::ImageError;

/// What stands for a stream on the command line. A file of this name is `./-`.
pub(super) fn is_stream(path: &Path) -> bool {
    path == Path::new("-")
}

/// One frame that is asked for. That its file exists is not said.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Input {
    pub(super) path: PathBuf,
    /// The frame's number: the pattern's, or the last one in the name.
    pub(super) number: Option<u64>,
}

impl Input {
    fn of(path: PathBuf) -> Self {
        Self { number: last_number(&path), path }
    }
}

/// The frames that arguments stand for, in the arguments' order, and those of a pattern in
/// order of number. `chosen` says which numbers to take; if one of them is not there, that
/// is an error, or with `keep_going` an input whose file is missing. Of the files that several
/// arguments, a folder or a glob stand for, those are left out that are no frames: they hold
/// features of others, and lie in one folder with them.
pub(super) fn find(
    arguments: &[PathBuf],
    chosen: Option<&Numbers>,
    keep_going: bool,
    is_frame: &dyn Fn(&Path) -> bool,
) -> Result<Vec<Input>, Error> {
    let mut inputs = Vec::with_capacity(arguments.len());
    // Files that are named one by one, by a shell perhaps, are one group to choose from.
    let mut files = Vec::new();
    for argument in arguments {
        let name = argument.display().to_string();
        if is_stream(argument) {
            if let [_, _, ..] = arguments {
                return Err(Error::Usage(
                    "-: standard input is one image; it cannot be filtered with others".to_owned(),
                ));
            }
            inputs.push(Input { path: argument.clone(), number: None });
        } else if argument.is_dir() {
            let found = folder(argument, is_frame)?;
            inputs.extend(choose(found, &name, chosen, keep_going)?);
        } else if let Some(pattern) = Pattern::of(argument).filter(|_| !argument.exists()) {
            let found = frames(&pattern, &name)?;
            inputs.extend(of_pattern(&pattern, &name, &found, chosen, keep_going)?);
        } else if let Some(text) = glob_of(argument).filter(|_| !argument.exists()) {
            let found = matching(text, is_frame)?;
            inputs.extend(choose(found, &name, chosen, keep_going)?);
        } else if arguments.len() > 1 && !is_frame(argument) {
            // A shell has expanded the glob.
        } else if chosen.is_some() {
            files.push(Input::of(argument.clone()));
        } else {
            inputs.push(Input::of(argument.clone()));
        }
    }
    if let [first, .., last] = &files[..] {
        let name = format!("{} … {}", first.path.display(), last.path.display());
        inputs.extend(choose(files, &name, chosen, keep_going)?);
    } else if let [file] = &files[..] {
        let name = file.path.display().to_string();
        inputs.extend(choose(files, &name, chosen, keep_going)?);
    }
    if inputs.is_empty() && !arguments.is_empty() {
        let name = arguments[0].display().to_string();
        return Err(Error::NothingFound { name, reason: ONLY_FEATURES.to_owned() });
    }
    Ok(inputs)
}

/// Why there is no frame, where there are files.
const ONLY_FEATURES: &str =
    "every file is one of those that --albedo, --normal, --depth and --aux name";

/// Of files with numbers in their names those that are asked for.
fn choose(
    found: Vec<Input>,
    name: &str,
    chosen: Option<&Numbers>,
    keep_going: bool,
) -> Result<Vec<Input>, Error> {
    let Some(chosen) = chosen else { return Ok(found) };
    let there: Numbers = found.iter().filter_map(|input| input.number).collect();
    let missing: Numbers = chosen.iter().filter(|&number| !there.contains(number)).collect();
    let fellows = found.iter().find_map(|input| Pattern::around(&input.path));
    let absent: Vec<Input> = match (missing.is_empty(), fellows) {
        (true, _) => Vec::new(),
        (false, Some(fellows)) if keep_going => missing
            .iter()
            .map(|number| Input { path: fellows.path(number), number: Some(number) })
            .collect(),
        (false, _) => return Err(no_such_frames(name, &missing)),
    };
    let mut kept: Vec<Input> = found
        .into_iter()
        .filter(|input| input.number.is_some_and(|number| chosen.contains(number)))
        .chain(absent)
        .collect();
    // A stable sort: sequences side by side stay in order.
    kept.sort_by_key(|input| input.number);
    Ok(kept)
}

/// Of a pattern's frames those that are asked for.
fn of_pattern(
    pattern: &Pattern,
    name: &str,
    found: &Numbers,
    chosen: Option<&Numbers>,
    keep_going: bool,
) -> Result<Vec<Input>, Error> {
    let missing: Numbers =
        chosen.into_iter().flat_map(Numbers::iter).filter(|&k| !found.contains(k)).collect();
    if !missing.is_empty() && !keep_going {
        return Err(no_such_frames(name, &missing));
    }
    let numbers = chosen.unwrap_or(found);
    Ok(numbers
        .iter()
        .map(|number| Input { path: pattern.path(number), number: Some(number) })
        .collect())
}

/// The numbers of a pattern's files; there is one at least.
fn frames(pattern: &Pattern, name: &str) -> Result<Numbers, Error> {
    let folder = pattern.folder();
    let names = entries(folder)?;
    let numbers: Numbers =
        names.iter().filter_map(|name| pattern.number(name.file_name()?.to_str()?)).collect();
    if numbers.is_empty() {
        let example = pattern.path(1);
        return Err(Error::NothingFound {
            name: name.to_owned(),
            reason: format!(
                "no file in {} has such a name, as {} would",
                folder.display(),
                example.display()
            ),
        });
    }
    Ok(numbers)
}

/// Every EXR file directly in a folder that is a frame, those left out that are hidden; one at
/// least.
fn folder(folder: &Path, is_frame: &dyn Fn(&Path) -> bool) -> Result<Vec<Input>, Error> {
    let is_image = |path: &PathBuf| {
        let hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes()[0] == b'.');
        let ending = path.extension().and_then(OsStr::to_str);
        !hidden && ending.is_some_and(|ending| ending.eq_ignore_ascii_case("exr")) && path.is_file()
    };
    let mut paths: Vec<PathBuf> = entries(folder)?.into_iter().filter(is_image).collect();
    if paths.is_empty() {
        return Err(Error::NothingFound {
            name: folder.display().to_string(),
            reason: "no .exr file is directly in this folder".to_owned(),
        });
    }
    paths.retain(|path| is_frame(path));
    if paths.is_empty() {
        let name = folder.display().to_string();
        return Err(Error::NothingFound { name, reason: ONLY_FEATURES.to_owned() });
    }
    paths.sort();
    Ok(paths.into_iter().map(Input::of).collect())
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let failed = |source: io::Error| ImageError::Io {
        path: folder.to_owned(),
        action: "list the folder's files",
        source,
    };
    let entries = fs::read_dir(folder).map_err(failed)?;
    let path = |entry: fs::DirEntry| match folder == Path::new(".") {
        // As the pattern has it.
        true => PathBuf::from(entry.file_name()),
        false => entry.path(),
    };
    Ok(entries.map(|entry| entry.map(path)).collect::<Result<_, _>>().map_err(failed)?)
}

/// The text of an argument that a shell would have expanded, had it not been quoted.
fn glob_of(argument: &Path) -> Option<&str> {
    argument.to_str().filter(|text| text.contains(['*', '?', '[']))
}

/// The frames that a glob finds, in order of name; one at least.
fn matching(text: &str, is_frame: &dyn Fn(&Path) -> bool) -> Result<Vec<Input>, Error> {
    let options = glob::MatchOptions {
        require_literal_separator: true,
        require_literal_leading_dot: true,
        ..glob::MatchOptions::default()
    };
    let paths = glob::glob_with(text, options).map_err(|error| {
        Error::Usage(format!("{text}: not a pattern for files: {error}; quote [ as [[]"))
    })?;
    let mut inputs = Vec::new();
    for path in paths {
        let path = path.map_err(|error| ImageError::Io {
            path: error.path().to_owned(),
            action: "list the folder's files",
            source: error.into(),
        })?;
        if path.is_file() {
            inputs.push(Input::of(path));
        }
    }
    if inputs.is_empty() {
        return Err(Error::NothingFound {
            name: text.to_owned(),
            reason: "no file has such a name".to_owned(),
        });
    }
    inputs.retain(|input| is_frame(&input.path));
    if inputs.is_empty() {
        let reason = ONLY_FEATURES.to_owned();
        return Err(Error::NothingFound { name: text.to_owned(), reason });
    }
    Ok(inputs)
}

fn no_such_frames(name: &str, missing: &Numbers) -> Error {
    Error::MissingFrames { name: name.to_owned(), frames: missing.listing() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with empty files.
    fn folder_of(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for name in names {
            fs::write(folder.path().join(name), "").expect("a writable folder");
        }
        folder
    }

    fn names(
        folder: &tempfile::TempDir,
        arguments: &[&str],
        frames: Option<&str>,
        keep_going: bool,
    ) -> Result<Vec<String>, String> {
        let arguments: Vec<PathBuf> = arguments.iter().map(|a| folder.path().join(a)).collect();
        let chosen = frames.map(|text| text.parse().expect("frames"));
        let is_frame = |path: &Path| !path.to_string_lossy().contains("albedo");
        let found = find(&arguments, chosen.as_ref(), keep_going, &is_frame);
        let found = found.map_err(|error| error.to_string())?;
        let name = |input: &Input| input.path.file_name().expect("a name").to_owned();
        Ok(found.iter().map(|input| name(input).into_string().expect("UTF-8")).collect())
    }

    #[test]
    fn patterns_globs_and_folders_stand_for_their_files() {
        let place = folder_of(&[
            "s.0010.exr",
            "s.0002.exr",
            "s.0001.exr",
            "s.1.exr",
            "s.0003.png",
            ".s.0004.exr",
            "b.EXR",
        ]);
        let found = |argument| names(&place, &[argument], None, false).expect("files");
        assert_eq!(found("s.####.exr"), ["s.0001.exr", "s.0002.exr", "s.0010.exr"]);
        assert_eq!(found("s.%04d.exr"), found("s.####.exr"));
        assert_eq!(found("s.#.exr"), ["s.1.exr"]);
        assert_eq!(found("s.0*.exr"), found("s.####.exr"));
        assert_eq!(found("s.000[12].exr"), ["s.0001.exr", "s.0002.exr"]);
        assert_eq!(found(""), ["b.EXR", "s.0001.exr", "s.0002.exr", "s.0010.exr", "s.1.exr"]);
        for argument in ["t.####.exr", "t*.exr"] {
            let error = names(&place, &[argument], None, false).expect_err("nothing");
            assert!(error.contains(argument), "{error}");
        }
        let bare = folder_of(&["a.png"]);
        assert!(names(&bare, &[""], None, false).expect_err("nothing").contains(".exr"));
    }

    #[test]
    fn numbers_choose_among_all_kinds() {
        let place = folder_of(&["s.0001.exr", "s.0002.exr", "s.0003.exr", "s.0005.exr"]);
        let files = ["s.0005.exr", "s.0001.exr", "s.0003.exr"];
        for arguments in [&["s.####.exr"][..], &["s.*.exr"], &[""], &files] {
            let found = names(&place, arguments, Some("1-5x2"), false).expect("files");
            assert_eq!(found, ["s.0001.exr", "s.0003.exr", "s.0005.exr"], "{arguments:?}");
            let error = names(&place, arguments, Some("3-8"), false).expect_err("some are missing");
            assert!(error.contains("6-8"), "{error}");
            let found = names(&place, arguments, Some("3,7"), true).expect("some are missing");
            assert_eq!(found, ["s.0003.exr", "s.0007.exr"], "{arguments:?}");
        }
    }

    #[test]
    fn files_with_features_are_no_frames() {
        let place = folder_of(&["s.1.exr", "albedo.1.exr", "s.2.exr", "albedo.2.exr"]);
        let named = ["albedo.1.exr", "s.1.exr", "s.2.exr"];
        for arguments in [&[""][..], &["*.exr"], &named] {
            let found = names(&place, arguments, None, false).expect("files");
            assert_eq!(found, ["s.1.exr", "s.2.exr"], "{arguments:?}");
        }
        // What lacks its picture is no frame because its albedo is there.
        fs::remove_file(place.path().join("s.2.exr")).expect("writable");
        let error = names(&place, &[""], Some("1-2"), false).expect_err("one is missing");
        assert!(error.contains("no frames 2"), "{error}");
        for arguments in [&["albedo*.exr"][..], &["albedo.1.exr", "albedo.2.exr"]] {
            let error = names(&place, arguments, None, false).expect_err("there is none");
            assert!(error.contains("--albedo"), "{error}");
        }
        // Whoever names one file means it.
        assert_eq!(names(&place, &["albedo.1.exr"], None, false).expect("it"), ["albedo.1.exr"]);
    }

    #[test]
    fn a_file_with_such_a_name_is_that_file() {
        let place = folder_of(&["a#.exr", "a[1].exr", "a1.exr"]);
        for name in ["a#.exr", "a[1].exr"] {
            assert_eq!(names(&place, &[name], None, false), Ok(vec![name.to_owned()]));
        }
    }
}
