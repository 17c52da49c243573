//! `denoise` with one frame and with many.

use std::fs;

use crate::place::{CLEAN, Channel, EDGE_AWARE, NOISY, Place, json, stderr, write_exr};

/// `denoise` with a filter that reads the normals.
fn denoise<'a>(inputs: &[&'a str], output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["denoise"], inputs, &["-o", output, "--filter", EDGE_AWARE], more].concat()
}

/// A folder `frames` with as many images as names, no two alike.
fn film(names: &[&str]) -> Place {
    let place = Place::new();
    fs::create_dir(place.path("frames")).expect("a writable folder");
    for (k, name) in names.iter().enumerate() {
        let mut channels = NOISY;
        channels[k % 3].1 = CLEAN[k % 3].1;
        write_exr(&place.path(&format!("frames/{name}")), &channels);
    }
    place
}

#[test]
fn several_frames_are_what_each_would_be_alone() {
    let inputs = ["frames/a.exr", "frames/b.1.exr", "frames/c.EXR"];
    let place = film(&["a.exr", "b.1.exr", "c.EXR"]);
    for (format, results) in
        [("exr", ["a.exr", "b.1.exr", "c.exr"]), ("png", ["a.png", "b.1.png", "c.png"])]
    {
        let clean = format!("clean/{format}/");
        let output = place.run(&denoise(&inputs, &clean, &["--format", format, "--timings"]));
        let report = stderr(&output);
        assert!(output.status.success() && output.stdout.is_empty(), "{report}");
        // What feeds the filter, once, as it is the same; then one line of remarks and one of
        // times each, in the order of the inputs.
        let (feeds, rest) = report.split_once('\n').expect("several lines");
        assert!(feeds.starts_with("frames/a.exr: colour from R G B"), "{report}");
        let lines: Vec<&str> = rest.lines().collect();
        assert_eq!(lines.len(), 2 * inputs.len() + 1, "{report}");
        for (name, lines) in results.iter().zip(lines.chunks(2)) {
            assert!(lines[0].starts_with(&format!("{clean}{name}: 24x20 pixels")), "{report}");
            assert!(lines[1].starts_with("load "), "{report}");
        }
        assert!(lines[6].starts_with("3 frames in ") && lines[6].contains(" add up to "));
        for (input, name) in inputs.iter().zip(results) {
            let alone = format!("alone.{format}");
            place.done(&denoise(&[input], &alone, &[]));
            assert!(place.bytes(&format!("{clean}{name}")) == place.bytes(&alone), "{name}");
        }
    }
    place.done(&denoise(&inputs, "clean", &["--threads", "1"]));
    place.done(&denoise(&inputs, "room", &["--threads", "2"]));
    for name in ["a.exr", "b.1.exr", "c.exr"] {
        let once = place.bytes(&format!("clean/exr/{name}"));
        assert!(place.bytes(&format!("clean/{name}")) == once, "{name} with one thread");
        assert!(place.bytes(&format!("room/{name}")) == once, "{name} with two");
    }
}

#[test]
fn one_frame_can_go_to_a_folder() {
    let place = film(&["a.exr"]);
    let input = ["frames/a.exr"];
    place.done(&denoise(&input, "alone.exr", &["--format", "exr"]));
    place.done(&denoise(&input, "room", &[]));
    place.done(&denoise(&input, "new/folder/", &[]));
    for name in ["room/a.exr", "new/folder/a.exr"] {
        assert!(place.bytes(name) == place.bytes("alone.exr"), "{name}");
    }
    place.done(&denoise(&input, "frames", &["--format", "png"]));
    assert!(place.bytes("frames/a.png").starts_with(b"\x89PNG"));
    place.fails(2, &denoise(&input, "no.exr", &["--format", "png"]), &["no.exr", "--format"]);
    place.fails(2, &denoise(&input, "no.exr", &["--format", "jpg"]), &["jpg", "png"]);
    place.fails(2, &denoise(&input, "frames", &[]), &["frames/a.exr", "input"]);
}

#[test]
fn a_frame_that_fails_leaves_the_others_alone() {
    let place = film(&["a.exr", "b.exr", "c.exr", "d.exr"]);
    let inputs = ["frames/a.exr", "frames/b.exr", "frames/c.exr", "frames/d.exr"];
    fs::write(place.path("frames/b.exr"), "no image").expect("writable");
    write_exr(&place.path("frames/c.exr"), &CLEAN);
    let output = place.run(&denoise(&inputs, "clean/", &["--timings"]));
    let report = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{report}");
    let starts = [
        "frames/a.exr: colour from",
        "clean/a.exr: 24x20",
        "load ",
        "tamis: error: frames/b.exr: not an OpenEXR file",
        "tamis: error: frames/c.exr: the filter reads `normal`",
        "clean/d.exr: 24x20",
        "load ",
        "2 frames in ",
        "tamis: error: 2 of 4 frames failed:",
        "  frames/b.exr: not an OpenEXR file",
        "  frames/c.exr: the filter reads `normal`",
    ];
    assert_eq!(report.lines().count(), starts.len(), "{report}");
    for (line, start) in report.lines().zip(starts) {
        assert!(line.starts_with(start), "no `{start}` in: {report}");
    }
    for (input, name) in [("frames/a.exr", "a.exr"), ("frames/d.exr", "d.exr")] {
        place.done(&denoise(&[input], "alone.exr", &[]));
        assert!(place.bytes(&format!("clean/{name}")) == place.bytes("alone.exr"), "{name}");
    }
    assert_eq!(fs::read_dir(place.path("clean")).expect("a folder").count(), 2);

    let quiet = place.run(&denoise(&inputs, "clean/", &["--quiet", "--timings"]));
    assert_eq!(stderr(&quiet).lines().count(), 5, "errors only: {}", stderr(&quiet));
    place.fails(1, &denoise(&inputs[1..3], "none/", &[]), &["2 of 2 frames failed"]);
    assert!(!place.path("none").exists(), "there was nothing to put into the folder");
}

#[test]
fn several_frames_that_cannot_all_be_done_are_not_begun() {
    let place = film(&["a.exr", "b.exr"]);
    let (a, b) = ("frames/a.exr", "frames/b.exr");
    fs::copy(place.path(a), place.path("room/a.exr")).expect("writable");
    let clash = denoise(&[a, b, "room/a.exr"], "clean/", &[]);
    place.fails(2, &clash, &[a, "room/a.exr", "clean/a.exr"]);
    let missing = denoise(&["no1.exr", a, "no2.exr"], "clean/", &[]);
    place.fails(1, &missing, &["2 of 3", "no1.exr", "no2.exr"]);
    place.fails(2, &denoise(&[a, b], "frames", &[]), &[a, "input"]);
    place.fails(2, &denoise(&["room/a.exr", b], "room/../frames/", &[]), &["/b.exr", "input"]);
    place.fails(2, &denoise(&[a, b], "clean", &[]), &["2 inputs", "clean", "folder"]);
    place.fails(2, &denoise(&[a, b], "clean.exr", &[]), &["2 inputs", "clean.exr", "folder"]);
    place.fails(1, &denoise(&[a, b], "room/a.exr/", &[]), &["room/a.exr/", "folder"]);
    place.fails(2, &denoise(&[a, b], "clean/", &["--backend", "none"]), &["none"]);
    assert!(!place.path("clean").exists());
}

#[cfg(unix)]
#[test]
fn a_folder_that_cannot_be_made_ends_the_run() {
    let place = film(&["a.exr", "b.exr"]);
    std::os::unix::fs::symlink("nowhere", place.path("clean")).expect("a writable folder");
    let run = denoise(&["frames/a.exr", "frames/b.exr"], "clean/", &[]);
    let report = place.fails(1, &run, &["clean/", "--output"]);
    assert_eq!(report.lines().count(), 1, "once for all frames: {report}");
}

/// Without `--filter` nothing that a file lacks is an error: the filter does without, and a line
/// says what feeds it.
#[test]
fn a_frame_without_a_filter_gets_the_one_that_does_without() {
    let place = film(&["a.exr", "b.exr", "c.exr"]);
    let depth: Channel = ("Depth.Z", |x, _| 1.0 + x as f32);
    write_exr(&place.path("frames/b.exr"), &CLEAN);
    write_exr(&place.path("frames/c.exr"), &[&NOISY[..], &[depth]].concat());
    let frames = ["frames/a.exr", "frames/b.exr", "frames/c.exr"];
    let denoise = |more: &[&str]| {
        let output = place.run(&[&["denoise"], &frames[..], &["-o", "clean/"], more].concat());
        let report = stderr(&output);
        assert!(output.status.success(), "{report}");
        report
    };
    let report = denoise(&[]);
    for (frame, feeds) in [
        ("a", "normals from Normal, albedo from Albedo; absent: depth, variances (estimated)"),
        ("b", "variances (estimated); albedo and normals would take away"),
        ("c", "albedo from Albedo, depth from Depth.Z; absent: variances (estimated)"),
    ] {
        let begin = format!("frames/{frame}.exr: colour from ");
        let line = report.lines().find(|line| line.starts_with(&begin));
        assert!(line.is_some_and(|line| line.contains(feeds)), "no `{feeds}` in: {report}");
    }
    assert_eq!(report.matches("filter `tamis`").count(), 3, "{report}");

    // Radii are for single weights.
    let radius = ["denoise", frames[0], "-o", "small.exr", "--radius", "2"];
    place.fails(2, &radius, &["--radius 2", "`tamis` is a program"]);
    let radius = ["denoise", frames[0], "-o", "small.exr", "--radius", "2", "--filter", "gaussian"];
    assert!(stderr(&place.run(&radius)).contains("filter `gaussian`, radius 2"));

    // Whoever names a filter wants that one.
    let named = ["denoise", frames[0], "-o", "no.exr", "--filter", "kan2017"];
    place.fails(1, &named, &["frames/a.exr", "the filter reads"]);
}

#[test]
fn strength_is_how_much_of_the_result_is_taken() {
    let place = Place::new();
    let error = |strength: &str, of: &str| {
        let more = ["--strength", strength];
        place.done(&denoise(&["room/4spp.exr"], "out.exr", &more));
        let measured = json(&place.done(&["compare", "out.exr", of, "--json"]));
        measured["rel_mse"].as_f64().expect("a number")
    };
    assert_eq!(error("0", "room/4spp.exr"), 0.0);
    let [none, half, all] = ["0", "0.5", "1"].map(|strength| error(strength, "room/4spp.exr"));
    assert!(none < half && half < all, "{none} {half} {all}");
    // Half as far is a quarter of the square.
    assert!((4.0 * half / all - 1.0).abs() < 1e-4, "{half} {all}");
    let more = ["--strength", "1.5"];
    place.fails(2, &denoise(&["room/4spp.exr"], "out2.exr", &more), &["--strength", "0 to 1"]);
}
