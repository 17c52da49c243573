//! Completions and manual pages.

use std::fs;

use crate::place::Place;

#[test]
fn every_shell_has_its_completions() {
    let place = Place::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = place.done(&["completions", shell]);
        for word in ["denoise", "skip-existing", "completions"] {
            assert!(script.contains(word), "no {word} for {shell}");
        }
    }
    place.fails(2, &["completions", "tcsh"], &["tcsh", "zsh"]);
}

#[test]
fn every_command_has_a_page() {
    let place = Place::new();
    place.done(&["man", "-o", "man/man1"]);
    let entries = fs::read_dir(place.path("man/man1")).expect("a folder");
    let mut names: Vec<String> = entries
        .map(|entry| entry.expect("readable").file_name().into_string().expect("UTF-8"))
        .collect();
    names.sort();
    let help = place.done(&["--help"]);
    let listing = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let mut pages: Vec<String> = listing
        .take_while(|line| !line.is_empty())
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|command| *command != "help")
        .map(|command| format!("tamis-{command}.1"))
        .collect();
    pages.push("tamis.1".to_owned());
    pages.sort();
    assert_eq!(names, pages);
    let page = String::from_utf8(place.bytes("man/man1/tamis-denoise.1")).expect("UTF-8");
    for part in ["tamis\\-denoise", "\\-\\-skip\\-existing", "\n  tamis denoise render.exr"] {
        assert!(page.contains(part), "no `{part}` in: {page}");
    }
}
