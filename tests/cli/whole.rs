//! Files of renderers, whole: what is not colour stays as it is. The first test takes files that
//! Blender and Mitsuba wrote (`tests/renders`), the others small ones that are made here, each
//! of a kind that went wrong.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use exr::image::FlatSamples;
use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, Image, Layer, WritableImage, f16,
};
use serde_json::Value;

use crate::made::{Made, SIZE, Whole, denoised, error, layer, write};
use crate::place::{Place, json, stderr};

fn renders() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/renders")
}

/// What the file was made with by real renderers, as their users tick the boxes, is filtered
/// without an option, nearer to its reference, and written whole.
#[test]
fn files_of_real_renderers_stay_whole() {
    let place = Place::new();
    let list = fs::read_to_string(renders().join("files.json")).expect("the list of files");
    let list: BTreeMap<String, Value> = serde_json::from_str(&list).expect("a table");
    assert!(list.len() > 10);
    for (name, entry) in list {
        let input = renders().join(&name);
        let output = place.path("out.exr");
        let path = input.to_str().expect("a plain path");
        let run = place.run(&["denoise", path, "-o", "out.exr"]);
        assert!(run.status.success(), "{name}: {}", stderr(&run));
        let (before, after) = (Whole::read(&input), Whole::read(&output));
        let colours = entry["colours"].as_array().expect("a list");
        let mut filtered = Vec::new();
        for colour in colours {
            let part = colour["part"].as_u64().expect("a number") as usize;
            let channels: Vec<&str> = colour["channels"]
                .as_array()
                .expect("three")
                .iter()
                .map(|channel| channel.as_str().expect("a name"))
                .collect();
            let reference = colour["reference"].as_str().expect("a file");
            let reference = Whole::read(&renders().join(reference));
            let rgb = |whole: &Whole, part: usize, names: &[&str]| {
                names.iter().map(|name| whole.samples(part, name)).collect::<Vec<_>>()
            };
            let clean = rgb(&reference, 0, &["R", "G", "B"]);
            let of = |image: Vec<Vec<f32>>| {
                error([0, 1, 2].map(|k| &image[k][..]), [0, 1, 2].map(|k| &clean[k][..]))
            };
            let (noisy, result) =
                (of(rgb(&before, part, &channels)), of(rgb(&after, part, &channels)));
            assert!(result < 0.75 * noisy, "{name}, {channels:?}: {noisy} became {result}");
            filtered.extend(channels.into_iter().map(|channel| (part, channel)));
        }
        // DWA codes what ends in R, G, B or Y anew, colour or not: that is told.
        if !name.contains("dwa") {
            before.is_kept_by(&after, &filtered);
        }
    }
}

#[test]
fn every_other_channel_and_attribute_is_kept() {
    let place = Place::new();
    let made = Made::new(1);
    let pixels = SIZE.0 * SIZE.1;
    let mut channels = made.all();
    let ids = (0..pixels as u32).map(|k| k * 77).collect();
    channels.push(("id".to_owned(), FlatSamples::U32(ids)));
    channels.push(("mask".to_owned(), FlatSamples::F16(vec![f16::from_f32(0.3); pixels])));
    channels.push(("crypto00.R".to_owned(), FlatSamples::F32(vec![f32::NAN; pixels])));
    let mut layer = layer(channels);
    layer.encoding.compression = Compression::PIZ;
    layer.attributes.owner = Some("nobody".into());
    let custom = exr::meta::attribute::AttributeValue::Custom {
        kind: "mystery".into(),
        bytes: vec![1, 2, 3].into(),
    };
    layer.attributes.other.insert("custom".into(), custom);
    Image::from_layer(layer).write().to_file(place.path("in.exr")).expect("writable");
    let (before, after, _) = denoised(&place, &[]);
    before.is_kept_by(&after, &[(0, "R"), (0, "G"), (0, "B")]);
    let rgb = ["R", "G", "B"].map(|name| after.samples(0, name));
    assert!(made.error_of(rgb.each_ref().map(Vec::as_slice)) < 0.2 * made.noise());
}

#[test]
fn a_grey_image_stays_grey() {
    let place = Place::new();
    let made = Made::new(2);
    let only = |name: &str| (name == "G").then(|| "Y".to_owned());
    write(&place.path("in.exr"), made.named(only));
    let (before, after, _) = denoised(&place, &[]);
    before.is_kept_by(&after, &[(0, "Y")]);
    let error = |whole: &Whole| {
        let y = whole.samples(0, "Y");
        let g = &made.truth[1][..];
        error([&y, &y, &y], [g, g, g])
    };
    assert!(error(&after) < 0.6 * error(&before));
}

#[test]
fn nothing_leaks_to_where_nothing_is() {
    let place = Place::new();
    let made = Made::new(3);
    let alpha: Vec<f32> =
        (0..SIZE.0 * SIZE.1).map(|k| ((k % SIZE.0) as f32 / 10.0 - 1.0).clamp(0.0, 1.0)).collect();
    let mut channels = made.all();
    for (name, samples) in &mut channels {
        if ["R", "G", "B"].contains(&name.as_str()) {
            let covered = samples.values_as_f32().zip(&alpha).map(|(x, a)| x * a);
            *samples = FlatSamples::F32(covered.collect());
        }
    }
    channels.push(("A".to_owned(), FlatSamples::F32(alpha.clone())));
    write(&place.path("in.exr"), channels);
    let (before, after, _) = denoised(&place, &[]);
    before.is_kept_by(&after, &[(0, "R"), (0, "G"), (0, "B")]);
    let red = after.samples(0, "R");
    assert!(alpha.iter().zip(&red).all(|(&a, &r)| a > 0.0 || r == 0.0));
    assert!(alpha.iter().zip(&red).any(|(&a, &r)| a == 1.0 && r > 0.0));

    place.done(&["denoise", "in.exr", "-o", "out.png", "--exposure", "1"]);
    let decoder = png::Decoder::new(std::io::Cursor::new(place.bytes("out.png")));
    let mut reader = decoder.read_info().expect("a PNG file");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a small one")];
    let frame = reader.next_frame(&mut pixels).expect("one frame");
    assert_eq!(frame.color_type, png::ColorType::Rgba);
    let levels: Vec<u8> = pixels.chunks(4).map(|pixel| pixel[3]).collect();
    assert!(levels.iter().zip(&alpha).all(|(&level, &a)| level == (255.0 * a).round() as u8));
}

#[test]
fn every_view_has_its_own_features() {
    let place = Place::new();
    let (left, right) = (Made::new(4), Made::new(5));
    write(&place.path("left.exr"), left.all());
    write(&place.path("right.exr"), right.all());
    let mut channels = left.all();
    channels.extend(right.named(|name| Some(format!("right.{name}"))));
    let mut stereo = layer(channels);
    stereo.attributes.multi_view_names = Some(vec!["left".into(), "right".into()]);
    Image::from_layer(stereo).write().to_file(place.path("in.exr")).expect("writable");
    let (_, both, report) = denoised(&place, &[]);
    assert!(report.contains("view `left`") && report.contains("view `right`"), "{report}");
    let (_, one, _) = denoised(&place, &["--view", "right"]);
    for (view, prefix) in [("left", ""), ("right", "right.")] {
        place.done(&["denoise", &format!("{view}.exr"), "-o", "alone.exr"]);
        let alone = Whole::read(&place.path("alone.exr"));
        for name in ["R", "G", "B"] {
            let full = format!("{prefix}{name}");
            assert_eq!(both.samples(0, &full), alone.samples(0, name), "{full}");
        }
    }
    assert_eq!(one.samples(0, "right.G"), both.samples(0, "right.G"));
    assert_eq!(one.samples(0, "G"), left.channels["G"], "another view is left alone");
    let wrong = ["denoise", "in.exr", "-o", "no.exr", "--view", "middle"];
    place.fails(1, &wrong, &["in.exr", "middle", "left, right"]);
}

#[test]
fn parts_of_other_windows_are_placed() {
    let place = Place::new();
    let made = Made::new(6);
    let is_albedo = |name: &str| name.starts_with("Albedo");
    let beauty = layer(made.named(|name| (!is_albedo(name)).then(|| name.to_owned())));
    // The albedo of the ball and a little around it.
    let (x0, y0, size) = (16, 4, (28, 24));
    let cropped =
        made.channels.iter().filter(|(name, _)| is_albedo(name)).map(|(name, samples)| {
            let rows = samples.chunks(SIZE.0).skip(y0).take(size.1);
            let pixels = rows.flat_map(|row| row[x0..x0 + size.0].to_vec()).collect();
            AnyChannel::new(*name, FlatSamples::F32(pixels))
        });
    let mut beauty = beauty;
    beauty.attributes.layer_name = Some("beauty".into());
    let channels = AnyChannels::sort(cropped.collect());
    let mut albedo = Layer::new(size, Default::default(), Encoding::FAST_LOSSLESS, channels);
    albedo.attributes.layer_name = Some("albedo".into());
    albedo.attributes.layer_position = exr::math::Vec2(x0 as i32, y0 as i32);
    let window = exr::meta::attribute::IntegerBounds::from_dimensions(SIZE);
    let attributes = exr::meta::header::ImageAttributes::new(window);
    let image = Image::from_layers(attributes, vec![beauty, albedo]);
    image.write().to_file(place.path("in.exr")).expect("writable");
    let (before, after, report) = denoised(&place, &[]);
    before.is_kept_by(&after, &[(0, "R"), (0, "G"), (0, "B")]);
    assert!(
        report.contains("albedo from Albedo") && report.contains("28x24 at (16, 4)"),
        "{report}"
    );
    // Where the albedo is, it helps.
    let inside = |samples: &[f32]| -> Vec<f32> {
        let rows = samples.chunks(SIZE.0).skip(y0).take(size.1);
        rows.flat_map(|row| row[x0..x0 + size.0].to_vec()).collect()
    };
    let error = |whole: &Whole| {
        let image = ["R", "G", "B"].map(|name| inside(&whole.samples(0, name)));
        let truth = made.truth.each_ref().map(|channel| inside(channel));
        error(image.each_ref().map(Vec::as_slice), truth.each_ref().map(Vec::as_slice))
    };
    let without = made.named(|name| (!is_albedo(name)).then(|| name.to_owned()));
    write(&place.path("in.exr"), without);
    let (_, without, _) = denoised(&place, &[]);
    assert!(error(&after) < 0.35 * error(&before), "{} of {}", error(&after), error(&before));
    assert!(error(&after) < 0.5 * error(&without), "{}, {}", error(&after), error(&without));
}

#[test]
fn layers_that_add_up_to_the_colour_still_do() {
    let place = Place::new();
    let made = Made::new(13);
    let mut channels = made.all();
    for name in ["R", "G", "B"] {
        // Two lights, of which the second reaches half of the wall.
        let part = |light: f32| -> FlatSamples {
            let pixels = made.channels[name].iter().enumerate();
            let share = |k: usize| if k % SIZE.0 < SIZE.0 / 2 { light } else { 1.0 - light };
            FlatSamples::F32(pixels.map(|(k, x)| x * share(k)).collect())
        };
        channels.push((format!("light_key.{name}"), part(0.75)));
        channels.push((format!("light_fill.{name}"), part(0.25)));
        channels.push((format!("specular.{name}"), part(0.5)));
        channels.push((format!("Direct.{name}"), part(0.75)));
        channels.push((format!("crypto00.{name}"), part(0.5)));
    }
    channels.push(("A".to_owned(), FlatSamples::F32(vec![1.0; SIZE.0 * SIZE.1])));
    write(&place.path("in.exr"), channels);
    let (_, plain, _) = denoised(&place, &[]);
    let (before, after, report) = denoised(&place, &["--layers", "light_*", "--alpha", "filter"]);
    assert!(report.contains("by the same weights: light_fill, light_key, A"), "{report}");
    for name in ["R", "G", "B"] {
        assert_eq!(after.samples(0, name), plain.samples(0, name), "the colour is what it was");
        let of = |layer: &str| after.samples(0, &format!("{layer}.{name}"));
        let sum = of("light_key").into_iter().zip(of("light_fill")).map(|(a, b)| a + b);
        for (sum, whole) in sum.zip(after.samples(0, name)) {
            assert!((sum - whole).abs() <= 2e-5 * (1.0 + whole), "{sum} instead of {whole}");
        }
        assert_ne!(of("light_key"), before.samples(0, &format!("light_key.{name}")));
        assert_eq!(of("specular"), before.samples(0, &format!("specular.{name}")));
    }
    // What is the same everywhere stays so.
    assert!(after.samples(0, "A").iter().all(|a| (a - 1.0).abs() < 1e-5));
    // Direct light feeds filters, and is light all the same; data are no pictures.
    let (_, all, report) = denoised(&place, &["--layers", "*"]);
    assert!(report.contains("weights: Direct, light_fill, light_key, specular"), "{report}");
    assert_eq!(all.samples(0, "Direct.G"), after.samples(0, "light_key.G"));
    let wrong = ["denoise", "in.exr", "-o", "no.exr", "--layers", "light_*,lamp*"];
    place.fails(1, &wrong, &["in.exr", "lamp*", "light_key", "specular"]);
    let lossy = "version = 2\nname = \"x\"\n[[stage]]\nname = \"y\"\nmap = \"sqrt(color)\"\n";
    fs::write(place.path("root.toml"), lossy).expect("writable");
    let wrong =
        ["denoise", "in.exr", "-o", "no.exr", "--layers", "light_*", "--filter", "root.toml"];
    place.fails(1, &wrong, &["in.exr", "`x`", "--layers"]);
}

#[test]
fn normals_as_colours_are_told_and_taken_back() {
    let place = Place::new();
    let made = Made::new(9);
    write(&place.path("in.exr"), made.all());
    denoised(&place, &[]);
    let (expected, reference) = (Whole::read(&place.path("out.exr")), &made);
    let mut channels = made.all();
    for (name, samples) in &mut channels {
        if name.starts_with("Normal") {
            let encoded = samples.values_as_f32().map(|x| 0.5 * x + 0.5);
            *samples = FlatSamples::F32(encoded.collect());
        }
    }
    write(&place.path("in.exr"), channels);
    let (_, after, report) = denoised(&place, &[]);
    assert!(report.contains("normals: between 0 and 1"), "{report}");
    let error = |whole: &Whole| {
        let rgb = ["R", "G", "B"].map(|name| whole.samples(0, name));
        reference.error_of(rgb.each_ref().map(Vec::as_slice))
    };
    assert!((error(&after) / error(&expected) - 1.0).abs() < 1e-3);
}

#[test]
fn images_of_other_places_are_compared_where_they_overlap() {
    let place = Place::new();
    let made = Made::new(11);
    write(&place.path("a.exr"), made.all());
    let mut moved = layer(made.all());
    moved.attributes.layer_position = exr::math::Vec2(4, 2);
    Image::from_layer(moved).write().to_file(place.path("b.exr")).expect("writable");
    let text = place.done(&["compare", "a.exr", "b.exr"]);
    assert!(text.contains("where both are: 44x30 at (4, 2)"), "{text}");
    let values = json(&place.done(&["compare", "a.exr", "b.exr", "--json"]));
    assert!(values["rel_mse"].as_f64().is_some_and(|error| error > 0.0), "{values}");
    let values = json(&place.done(&["compare", "a.exr", "a.exr", "--json"]));
    assert!(values["overlap"].is_null() && values["rel_mse"] == 0.0, "{values}");
}

/// What a format of one picture has no place for is told once, and what feeds filters is not
/// called a loss.
#[test]
fn what_is_not_in_a_png_file_is_told() {
    let place = Place::new();
    let made = Made::new(17);
    let mut channels = made.all();
    for layer in ["light_key", "light_fill", "crypto00"] {
        channels
            .extend(made.named(|name| (!name.contains('.')).then(|| format!("{layer}.{name}"))));
    }
    channels.push(("mask".to_owned(), FlatSamples::F32(vec![1.0; SIZE.0 * SIZE.1])));
    channels.push(("A".to_owned(), FlatSamples::F32(vec![1.0; SIZE.0 * SIZE.1])));
    write(&place.path("in.exr"), channels);
    let report = |output: &str| {
        let run = place.run(&["denoise", "in.exr", "-o", output, "--layers", "light_*"]);
        assert!(run.status.success(), "{}", stderr(&run));
        stderr(&run)
    };
    for (output, name) in [("out.png", "PNG"), ("out.pfm", "PFM")] {
        let remark = format!(
            "{output}: a {name} file holds one picture; not in it: crypto00, light_fill, \
             light_key, mask\n"
        );
        assert!(report(output).contains(&remark), "{}", report(output));
    }
    assert!(!report("out.exr").contains("not in it"));

    let mut channels = made.all();
    channels.extend(made.named(|name| Some(format!("right.{name}"))));
    let mut stereo = layer(channels);
    stereo.attributes.multi_view_names = Some(vec!["left".into(), "right".into()]);
    Image::from_layer(stereo).write().to_file(place.path("1.exr")).expect("writable");
    fs::copy(place.path("1.exr"), place.path("2.exr")).expect("writable");
    let run = place.run(&["denoise", "1.exr", "2.exr", "-o", "clean/", "--format", "png"]);
    let report = stderr(&run);
    let remark = "clean/1.png: a PNG file holds one picture; not in it: view `right`\n";
    assert!(report.contains(remark), "{report}");
    assert_eq!(report.matches("not in it").count(), 1, "{report}");
    // The other view alone leaves out this one, which was not filtered.
    let run = place.run(&["denoise", "1.exr", "-o", "out.png", "--view", "right"]);
    assert!(stderr(&run).contains("not in it: "), "{}", stderr(&run));
    write(&place.path("in.exr"), made.all());
    let run = place.run(&["denoise", "in.exr", "-o", "out.png"]);
    assert!(!stderr(&run).contains("not in it"), "{}", stderr(&run));
}
