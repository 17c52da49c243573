//! `stress`.

use std::fs;

use serde_json::Value;

use crate::place::{EDGE_AWARE, Place, json};

/// The certificate of a filter, which must have this verdict.
#[track_caller]
fn certificate(place: &Place, verdict: &str, arguments: &[&str]) -> Value {
    let output = place.run(&[&["stress", "--json"][..], arguments].concat());
    let certificate = json(&String::from_utf8_lossy(&output.stdout));
    let reasons = &certificate["reasons"];
    assert_eq!(certificate["verdict"], verdict, "{reasons:#}");
    assert_eq!(output.status.code(), Some(i32::from(verdict == "unstable")), "{reasons:#}");
    certificate
}

#[test]
fn known_filters_pass() {
    let place = Place::new();
    for name in ["gaussian", "bilateral", "cross-bilateral"] {
        certificate(&place, "stable", &[name]);
    }
}

/// The paper's filter raises distances to the power of 0.002: a distance of zero counts
/// for nothing, and one of the last bit for nine tenths.
#[test]
fn the_papers_filter_hangs_on_last_bits() {
    unstable("kan2017", &["last bit of worldPosition", "`leaves`"]);
}

/// Fails unless the filter is unstable, and one of the reasons names all of these.
#[track_caller]
fn unstable(filter: &str, named: &[&str]) {
    let certificate = certificate(&Place::new(), "unstable", &[filter]);
    let reasons = certificate["reasons"].as_array().expect("a list");
    let names = |reason: &&Value| {
        let text = reason["text"].as_str().expect("a sentence");
        reason["verdict"] == "unstable" && named.iter().all(|name| text.contains(name))
    };
    assert!(reasons.iter().any(|reason| names(&reason)), "{filter}: {reasons:#?}");
}

#[test]
fn what_magnifies_roundings_is_unstable() {
    unstable("pow(dot(normal, normal), 10000)", &["interp", "from exact"]);
    unstable("1 / distance2(texture, texture)", &["last bit of texture", "changes the result"]);
}

#[test]
fn weights_that_cancel_are_unstable() {
    unstable("1 - 1.0000001 * exp(-distance2(texture, texture))", &["interp", "`last bits`"]);
    unstable("sin(1000 * distance2(color, color))", &["noise of 1e-3 in color"]);
}

#[test]
fn what_looks_at_absolute_coordinates_is_unstable() {
    unstable("1 / (1 + distance1(color, pixel))", &["flipped left to right", "order of sums"]);
}

/// A division by what vanishes between two features, which only counts where the albedo
/// is the same to the last bit: leaves of one colour.
#[test]
fn what_only_the_same_albedo_to_the_bit_escapes_is_unstable() {
    let weight = "exp(sinc(distance1(texture, texture) / biweight(distanceMax(texture, depth))) \
                  - distance2(normal, normal))";
    unstable(weight, &["last bit of texture", "`leaves`"]);
}

#[test]
fn a_sound_filter_is_stable_and_the_same_seed_says_so_in_the_same_words() {
    let place = Place::new();
    let arguments = |more: &[&'static str]| {
        [&[EDGE_AWARE, "--scenes", "room", "--radius", "5"][..], more].concat()
    };
    let one = certificate(&place, "stable", &arguments(&["--threads", "1"]));
    let two = certificate(&place, "stable", &arguments(&["--threads", "2", "-o", "out.json"]));
    assert_eq!(one, two);
    assert_eq!(json(&String::from_utf8(place.bytes("out.json")).expect("UTF-8")), two);
    let other = certificate(&place, "stable", &arguments(&["--seed", "2"]));
    assert_ne!(one["sensitivity"], other["sensitivity"]);

    let scenes = one["scenes"].as_array().expect("a list");
    let room = scenes.last().expect("the given ones come last");
    assert_eq!((room["scene"].as_str(), room["kind"].as_str()), (Some("room"), Some("real")));
    let engines: Vec<&str> =
        one["engines"].as_array().unwrap().iter().map(|e| e["name"].as_str().unwrap()).collect();
    assert_eq!(engines[..2], ["jit", "interp"]);
    if cfg!(feature = "jit") {
        assert_eq!(room["accuracy"][0], room["accuracy"][1], "the same bits");
        assert!(room["accuracy"][0]["value"].as_f64().expect("it ran") < 1e-6);
    }
    let refused = one["behaviour"].as_array().unwrap().iter().find(|b| b["fault"] == "missing");
    assert_eq!(refused.map(|b| b["outcome"].as_str()), Some(Some("refused")));

    let text = place.done(&["stress", EDGE_AWARE, "--radius", "3"]);
    for part in
        ["expression, 1 stage, reach 3, seed 1: stable", "interp", "unpromised", "transposed"]
    {
        assert!(text.contains(part), "no `{part}` in: {text}");
    }
}

#[test]
fn a_program_has_a_certificate_with_its_guards_stage_by_stage() {
    let place = Place::new();
    let program = "version = 2\nname = \"two\"\n[absent]\nnormal = 0\n[[stage]]\nname = \"first\"\n\
                   gather = \"color\"\nweight = \"exp(-distance2(normal, normal))\"\nradius = 1\n\
                   [[stage]]\nname = \"second\"\ngather = \"first\"\nradius = 2\n\
                   weight = \"exp(-distance2(normal, normal))\"\n[[stage]]\nname = \"result\"\n\
                   map = \"second / 2 + color / 2\"\n";
    fs::write(place.path("two.toml"), program).expect("writable");
    let certificate = certificate(&place, "stable", &["two.toml", "--scenes", "room"]);
    assert_eq!((&certificate["stages"], &certificate["reach"]), (&3.into(), &3.into()));
    let scenes = certificate["scenes"].as_array().expect("a list");
    for scene in scenes {
        let guards = scene["guards"].as_array().expect("a list").iter();
        assert!(guards.map(|guards| &guards["stage"]).eq(["first", "second"]), "{scene:#}");
        assert_eq!(scene["reach"], 3, "programs run whole");
    }
    let missing = certificate["behaviour"].as_array().expect("a list").iter();
    let missing = missing.filter(|b| b["fault"] == "missing" && b["feature"] == "normal");
    assert!(missing.map(|b| &b["outcome"]).eq(["filtered"]), "something stands in for it");
    let text = place.done(&["stress", "two.toml"]);
    assert!(text.contains("two, 3 stages, reach 3, seed 1: stable"), "{text}");
    place.fails(2, &["stress", "two.toml", "--radius", "3"], &["--radius", "two"]);
}

#[test]
fn what_cannot_be_certified_is_an_error() {
    let place = Place::new();
    place.fails(2, &["stress"], &["FILTER"]);
    place.fails(2, &["stress", "bilatral"], &["bilatral", "cross-bilateral"]);
    place.fails(1, &["stress", "missing.toml"], &["missing.toml"]);
    place.fails(1, &["stress", EDGE_AWARE, "--scenes", "nowhere"], &["nowhere"]);
    place.fails(1, &["stress", EDGE_AWARE, "--gpu", "no such card"], &["gpu"]);
    let lacking = ["stress", "exp(-distance2(depth, depth))", "--scenes", "room/4spp.exr"];
    place.fails(1, &lacking, &["room/4spp.exr", "`depth`"]);
}
