//! The library as C programs see it, and the test scenes.
#![allow(dead_code, reason = "no suite needs all of it")]

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use tamis::scene::{LoadOptions, Needs, RawScene};
use tempfile::TempDir;

/// A path of this package.
pub(crate) fn own(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// A path of the project.
pub(crate) fn project(path: &str) -> PathBuf {
    own("..").join(path)
}

/// Where cargo put the library when it built this test.
pub(crate) fn built() -> PathBuf {
    let test = std::env::current_exe().expect("a test knows where it is");
    let folder = test.parent().expect("it is in a folder").to_owned();
    assert!(folder.join("libtamis_c.so").is_file(), "{} has no libtamis_c.so", folder.display());
    folder
}

/// Runs a command; what it printed.
///
/// # Panics
/// If it cannot be started, or fails.
pub(crate) fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| {
        let program = command.get_program().to_string_lossy();
        panic!("`{program}` cannot be started ({error}): scripts/test installs it")
    });
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    assert!(output.status.success(), "{command:?}: {}\n{text}", output.status);
    text
}

/// A folder with the library under its name, and programs that are linked with it.
pub(crate) struct Programs {
    folder: TempDir,
}

impl Programs {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let library = built().join("libtamis_c.so");
        for name in ["libtamis.so", "libtamis.so.0.1"] {
            symlink(&library, folder.path().join(name)).expect("a link");
        }
        Self { folder }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Compiles a program so that it ends where it misuses memory or does what C leaves open.
    pub(crate) fn compile(&self, source: &Path) -> PathBuf {
        let program = self.path(&source.file_stem().expect("a name").to_string_lossy());
        let folder = self.folder.path().display();
        let mut command = Command::new("cc");
        command.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-g", "-pthread"]);
        command.args(["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]);
        command.arg("-I").arg(own("include")).arg(source).arg("-o").arg(&program);
        command.args([format!("-L{folder}"), format!("-Wl,-rpath,{folder}")]);
        run(command.args(["-ltamis", "-lm"]));
        program
    }
}

/// Every test scene.
pub(crate) fn scenes() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(project("data/test")).expect("scenes");
    let mut scenes: Vec<PathBuf> = entries
        .map(|entry| entry.expect("a folder").path().join("4spp.exr"))
        .filter(|path| path.is_file())
        .collect();
    scenes.sort();
    assert!(scenes.len() >= 3, "only {} scenes", scenes.len());
    scenes
}

pub(crate) fn raw(path: &Path) -> RawScene {
    RawScene::read(path, &Needs::everything(), &LoadOptions::default()).expect("a file of ours")
}

/// The samples of a pixel side by side.
pub(crate) fn interleaved(planes: &[Vec<f32>]) -> Vec<f32> {
    (0..planes[0].len()).flat_map(|k| planes.iter().map(move |plane| plane[k])).collect()
}
