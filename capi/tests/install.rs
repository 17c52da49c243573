//! The installed library serves pkg-config and CMake.
#![cfg(target_os = "linux")]

mod common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::{built, project, run};
use tempfile::TempDir;

/// A prefix with the library that this test was built with.
fn installed() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let prefix = folder.path().join("prefix");
    let mut install = Command::new(project("scripts/install_capi"));
    let said = run(install.arg("--from").arg(built()).arg(&prefix));
    assert!(said.contains(&format!("installed Tamis {}", env!("CARGO_PKG_VERSION"))), "{said}");
    (folder, prefix)
}

/// Runs the example without arguments: that it starts shows that it finds the library.
fn starts(program: &Path) {
    let output = Command::new(program).output().expect("the program is there");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("usage: embed"), "{said}");
}

/// Names of the functions that the header declares.
fn declared() -> Vec<String> {
    let header = fs::read_to_string(project("capi/include/tamis.h")).expect("a header");
    let names =
        header.lines().filter(|line| !line.starts_with([' ', '/', '*'])).filter_map(|line| {
            let name = line.split('(').next()?.rsplit([' ', '*']).next()?;
            name.starts_with("tamis").then(|| name.to_owned())
        });
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn programs_are_built_with_pkg_config_and_cmake() {
    let (folder, prefix) = installed();
    let example = project("examples/embed.c").canonicalize().expect("the example is there");

    let pkg_config = |argument: &[&str]| -> Vec<String> {
        let mut command = Command::new("pkg-config");
        command.env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"));
        let flags = run(command.args(argument).arg("tamis"));
        flags.split_whitespace().map(str::to_owned).collect()
    };
    assert_eq!(pkg_config(&["--modversion"]), [env!("CARGO_PKG_VERSION")]);
    let shared = folder.path().join("shared");
    let rpath = format!("-Wl,-rpath,{}", prefix.join("lib").display());
    let cc = |program: &Path| {
        let mut command = Command::new("cc");
        command.arg("-std=c99").arg(&example).arg("-o").arg(program);
        command
    };
    run(cc(&shared).args(pkg_config(&["--cflags", "--libs"])).arg(rpath));
    starts(&shared);
    // The archive alone, which the name of the file chooses.
    let (alone, archive) = (folder.path().join("alone"), prefix.join("lib/libtamis.a"));
    let flags = pkg_config(&["--static", "--cflags", "--libs"]);
    let flags = flags.iter().map(|flag| match flag.as_str() {
        "-ltamis" => archive.display().to_string(),
        _ => flag.clone(),
    });
    run(cc(&alone).args(flags));
    starts(&alone);

    let source = folder.path().join("source");
    fs::create_dir(&source).expect("a folder");
    let lists = format!(
        "cmake_minimum_required(VERSION 3.10)\nproject(embed C)\nset(CMAKE_C_STANDARD 99)\n\
         find_package(tamis 0.1 REQUIRED)\nadd_executable(embed {0})\n\
         target_link_libraries(embed PRIVATE tamis::tamis)\nadd_executable(alone {0})\n\
         target_link_libraries(alone PRIVATE tamis::static)\n",
        example.display()
    );
    fs::write(source.join("CMakeLists.txt"), lists).expect("written");
    let build = folder.path().join("build");
    let mut configure = Command::new("cmake");
    configure.arg("-S").arg(&source).arg("-B").arg(&build);
    run(configure.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display())));
    run(Command::new("cmake").arg("--build").arg(&build));
    starts(&build.join("embed"));
    starts(&build.join("alone"));
}

#[test]
fn the_library_exports_what_the_header_declares_and_nothing_else() {
    let said =
        run(Command::new("nm").args(["-D", "--defined-only"]).arg(built().join("libtamis_c.so")));
    let mut exported: Vec<&str> =
        said.lines().filter_map(|line| line.split_whitespace().last()).collect();
    exported.sort_unstable();
    assert_eq!(exported, declared());
}

#[test]
fn a_prefix_that_is_no_absolute_path_is_refused() {
    for arguments in [&["here"][..], &[], &["--from"], &["--from", "/nowhere", "/tmp"]] {
        let output = Command::new(project("scripts/install_capi")).args(arguments).output();
        let output = output.expect("bash is there");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{arguments:?}");
        assert!(said.contains("usage:") || said.contains("has no libtamis_c.so"), "{said}");
    }
}
