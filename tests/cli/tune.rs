//! `tune`.

use std::fs;

use crate::place::{CLEAN, Place, stderr, write_exr};

/// A blur whose width is a constant.
const BLUR: &str = r#"version = 2
name = "blur"
[params]
width = { value = 0.3, min = 0.01, max = 10 }
[[stage]]
name = "result"
gather = "color"
weight = "exp(-distance2(pixel, pixel) / width)"
radius = 2
"#;

fn place() -> Place {
    let place = Place::new();
    fs::write(place.path("blur.toml"), BLUR).expect("a writable folder");
    place
}

fn tune<'a>(output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let given = ["tune", "blur.toml", "--scenes", "room", "--validate", "room", "-o", output];
    given.into_iter().chain(more.iter().copied()).collect()
}

/// A few steps on parts of the small scene.
const FEW: [&str; 8] = ["--batch", "2", "--crop", "16", "--interval", "4", "--rate", "0.1"];

#[test]
fn tuning_finds_the_same_constants_however_it_is_run() {
    let place = place();
    let whole = |name, more: &[&'static str]| {
        let more = [&FEW[..], &["--steps", "12"], more].concat();
        place.done(&tune(name, &more))
    };
    let text = whole("one.toml", &["--threads", "1"]);
    assert!(text.contains("finished") && text.contains("trimmed"), "{text}");
    whole("two.toml", &["--threads", "2", "--backend", "interp"]);
    // A run whose time is up before its first step, and that goes on from there.
    let none = [&FEW[..], &["--steps", "12", "--max-time", "0"]].concat();
    let text = place.done(&tune("later.toml", &none));
    assert!(text.contains("time limit"), "{text}");
    // It remembers its scenes.
    place.done(&["tune", "blur.toml", "-o", "later.toml", "--resume"]);
    let file = |name: &str| {
        let text = String::from_utf8(place.bytes(name)).expect("UTF-8");
        let mut file: toml::Table = text.parse().expect("TOML");
        file.remove("name");
        file
    };
    assert_eq!(file("one.toml"), file("two.toml"));
    assert_eq!(file("one.toml"), file("later.toml"));
    assert_eq!(place.bytes("one.csv"), place.bytes("later.csv"));
    let width = file("one.toml")["params"]["width"]["value"].as_float().expect("a number");
    assert!(width > 0.4, "noise asks for a wide blur, not {width}");
    let chart = String::from_utf8(place.bytes("one.svg")).expect("UTF-8");
    assert!(chart.contains("Tuning one") && chart.contains("RelMSE"), "{chart}");
    // What was tuned is a filter like any other.
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", "one.toml"]);
}

#[test]
fn what_cannot_be_tuned_is_said_before_anything_is_written() {
    let place = place();
    let named = ["bilateral", "constant", "[params]"];
    place.fails(1, &["tune", "bilateral", "--scenes", "room", "-o", "x.toml"], &named);
    place.fails(2, &tune("x.toml", &["--crop", "7"]), &["crop", "even"]);
    place.fails(2, &tune("x.toml", &["--batch", "1000000000"]), &["batch", "to 10000"]);
    place.fails(2, &tune("x.toml", &["--resume", "--seed", "3"]), &["--seed", "--resume"]);
    place.fails(1, &tune("x.toml", &["--resume"]), &["x.json"]);
    place.fails(2, &["tune", "blur.toml", "-o", "x.toml"], &["--scenes"]);
    fs::write(place.path("x.json"), "{}").expect("a writable folder");
    place.fails(1, &tune("x.toml", &["--resume"]), &["x.json", "checkpoint"]);
}

#[test]
fn a_run_replaces_no_other_by_accident() {
    let place = place();
    let few = [&FEW[..], &["--steps", "2"]].concat();
    place.done(&tune("x.toml", &few));
    place.fails(1, &tune("x.toml", &few), &["x.json", "--resume", "--output", "--overwrite"]);
    place.done(&tune("x.toml", &[&few[..], &["--overwrite"]].concat()));
    place.fails(2, &tune("x.toml", &["--resume", "--overwrite"]), &["--overwrite"]);
}

#[test]
fn a_run_is_not_resumed_on_scenes_that_have_changed_or_from_a_damaged_file() {
    let place = place();
    let few = [&FEW[..], &["--steps", "2"]].concat();
    place.done(&tune("x.toml", &few));
    assert!(!place.path("x.lock").exists() || cfg!(not(unix)));
    let mut clean = CLEAN;
    clean[0].1 = |x, y| if (x, y) == (3, 4) { 0.801 } else { CLEAN[0].1(x, y) };
    write_exr(&place.path("room/reference.exr"), &clean);
    place.fails(1, &tune("x.toml", &["--resume"]), &["the reference of `room`", "start anew"]);
    write_exr(&place.path("room/reference.exr"), &CLEAN);
    let mut bytes = place.bytes("x.json");
    let at = bytes.len() / 2;
    bytes[at] ^= 1;
    fs::write(place.path("x.json"), bytes).expect("writable");
    place.fails(1, &tune("x.toml", &["--resume"]), &["x.json is damaged"]);
}

#[test]
fn a_checkpoint_that_cannot_be_written_does_not_end_a_run() {
    let place = place();
    fs::create_dir_all(place.path("x.json/in the way")).expect("a folder");
    let few = [&FEW[..], &["--steps", "4", "--overwrite", "--checkpoint-every", "1"]].concat();
    let output = place.run(&tune("x.toml", &few));
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    assert_eq!(said.matches("x.json: cannot write").count(), 1, "{said}");
    assert!(place.path("x.toml").is_file());
    place.fails(1, &tune("gone/x.toml", &few), &["gone: cannot write", "--output"]);
}

#[test]
fn a_checkpoint_of_another_filter_is_refused() {
    let place = place();
    let few = [&FEW[..], &["--steps", "2"]].concat();
    let output = place.run(&tune("x.toml", &few));
    assert!(output.status.success(), "{}", stderr(&output));
    fs::write(place.path("blur.toml"), BLUR.replace("0.3", "0.4")).expect("a writable folder");
    place.fails(1, &tune("x.toml", &["--resume"]), &["filter"]);
}
