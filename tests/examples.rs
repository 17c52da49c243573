//! The examples run, and show what they say.

use std::path::{Path, PathBuf};
use std::process::Command;

/// An example that cargo built for this run.
fn example(name: &str) -> PathBuf {
    // Tests stand in a folder beside that of the examples.
    let test = std::env::current_exe().expect("this test has a file");
    let built = test.parent().and_then(Path::parent).expect("in target/debug/deps");
    built.join("examples").join(name).with_extension(std::env::consts::EXE_EXTENSION)
}

fn output(name: &str) -> String {
    let mut command = Command::new(example(name));
    let output = command.current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("cargo built it");
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn a_frame_in_memory_is_denoised_as_its_file_is() {
    let text = output("denoise_memory");
    assert!(text.contains("\n0 samples differ from what the file gets\n"), "{text}");
}

#[test]
fn a_program_is_tuned_on_frames_in_memory() {
    let text = output("tune_memory");
    let value = |line: &str| -> f32 {
        let number = line.split(' ').nth(3).expect("name, value, `before,`, value");
        number.parse().expect("a number")
    };
    let range = text.lines().find(|line| line.starts_with("range:")).expect("it is told");
    assert!(text.contains("name = \"walls\"") && value(range) != 0.5, "{text}");
}
