//! `export`.

use std::fs;

use crate::place::{EDGE_AWARE, Place};

#[test]
fn exports_go_to_stdout_or_whole_into_a_file() {
    let place = Place::new();
    let filter = |name: &str, stages: usize| {
        let stage = |k: usize| {
            let of = "gather = \"color\"\nradius = 4";
            format!("[[stage]]\nname = \"s{k}\"\n{of}\nweight = \"{EDGE_AWARE}\"\n")
        };
        let stages_text: String = (0..stages).map(stage).collect();
        let text = format!("version = 2\nname = \"{name}\"\n{stages_text}");
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

    // A program is code and a header.
    let code = place.done(&["export", "2.toml", "--lang", "c"]);
    assert!(code.contains("int twice_filter(") && code.contains("size_t twice_scratch("), "{code}");
    place.done(&["export", "2.toml", "--lang", "c", "-o", "twice.c"]);
    if cfg!(unix) {
        assert_eq!(place.done(&["export", "2.toml", "--lang", "c", "-o", "/dev/stdout"]), code);
    }
    assert_eq!(place.bytes("twice.c"), code.into_bytes());
    let header = String::from_utf8(place.bytes("twice.h")).expect("C is text");
    assert!(header.contains("struct twice_inputs {") && !header.contains("#include <math.h>"));
    place.fails(2, &["export", "2.toml", "--lang", "c", "-o", "twice.h"], &["twice.h", ".c`"]);
    let without = ["export", "tamis", "--lang", "python", "--without", "depth,normal"];
    let python = place.done(&without);
    assert!(python.contains("Absent: `depth`") && python.contains("def compute_p0("), "{python}");
    place.fails(2, &["export", "tamis", "--lang", "c", "--without", "color"], &["color", "albedo"]);
    let required = ["export", "1.toml", "--lang", "c", "--without", "normal"];
    place.fails(1, &required, &["`edge*/aware`", "normal", "stands in"]);

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
            assert!(text.contains(" weight(") && text.contains("--precision standard"), "{text}");
            let fast = place.done(&[&export(lang)[..], &["--precision", "fast"]].concat());
            assert!(fast.contains("--precision fast"), "{fast}");
        } else {
            place.fails(1, &export(lang), &["feature `gpu`", lang]);
        }
    }
    if cfg!(feature = "gpu") {
        // The kernels of a program are a folder of their own.
        let program = ["export", "tamis-formula", "--lang", "wgsl"];
        place.fails(2, &program, &["wgsl", "folder", "--output"]);
        let folder = [&program[..], &["-o", "kernels"]].concat();
        place.done(&folder);
        let manifest = String::from_utf8(place.bytes("kernels/manifest.json")).expect("JSON");
        assert!(manifest.contains("\"000_map_0.wgsl\""), "{manifest}");
        assert!(!place.bytes("kernels/000_map_0.wgsl").is_empty());
        place.fails(2, &folder, &["kernels", "not empty"]);
        place.done(&[&export("spirv")[..], &["-o", "filter.spv"]].concat());
        assert_eq!(place.bytes("filter.spv")[..4], 0x0723_0203_u32.to_le_bytes());
    }
    let fast = |lang| [&export(lang)[..], &["--precision", "fast"]].concat();
    place.fails(2, &fast("latex"), &["latex", "--precision fast", "--help"]);
    assert_ne!(place.done(&fast("c")), place.done(&export("c")));
    let exact = [&export("c")[..], &["--precision", "exact"]].concat();
    place.fails(2, &exact, &["exact", "standard", "fast"]);
}
