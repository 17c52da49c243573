//! What `--scenes` means: folders to search, or pairs of files.

use std::path::{self, Path, PathBuf};

use super::error::Error;
use crate::scene::{SceneFiles, discover};

/// How the help spells an argument.
pub(super) const VALUE: &str = "DIR|NOISY.exr,REFERENCE.exr";

/// The scenes that arguments stand for, in their order, each once.
pub(super) fn find(arguments: &[PathBuf]) -> Result<Vec<SceneFiles>, Error> {
    let mut scenes: Vec<SceneFiles> = Vec::new();
    for argument in arguments {
        let found = match pair(argument) {
            Some((noisy, reference)) => vec![SceneFiles::of(&noisy, &reference)],
            None if !argument.exists() => {
                return Err(Error::NoSuchScenes { path: argument.display().to_string() });
            }
            None => discover(&[argument])?,
        };
        for scene in found {
            if !scenes.contains(&scene) {
                scenes.push(scene);
            }
        }
    }
    Ok(scenes)
}

/// The one scene that an argument stands for.
pub(super) fn one(argument: &Path) -> Result<SceneFiles, Error> {
    let mut found = find(&[argument.to_owned()])?;
    match found.len() {
        1 => Ok(found.swap_remove(0)),
        count => Err(Error::Usage(format!(
            "{}: there are {count} scenes below; name one of them: {}",
            argument.display(),
            found.iter().map(|files| files.name.as_str()).collect::<Vec<_>>().join(", ")
        ))),
    }
}

/// An argument that stands for the same scenes in whatever folder the program runs.
pub(super) fn absolute(argument: &Path) -> PathBuf {
    let whole = |path: &Path| path::absolute(path).unwrap_or_else(|_| path.to_owned());
    match pair(argument) {
        Some((noisy, reference)) => {
            let mut both = whole(&noisy).into_os_string();
            both.push(",");
            both.push(whole(&reference));
            both.into()
        }
        None => whole(argument),
    }
}

/// Two files named with a comma between them; a path that exists is never two.
fn pair(argument: &Path) -> Option<(PathBuf, PathBuf)> {
    if argument.exists() {
        return None;
    }
    let (noisy, reference) = argument.to_str()?.split_once(',')?;
    Some((noisy.into(), reference.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comma_joins_two_files() {
        let both = PathBuf::from("some/room.exr,other/clean.exr");
        let scenes = find(&[both.clone(), both]).expect("nothing is read yet");
        assert_eq!(scenes.len(), 1);
        assert_eq!(scenes[0].name, "room");
        assert_eq!(scenes[0].reference, Path::new("other/clean.exr"));
        assert!(find(&[PathBuf::from("no/such/folder")]).is_err());
    }

    #[test]
    fn both_files_of_a_pair_are_made_absolute() {
        let here = std::env::current_dir().expect("there is one");
        let mut both = here.join("a.exr").into_os_string();
        both.push(",");
        both.push(here.join("b.exr"));
        assert_eq!(absolute(Path::new("a.exr,b.exr")), PathBuf::from(both));
        assert_eq!(absolute(Path::new("src")), here.join("src"));
    }
}
