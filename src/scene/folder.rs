//! Scenes on disk: folders with `reference.exr`, and `4spp.exr` or the like.

use std::fs;
use std::path::{Path, PathBuf};

use super::SceneError;
use crate::image::ImageError;

/// The noisy image of a scene folder; where there is none, the one of the fewest samples.
pub const NOISY: &str = "4spp.exr";
/// The clean one.
pub const REFERENCE: &str = "reference.exr";
/// Folders nested deeper than this are not searched (links can form loops).
const MAX_DEPTH: usize = 8;

/// A scene's two files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneFiles {
    /// The folder's name.
    pub name: String,
    /// The noisy image with its features.
    pub noisy: PathBuf,
    /// The clean image.
    pub reference: PathBuf,
}

impl SceneFiles {
    /// The scene in a folder.
    ///
    /// # Errors
    /// If one of the two files is missing, or the folder cannot be read.
    pub fn in_folder(folder: &Path) -> Result<Self, SceneError> {
        let missing = |missing| SceneError::NotAScene { path: folder.to_owned(), missing };
        if !folder.join(REFERENCE).is_file() {
            return Err(missing(REFERENCE));
        }
        let usual = Some(folder.join(NOISY)).filter(|path| path.is_file());
        let noisy = match usual {
            Some(path) => Some(path),
            None => sample_counts(folder)?.into_iter().map(|(_, path)| path).next(),
        };
        Ok(Self::of(&noisy.ok_or_else(|| missing(NOISY))?, &folder.join(REFERENCE)))
    }

    /// The scene made of any two files, named as [`scene_name`] says.
    pub fn of(noisy: &Path, reference: &Path) -> Self {
        Self { name: scene_name(noisy), noisy: noisy.to_owned(), reference: reference.to_owned() }
    }
}

/// How many samples per pixel a file has by its name: 16 for `16spp.exr`.
pub fn samples_of(noisy: &Path) -> Option<u32> {
    noisy.file_name()?.to_str()?.strip_suffix("spp.exr")?.parse().ok()
}

/// The noisy images of a folder, those of fewer samples first.
///
/// # Errors
/// If the folder cannot be read.
pub fn sample_counts(folder: &Path) -> Result<Vec<(u32, PathBuf)>, SceneError> {
    let io = |source| ImageError::Io { path: folder.to_owned(), action: "list", source };
    let mut images = Vec::new();
    for entry in fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        images.extend(samples_of(&path).map(|samples| (samples, path)));
    }
    images.sort();
    Ok(images)
}

/// What reports call the scene whose noisy image this is: the folder's name for
/// `4spp.exr` and the like, as all scenes have one of these, else the file's.
pub fn scene_name(noisy: &Path) -> String {
    let usual = samples_of(noisy).is_some();
    // The folder of a relative path may be known to the system alone.
    let absolute = std::path::absolute(noisy).unwrap_or_else(|_| noisy.to_owned());
    let folder = absolute.parent().and_then(Path::file_name);
    match folder {
        Some(folder) if usual => folder.to_string_lossy().into_owned(),
        Some(_) | None => {
            noisy.file_stem().unwrap_or(noisy.as_os_str()).to_string_lossy().into_owned()
        }
    }
}

/// Every scene in or below the given folders, sorted by path within each, each
/// once. Folders that have neither of the two files are searched further; one
/// that has only one is an error, as something is missing there.
///
/// # Errors
/// If a folder cannot be read, is incomplete, or nothing is found at all.
pub fn discover<P: AsRef<Path>>(folders: &[P]) -> Result<Vec<SceneFiles>, SceneError> {
    let mut scenes: Vec<SceneFiles> = Vec::new();
    for folder in folders {
        search(folder.as_ref(), MAX_DEPTH, &mut scenes)?;
    }
    if scenes.is_empty() {
        let names = folders.iter().map(|folder| folder.as_ref().display().to_string());
        return Err(SceneError::NoScenes { folders: names.collect::<Vec<_>>().join(", ") });
    }
    Ok(scenes)
}

fn search(folder: &Path, depth: usize, scenes: &mut Vec<SceneFiles>) -> Result<(), SceneError> {
    if [NOISY, REFERENCE].iter().any(|file| folder.join(file).is_file()) {
        let scene = SceneFiles::in_folder(folder)?;
        if !scenes.contains(&scene) {
            scenes.push(scene);
        }
        return Ok(());
    }
    let io = |source| ImageError::Io { path: folder.to_owned(), action: "list", source };
    let mut below = Vec::new();
    for entry in fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.is_dir() {
            below.push(path);
        }
    }
    below.sort();
    if depth > 0 {
        for path in below {
            search(&path, depth - 1, scenes)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_found_sorted_and_once() {
        let root = tempfile::tempdir().expect("a temporary folder");
        for scene in ["b", "a", "deep/c"] {
            let folder = root.path().join(scene);
            fs::create_dir_all(&folder).expect("writable");
            for file in [NOISY, REFERENCE] {
                fs::write(folder.join(file), b"").expect("writable");
            }
        }
        let found = discover(&[root.path(), &root.path().join("a")]).expect("three scenes");
        let names: Vec<&str> = found.iter().map(|scene| scene.name.as_str()).collect();
        assert_eq!(names, ["a", "b", "c"]);

        // Another number of samples will do.
        let at = |file: &str| root.path().join("a").join(file);
        fs::rename(at(NOISY), at("16spp.exr")).expect("writable");
        fs::write(at("64spp.exr"), b"").expect("writable");
        let found = discover(&[root.path()]).expect("three scenes");
        assert_eq!((found[0].name.as_str(), &found[0].noisy), ("a", &at("16spp.exr")));

        fs::remove_file(root.path().join("b").join(REFERENCE)).expect("removable");
        let error = discover(&[root.path()]).unwrap_err().to_string();
        assert!(error.contains("reference.exr"), "{error}");
    }

    #[test]
    fn nothing_found_is_an_error_that_says_what_a_scene_is() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let error = discover(&[root.path()]).unwrap_err().to_string();
        assert!(error.contains("4spp.exr"), "{error}");
        assert!(discover(&[Path::new("/no/such/folder")]).is_err());
    }

    #[test]
    fn a_scene_is_named_by_its_folder_or_its_file() {
        assert_eq!(scene_name(Path::new("/data/kitchen/4spp.exr")), "kitchen");
        assert_eq!(scene_name(Path::new("/data/kitchen/64spp.exr")), "kitchen");
        assert_eq!(scene_name(Path::new("/data/kitchen/frame7.exr")), "frame7");
    }
}
