//! The floors of ARCHITECTURE.md: imports point down only.

use std::fs;
use std::path::{Path, PathBuf};

/// The floors, lowest first; rooms on one floor do not know each other.
const FLOORS: &[&[&str]] = &[
    &["expr"],
    &["scene"],
    &["filter"],
    &["plan"],
    &["backend"],
    &["evolve", "export", "report", "stress"],
    &["cli"],
];

fn floor(room: &str) -> Option<usize> {
    FLOORS.iter().position(|rooms| rooms.contains(&room))
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("src is readable") {
        let path = entry.expect("src is readable").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The rooms that a source names as `crate::room`.
fn named(text: &str) -> impl Iterator<Item = &str> {
    text.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .flat_map(|line| line.split("crate::").skip(1))
        .map(|rest| rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or(""))
}

#[test]
fn imports_point_down() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut checked = 0;
    for file in files {
        let relative = file.strip_prefix(&root).expect("below src");
        let first = relative.components().next().expect("a file name").as_os_str();
        let room = first.to_string_lossy().trim_end_matches(".rs").to_owned();
        // lib.rs and main.rs stand above all floors.
        let Some(own) = floor(&room) else { continue };
        let text = fs::read_to_string(&file).expect("sources are readable");
        for other in named(&text) {
            if let Some(level) = floor(other) {
                assert!(
                    level < own || other == room,
                    "{} (floor {own}) must not know `{other}` (floor {level})",
                    relative.display()
                );
                checked += 1;
            }
        }
    }
    assert!(checked > 50, "only {checked} imports found: does this test still read the sources?");
}

#[test]
fn every_room_has_a_floor() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for entry in fs::read_dir(root).expect("src is readable") {
        let path = entry.expect("src is readable").path();
        if path.is_dir() {
            let room = path.file_name().expect("a name").to_string_lossy().into_owned();
            assert!(floor(&room).is_some(), "`{room}` stands on no floor");
        }
    }
}
