//! `evolve`.

#[cfg(unix)]
use std::process::{Child, Command, Stdio};
#[cfg(unix)]
use std::thread;
#[cfg(unix)]
use std::time::{Duration, Instant};

use crate::place::{CLEAN, NOISY, Place, json, stderr, write_exr};

/// A search of a few seconds at most.
const TINY: [&str; 12] = [
    "evolve",
    "--preset",
    "weights",
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
    same_page(&place, ["one", "two", "resumed"]);
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
fn under_way(place: &Place, out: &str) -> Child {
    started(place, &tiny(out, &["--generations", "1000000"]), out)
}

/// A search that is under way: the initial population is judged.
#[cfg(unix)]
fn started(place: &Place, arguments: &[&str], out: &str) -> Child {
    let mut command = place.program(arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let start = Instant::now();
    while !place.path(&format!("{out}/best.toml")).exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no filter appears");
        thread::sleep(Duration::from_millis(10));
    }
    child.expect("the program starts")
}

#[cfg(unix)]
fn send(signal: &str, child: &Child) {
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status();
    assert!(kill.expect("there is a kill command").success());
}

fn training(place: &Place, file: &str) -> toml::Table {
    let file = String::from_utf8(place.bytes(file)).expect("UTF-8");
    let file: toml::Table = file.parse().expect("TOML");
    file["training"].as_table().expect("a table").clone()
}

#[cfg(unix)]
#[test]
fn an_interrupted_search_writes_its_best_so_far_and_can_judge_it_later() {
    for signal in ["-INT", "-TERM"] {
        let place = Place::new();
        let child = under_way(&place, "out");
        send(signal, &child);
        let output = child.wait_with_output().expect("the program ends");
        let said = stderr(&output);
        assert!(output.status.success() && said.contains("stopping"), "{said}");
        let text = String::from_utf8(output.stdout).expect("UTF-8");
        assert!(text.contains("search stopped by the user"), "{text} {said}");
        assert!(text.contains("not judged on all pixels"), "{text}");
        place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", "out/best.toml"]);
        assert!(training(&place, "out/best.toml").get("error").is_none());
        assert!(place.path("out/checkpoint.json").is_file());

        // The command that it names judges the finalists, and breeds nothing.
        let command = text.lines().find(|line| line.starts_with("`tamis evolve")).expect("it");
        let command = command.split('`').nth(1).expect("it is quoted");
        let judged = place.done(&command.split(' ').skip(1).collect::<Vec<_>>());
        assert!(judged.contains("training error") && judged.contains("finished"), "{judged}");
        assert!(training(&place, "out/best.toml")["error"].is_float());
    }
}

#[cfg(unix)]
#[test]
fn a_killed_search_leaves_a_filter_and_nothing_that_is_in_the_way() {
    let place = Place::new();
    let mut child = under_way(&place, "out");
    // Another one may not write there meanwhile, whatever it is told.
    for more in [&["--generations", "1"][..], &["--generations", "1", "--overwrite"]] {
        let output = place.run(&tiny("out", more));
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        let process = format!("process {}", child.id());
        assert!(said.contains(&process) && said.contains("--out"), "{said}");
    }
    let output = place.run(&["evolve", "--out", "out", "--resume"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    send("-KILL", &child);
    assert!(!child.wait().expect("it ends").success());
    assert!(place.path("out/search.lock").is_file());

    let training = training(&place, "out/best.toml");
    assert!(training["ending"].as_str().is_some_and(|text| text.contains("under way")));
    assert!(training.get("error").is_none() && training["error-while-breeding"].is_float());
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", "out/best.toml"]);
    std::fs::write(place.path("out/.tamis-4294967295-Xyz123"), "left").expect("writable");
    let resume = ["evolve", "--out", "out", "--resume", "--max-time", "0"];
    assert!(place.done(&resume).contains("stopped by the time limit"));
    assert!(!place.path("out/search.lock").exists());
    // What there is to tell of left-over files hangs on the system.
    let left = place.path("out/.tamis-4294967295-Xyz123").exists();
    assert_eq!(left, cfg!(not(target_os = "linux")));
}

#[test]
fn a_search_is_not_resumed_on_scenes_that_have_changed() {
    let place = Place::new();
    place.done(&tiny("out", &["--generations", "0"]));
    let resume = ["evolve", "--out", "out", "--resume", "--generations", "1"];
    let mut noisy = NOISY;
    noisy[3].1 = |x, _| if x < 12 { 0.999 } else { 0.0 };
    write_exr(&place.path("room/4spp.exr"), &noisy);
    place.fails(1, &resume, &["the noisy image of `room`", "start anew"]);
    write_exr(&place.path("room/4spp.exr"), &NOISY);
    let mut clean = CLEAN;
    clean[0].1 = |x, y| if (x, y) == (3, 4) { 0.801 } else { CLEAN[0].1(x, y) };
    write_exr(&place.path("room/reference.exr"), &clean);
    place.fails(1, &resume, &["the reference of `room`"]);
    write_exr(&place.path("room/reference.exr"), &CLEAN);
    place.done(&resume);
}

#[test]
fn a_search_can_be_resumed_whatever_its_share() {
    let place = Place::new();
    let mut random = 7u64;
    for k in 0..12 {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        let share = ((random >> 11) as f64 / (1u64 << 53) as f64).to_string();
        let out = format!("out{k}");
        place.done(&tiny(&out, &["--generations", "0", "--share", &share]));
        place.done(&["evolve", "--out", &out, "--resume", "--generations", "1"]);
    }
}

#[test]
fn a_damaged_checkpoint_is_refused() {
    let place = Place::new();
    place.done(&tiny("out", &["--generations", "1"]));
    let mut bytes = place.bytes("out/checkpoint.json");
    let at = bytes.len() / 3;
    bytes[at] ^= 1;
    std::fs::write(place.path("out/checkpoint.json"), bytes).expect("writable");
    let resume = ["evolve", "--out", "out", "--resume", "--generations", "2"];
    place.fails(1, &resume, &["out/checkpoint.json", "damaged", "start anew"]);
    place.fails(1, &["evolve", "--out", "gone", "--resume"], &["gone/checkpoint.json"]);
    assert!(!place.path("gone").exists());
}

#[test]
fn what_is_out_of_bounds_is_refused_before_anything_is_read() {
    let place = Place::new();
    for (flag, value, named) in [
        ("--island-size", "1000000000", "island_size"),
        ("--island-size", "1", "island_size"),
        ("--islands", "0", "islands"),
        ("--islands", "18446744073709551615", "islands"),
        ("--tournament", "7", "to the island's size"),
        ("--radius", "0", "radius"),
        ("--radius", "4294967295", "radius"),
        ("--generations", "4294967295", "generations"),
        ("--finalists", "0", "finalists"),
        ("--batch", "0", "batch"),
        ("--together", "0", "together"),
        ("--max-nodes", "18446744073709551615", "max_nodes"),
        ("--initial-mutations", "4294967295", "initial_mutations"),
        ("--share", "0", "share"),
        ("--threads", "1000000", "--threads"),
        ("--threads", "0", "--threads"),
    ] {
        let mut arguments = vec!["evolve", "--preset", "weights", "--scenes", "nowhere"];
        arguments.extend(["--out", "out"]);
        if flag != "--island-size" {
            arguments.extend(["--island-size", "6"]);
        }
        arguments.extend([flag, value]);
        place.fails(2, &arguments, &[named]);
    }
    assert!(!place.path("out").exists());
}

#[test]
fn what_cannot_be_written_is_said_at_once_and_never_costs_the_result() {
    let place = Place::new();
    // A folder that cannot be made, and one that takes no files; no scene is looked for.
    let nowhere = ["evolve", "--scenes", "nowhere", "--out"];
    place.fails(
        1,
        &[&nowhere[..], &["room/4spp.exr/out"]].concat(),
        &["room/4spp.exr/out", "--out"],
    );
    if cfg!(target_os = "linux") {
        place.fails(1, &[&nowhere[..], &["/proc"]].concat(), &["/proc", "cannot write", "--out"]);
    }

    let whole = place.done(&tiny("whole", &["--generations", "6"]));
    let weight = whole.lines().next().expect("the filter");
    for (blocked, status) in [("checkpoint.json", 0), ("best.toml", 1), ("history.csv", 1)] {
        let out = format!("without-{blocked}");
        std::fs::create_dir_all(place.path(&format!("{out}/{blocked}/in the way")))
            .expect("a folder");
        let more = ["--generations", "6", "--overwrite", "--checkpoint-every", "1"];
        let output = place.run(&tiny(&out, &more));
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(status), "{said}");
        let text = String::from_utf8(output.stdout).expect("UTF-8");
        assert!(text.starts_with(weight), "{text}");
        let warned = said.matches("warning:").count();
        assert_eq!(warned, usize::from(blocked != "history.csv"), "{said}");
        assert!(said.contains(&format!("{blocked}: cannot write")), "{said}");
        for other in ["checkpoint.json", "best.toml", "history.csv", "summary.md"] {
            let there = place.path(&format!("{out}/{other}")).is_file();
            assert_eq!(there, other != blocked, "{out}/{other}");
        }
    }
}

#[test]
fn a_search_replaces_no_other_by_accident() {
    let place = Place::new();
    let none = ["--generations", "0"];
    place.done(&tiny("out", &none));
    place.fails(1, &tiny("out", &none), &["out", "--resume", "--out", "--overwrite"]);
    place.fails(2, &["evolve", "--resume", "--overwrite"], &["--overwrite"]);
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

/// Checks that searches left one page, but for the folders that they say they are in.
fn same_page(place: &Place, outs: [&str; 3]) {
    let page = |out: &str| {
        let html = String::from_utf8(place.bytes(&format!("{out}/report.html"))).expect("UTF-8");
        assert!(html.contains(&format!(" --out {out}")), "no command in the page of {out}");
        html.replace(&format!(" --out {out}"), "")
    };
    let first = page(outs[0]);
    assert!(outs.iter().all(|out| page(out) == first), "pages differ");
}

/// A search for programs of a few seconds.
pub(crate) fn programs<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["evolve", "--scenes", "room", "--validate", "room", "--out", out];
    arguments.extend(["--population", "5", "--children", "5", "--tune-steps", "2", "--crop", "8"]);
    arguments.extend(["--exam", "8", "--finish-steps", "3", "--interval", "1"]);
    arguments.extend(more);
    arguments
}

#[test]
fn a_search_finds_the_same_programs_however_it_is_run() {
    let place = Place::new();
    let text = place.done(&programs("one", &["--generations", "3", "--threads", "1"]));
    for said in ["front-01", "kan2017", "seed, as it was", "search finished"] {
        assert!(text.contains(said), "{text}");
    }
    place.done(&programs("two", &["--generations", "3", "--threads", "2"]));
    place.done(&programs("resumed", &["--generations", "1"]));
    place.done(&["evolve", "--out", "resumed", "--resume", "--generations", "3"]);
    same_page(&place, ["one", "two", "resumed"]);
    let others = ["history.jsonl", "front/front-01.toml", "summary.md", "front.svg"];
    for file in ["best.toml", "history.csv"].into_iter().chain(others) {
        let bytes = place.bytes(&format!("one/{file}"));
        assert!(place.bytes(&format!("two/{file}")) == bytes, "{file} with two threads");
        assert!(place.bytes(&format!("resumed/{file}")) == bytes, "{file} after a resume");
    }
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", "one/best.toml"]);
    assert_eq!(training(&place, "one/best.toml")["ending"].as_str(), Some("finished"));

    // No program of an older run is left beside those of a new one.
    std::fs::write(place.path("one/front/front-99.toml"), "old").expect("writable");
    std::fs::write(place.path("one/front/mine.toml"), "mine").expect("writable");
    place.done(&programs("one", &["--generations", "0", "--overwrite"]));
    assert!(!place.path("one/front/front-99.toml").exists());
    assert!(place.path("one/front/mine.toml").exists());
}

#[test]
fn what_a_search_for_programs_cannot_be_told_is_refused_by_name() {
    let place = Place::new();
    place.fails(2, &programs("out", &["--islands", "3"]), &["--islands", "`quick`"]);
    place.fails(2, &tiny("out", &["--population", "9"]), &["--population", "`weights`"]);
    place.fails(2, &tiny("out", &["--validate", "room"]), &["--validate", "programs"]);
    place.fails(2, &programs("out", &["--require-stable"]), &["--require-stable", "stress"]);
    place.fails(2, &programs("out", &["--population", "1000000000"]), &["population"]);
    place.fails(2, &programs("out", &["--features", "colour"]), &["colour"]);
    place.fails(2, &programs("out", &["--initial", "tamos"]), &["tamos", "tamis-formula"]);
    assert!(!place.path("out/checkpoint.json").exists());

    place.done(&programs("done", &["--generations", "0"]));
    place.fails(1, &programs("done", &["--generations", "0"]), &["--overwrite"]);
    place.fails(2, &["evolve", "--out", "done", "--resume", "--seed", "3"], &["--seed"]);
    let resume = ["evolve", "--out", "done", "--resume", "--generations", "1"];
    let mut noisy = NOISY;
    noisy[3].1 = |x, _| if x < 12 { 0.999 } else { 0.0 };
    write_exr(&place.path("room/4spp.exr"), &noisy);
    place.fails(1, &resume, &["the noisy image of `room`", "start anew"]);
    write_exr(&place.path("room/4spp.exr"), &NOISY);
    let mut bytes = place.bytes("done/checkpoint.json");
    let at = bytes.len() / 2;
    bytes[at] ^= 1;
    std::fs::write(place.path("done/checkpoint.json"), bytes).expect("writable");
    place.fails(1, &resume, &["done/checkpoint.json", "damaged"]);
}

#[cfg(unix)]
#[test]
fn an_interrupted_search_for_programs_leaves_its_best_and_goes_on() {
    let place = Place::new();
    let child = started(&place, &programs("out", &["--generations", "100000"]), "out");
    assert_eq!(training(&place, "out/best.toml")["ending"].as_str(), Some("under way"));
    send("-INT", &child);
    let output = child.wait_with_output().expect("the program ends");
    let said = stderr(&output);
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(output.status.success() && text.contains("stopped by the user"), "{text} {said}");
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", "out/best.toml"]);
    let more = ["evolve", "--out", "out", "--resume", "--max-time", "1"];
    assert!(place.done(&more).contains("stopped by the time limit"));
}
