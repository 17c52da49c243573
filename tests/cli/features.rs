//! What feeds filters: features by any name and in files of their own, of any size, and files
//! that lack some of their rows.

use std::fs;
use std::path::Path;

use exr::image::FlatSamples;
use exr::prelude::{AnyChannel, AnyChannels, Compression, Encoding, Image, Layer, WritableImage};

use crate::made::{Made, SIZE, Whole, denoised, error, layer, write};
use crate::place::{Place, json, stderr};

#[test]
fn features_may_be_called_anything_and_be_anywhere() {
    let place = Place::new();
    let made = Made::new(7);
    write(&place.path("whole.exr"), made.all());
    place.done(&["denoise", "whole.exr", "-o", "expected.exr"]);
    let expected = place.pixels("expected.exr");

    // Other names, said.
    write(
        &place.path("in.exr"),
        made.named(|name| Some(name.replace("Albedo", "my tint").replace("Normal", "bent"))),
    );
    denoised(&place, &["--map", "albedo=my tint,normal=Bent"]);
    assert_eq!(place.pixels("out.exr"), expected);
    let wrong = ["denoise", "in.exr", "-o", "no.exr", "--map", "albedo=tints"];
    place.fails(1, &wrong, &["in.exr", "tints", "my tint.R"]);
    let wrong = ["denoise", "in.exr", "-o", "no.exr", "--map", "albino=my tint"];
    place.fails(2, &wrong, &["albino", "albedo"]);

    // Files of their own.
    let of = |part: &str, name: &str| name.strip_prefix(part).map(str::to_owned);
    let bare = |name: &str| (!name.contains('.')).then(|| name.to_owned());
    write(&place.path("in.exr"), made.named(|name| bare(name)));
    write(&place.path("a.exr"), made.named(|name| of("Albedo.", name)));
    write(&place.path("n.exr"), made.named(|name| of("Normal.", name)));
    write(&place.path("shot_Depth.0012.exr"), made.named(|name| of("Depth.", name)));
    let files = ["--albedo", "a.exr", "--normal", "n.exr", "--aux", "shot_Depth.0012.exr"];
    let (_, _, report) = denoised(&place, &files);
    let feeds = "in.exr: colour from R G B; n.exr: normals from X Y Z; a.exr: albedo from R G B; \
                 shot_Depth.0012.exr: depth from Z; absent: variances (estimated)";
    assert_eq!(report.lines().next(), Some(feeds));
    assert_eq!(place.pixels("out.exr"), expected);
    let wrong = ["denoise", "in.exr", "-o", "no.exr", "--aux", "a.exr"];
    place.fails(1, &wrong, &["a.exr", "nothing in it", "--albedo"]);
    let wrong = ["denoise", "in.exr", "-o", "no.exr", "--albedo", "shot_Depth.0012.exr"];
    place.fails(1, &wrong, &["shot_Depth.0012.exr", "albedo"]);
    fs::rename(place.path("a.exr"), place.path("shot.albedo.exr")).expect("writable");
    let files = ["--aux", "shot.albedo.exr", "--normal", "n.exr", "--depth", "shot_Depth.0012.exr"];
    denoised(&place, &files);
    assert_eq!(place.pixels("out.exr"), expected);

    // Several features of one file, which is named once.
    write(&place.path("more.exr"), made.named(|name| name.contains('.').then(|| name.to_owned())));
    let (_, _, report) = denoised(&place, &["--aux", "more.exr"]);
    let feeds = "in.exr: colour from R G B; more.exr: normals from Normal, albedo from Albedo, \
                 depth from Depth.Z; absent: variances (estimated)";
    assert_eq!(report.lines().next(), Some(feeds));
    assert_eq!(place.pixels("out.exr"), expected);
}

#[test]
fn what_open_image_denoises_tools_speak_is_spoken() {
    let place = Place::new();
    let made = Made::new(8);
    let channel = |name: &str| made.channels[name].clone();
    let pfm = |file: &str, names: [&str; 3]| {
        let channels = names.map(channel);
        let bytes = tamis::image::pfm::write(SIZE, channels.each_ref().map(Vec::as_slice));
        fs::write(place.path(file), bytes).expect("writable");
    };
    pfm("hdr.pfm", ["R", "G", "B"]);
    pfm("alb.pfm", ["Albedo.R", "Albedo.G", "Albedo.B"]);
    pfm("nrm.pfm", ["Normal.X", "Normal.Y", "Normal.Z"]);
    let no_depth = |name: &str| (name != "Depth.Z").then(|| name.to_owned());
    write(&place.path("in.exr"), made.named(no_depth));
    denoised(&place, &[]);
    let aux = ["--aux", "alb.pfm", "--aux", "nrm.pfm"];
    place.done(&[&["denoise", "hdr.pfm", "-o", "clean.pfm"][..], &aux].concat());
    assert_eq!(place.pixels("clean.pfm"), place.pixels("out.exr"));
    place.done(&[&["denoise", "hdr.pfm", "-o", "clean.exr"][..], &aux].concat());
    assert_eq!(place.pixels("clean.exr"), place.pixels("out.exr"));
}

#[test]
fn a_lit_layer_is_no_albedo() {
    let place = Place::new();
    let made = Made::new(10);
    let mut channels = made.named(|name| (!name.contains("Albedo")).then(|| name.to_owned()));
    channels.extend(made.named(|name| (!name.contains('.')).then(|| format!("diffuse.{name}"))));
    write(&place.path("in.exr"), channels);
    let (_, _, report) = denoised(&place, &[]);
    assert!(report.contains("absent: albedo"), "{report}");
    let listed = json(&place.done(&["inspect", "in.exr", "--json"]));
    let features = listed["features"].as_array().expect("a list");
    let albedo = features.iter().find(|entry| entry["feature"] == "albedo");
    assert_eq!(albedo.expect("listed")["status"], "absent");
}

/// A file of scan lines that ends after so many chunks of 16 rows, as a renderer leaves it that
/// was killed.
fn unfinished(path: &Path, made: Vec<(String, FlatSamples)>) {
    let mut lines = layer(made);
    lines.encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: exr::prelude::Blocks::ScanLines,
        line_order: exr::prelude::LineOrder::Increasing,
    };
    Image::from_layer(lines).write().to_file(path).expect("a writable folder");
    let bytes = fs::read(path).expect("just written");
    fs::write(path, &bytes[..bytes.len() - 9]).expect("writable");
}

#[test]
fn an_unfinished_render_is_refused_or_read_as_far_as_it_goes() {
    let place = Place::new();
    let made = Made::new(12);
    unfinished(&place.path("in.exr"), made.all());
    let refused = ["denoise", "in.exr", "-o", "out.exr"];
    let report = place.fails(1, &refused, &["in.exr", "not finished", "rows", "--repair median"]);
    assert_eq!(report.lines().count(), 1, "{report}");
    for more in [&[][..], &["--max-memory", "150K"]] {
        let run = place.run(&[&refused[..], &["-q", "--repair", "median"], more].concat());
        let report = stderr(&run);
        assert!(run.status.success(), "{report}");
        assert!(report.contains("16 of 32 row(s) are missing; they stay black"), "{report}");
        assert!(!report.contains("bad pixel"), "{report}");
        let red = Whole::read(&place.path("out.exr")).samples(0, "R");
        let (there, missing) = red.split_at(16 * SIZE.0);
        assert!(there.iter().all(|&x| x > 0.0) && missing.iter().all(|&x| x == 0.0));
    }
}

/// Rows beside a gap are as bright as they would be without it, with features and without.
#[test]
fn what_is_missing_darkens_nothing() {
    let place = Place::new();
    let made = Made::new(13);
    let colour = |name: &str| (!name.contains('.')).then(|| name.to_owned());
    for channels in [made.all(), made.named(colour)] {
        write(&place.path("in.exr"), channels.clone());
        let (_, whole, _) = denoised(&place, &[]);
        unfinished(&place.path("in.exr"), channels);
        place.done(&["denoise", "in.exr", "-o", "out.exr", "--repair", "median"]);
        let part = Whole::read(&place.path("out.exr"));
        for name in ["R", "G", "B"] {
            let row = |image: &Whole, y: usize| -> f32 {
                image.samples(0, name)[y * SIZE.0..][..SIZE.0].iter().sum()
            };
            let row = |y| row(&part, y) / row(&whole, y);
            // The gap begins below row 15.
            for y in [10, 13, 14, 15] {
                assert!((row(y) - 1.0).abs() < 0.1, "row {y} of {name}: {}", row(y));
            }
        }
    }
}

/// Writes the pixels of a window, which the whole picture's display window has or its own.
fn write_part(
    path: &Path,
    channels: Vec<(String, FlatSamples)>,
    (x, y): (usize, usize),
    size: (usize, usize),
    is_part: bool,
) {
    let part = channels.into_iter().map(|(name, samples)| {
        let samples: Vec<f32> = samples.values_as_f32().collect();
        let rows = samples.chunks(SIZE.0).skip(y).take(size.1);
        let part: Vec<f32> = rows.flat_map(|row| &row[x..x + size.0]).copied().collect();
        AnyChannel::new(&name[..], FlatSamples::F32(part))
    });
    let channels = AnyChannels::sort(part.collect());
    let mut layer = Layer::new(size, Default::default(), Encoding::FAST_LOSSLESS, channels);
    if is_part {
        layer.attributes.layer_position = exr::math::Vec2(x as i32, y as i32);
    }
    let mut image = Image::from_layer(layer);
    if is_part {
        image.attributes.display_window.position = exr::math::Vec2(0, 0);
        image.attributes.display_window.size = exr::math::Vec2(SIZE.0, SIZE.1);
    }
    image.write().to_file(path).expect("a writable folder");
}

#[test]
fn a_feature_of_another_size_is_refused_and_a_part_of_the_picture_placed() {
    let place = Place::new();
    let made = Made::new(14);
    let bare = |name: &str| (!name.contains('.')).then(|| name.to_owned());
    let albedo = || made.named(|name| name.strip_prefix("Albedo.").map(str::to_owned));
    write(&place.path("in.exr"), made.named(bare));
    let denoise = ["denoise", "in.exr", "-o", "no.exr", "--albedo"];
    write_part(&place.path("small.exr"), albedo(), (0, 0), (24, 16), false);
    let channels = ["R", "G", "B"].map(|name| vec![made.channels[name][0]; 24 * 16]);
    let bytes = tamis::image::pfm::write((24, 16), channels.each_ref().map(Vec::as_slice));
    fs::write(place.path("small.pfm"), bytes).expect("writable");
    for small in ["small.exr", "small.pfm"] {
        let said = [small, "albedo", "24x16", "in.exr", "48x32", "same size"];
        place.fails(1, &[&denoise[..], &[small]].concat(), &said);
    }
    assert!(!place.path("no.exr").exists());

    write_part(&place.path("crop.exr"), albedo(), (8, 4), (30, 20), true);
    let (_, cropped, report) = denoised(&place, &["--albedo", "crop.exr"]);
    let remark = "albedo: its data window is 30x20 at (8, 4); 936 pixel(s) outside of it count";
    assert!(report.contains(remark), "{report}");
    write(&place.path("a.exr"), albedo());
    let (_, whole, _) = denoised(&place, &["--albedo", "a.exr"]);
    // Within the part, it is where it should be: as good as the whole albedo.
    let inside = |samples: Vec<f32>| -> Vec<f32> {
        let rows = samples.chunks(SIZE.0).skip(8).take(12);
        rows.flat_map(|row| &row[12..34]).copied().collect()
    };
    let error = |image: &Whole| {
        let rgb = ["R", "G", "B"].map(|name| inside(image.samples(0, name)));
        let truth = made.truth.clone().map(inside);
        error(rgb.each_ref().map(Vec::as_slice), truth.each_ref().map(Vec::as_slice))
    };
    assert!(error(&cropped) < 1.5 * error(&whole), "{} {}", error(&cropped), error(&whole));

    // A part of the colour, with features of the whole picture.
    write_part(&place.path("in.exr"), made.named(bare), (8, 4), (30, 20), true);
    let (_, _, report) = denoised(&place, &["--albedo", "a.exr"]);
    assert!(!report.contains("data window"), "all of it is covered: {report}");
    // Beside it, it says nothing of it.
    write_part(&place.path("beside.exr"), albedo(), (40, 26), (8, 6), true);
    place.fails(1, &[&denoise[..], &["beside.exr"]].concat(), &["8x6 at (40, 26)", "30x20"]);
}

#[test]
fn a_depth_may_be_a_grey_image_in_colours() {
    let place = Place::new();
    let made = Made::new(15);
    write(&place.path("in.exr"), made.all());
    denoised(&place, &[]);
    let expected = place.pixels("out.exr");
    write(&place.path("in.exr"), made.named(|name| (name != "Depth.Z").then(|| name.to_owned())));
    let depth = |names: &[&str]| {
        let samples = || FlatSamples::F32(made.channels["Depth.Z"].clone());
        let channels = names.iter().map(|&name| (name.to_owned(), samples()));
        write(&place.path("z.exr"), channels.collect());
    };
    let remark = "depth: one number per pixel, taken from z.exr:";
    for (names, said) in [
        (&["R", "G", "B"][..], Some("R; B, G not used")),
        (&["R", "G", "B", "A"], Some("R; B, G not used")),
        (&["zone", "far"], Some("far; zone not used")),
        (&["R"], None),
        (&["distance"], None),
        (&["Z", "R"], None),
    ] {
        depth(names);
        let (_, _, report) = denoised(&place, &["--depth", "z.exr"]);
        assert_eq!(place.pixels("out.exr"), expected, "{names:?}");
        match said {
            Some(said) => assert!(report.contains(&format!("{remark}{said}")), "{report}"),
            None => assert!(!report.contains("one number"), "{report}"),
        }
    }
}

/// A feature has one name wherever it is spoken of, and its setting that of the renderer.
#[test]
fn what_is_missing_is_called_as_users_call_it() {
    let place = Place::new();
    let made = Made::new(16);
    let blender = |name: &str| match name.split_once('.') {
        None => Some(format!("ViewLayer.Combined.{name}")),
        Some(("Normal", axis)) => Some(format!("ViewLayer.Denoising Normal.{axis}")),
        Some(_) => None,
    };
    write(&place.path("in.exr"), made.named(blender));
    let listed = json(&place.done(&["inspect", "in.exr", "--json"]));
    let features = listed["features"].as_array().expect("a list");
    let names: Vec<&str> =
        features.iter().map(|entry| entry["feature"].as_str().expect("a name")).collect();
    let expected = ["position", "normal", "albedo", "secondaryAlbedo", "depth", "direct", "color"];
    assert_eq!(names, expected);
    let setting = "View Layer > Passes > Data > Denoising Data";
    assert_eq!(
        (&listed["renderer"], &listed["switch_on"]),
        (&"Blender Cycles".into(), &setting.into())
    );
    assert_eq!(features[2]["channels"][0], "Denoising Albedo");
    let text = place.done(&["inspect", "in.exr"]);
    assert!(text.contains(&format!("switch on in Blender Cycles: {setting}")), "{text}");
    for (name, term) in [("albedo", "texture"), ("direct", "dirIllumination")] {
        // Every name that inspect lists is one that --map takes.
        let map = format!("{name}=ViewLayer.Denoising Normal");
        place.done(&["denoise", "in.exr", "-o", "mapped.exr", "--map", &map]);
        for spelled in [name, term] {
            let filter = format!("exp(-distance2({spelled}, {spelled}))");
            let run = ["denoise", "in.exr", "-o", "no.exr", "--filter", &filter];
            let said =
                ["in.exr", &format!("reads `{name}`"), "Blender Cycles: View Layer > Passes"];
            place.fails(1, &run, &said);
        }
    }
    // Where nobody knows the renderer, nothing is said of it.
    write(&place.path("in.exr"), made.named(|name| (!name.contains('.')).then(|| name.to_owned())));
    let text = place.done(&["inspect", "in.exr"]);
    assert!(!text.contains("switch on"), "{text}");
    let run = ["denoise", "in.exr", "-o", "no.exr", "--filter", "distance2(albedo, albedo)"];
    place.fails(1, &run, &["reads `albedo`", "Render that feature too"]);
}

#[test]
fn luminance_and_chroma_are_no_grey_image() {
    let place = Place::new();
    let made = Made::new(18);
    let of = |name: &str| made.channels[name].iter().copied();
    let y: Vec<f32> = of("R")
        .zip(of("G"))
        .zip(of("B"))
        .map(|((r, g), b)| 0.2126 * r + 0.7152 * g + 0.0722 * b)
        .collect();
    let chroma = |name: &str| of(name).zip(&y).map(|(x, y)| (x - y) / y).collect();
    let coloured = |prefix: &str| {
        [("Y", y.clone()), ("RY", chroma("R")), ("BY", chroma("B"))]
            .map(|(name, samples)| (format!("{prefix}{name}"), FlatSamples::F32(samples)))
            .to_vec()
    };
    for prefix in ["", "beauty."] {
        write(&place.path("in.exr"), coloured(prefix));
        let run = ["denoise", "in.exr", "-o", "no.exr"];
        let said = ["in.exr", "luminance and chroma", "R, G and B"];
        place.fails(1, &run, &said);
        for layer in ["Y", "beauty", "beauty.Y"] {
            let map = format!("color={layer}");
            if layer == "Y" || !prefix.is_empty() {
                let run = ["denoise", "in.exr", "-o", "no.exr", "--map", &map];
                let report = place.run(&run);
                assert_eq!(report.status.code(), Some(1), "{layer}: {}", stderr(&report));
            }
        }
        let text = place.done(&["inspect", "in.exr"]);
        assert!(text.contains("RY"), "{text}");
    }
    // As an albedo it is refused, and beside a colour it is no matter.
    write(&place.path("yc.exr"), coloured(""));
    let plain = made.named(|name| (!name.contains('.')).then(|| name.to_owned()));
    write(&place.path("in.exr"), plain.clone());
    let run = ["denoise", "in.exr", "-o", "no.exr", "--albedo", "yc.exr"];
    place.fails(1, &run, &["yc.exr", "luminance and chroma"]);
    assert!(!place.path("no.exr").exists());
    write(&place.path("in.exr"), [plain, coloured("proxy.")].concat());
    let (before, after, _) = denoised(&place, &[]);
    before.is_kept_by(&after, &[(0, "R"), (0, "G"), (0, "B")]);
}
