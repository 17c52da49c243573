//! `denoise` with patterns, folders, shares of sequences, and what becomes of each frame.

use std::fs;

use serde_json::Value;

use crate::place::{CLEAN, Channel, EDGE_AWARE, NOISY, Place, json, stderr, write_exr};

/// `denoise` with a filter that reads the normals.
fn denoise<'a>(inputs: &[&'a str], output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["denoise"], inputs, &["-o", output, "--filter", EDGE_AWARE], more].concat()
}

/// A folder `frames` with `shot.0001.exr` and so on, no two neighbours alike.
fn shot(numbers: &[usize]) -> Place {
    let place = Place::new();
    fs::create_dir(place.path("frames")).expect("a writable folder");
    for &k in numbers {
        let mut channels = NOISY;
        channels[k % 3].1 = CLEAN[k % 3].1;
        write_exr(&place.path(&format!("frames/shot.{k:04}.exr")), &channels);
    }
    place
}

/// The names in a folder, sorted.
fn names(place: &Place, folder: &str) -> Vec<String> {
    let entries = fs::read_dir(place.path(folder)).expect("a folder");
    let name = |entry: Result<fs::DirEntry, _>| entry.expect("readable").file_name();
    let mut names: Vec<String> =
        entries.map(|entry| name(entry).into_string().expect("UTF-8")).collect();
    names.sort();
    names
}

fn lines(text: &str) -> Vec<Value> {
    text.lines().map(json).collect()
}

#[test]
fn a_pattern_takes_its_frames_and_gives_their_numbers() {
    let place = shot(&[1, 2, 3, 10]);
    let all = ["shot.0001.exr", "shot.0002.exr", "shot.0003.exr", "shot.0010.exr"];
    place.done(&denoise(&["frames/shot.####.exr"], "all/", &[]));
    assert_eq!(names(&place, "all"), all);
    let run = place.run(&denoise(
        &["frames/shot.%04d.exr"],
        "clean/c_###.exr",
        &["--frames", "1-3x2,10"],
    ));
    let report = stderr(&run);
    assert!(run.status.success(), "{report}");
    assert_eq!(names(&place, "clean"), ["c_001.exr", "c_003.exr", "c_010.exr"]);
    // The first line says what feeds the filter, in all of them.
    let order = report.lines().skip(1).filter_map(|line| line.split(':').next());
    let order: Vec<&str> = order.collect();
    assert_eq!(order, ["clean/c_001.exr", "clean/c_003.exr", "clean/c_010.exr"], "{report}");
    for number in ["1", "3", "10"] {
        let name = format!("{number:0>4}.exr");
        place.done(&denoise(&[&format!("frames/shot.{name}")], "alone.exr", &[]));
        assert!(place.bytes(&format!("all/shot.{name}")) == place.bytes("alone.exr"), "{name}");
        let renamed = format!("clean/c_{number:0>3}.exr");
        assert!(place.bytes(&renamed) == place.bytes("alone.exr"), "{renamed}");
    }
    // One frame may have any name.
    place.done(&denoise(&["frames/shot.####.exr"], "two.exr", &["--frames", "2"]));
    assert!(place.bytes("two.exr") == place.bytes("all/shot.0002.exr"));
}

#[test]
fn folders_and_globs_stand_for_their_files() {
    let place = shot(&[2, 1]);
    fs::write(place.path("frames/.shot.0003.exr"), "hidden").expect("writable");
    fs::write(place.path("frames/notes.txt"), "no image").expect("writable");
    fs::create_dir(place.path("frames/old.exr")).expect("writable");
    for (input, clean) in
        [("frames", "a/"), ("frames/", "b/"), ("frames/*.exr", "c/"), ("fr*/shot.000[12]*", "d/")]
    {
        place.done(&denoise(&[input], clean, &[]));
        assert_eq!(names(&place, clean), ["shot.0001.exr", "shot.0002.exr"], "{input}");
    }
    let both = ["frames/shot.0001.exr", "frames/shot.0002.exr"];
    for inputs in [&["frames"][..], &["frames/*.exr"], &both] {
        place.done(&denoise(inputs, "one/shot.####.exr", &["--frames", "2"]));
        assert_eq!(names(&place, "one"), ["shot.0002.exr"], "{inputs:?}");
    }
}

#[test]
fn what_is_not_there_is_named_before_any_work() {
    let place = shot(&[1, 2, 5]);
    let pattern = "frames/shot.####.exr";
    for nothing in ["frames/take.####.exr", "frames/take*.exr", "none/*.exr"] {
        place.fails(1, &denoise(&[nothing], "clean/", &[]), &[nothing, "nothing was found"]);
    }
    place.fails(1, &denoise(&["none/####.exr"], "clean/", &[]), &["none"]);
    fs::create_dir(place.path("empty")).expect("writable");
    place.fails(1, &denoise(&["empty"], "clean/", &[]), &["empty", ".exr"]);
    let missing = ["1-6", "--keep-going"];
    for input in [pattern, "frames", "frames/*.exr"] {
        let run = denoise(&[input], "clean/", &["--frames", missing[0]]);
        place.fails(1, &run, &[input, "no frames 3-4, 6,", "--keep-going"]);
    }
    for frames in ["", "a", "3-1", "1-5x0"] {
        place.fails(2, &denoise(&[pattern], "clean/", &["--frames", frames]), &["--frames"]);
    }
    place.fails(2, &denoise(&[pattern], "clean.exr", &[]), &["3 inputs", "clean.####.exr"]);
    place.fails(2, &denoise(&["room/reference.exr"], "c.#.exr", &[]), &["reference.exr", "number"]);
    assert!(!place.path("clean").exists());

    let output = place.run(&[&denoise(&[pattern], "clean/", &["--frames"])[..], &missing].concat());
    let report = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{report}");
    assert_eq!(names(&place, "clean"), ["shot.0001.exr", "shot.0002.exr", "shot.0005.exr"]);
    let summary: Vec<&str> =
        report.lines().skip_while(|line| !line.contains("3 of 6 frames failed:")).collect();
    let [_, failures @ ..] = &summary[..] else { panic!("no summary in: {report}") };
    assert_eq!(failures.len(), 3, "{report}");
    for (line, number) in failures.iter().zip([3, 4, 6]) {
        assert!(line.starts_with(&format!("  frames/shot.000{number}.exr: ")), "{line}");
    }
}

#[test]
fn results_that_exist_are_left_alone_if_asked_to() {
    let place = shot(&[1, 2, 3]);
    fs::create_dir(place.path("clean")).expect("writable");
    fs::write(place.path("clean/shot.0002.exr"), "old").expect("writable");
    let skipping = denoise(&["frames"], "clean", &["--skip-existing"]);
    let report = stderr(&place.run(&skipping));
    assert_eq!(place.bytes("clean/shot.0002.exr"), b"old");
    assert_eq!(names(&place, "clean").len(), 3);
    assert!(report.lines().any(|line| line.starts_with("1 of 3 frames skipped")), "{report}");
    let report = stderr(&place.run(&skipping));
    assert_eq!(report.lines().count(), 1, "{report}");
    assert!(report.starts_with("3 of 3 frames skipped"), "{report}");
    // Of what is done nothing else is needed.
    fs::remove_file(place.path("frames/shot.0002.exr")).expect("a file");
    let pattern = ["frames/shot.0001.exr", "frames/shot.0002.exr"];
    place.done(&denoise(&pattern, "clean", &["--skip-existing"]));
    place.done(&denoise(&["frames/shot.####.exr"], "clean/shot.####.exr", &[]));
    place.fails(1, &denoise(&pattern, "clean", &[]), &["1 of 2", "shot.0002.exr"]);
}

#[test]
fn every_frame_has_a_line_of_json() {
    let place = shot(&[1, 2, 3, 4]);
    fs::create_dir(place.path("clean")).expect("writable");
    fs::write(place.path("clean/shot.0002.exr"), "old").expect("writable");
    fs::write(place.path("frames/shot.0003.exr"), "no image").expect("writable");
    let options = ["--json", "--skip-existing"];
    let output = place.run(&denoise(&["frames/shot.####.exr"], "clean", &options));
    assert_eq!(output.status.code(), Some(1));
    let found = lines(&String::from_utf8(output.stdout.clone()).expect("UTF-8"));
    let status = |k: usize| found[k]["status"].as_str().expect("text").to_owned();
    assert_eq!([0, 1, 2, 3].map(status), ["done", "skipped", "failed", "done"]);
    for (k, line) in found.iter().enumerate() {
        let done = line["status"] == "done";
        assert_eq!(line["frame"], k + 1);
        assert_eq!(line["input"], format!("frames/shot.000{}.exr", k + 1));
        assert_eq!(line["output"], format!("clean/shot.000{}.exr", k + 1));
        assert_eq!(line["seconds"].is_number(), done, "{line}");
        assert_eq!(line["filter"].is_string(), done, "{line}");
        assert_eq!(line["error"].is_string(), line["status"] == "failed", "{line}");
    }
    let error = found[2]["error"].as_str().expect("text");
    assert!(error.contains("not an OpenEXR file"), "{error}");
    // Remarks are for people.
    assert!(stderr(&output).contains("24x20 pixels"), "{}", stderr(&output));

    let alone = place.run(&denoise(&["frames/shot.0003.exr"], "alone.exr", &["--json"]));
    assert_eq!(alone.status.code(), Some(1));
    let found = lines(&String::from_utf8(alone.stdout.clone()).expect("UTF-8"));
    assert_eq!((found.len(), &found[0]["status"]), (1, &Value::from("failed")));
    let report = stderr(&alone);
    assert!(report.starts_with("tamis: error: frames/shot.0003.exr"), "{report}");
    fs::copy(place.path("frames/shot.0001.exr"), place.path("room/one.exr")).expect("writable");
    let unnumbered = lines(&place.done(&denoise(&["room/one.exr"], "r.exr", &["--json"])));
    assert_eq!(unnumbered[0]["frame"], Value::Null);
}

#[test]
fn shares_make_up_the_whole() {
    let place = shot(&[1, 2, 3, 4, 5]);
    let share = |shard: &'static str, more: &[&'static str]| {
        let more = [&["--shard", shard, "--json"], more].concat();
        let text = place.done(&denoise(&["frames"], "clean/", &more));
        let number = |line: &Value| line["frame"].as_u64().expect("a number");
        lines(&text).iter().map(number).collect::<Vec<u64>>()
    };
    assert_eq!(share("1/3", &[]), [1, 4]);
    assert_eq!(names(&place, "clean").len(), 2);
    // Whatever is there already, a share is the same one.
    assert_eq!(share("2/3", &["--skip-existing"]), [2, 5]);
    assert_eq!(share("1/3", &["--skip-existing"]), [1, 4]);
    assert_eq!(share("3/3", &[]), [3]);
    assert_eq!(names(&place, "clean").len(), 5);
    assert_eq!(share("2/2", &["--frames", "1-5x2"]), [3]);
    assert_eq!(share("7/7", &[]), [0_u64; 0]);
    for shard in ["0/4", "5/4", "x", "1"] {
        place.fails(2, &denoise(&["frames"], "clean/", &["--shard", shard]), &["--shard"]);
    }
}

#[test]
fn bad_pixels_are_told_even_to_the_quiet() {
    let place = shot(&[1]);
    let mut channels = NOISY;
    channels[0].1 = |x, y| if (x, y) == (3, 4) { f32::NAN } else { 0.5 };
    write_exr(&place.path("frames/shot.0002.exr"), &channels);
    for (repair, what) in [("median", "1 bad pixel"), ("none", "left in")] {
        let output = place.run(&denoise(&["frames"], "clean/", &["-q", "--repair", repair]));
        let report = stderr(&output);
        assert!(output.status.success(), "{report}");
        assert!(report.starts_with("frames/shot.0002.exr: R: ") && report.contains(what));
        assert_eq!(report.lines().count(), 1, "{report}");
    }
}

/// Features of each frame in a file of its own, in the frames' folder or in another.
#[test]
fn frames_of_a_folder_have_their_features_beside_them() {
    let place = shot(&[1, 2]);
    place.done(&denoise(&["frames"], "expected/", &[]));
    let named = |begin: &str, channels: &[Channel]| -> Vec<Channel> {
        channels.iter().filter(|(name, _)| name.starts_with(begin)).copied().collect()
    };
    fs::create_dir(place.path("n")).expect("writable");
    for k in 1..=2 {
        let mut channels = NOISY;
        channels[k % 3].1 = CLEAN[k % 3].1;
        let colour: Vec<Channel> =
            channels.iter().filter(|(name, _)| !name.contains('.')).copied().collect();
        write_exr(&place.path(&format!("frames/shot.{k:04}.exr")), &colour);
        let normal = named("Normal", &channels);
        write_exr(&place.path(&format!("frames/normal.{k:04}.exr")), &normal);
        write_exr(&place.path(&format!("n/{k:04}.exr")), &normal);
        write_exr(&place.path(&format!("frames/albedo.{k:02}.exr")), &named("Albedo", &channels));
    }
    let beside = |normal| ["--normal", normal, "--albedo", "frames/albedo.##.exr"];
    for (input, normal, clean) in [
        ("frames", "frames/normal.####.exr", "a/"),
        ("frames/*.exr", "frames/normal.%04d.exr", "b/"),
    ] {
        place.done(&denoise(&[input], clean, &beside(normal)));
        assert_eq!(names(&place, clean), ["shot.0001.exr", "shot.0002.exr"], "{input}");
        for name in names(&place, clean) {
            let expected = place.pixels(&format!("expected/{name}"));
            assert_eq!(place.pixels(&format!("{clean}{name}")), expected, "{name}");
        }
    }
    for k in 1..=2 {
        fs::remove_file(place.path(&format!("frames/normal.{k:04}.exr"))).expect("writable");
    }
    place.done(&denoise(&["frames"], "c/", &beside("n/####.exr")));
    assert_eq!(place.pixels("c/shot.0002.exr"), place.pixels("expected/shot.0002.exr"));

    // What is not there is told before any work, as are frames without a number.
    fs::remove_file(place.path("n/0002.exr")).expect("writable");
    let run = denoise(&["frames"], "d/", &beside("n/####.exr"));
    place.fails(1, &run, &["1 of 6", "n/0002.exr"]);
    write_exr(&place.path("frames/last.exr"), &CLEAN);
    place.fails(2, &run, &["frames/albedo.##.exr", "frames/last.exr", "number"]);
    place.fails(1, &denoise(&["n"], "d/", &beside("n/####.exr")), &["n", "--normal"]);
    assert!(!place.path("d").exists());
}

/// A file whose name would be a pattern is itself, wherever it is named.
#[test]
fn a_file_with_a_number_sign_in_its_name_is_no_pattern() {
    let place = shot(&[1]);
    write_exr(&place.path("v#1.exr"), &NOISY);
    write_exr(&place.path("v11.exr"), &NOISY);
    let normal: Vec<Channel> =
        NOISY.iter().filter(|(name, _)| name.starts_with("Normal")).copied().collect();
    write_exr(&place.path("n#.exr"), &normal);
    place.done(&denoise(&["room/4spp.exr"], "alone.exr", &[]));
    place.done(&denoise(&["v#1.exr"], "out.exr", &["--normal", "n#.exr"]));
    assert_eq!(place.pixels("out.exr"), place.pixels("alone.exr"));
    fs::write(place.path("o#1.exr"), "an older result").expect("writable");
    place.done(&denoise(&["v#1.exr"], "o#1.exr", &[]));
    assert_eq!(place.pixels("o#1.exr"), place.pixels("alone.exr"));
    // The file with the sign alone: its name has no frame number but the one behind it.
    let status = place.done(&denoise(&["v#1.exr"], "json.exr", &["--json"]));
    assert_eq!(lines(&status)[0]["frame"], 1);
    // Where there is no such file, it is a pattern.
    fs::remove_file(place.path("v#1.exr")).expect("writable");
    place.done(&denoise(&["v#1.exr"], "clean/", &[]));
    assert_eq!(names(&place, "clean"), ["v11.exr"]);
}
