//! `denoise` between pipes.

use std::fs::{self, File};
use std::process::Output;

use crate::place::{EDGE_AWARE, Place, stderr};

/// Runs with a file as standard input.
fn piped(place: &Place, input: &str, arguments: &[&str]) -> Output {
    let mut command = place.program(arguments);
    command.stdin(File::open(place.path(input)).expect("a file"));
    command.env("TMPDIR", place.path("tmp"));
    command.output().expect("the program starts")
}

fn place() -> Place {
    let place = Place::new();
    fs::create_dir(place.path("tmp")).expect("a writable folder");
    place
}

#[test]
fn standard_input_and_output_can_take_the_files_places() {
    let place = place();
    let filter = ["--filter", EDGE_AWARE, "--timings"];
    for format in ["exr", "png"] {
        let alone = format!("alone.{format}");
        place.done(&[&["denoise", "room/4spp.exr", "-o", &alone][..], &filter].concat());
        let to_pipe = ["-o", "-", "--format", format];
        let output =
            piped(&place, "room/4spp.exr", &[&["denoise", "-"], &to_pipe[..], &filter].concat());
        let report = stderr(&output);
        assert!(output.status.success(), "{report}");
        assert!(output.stdout == place.bytes(&alone), "{format}");
        assert!(report.contains("\nstandard output: 24x20 pixels"), "{report}");
        let output = piped(
            &place,
            "room/4spp.exr",
            &[&["denoise", "-", "-o", "in.exr"], &filter[..]].concat(),
        );
        assert!(output.status.success() && output.stdout.is_empty(), "{}", stderr(&output));
    }
    assert!(place.bytes("in.exr") == place.bytes("alone.exr"));
    // Without --format, linear.
    let output =
        place.run(&["denoise", "room/4spp.exr", "-o", "-", "--filter", EDGE_AWARE, "--quiet"]);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", stderr(&output));
    assert!(output.stdout == place.bytes("alone.exr"));
    assert_eq!(fs::read_dir(place.path("tmp")).expect("a folder").count(), 0);
}

#[test]
fn streams_are_for_a_single_image() {
    let place = place();
    let two = ["room/4spp.exr", "room/reference.exr"];
    let to = |inputs: &[&'static str], output| {
        [&["denoise"], inputs, &["-o", output, "--filter", "1"]].concat()
    };
    place.fails(2, &to(&["-", two[0]], "clean/"), &["standard input"]);
    place.fails(2, &to(&two, "-"), &["2 inputs"]);
    place.fails(2, &to(&["-"], "clean/"), &["standard input", "name"]);
    place.fails(2, &to(&["-"], "c.##.exr"), &["standard input", "number"]);
    place.fails(2, &[&to(&two[..1], "-")[..], &["--json"]].concat(), &["--json", "--output -"]);
}

#[test]
fn a_damaged_stream_is_called_what_it_is() {
    let place = place();
    fs::write(place.path("text"), "no image").expect("writable");
    let output = piped(&place, "text", &["denoise", "-", "-o", "-"]);
    let report = stderr(&output);
    assert_eq!(output.status.code(), Some(1));
    assert!(report.starts_with("tamis: error: standard input: not an OpenEXR file"), "{report}");
    assert!(output.stdout.is_empty());
    assert_eq!(fs::read_dir(place.path("tmp")).expect("a folder").count(), 0);
}
