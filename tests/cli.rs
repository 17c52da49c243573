//! The program as people meet it: arguments in; text, files and an exit status
//! out.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, WritableImage};
use serde_json::Value;

const WIDTH: usize = 24;
const HEIGHT: usize = 20;

/// A channel's name, and its sample in column x and row y.
type Channel = (&'static str, fn(usize, usize) -> f32);

/// Two walls of different brightness that meet at an edge in the normals.
const CLEAN: [Channel; 3] = [
    ("R", |x, _| if x < 12 { 0.8 } else { 0.2 }),
    ("G", |x, _| if x < 12 { 0.6 } else { 0.3 }),
    ("B", |x, _| if x < 12 { 0.4 } else { 0.5 }),
];

const NOISY: [Channel; 9] = [
    ("R", |x, y| CLEAN[0].1(x, y) * noise(x, y, 1)),
    ("G", |x, y| CLEAN[1].1(x, y) * noise(x, y, 2)),
    ("B", |x, y| CLEAN[2].1(x, y) * noise(x, y, 3)),
    ("Normal.X", |x, _| if x < 12 { 1.0 } else { 0.0 }),
    ("Normal.Y", |x, _| if x < 12 { 0.0 } else { 1.0 }),
    ("Normal.Z", |_, _| 0.0),
    ("Albedo.R", |x, _| if x < 12 { 0.8 } else { 0.4 }),
    ("Albedo.G", |_, _| 0.5),
    ("Albedo.B", |_, _| 0.5),
];

/// A factor around 1 that nobody could guess from the pixel's neighbours.
fn noise(x: usize, y: usize, salt: u32) -> f32 {
    let mut bits = (x as u32 * 73_856_093) ^ (y as u32 * 19_349_663) ^ (salt * 83_492_791);
    bits ^= bits >> 13;
    bits = bits.wrapping_mul(0x5bd1_e995);
    bits ^= bits >> 15;
    0.2 + 1.6 * (bits & 0xffff) as f32 / 65_535.0
}

fn write_exr(path: &Path, channels: &[Channel]) {
    let samples = |f: fn(usize, usize) -> f32| {
        FlatSamples::F32((0..WIDTH * HEIGHT).map(|i| f(i % WIDTH, i / WIDTH)).collect())
    };
    let channels =
        AnyChannels::sort(channels.iter().map(|&(n, f)| AnyChannel::new(n, samples(f))).collect());
    let layer = Layer::new((WIDTH, HEIGHT), Default::default(), Encoding::FAST_LOSSLESS, channels);
    Image::from_layer(layer).write().to_file(path).expect("a writable folder");
}

/// A folder with a scene in it: `room/4spp.exr` and `room/reference.exr`.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        let place = Self { folder: tempfile::tempdir().expect("a temporary folder") };
        fs::create_dir(place.path("room")).expect("a writable folder");
        write_exr(&place.path("room/4spp.exr"), &NOISY);
        write_exr(&place.path("room/reference.exr"), &CLEAN);
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program, about to run in the folder.
    fn program(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tamis"));
        command.current_dir(self.folder.path()).args(arguments).stdin(Stdio::null());
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.program(arguments).output().expect("the program starts")
    }

    /// Runs what must work; returns stdout.
    fn done(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    /// Runs what must fail with a status, naming what is given; returns stderr.
    #[track_caller]
    fn fails(&self, status: i32, arguments: &[&str], named: &[&str]) -> String {
        let before = self.files();
        let output = self.run(arguments);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {message}");
        assert!(output.stdout.is_empty(), "results on stdout of a failed run");
        for name in named {
            assert!(message.contains(name), "{arguments:?}: no `{name}` in: {message}");
        }
        assert!(!message.contains("panicked"), "{message}");
        assert_eq!(self.files(), before, "{arguments:?} left files behind");
        message
    }

    /// Every file in and below the folder.
    fn files(&self) -> Vec<PathBuf> {
        fn list(folder: &Path, found: &mut Vec<PathBuf>) {
            for entry in fs::read_dir(folder).expect("readable") {
                let path = entry.expect("readable").path();
                if path.is_dir() { list(&path, found) } else { found.push(path) }
            }
        }
        let mut found = Vec::new();
        list(self.folder.path(), &mut found);
        found.sort();
        found
    }

    /// The values of `--lanes` that this host can do.
    fn lanes(&self) -> Vec<String> {
        let host = json(&self.done(&["inspect", "--host", "--json"]));
        let vectors = host["vectors"].as_array().expect("a list").clone();
        let possible = vectors.iter().filter(|entry| entry["lacking"].is_null());
        possible.map(|entry| entry["bits"].to_string()).collect()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error} in: {text}"))
}

const EDGE_AWARE: &str = "exp(-distance2(normal, normal) / 0.1)";

#[test]
fn a_filtered_image_is_nearer_to_its_reference() {
    let place = Place::new();
    let noisy = json(&place.done(&["compare", "room/4spp.exr", "room/reference.exr", "--json"]));
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", EDGE_AWARE]);
    let clean = json(&place.done(&["compare", "out.exr", "room/reference.exr", "--json"]));
    let error = |of: &Value| of["rel_mse"].as_f64().expect("a number");
    assert!(error(&clean) < error(&noisy) / 20.0, "{clean} against {noisy}");
    assert!(clean["trimmed_rel_mse"].as_f64() <= clean["rel_mse"].as_f64());
    assert!(clean["psnr_db"].as_f64() > noisy["psnr_db"].as_f64());
    let same = place.done(&["compare", "out.exr", "out.exr"]);
    assert!(same.contains("inf dB"), "{same}");
}

#[test]
fn a_filter_may_look_at_absolute_coordinates() {
    let place = Place::new();
    let filter = "1 / (1 + distance1(color, pixel))";
    place.done(&["denoise", "room/4spp.exr", "-o", "out.exr", "--filter", filter]);
    let text = place.done(&["score", "--scenes", "room", "--filters", filter]);
    let row = text.lines().find(|line| line.starts_with("room")).expect("a row per scene");
    assert!(row.ends_with(')'), "{text}");
}

#[test]
fn back_ends_threads_and_exact_passes_write_the_same_bytes() {
    let place = Place::new();
    let filter = "kernel.toml";
    fs::write(
        place.path(filter),
        format!(
            "version = 1\nname = \"kernel\"\n[[stage]]\nradius = 4\n\
             weight = \"{EDGE_AWARE} * tricube(distance2(pixel, pixel) / 4)\"\n"
        ),
    )
    .expect("writable");
    let denoise = |out: &str, more: &[&str]| {
        let mut arguments = vec!["denoise", "room/4spp.exr", "-o", out, "--filter", filter];
        arguments.extend(more);
        place.done(&arguments);
        place.bytes(out)
    };
    let interp = denoise("interp.exr", &["--backend", "interp"]);
    assert_eq!(denoise("rate.exr", &["--backend", "interp", "--without", "rate"]), interp);
    assert_eq!(denoise("threads.exr", &["--threads", "1", "--backend", "interp"]), interp);
    if cfg!(feature = "jit") {
        assert_eq!(denoise("jit.exr", &["--backend", "jit"]), interp);
        assert_eq!(denoise("again.exr", &["--threads", "2"]), interp);
        for lanes in place.lanes() {
            assert_eq!(denoise("lanes.exr", &["--lanes", &lanes]), interp, "{lanes}");
        }
    }
    assert_ne!(denoise("radius.exr", &["--radius", "2"]), interp);
}

#[test]
fn the_report_says_what_was_estimated_repaired_and_kept() {
    let place = Place::new();
    let mut channels = NOISY;
    channels[0].1 = |x, y| if (x, y) == (3, 4) { f32::NAN } else { NOISY[0].1(x, y) };
    write_exr(&place.path("bad.exr"), &channels);
    let estimate = format!("{EDGE_AWARE} + nVariance");
    let output = place.run(&["denoise", "bad.exr", "-o", "out.exr", "--filter", &estimate]);
    let report = stderr(&output);
    assert!(output.status.success() && output.stdout.is_empty(), "{report}");
    for part in ["bad.exr: R: 1 bad pixel", "nVariance: not in the file, estimated", "out.exr"] {
        assert!(report.contains(part), "no `{part}` in: {report}");
    }
    let refused = ["denoise", "bad.exr", "-o", "no.exr", "--filter", "1", "--repair", "error"];
    place.fails(1, &refused, &["bad.exr", "\"R\"", "x = 3, y = 4", "--repair median"]);

    let output = place.run(&["denoise", "room/4spp.exr", "-o", "kept.exr", "--filter", "0"]);
    assert!(stderr(&output).contains("480 pixels (100.0%) kept"), "{}", stderr(&output));
    let quiet = place.run(&["-q", "denoise", "bad.exr", "-o", "quiet.exr", "--filter", &estimate]);
    assert!(quiet.status.success() && quiet.stderr.is_empty(), "{}", stderr(&quiet));
}

#[test]
fn errors_name_what_is_at_fault_and_leave_nothing_behind() {
    let place = Place::new();
    fs::write(place.path("text.exr"), "no image").expect("writable");
    fs::write(place.path("cut.exr"), &place.bytes("room/4spp.exr")[..700]).expect("writable");
    fs::write(place.path("bad.toml"), "version = 1\nname = 3\n").expect("writable");
    let with = |input, filter| ["denoise", input, "-o", "out.exr", "--filter", filter];

    place.fails(1, &with("missing.exr", "1"), &["missing.exr"]);
    place.fails(1, &with("text.exr", "1"), &["text.exr", "not an OpenEXR file"]);
    place.fails(1, &with("cut.exr", "1"), &["cut.exr", "damaged"]);
    place.fails(1, &with("room/4spp.exr", "bad.toml"), &["bad.toml"]);
    place.fails(1, &with("room/4spp.exr", "missing.toml"), &["missing.toml"]);
    place.fails(
        1,
        &with("room/4spp.exr", "exp(-distance2(worldPosition, worldPosition))"),
        &["room/4spp.exr", "`worldPosition`", "Position.X", "Normal.X"],
    );
    let nowhere = ["denoise", "room/4spp.exr", "-o", "no/such/out.exr", "--filter", "1"];
    place.fails(1, &nowhere, &["no/such/out.exr"]);
    place.fails(1, &["compare", "room/4spp.exr", "missing.exr"], &["missing.exr"]);
    place.fails(1, &["inspect", "text.exr"], &["text.exr"]);
    place.fails(1, &["score", "--scenes", "nowhere"], &["nowhere", "NOISY.exr,REFERENCE.exr"]);
    place.fails(1, &["evolve"], &["data/train"]);
    place.fails(1, &["evolve", "--resume", "--scenes", "room"], &["checkpoint.json"]);
}

#[test]
fn a_wrong_command_line_is_told_from_failed_work() {
    let place = Place::new();
    let with = |more: &[&'static str]| {
        let mut arguments = vec!["denoise", "room/4spp.exr", "-o", "out.exr"];
        arguments.extend(more);
        arguments
    };
    place.fails(2, &[], &["Usage"]);
    place.fails(2, &["denoise", "room/4spp.exr"], &["--output"]);
    place.fails(2, &with(&["--filter", "bilatral"]), &["bilatral", "cross-bilateral"]);
    place.fails(2, &with(&["--filter", "exp(normal)"]), &["exp(normal)", "    ^"]);
    place.fails(2, &with(&["--filter", "normal"]), &["distance2(normal, normal)"]);
    place.fails(2, &with(&["--backend", "abacus"]), &["abacus", "gpu", "interp"]);
    place.fails(2, &with(&["--gpu", "0"]), &["--gpu", "--backend auto"]);
    place.fails(2, &with(&["--lanes", "64"]), &["64", "auto", "512"]);
    place.fails(2, &with(&["--backend", "interp", "--lanes", "128"]), &["--lanes", "jit"]);
    place.fails(2, &with(&["--precision", "double"]), &["double", "exact", "fast"]);
    place.fails(2, &with(&["--radius", "129"]), &["129", "128"]);
    place.fails(2, &with(&["--without", "luck"]), &["luck", "share"]);
    let onto_itself = ["denoise", "room/4spp.exr", "-o", "room/../room/4spp.exr"];
    place.fails(2, &onto_itself, &["4spp.exr", "input"]);
    place.fails(2, &["denoise", "room/4spp.exr", "-o", "out.jpg"], &["out.jpg", ".png"]);
    place.fails(2, &["evolve", "--scenes", "room", "--crossover", "0.9"], &["add up to 1"]);
    place.fails(2, &["evolve", "--scenes", "room", "--islands", "no"], &["--islands"]);
    place.fails(2, &["evolve", "--resume", "--seed", "3"], &["--seed"]);
    assert_eq!(place.run(&["--help"]).status.code(), Some(0));
    assert!(place.done(&["--version"]).starts_with("tamis "));
}

/// With the drivers of this computer out of sight; those of other systems are not
/// found by a variable.
#[test]
#[cfg(all(feature = "gpu", target_os = "linux"))]
fn without_a_gpu_the_way_out_is_named_and_auto_takes_it() {
    let place = Place::new();
    let run = |arguments: &[&str]| {
        let mut command = place.program(arguments);
        for variable in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
            command.env(variable, place.path("no_driver.json"));
        }
        command.output().expect("the program starts")
    };
    let denoise = ["denoise", "room/4spp.exr", "--filter", EDGE_AWARE, "-o"];
    let gpu = run(&[&denoise[..], &["gpu.exr", "--backend", "gpu"]].concat());
    assert_eq!(gpu.status.code(), Some(1));
    assert!(stderr(&gpu).contains("no GPU was found"), "{}", stderr(&gpu));
    assert!(stderr(&gpu).contains("--backend jit"), "{}", stderr(&gpu));
    assert!(!place.path("gpu.exr").exists());
    let listed = run(&["gpus"]);
    assert_eq!((listed.status.code(), listed.stdout.len()), (Some(1), 0));
    assert_eq!(run(&["gpus", "--json"]).stdout, b"[]\n");

    let auto = run(&[&denoise[..], &["auto.exr", "--backend", "auto"]].concat());
    assert!(auto.status.success(), "{}", stderr(&auto));
    assert!(stderr(&auto).contains("no GPU was found"), "{}", stderr(&auto));
    place.done(&[&denoise[..], &["jit.exr"]].concat());
    assert_eq!(place.bytes("auto.exr"), place.bytes("jit.exr"));

    let memory = run(&[&denoise[..], &["gpu.exr", "--max-memory", "lots"]].concat());
    assert_eq!(memory.status.code(), Some(2));
    assert!(stderr(&memory).contains("512M"), "{}", stderr(&memory));
}

#[test]
fn inspect_tells_what_feeds_what() {
    let place = Place::new();
    let mut channels = NOISY;
    channels[8].1 = |x, _| if x == 0 { f32::INFINITY } else { 0.5 };
    write_exr(&place.path("bad.exr"), &channels);
    let text = place.done(&["inspect", "bad.exr"]);
    let line = |name: &str| {
        let found = text.lines().find(|line| line.split_whitespace().next() == Some(name));
        found.unwrap_or_else(|| panic!("no line `{name}` in: {text}")).to_owned()
    };
    assert!(line("Albedo.B").contains("texture[2]") && line("Albedo.B").contains("20 infinite"));
    assert!(line("Normal.Z").contains("constant 0"), "{text}");
    assert!(line("depth").contains("absent") && line("depth").contains("Depth.Z"), "{text}");
    assert!(line("normal").contains("estimated"), "{text}");

    let report = json(&place.done(&["inspect", "bad.exr", "--json"]));
    assert_eq!(report["layers"][0]["width"], WIDTH);
    assert_eq!(report["layers"][0]["channels"].as_array().map(Vec::len), Some(9));
    assert_eq!(report["layers"][0]["channels"][0]["samples"]["infinite"], 20);
    let status = |feature: &str| {
        let features = report["features"].as_array().expect("a list").iter();
        let entry = features.clone().find(|entry| entry["feature"] == feature);
        entry.expect("every feature is listed")["status"].clone()
    };
    assert_eq!([status("normal"), status("depth")], ["present", "absent"]);
}

#[test]
#[cfg(feature = "jit")]
fn inspect_tells_what_the_host_can_do() {
    let place = Place::new();
    let text = place.done(&["inspect", "--host"]);
    assert_eq!(text.matches("chosen: the widest").count(), 1, "{text}");
    let host = json(&place.done(&["inspect", "--host", "--json"]));
    let vectors = host["vectors"].as_array().expect("a list");
    assert_eq!(vectors.len(), 3);
    // The last that is not lacking is the one that is chosen.
    let possible: Vec<&Value> = vectors.iter().filter(|entry| entry["lacking"].is_null()).collect();
    let (widest, others) = possible.split_last().expect("the tests need a host with FMA");
    assert_eq!(widest["chosen"], true);
    assert!(others.iter().all(|entry| entry["chosen"] == false));
    for entry in vectors.iter().filter(|entry| !entry["lacking"].is_null()) {
        let bits = entry["bits"].to_string();
        let denoise = ["denoise", "room/4spp.exr", "-o", "out.exr", "--lanes", &bits];
        place.fails(1, &denoise, &[&bits]);
    }
    place.fails(2, &["inspect"], &["IN.exr"]);
    place.fails(2, &["inspect", "--host", "room/4spp.exr"], &["--host"]);
}

#[test]
fn score_and_sheet_take_folders_and_pairs() {
    let place = Place::new();
    let pair = "room/4spp.exr,room/reference.exr";
    let filters = ["--filters", EDGE_AWARE, "bilateral", "kan2017"];
    let arguments = |scene, more: &[&'static str]| {
        let mut arguments = vec!["score", "--scenes", scene];
        arguments.extend(filters);
        arguments.extend(more);
        arguments
    };
    let scores = json(&place.done(&arguments("room", &["--json"])));
    let filtered = &scores[0]["filters"];
    assert_eq!(scores[0]["scene"], "room");
    assert!(filtered[0]["rel_mse"].as_f64() < scores[0]["noisy"]["rel_mse"].as_f64());
    let failure = filtered[2]["failure"].as_str().expect("there are no positions");
    assert!(failure.contains("worldPosition") && filtered[2]["rel_mse"].is_null(), "{failure}");

    let table = place.done(&arguments(pair, &["--markdown"]));
    assert!(table.lines().all(|line| line.starts_with("| ") && line.ends_with(" |")), "{table}");
    assert!(table.contains("| room ") && table.contains(" - |"), "{table}");

    place.done(&["sheet", pair, "-o", "sheet.png", "--filters", "bilateral", "gaussian"]);
    let decoder = png::Decoder::new(std::io::Cursor::new(place.bytes("sheet.png")));
    let picture = decoder.read_info().expect("a PNG file");
    assert!(picture.info().width as usize > 4 * WIDTH);
    let named = ["sheet", "room", "-o", "no.png", "--filters", "kan2017"];
    place.fails(1, &named, &["worldPosition"]);
}

#[test]
fn png_results_and_listings() {
    let place = Place::new();
    place.done(&["denoise", "room/4spp.exr", "-o", "out.png", "--filter", "bilateral"]);
    assert!(place.bytes("out.png").starts_with(b"\x89PNG"));
    let list = json(&place.done(&["filters", "--json"]));
    let names: Vec<&str> =
        list.as_array().expect("a list").iter().filter_map(|f| f["name"].as_str()).collect();
    assert!(names.contains(&"kan2017") && names.contains(&"bilateral"), "{names:?}");
    assert!(place.done(&["filters", "bilateral"]).contains("distance2(color, color)"));
    let language = place.done(&["language"]);
    for word in ["distanceMax(a, b)", "secTexVariance", "tricube(x)", "Albedo.R"] {
        assert!(language.contains(word), "no {word} in: {language}");
    }
}

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
        // One line of remarks and one of times each, in the order of the inputs.
        let lines: Vec<&str> = report.lines().collect();
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
        "clean/a.exr: 24x20",
        "load ",
        "tamis: error: frames/b.exr: not an OpenEXR file",
        "tamis: error: frames/c.exr: the filter reads `normal`",
        "clean/d.exr: 24x20",
        "load ",
        "2 frames in ",
        "tamis: error: 2 of 4 frames failed",
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
    assert_eq!(stderr(&quiet).lines().count(), 3, "errors only: {}", stderr(&quiet));
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

#[test]
fn exports_go_to_stdout_or_whole_into_a_file() {
    let place = Place::new();
    let filter = |name: &str, stages: usize| {
        let stage = format!("[[stage]]\nradius = 4\nweight = \"{EDGE_AWARE}\"\n");
        let text = format!("version = 1\nname = \"{name}\"\n{}", stage.repeat(stages));
        fs::write(place.path(&format!("{stages}.toml")), text).expect("writable");
    };
    filter("edge*/aware", 1);
    filter("twice", 2);
    let text = place.done(&["export", "1.toml", "--lang", "c"]);
    assert!(text.starts_with("/*\n") && text.contains("static float edge_aware_weight("), "{text}");
    assert!(text.contains(EDGE_AWARE) && text.contains("radius = 4"), "{text}");
    let nothing = place.done(&["export", "1.toml", "--lang", "c", "-o", "filter.c"]);
    assert_eq!((nothing.as_str(), place.bytes("filter.c")), ("", text.into_bytes()));
    let wide = place.done(&["export", EDGE_AWARE, "--lang", "c", "--radius", "7"]);
    assert!(wide.contains("float expression_weight(") && wide.contains("radius = 7"), "{wide}");
    let equations = place.done(&["export", "kan2017", "--lang", "latex"]);
    assert!(equations.contains("\\begin{equation}"), "{equations}");

    place.fails(1, &["export", "2.toml", "--lang", "c"], &["`twice`", "2 stages"]);
    place.fails(1, &["export", "missing.toml", "--lang", "c"], &["missing.toml"]);
    place.fails(1, &["export", "1.toml", "--lang", "c", "-o", "no/such.c"], &["no/such.c"]);
    place.fails(2, &["export", "1.toml", "--lang", "fortran"], &["fortran", "latex"]);
    place.fails(2, &["export", "1.toml"], &["--lang"]);
    place.fails(2, &["export", "bilatral", "--lang", "c"], &["bilatral", "cross-bilateral"]);
}

#[test]
fn shading_languages_are_written_where_they_are_built_in() {
    let place = Place::new();
    let export = |lang| ["export", EDGE_AWARE, "--lang", lang];
    for lang in ["wgsl", "glsl", "hlsl", "msl"] {
        if cfg!(feature = "gpu") {
            let text = place.done(&export(lang));
            assert!(text.contains(" weight(") && text.contains("--precision exact"), "{text}");
            let fast = place.done(&[&export(lang)[..], &["--precision", "fast"]].concat());
            assert!(fast.contains("--precision fast"), "{fast}");
        } else {
            place.fails(1, &export(lang), &["feature `gpu`", lang]);
        }
    }
    if cfg!(feature = "gpu") {
        place.done(&[&export("spirv")[..], &["-o", "filter.spv"]].concat());
        assert_eq!(place.bytes("filter.spv")[..4], 0x0723_0203_u32.to_le_bytes());
    }
    for lang in ["c", "latex"] {
        let fast = [&export(lang)[..], &["--precision", "fast"]].concat();
        place.fails(2, &fast, &[lang, "--precision fast", "--help"]);
        place.done(&[&export(lang)[..], &["--precision", "exact"]].concat());
    }
}

#[test]
fn nobody_listening_is_no_error() {
    let place = Place::new();
    let mut command = place.program(&["language"]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the program starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("the program ends");
    assert!(output.status.success() && output.stderr.is_empty(), "{}", stderr(&output));
}

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
    arguments.extend(["3", "--out", out, "--racing", "on"]);
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
    let resume =
        ["evolve", "--scenes", "room", "--out", "resumed", "--resume", "--generations", "4"];
    place.done(&resume);
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
fn a_search_keeps_to_its_time() {
    let place = Place::new();
    let text = place.done(&tiny("out", &["--generations", "1000000", "--max-time", "1"]));
    assert!(text.contains("stopped by the time limit"), "{text}");
}
