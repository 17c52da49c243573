//! Pages for browsers: what is in them, and that it fetches nothing.

use crate::place::{EDGE_AWARE, Place, json};

/// Checks that a page holds all that it shows.
fn keeps_to_itself(html: &str) {
    assert!(html.starts_with("<!DOCTYPE html>"), "{}", &html[..200]);
    assert!(html.contains("content=\"default-src 'none'; img-src data:;"), "no policy");
    for attribute in [" src=\"", " href=\"", " action=\""] {
        for (at, _) in html.match_indices(attribute) {
            let value = &html[at + attribute.len()..][..5];
            assert_eq!(value, "data:", "{attribute}");
        }
    }
    for word in ["@import", "XMLHttpRequest", "WebSocket", "sourceMappingURL", "fetch("] {
        assert!(!html.contains(word), "{word}");
    }
}

fn page(place: &Place, name: &str) -> String {
    let html = String::from_utf8(place.bytes(name)).expect("UTF-8");
    keeps_to_itself(&html);
    html
}

#[test]
fn several_images_are_compared_with_the_last() {
    let place = Place::new();
    place.done(&["denoise", "room/4spp.exr", "-o", "a<b.exr", "--filter", EDGE_AWARE]);
    let images = ["room/4spp.exr", "a<b.exr", "room/reference.exr"];
    let compare = [&["compare"], &images[..]].concat();
    let values = json(&place.done(&[&compare[..], &["--json", "--html", "page.html"]].concat()));
    let list = values.as_array().expect("a list");
    assert_eq!(list.len(), 2);
    // Each is what it is alone.
    for (image, value) in images.iter().zip(list) {
        let alone = json(&place.done(&["compare", image, "room/reference.exr", "--json"]));
        for figure in ["rel_mse", "trimmed_rel_mse", "mse", "psnr_db", "ssim", "flip"] {
            assert!(value[figure].is_f64(), "{figure} of {value}");
            assert_eq!(value[figure], alone[figure], "{figure} of {image}");
        }
    }
    assert_eq!(list[1]["image"], "a<b");
    assert!(list[0]["flip"].as_f64() > list[1]["flip"].as_f64(), "{values}");
    assert!(list[0]["ssim"].as_f64() < list[1]["ssim"].as_f64(), "{values}");

    let table = place.done(&compare);
    let head = table.lines().next().expect("a heading");
    assert_eq!(head.split_whitespace().collect::<Vec<_>>(), ["measure", "4spp", "a<b"]);
    let html = page(&place, "page.html");
    assert!(html.contains("a&lt;b") && !html.contains(">a<b"), "a name that is no text");
    // The page has the table's figures.
    for name in ["RelMSE", "PSNR", "SSIM", "FLIP"] {
        let row = table.lines().find(|line| line.starts_with(name)).expect("a row");
        for figure in row[name.len()..].replace(" dB", "").split_whitespace() {
            let cell = [format!(">{figure}<"), format!(">{figure} dB<")];
            assert!(cell.iter().any(|cell| html.contains(cell)), "no {figure} of {name}");
        }
    }
    // Three pictures of one crop, all of the small images.
    assert_eq!(html.matches("data-place=").count(), 3);
    for part in ["pixels-0", "pixels-1", "pixels-2", "relative-0", "relative-1", "flip-1"] {
        assert!(html.contains(&format!("id=\"{part}\"")), "no {part}");
    }
}

#[test]
fn a_comparison_replaces_no_image_and_needs_two() {
    let place = Place::new();
    let images = ["compare", "room/4spp.exr", "room/reference.exr"];
    let html = ["--html", "room/../room/4spp.exr"];
    place.fails(2, &[&images[..], &html].concat(), &["--html", "room/4spp.exr"]);
    place.fails(1, &[&images[..], &["--html", "no/page.html"]].concat(), &["no/page.html"]);
    place.fails(2, &["compare", "room/4spp.exr"], &["REFERENCE"]);
    place.fails(1, &["compare", "gone.exr", "room/4spp.exr", "room/4spp.exr"], &["gone.exr"]);
}

#[test]
fn the_page_of_a_search_has_its_figures_and_repeats_it() {
    let place = Place::new();
    let search = "evolve --scenes room --validate room --out out --population 5 --children 5 \
                  --tune-steps 2 --crop 8 --exam 8 --finish-steps 3 --interval 2 --generations 3";
    place.done(&search.split_whitespace().collect::<Vec<_>>());
    let html = page(&place, "out/report.html");
    assert!(!html.contains("http-equiv=\"refresh\""), "a search that ended goes on");
    let best: toml::Table =
        String::from_utf8(place.bytes("out/best.toml")).expect("UTF-8").parse().expect("TOML");
    let training = best["training"].as_table().expect("a table");
    let number = |key: &str| training[key].as_float().expect("a number");
    for figure in ["score", "validation-score"] {
        assert!(html.contains(&format!("{:.4}", number(figure))), "no {figure}");
    }
    let stages = best["stage"].as_array().expect("a list").len();
    assert_eq!(html.matches("<rect ").count(), stages, "a box per stage");
    for heading in [
        "Error by generation",
        "The front",
        "Beside other filters",
        "the validation scene \
                     room",
        "as a graph",
        "formulas",
        "looks at",
        "computes with",
        "The command",
    ] {
        assert!(html.contains(heading), "no {heading}");
    }
    let members = std::fs::read_dir(place.path("out/front")).expect("a folder").count();
    assert_eq!(html.matches("<details id=\"program-").count(), members + 1);

    // The course is the same in all three files.
    let csv = String::from_utf8(place.bytes("out/history.csv")).expect("UTF-8");
    let lines = String::from_utf8(place.bytes("out/history.jsonl")).expect("UTF-8");
    let data = html.split_once("id=\"data\">").expect("data").1;
    let data = json(data.split_once("</script>").expect("an end").0);
    assert_eq!(lines.lines().count(), 4);
    for (k, (line, row)) in lines.lines().zip(csv.lines().skip(1)).enumerate() {
        let line = json(line);
        let cells: Vec<&str> = row.split(',').collect();
        assert_eq!(line["generation"].to_string(), cells[0]);
        assert_eq!(line["best"].as_f64(), cells[1].parse().ok(), "{line} {row}");
        assert_eq!(line["validation"].as_f64(), cells[6].parse().ok(), "{line} {row}");
        let of = |line: usize| data["lines"][line]["values"][k].as_f64();
        assert_eq!(
            [of(0), of(1), of(2)],
            ["best", "median", "validation"].map(|n| line[n].as_f64())
        );
    }
    assert!(json(lines.lines().nth(1).expect("a line"))["validation"].is_null());

    let command = html.split_once("<pre class=\"command\">tamis ").expect("a command").1;
    let command = command.split_once("</pre>").expect("an end").0;
    let again = command.replace("--out out", "--out again");
    place.done(&again.split_whitespace().collect::<Vec<_>>());
    assert!(place.bytes("again/best.toml") == place.bytes("out/best.toml"), "{command}");
}

#[test]
fn the_page_of_a_search_for_weights_has_a_line_per_island() {
    let place = Place::new();
    let search = "evolve --preset weights --scenes room --out out --radius 2 --islands 2 \
                  --island-size 6 --generations 2 --finalists 2";
    place.done(&search.split_whitespace().collect::<Vec<_>>());
    let html = page(&place, "out/report.html");
    let data = html.split_once("id=\"data\">").expect("data").1;
    let data = json(data.split_once("</script>").expect("an end").0);
    let csv = String::from_utf8(place.bytes("out/history.csv")).expect("UTF-8");
    for (k, row) in csv.lines().skip(1).enumerate() {
        let best: f64 = row.split(',').nth(2).expect("a column").parse().expect("a number");
        assert_eq!(data["lines"][k % 2]["values"][k / 2].as_f64(), Some(best), "{row}");
    }
    assert_eq!(data["generations"], serde_json::json!([0, 1, 2]));
    assert!(html.contains("--islands=2") && html.contains("Finalists"), "no command, no finalists");
}
