//! The command that repeats a search.

use std::path::Path;

use super::parameters::{Tabled, arguments};
use crate::cli::recall::Recall;

/// The command that a search of these settings on these scenes is started with, with switches
/// that are no settings. Paths of scenes hang on no folder, so that it can be given anywhere.
pub(super) fn command<S: Tabled>(
    settings: &S,
    scenes: &Recall,
    out: &Path,
    switches: &[&str],
) -> String {
    let mut words: Vec<String> = vec!["tamis".to_owned(), "evolve".to_owned()];
    words.extend(arguments(settings));
    words.extend(switches.iter().map(|&switch| switch.to_owned()));
    for (flag, paths) in [("--scenes", scenes.scenes()), ("--validate", scenes.validate())] {
        if !paths.is_empty() {
            words.push(flag.to_owned());
            words.extend(paths.iter().map(|path| path.display().to_string()));
        }
    }
    words.extend(["--out".to_owned(), out.display().to_string()]);
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// A word as shells read it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./,=:+@%".contains(c);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evolve::programs::Settings;

    #[test]
    fn a_command_has_what_differs_and_survives_a_shell() {
        let settings = Settings { seed: 3, ..Settings::quick() };
        let scenes = Recall::of(&["/a b/it's".into()], &["/c".into()]);
        let command = command(&settings, &scenes, "out".as_ref(), &["--require-stable"]);
        assert_eq!(
            command,
            "tamis evolve --preset quick --seed=3 --require-stable --scenes '/a b/it'\\''s' \
             --validate /c --out out"
        );
    }
}
