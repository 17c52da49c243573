//! `explain`.

use std::fs;

use serde_json::Value;

use crate::place::{EDGE_AWARE, Place, json};

const PROGRAM: &str = r#"
version = 2
name = "two"
[absent]
depth = 0.0
[[stage]]
name = "grey"
map = "mean(color)"
[[stage]]
name = "smooth"
gather = "color"
weight = "exp(-min(4 * pow(distance2(normal, normal), 2) + pow(distance2(grey, grey), 2) / 100, 60))"
radius = 2
dilation = 2
[[stage]]
name = "result"
map = "smooth * 1"
"#;

#[test]
fn parts_are_told_with_what_the_error_is_without_them() {
    let place = Place::new();
    fs::write(place.path("two.toml"), PROGRAM).expect("writable");
    let explain = ["explain", "two.toml", "--scene", "room"];
    let text = place.done(&explain);
    assert!(text.starts_with("two on room ("), "{text}");
    assert!(text.contains("4 * pow(distance2(normal, normal), 2)"), "{text}");
    let told = json(&place.done(&[&explain[..], &["--json"]].concat()));
    let part = |text: &str| -> Value {
        let parts = told["parts"].as_array().expect("a list");
        parts.iter().find(|part| part["part"] == text).cloned().expect("the part is listed")
    };
    // The wall's edge shows in the normals alone.
    let error = |part: &Value| part["rel_mse"].as_f64().expect("a number");
    let term = part("4 * pow(distance2(normal, normal), 2)");
    assert!(error(&term) > 2.0 * error(&told["filtered"]), "{told}");
    assert_eq!((term["stage"].as_str(), term["kind"].as_str()), (Some("smooth"), Some("term")));
    let pass = part("smooth = mean of color");
    assert!((error(&pass) / error(&told["noisy"]) - 1.0).abs() < 1e-6, "{told}");
    assert_eq!(part("normal")["needed"], true);
    let interp = place.done(&[&explain[..], &["--json", "--backend", "interp"]].concat());
    assert_eq!(json(&interp), told);
    let threads = place.done(&[&explain[..], &["--json", "--threads", "1"]].concat());
    assert_eq!(json(&threads), told);
}

#[test]
fn a_page_holds_everything() {
    let place = Place::new();
    fs::write(place.path("two.toml"), PROGRAM).expect("writable");
    let at = ["--at", "0,0", "--at", "9,5"];
    let explain = ["explain", "two.toml", "--scene", "room", "--html", "page.html"];
    place.done(&[&explain[..], &at].concat());
    let page = String::from_utf8(place.bytes("page.html")).expect("pages are text");
    for part in ["Around pixel 0,0", "Around pixel 9,5", "smooth: 5x5 taps, 2 apart", "mean(color)"]
    {
        assert!(page.contains(part), "{part}: {page}");
    }
    // Three pictures and one per pass for each pixel; nothing else is fetched.
    assert_eq!(page.matches("src=\"data:image/png;base64,").count(), 2 * 4);
    assert!(!page.contains("http:") && !page.contains("https:"), "{page}");
}

#[test]
fn what_cannot_be_explained_is_said() {
    let place = Place::new();
    fn explain<'a>(more: &[&'a str]) -> Vec<&'a str> {
        [&["explain", EDGE_AWARE, "--scene"][..], more].concat()
    }
    place.fails(1, &explain(&["nowhere"]), &["nowhere", "no such file"]);
    place.fails(2, &explain(&["room", "--at", "3,4"]), &["--html"]);
    let outside = explain(&["room", "--html", "page.html", "--at", "4000,0"]);
    place.fails(2, &outside, &["--at 4000,0", "counted from 0"]);
    assert!(!place.path("page.html").exists());
    place.fails(2, &explain(&["room", "--html", "page.html", "--at", "-1,3"]), &["column and row"]);
    // No page replaces what it is made of.
    fs::write(place.path("two.toml"), PROGRAM).expect("writable");
    let over = ["explain", "two.toml", "--scene", "room", "--html"];
    for page in ["two.toml", "room/reference.exr", "room/4spp.exr"] {
        let before = place.bytes(page);
        place.fails(2, &[&over[..], &[page]].concat(), &[page, "would replace"]);
        assert_eq!(place.bytes(page), before);
    }
    place.fails(1, &[&over[..], &["none/page.html"]].concat(), &["no folder none"]);
    place.fails(2, &[&over[..], &["-"]].concat(), &["--html -", "files"]);
    place.fails(2, &["explain", "bilatral", "--scene", "room"], &["bilatral"]);
    place.fails(2, &["explain", EDGE_AWARE], &["--scene"]);
    place.fails(1, &explain(&["room/4spp.exr,room/none.exr"]), &["none.exr"]);
}
