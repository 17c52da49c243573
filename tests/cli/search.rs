//! `evolve`.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use crate::place::{Place, json, stderr};

/// A search of a few seconds at most.
const TINY: [&str; 10] = [
    "evolve",
    "--scenes",
    "room",
    "--radius",
    "2",
    "--islands",
    "2",
    "--island-size",
    "6",
    "--finalists",
];

fn tiny<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = TINY.to_vec();
    // RelMSE, because that is what `compare` prints.
    arguments.extend(["3", "--out", out, "--racing", "on", "--error", "rel-mse"]);
    arguments.extend(more);
    arguments
}

#[test]
fn a_search_finds_the_same_filter_however_it_is_run() {
    let place = Place::new();
    let text = place.done(&tiny("one", &["--generations", "4", "--threads", "1"]));
    assert!(text.contains("training error") && text.contains("kan2017"), "{text}");
    place.done(&tiny("two", &["--generations", "4", "--threads", "2"]));
    place.done(&tiny("resumed", &["--generations", "2"]));
    // The search remembers its scenes.
    place.done(&["evolve", "--out", "resumed", "--resume", "--generations", "4"]);
    for file in ["best.toml", "history.csv"] {
        let bytes = place.bytes(&format!("one/{file}"));
        assert!(place.bytes(&format!("two/{file}")) == bytes, "{file} with two threads");
        assert!(place.bytes(&format!("resumed/{file}")) == bytes, "{file} after a resume");
    }

    let file = String::from_utf8(place.bytes("one/best.toml")).expect("UTF-8");
    let file: toml::Table = file.parse().expect("TOML");
    let training = &file["training"];
    assert_eq!(training["seed"].as_integer(), Some(1));
    assert_eq!(training["parameters"]["island_size"].as_integer(), Some(6));
    assert_eq!(training["scenes"][0]["name"].as_str(), Some("room"));
    let error = training["error"].as_float().expect("a number");
    assert!(error < training["scenes"][0]["noisy-rel-mse"].as_float().expect("a number"));
    let summary = String::from_utf8(place.bytes("one/summary.md")).expect("UTF-8");
    let weight = file["stage"][0]["weight"].as_str().expect("text");
    assert!(summary.contains(weight) && summary.contains("What the filters look at"));

    // What was reported is what the file does.
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", "one/best.toml"]);
    let measured = json(&place.done(&["compare", "out.exr", "room/reference.exr", "--json"]));
    let measured = measured["rel_mse"].as_f64().expect("a number");
    assert!((measured / error - 1.0).abs() < 1e-9, "{measured} is not {error}");
}

#[test]
fn a_search_leaves_out_what_its_scenes_lack() {
    let place = Place::new();
    let output = place.run(&tiny("out", &["--generations", "0", "--backend", "interp"]));
    let log = stderr(&output);
    assert!(output.status.success(), "{log}");
    assert!(log.contains("not used") && log.contains("secTexture"), "{log}");
    let file = String::from_utf8(place.bytes("out/best.toml")).expect("UTF-8");
    assert!(file.contains("\"worldPosition\"") && !file.contains("\"normal\""), "{file}");
}

#[cfg(unix)]
#[test]
fn an_interrupted_search_writes_its_best_so_far() {
    let place = Place::new();
    let mut command = place.program(&tiny("out", &["--generations", "1000000"]));
    let mut child =
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts");
    let log = BufReader::new(child.stderr.take().expect("it is piped"));
    let interrupt = || {
        let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        assert!(kill.expect("there is a kill command").success());
    };
    let mut said = Vec::new();
    for line in log.lines() {
        let line = line.expect("UTF-8");
        if said.is_empty() && line.starts_with("generation") {
            interrupt();
            said.push(line);
        } else if !said.is_empty() {
            said.push(line);
        }
    }
    let output = child.wait_with_output().expect("the program ends");
    assert!(output.status.success(), "{said:?}");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(text.contains("search stopped by the user"), "{text} {said:?}");
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", "out/best.toml"]);
    assert!(place.path("out/checkpoint.json").is_file());
}

#[test]
fn a_search_replaces_no_other_by_accident() {
    let place = Place::new();
    let none = ["--generations", "0"];
    place.done(&tiny("out", &none));
    place.fails(1, &tiny("out", &none), &["out", "--resume", "--out", "--overwrite"]);
    place.fails(2, &tiny("out", &["--resume", "--overwrite"]), &["--overwrite"]);
    place.done(&tiny("out", &["--generations", "0", "--overwrite"]));
    place.done(&tiny("other", &none));
    // Scenes that are given are checked.
    std::fs::create_dir(place.path("moved")).expect("a writable folder");
    std::fs::rename(place.path("room"), place.path("moved/room")).expect("a folder");
    let resume = ["evolve", "--out", "out", "--resume", "--generations", "1"];
    place.fails(1, &resume, &["room"]);
    place.done(&[&resume[..], &["--scenes", "moved/room"]].concat());
    // From now on these are the search's.
    place.done(&["evolve", "--out", "out", "--resume", "--generations", "2"]);
    std::fs::write(place.path("out/scenes.json"), "[]").expect("writable");
    place.fails(1, &resume, &["out/scenes.json", "--scenes"]);
}

#[test]
fn a_search_keeps_to_its_time() {
    let place = Place::new();
    let text = place.done(&tiny("out", &["--generations", "1000000", "--max-time", "1"]));
    assert!(text.contains("stopped by the time limit"), "{text}");
}

#[test]
fn a_search_lets_only_stable_filters_win_if_asked_to() {
    let place = Place::new();
    let output = place.run(&tiny("out", &["--generations", "1", "--require-stable"]));
    assert!(output.status.success(), "{}", stderr(&output));
    let warned = stderr(&output).contains("no finalist is stable");
    let verdict = place.run(&["stress", "out/best.toml", "--scenes", "room"]);
    assert_eq!(verdict.status.success(), !warned, "{}", String::from_utf8_lossy(&verdict.stdout));
    let filter = String::from_utf8(place.bytes("out/best.toml")).expect("TOML");
    assert!(filter.contains("require-stable = true"), "{filter}");

    // Another search: what was refused here would have been bred from.
    let resume = ["evolve", "--scenes", "room", "--out", "out", "--resume", "--generations", "2"];
    place.fails(1, &resume, &["stable only"]);
    place.done(&[&resume[..], &["--require-stable"]].concat());
}
