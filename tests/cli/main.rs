//! The program as people meet it: arguments in; text, files and an exit status
//! out.

mod documents;
mod explain;
mod exports;
mod features;
mod frames;
mod made;
mod pages;
mod place;
mod search;
mod sequences;
#[cfg(unix)]
mod signals;
mod streams;
mod stress;
mod tune;
mod whole;
mod workers;

use std::fs;
use std::process::Stdio;

#[cfg(debug_assertions)]
use place::write_b44;
use place::{CLEAN, EDGE_AWARE, NOISY, Place, WIDTH, json, stderr, write_exr};
use serde_json::Value;
use tamis::scene::load_image;

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

/// Nothing can be searched or scored with a reference that has holes, as every error
/// would be infinite; `compare` leaves the holes out, and says how many they are.
#[test]
fn a_reference_with_pixels_that_are_no_numbers_is_refused_or_counted() {
    let place = Place::new();
    let mut clean = CLEAN;
    clean[1].1 = |x, y| match (x, y) {
        (7, 3) => f32::NAN,
        (2, 5) => f32::INFINITY,
        _ => CLEAN[1].1(x, y),
    };
    write_exr(&place.path("room/reference.exr"), &clean);
    let named = ["room/reference.exr", "\"G\"", "2 pixel(s)", "x = 7, y = 3"];
    place.fails(1, &["evolve", "--scenes", "room", "--generations", "0"], &named);
    place.fails(1, &["score", "--scenes", "room", "--filters", "bilateral"], &named);
    place.fails(1, &["bench", "--scenes", "room", "--filters", "bilateral"], &named);
    place.fails(1, &["sheet", "room", "-o", "no.png", "--filters", "bilateral"], &named);

    let compare = ["compare", "room/4spp.exr", "room/reference.exr"];
    let text = place.done(&compare);
    assert!(text.contains("pixels left out") && !text.contains("pixels not finite"), "{text}");
    let values = json(&place.done(&[&compare[..], &["--json"]].concat()));
    assert_eq!(values["left_out"].as_u64(), Some(2), "{values}");
    assert!(values["rel_mse"].as_f64().is_some_and(|error| error > 0.0), "{values}");

    // Those of the image are its fault.
    let text = place.done(&["compare", "room/reference.exr", "room/4spp.exr"]);
    assert!(text.contains("pixels not finite") && text.contains("inf"), "{text}");
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
fn back_ends_threads_and_exact_passes_write_the_same_pixels() {
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
        place.pixels(out)
    };
    let interp = denoise("interp.exr", &["--backend", "interp"]);
    assert_eq!(denoise("rate.exr", &["--backend", "interp", "--without", "hoist"]), interp);
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
fn precisions_are_as_far_from_exact_as_they_say() {
    let place = Place::new();
    let denoise = |out: &str, more: &[&str]| {
        let input = ["denoise", "room/4spp.exr", "-o", out, "--filter", "bilateral"];
        place.done(&[&input[..], more].concat());
        place.pixels(out)
    };
    let standard = denoise("standard.exr", &["--backend", "interp"]);
    let fast = denoise("fast.exr", &["--backend", "interp", "--precision", "fast"]);
    assert_ne!(fast, standard);
    if cfg!(feature = "jit") {
        assert_eq!(denoise("fast_jit.exr", &["--precision", "fast"]), fast);
    }
    denoise("exact.exr", &["--precision", "exact"]);
    let image = |name: &str| load_image(&place.path(name)).expect("a result");
    let off = |name: &str| {
        let (image, exact) = (image(name), image("exact.exr"));
        let pairs = image.rgb().concat().into_iter().zip(exact.rgb().concat());
        pairs.map(|(x, exact): (f32, f32)| (x - exact).abs() / exact).fold(0.0, f32::max)
    };
    assert!(off("standard.exr") <= 1e-5 && off("fast.exr") <= 1e-4);
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
    let left = ["denoise", "bad.exr", "-o", "left.exr", "--filter", "1", "--repair", "none"];
    let output = place.run(&left);
    assert!(output.status.success(), "{}", stderr(&output));
    for part in ["bad.exr: R: 1 bad pixel(s) left in", "kept the noisy colour"] {
        assert!(stderr(&output).contains(part), "no `{part}` in: {}", stderr(&output));
    }
    let inspected = json(&place.done(&["inspect", "left.exr", "--json"]));
    // One pixel is no number still, and it alone.
    let bad = inspected["bad_pixels"].as_array().expect("a list").iter();
    let bad: Vec<&Value> = bad.filter(|bad| bad["defect"] == "nan").collect();
    assert_eq!(bad.len(), 1, "{inspected}");
    assert_eq!([&bad[0]["of"], &bad[0]["count"]], [&Value::from("R"), &Value::from(1)]);

    let output = place.run(&["denoise", "room/4spp.exr", "-o", "kept.exr", "--filter", "0"]);
    assert!(stderr(&output).contains("480 pixels (100.0%) kept"), "{}", stderr(&output));
    // A program's stage is named, and what it has of pixels is counted.
    let program = "version = 2\nname = \"x\"\n[[stage]]\nname = \"sure\"\ngather = \"color\"\n\
                   weight = \"1\"\nradius = 1\n[[stage]]\nname = \"none\"\ngrid = \"half\"\n\
                   gather = \"sure\"\nweight = \"normal[0][i]\"\nradius = 1\n[[stage]]\n\
                   name = \"result\"\nmap = \"none\"\n";
    fs::write(place.path("program.toml"), program).expect("writable");
    for precision in ["standard", "exact"] {
        let arguments = ["denoise", "room/4spp.exr", "-o", "kept.exr", "--filter", "program.toml"];
        let output = place.run(&[&arguments[..], &["--precision", precision]].concat());
        let report = stderr(&output);
        assert!(report.contains("stage `none`: 60 pixels (50.0%) kept what was"), "{report}");
        assert!(!report.contains("stage `sure`"), "{report}");
    }
    let quiet = place.run(&["-q", "denoise", "bad.exr", "-o", "quiet.exr", "--filter", &estimate]);
    assert!(quiet.status.success(), "{}", stderr(&quiet));
    // Whoever is quiet still wants to know that pixels are made up.
    assert_eq!(stderr(&quiet).lines().count(), 1, "{}", stderr(&quiet));
    assert!(stderr(&quiet).starts_with("bad.exr: R: 1 bad pixel"), "{}", stderr(&quiet));
}

#[test]
fn errors_name_what_is_at_fault_and_leave_nothing_behind() {
    let place = Place::new();
    fs::write(place.path("text.exr"), "no image").expect("writable");
    fs::write(place.path("cut.exr"), &place.bytes("room/4spp.exr")[..200]).expect("writable");
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
        &["room/4spp.exr", "`position`", "Position.X", "Normal.X"],
    );
    let nowhere = ["denoise", "room/4spp.exr", "-o", "no/such/out.exr", "--filter", "1"];
    place.fails(1, &nowhere, &["no/such/out.exr"]);
    place.fails(1, &["compare", "room/4spp.exr", "missing.exr"], &["missing.exr"]);
    place.fails(1, &["inspect", "text.exr"], &["text.exr"]);
    place.fails(1, &["score", "--scenes", "nowhere"], &["nowhere", "NOISY.exr,REFERENCE.exr"]);
    place.fails(1, &["evolve"], &["data/corpus/train"]);
    place.fails(1, &["evolve", "--preset", "weights"], &["data/train"]);
    place.fails(1, &["evolve", "--resume", "--scenes", "room"], &["checkpoint.json"]);
}

/// The decoder's arithmetic overflows, which is a panic in builds that check for it.
#[test]
#[cfg(debug_assertions)]
fn a_panic_of_the_decoder_is_an_error_and_nothing_else() {
    let place = Place::new();
    write_b44(&place.path("b44.exr"));
    place.done(&["inspect", "b44.exr"]);
    let mut bytes = place.bytes("b44.exr");
    // The only chunk ends the file: its size, then blocks of 4 x 4 samples, of which the
    // first is 0 with the others 2^17 less.
    let end = bytes.len();
    let size = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|k| bytes[at + k])) as usize;
    let start = (4..end).find(|&at| size(at - 4) == end - at).expect("the chunk's size");
    bytes[start..].fill(0);
    bytes[start + 2] = 12 << 2;
    fs::write(place.path("b44.exr"), bytes).expect("writable");
    let denoise = ["denoise", "b44.exr", "-o", "out.exr", "--filter", "1"];
    for arguments in [&denoise[..], &["inspect", "b44.exr"]] {
        let said = place.fails(1, arguments, &["b44.exr", "break the decoder's assumptions"]);
        assert_eq!(said.lines().count(), 1, "{said}");
    }
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
    let exact_on = |more: &[&'static str]| with(&[&["--precision", "exact"], more].concat());
    place.fails(2, &exact_on(&["--lanes", "128"]), &["--lanes", "jit"]);
    if cfg!(feature = "gpu") {
        let f32_only = ["--precision exact", "f32", "--precision standard"];
        place.fails(2, &exact_on(&["--backend", "gpu"]), &f32_only);
    }
    place.fails(2, &with(&["--radius", "129"]), &["129", "128"]);
    place.fails(2, &with(&["--without", "luck"]), &["luck", "share"]);
    let onto_itself = ["denoise", "room/4spp.exr", "-o", "room/../room/4spp.exr"];
    place.fails(2, &onto_itself, &["4spp.exr", "input"]);
    place.fails(2, &["denoise", "room/4spp.exr", "-o", "out.jpg"], &["out.jpg", ".png"]);
    let weights = ["evolve", "--preset", "weights", "--scenes", "room"];
    place.fails(2, &[&weights[..], &["--crossover", "0.9"]].concat(), &["add up to 1"]);
    place.fails(2, &["evolve", "--scenes", "room", "--crossover", "0.9"], &["crossover + polish"]);
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
    assert_eq!(place.pixels("auto.exr"), place.pixels("jit.exr"));

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
    assert!(line("Albedo.B").contains("albedo[2]") && line("Albedo.B").contains("20 infinite"));
    assert!(line("Normal.Z").contains("constant 0"), "{text}");
    assert!(line("depth").contains("absent") && line("depth").contains("Depth.Z"), "{text}");
    assert!(line("normal").contains("estimated"), "{text}");
    let infinite = line("infinite");
    for part in ["Albedo.B", "20", "(0, 0) (0, 1) (0, 2) (0, 3) …", "median of the good ones"] {
        assert!(infinite.contains(part), "no `{part}` in: {infinite}");
    }
    assert!(place.done(&["inspect", "room/4spp.exr"]).ends_with("Bad pixels: none\n"));

    let report = json(&place.done(&["inspect", "bad.exr", "--json"]));
    assert_eq!(report["bad_pixels"][0]["first"][3], serde_json::json!([0, 3]));
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
    let (widest, others) = possible.split_last().expect("128 bits at least");
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
