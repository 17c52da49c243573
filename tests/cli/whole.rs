//! Files of renderers, whole: what is in them feeds filters, and what is not colour stays as
//! it is. The first tests take files that Blender and Mitsuba wrote (`tests/renders`), the
//! others small ones that are made here, each of a kind that went wrong.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use exr::image::{FlatImage, FlatSamples};
use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, Image, Layer, WritableImage, f16,
    read_all_flat_layers_from_file,
};
use serde_json::Value;

use crate::place::{Place, json, stderr};

/// The channels of a file by the number of their part and their name, and the parts'
/// attributes.
struct Whole {
    channels: BTreeMap<(usize, String), FlatSamples>,
    attributes: Vec<BTreeMap<String, String>>,
}

impl Whole {
    fn read(path: &Path) -> Self {
        let image: FlatImage = read_all_flat_layers_from_file(path)
            .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let mut channels = BTreeMap::new();
        let mut attributes = Vec::new();
        for (part, layer) in image.layer_data.into_iter().enumerate() {
            let mut said = BTreeMap::new();
            said.insert("encoding".to_owned(), format!("{:?}", layer.encoding));
            said.insert("size".to_owned(), format!("{:?}", layer.size));
            let mut own = layer.attributes;
            for (name, value) in std::mem::take(&mut own.other) {
                said.insert(name.to_string(), format!("{value:?}"));
            }
            said.insert("own".to_owned(), format!("{own:?}"));
            attributes.push(said);
            for channel in layer.channel_data.list {
                channels.insert((part, channel.name.to_string()), channel.sample_data);
            }
        }
        let mut shared = BTreeMap::from([(
            "windows".to_owned(),
            format!("{:?} {}", image.attributes.display_window, image.attributes.pixel_aspect),
        )]);
        for (name, value) in image.attributes.other {
            shared.insert(name.to_string(), format!("{value:?}"));
        }
        attributes.push(shared);
        Self { channels, attributes }
    }

    /// Checks that another file differs in these channels alone, and says so in an attribute.
    #[track_caller]
    fn is_kept_by(&self, other: &Self, but: &[(usize, &str)]) {
        let names = |whole: &Self| whole.channels.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(self), names(other));
        for ((part, name), samples) in &self.channels {
            let new = &other.channels[&(*part, name.clone())];
            let is_same = bits(samples) == bits(new);
            let is_filtered = but.contains(&(*part, name.as_str()));
            assert_eq!(is_same, !is_filtered, "part {part}, channel {name}");
        }
        for (part, (before, after)) in self.attributes.iter().zip(&other.attributes).enumerate() {
            let mut after = after.clone();
            let said = after.remove("tamis");
            let is_filtered = but.iter().any(|(of, _)| *of == part);
            assert_eq!(said.is_some(), is_filtered, "part {part} says what was done");
            assert!(said.is_none_or(|said| said.contains("filter tamis (")));
            assert_eq!(*before, after, "attributes of part {part}");
        }
    }

    fn samples(&self, part: usize, name: &str) -> Vec<f32> {
        self.channels[&(part, name.to_owned())].values_as_f32().collect()
    }
}

/// The type of samples, and their bits.
fn bits(samples: &FlatSamples) -> (u8, Vec<u32>) {
    match samples {
        FlatSamples::F16(samples) => {
            (0, samples.iter().map(|sample| u32::from(sample.to_bits())).collect())
        }
        FlatSamples::F32(samples) => (1, samples.iter().map(|sample| sample.to_bits()).collect()),
        FlatSamples::U32(samples) => (2, samples.clone()),
    }
}

/// RelMSE of three channels.
fn error(image: [&[f32]; 3], reference: [&[f32]; 3]) -> f64 {
    let pairs = image.into_iter().zip(reference).flat_map(|(a, b)| a.iter().zip(b));
    let errors = pairs.map(|(&a, &b)| f64::from(a - b).powi(2) / (f64::from(b).powi(2) + 0.01));
    errors.sum::<f64>() / (3 * image[0].len()) as f64
}

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

/// A wall with a checker of two albedos and a ball before it, as a renderer sees them.
struct Made {
    channels: BTreeMap<&'static str, Vec<f32>>,
    truth: [Vec<f32>; 3],
}

const SIZE: (usize, usize) = (48, 32);

impl Made {
    fn new(seed: u32) -> Self {
        let mut made = Self { channels: BTreeMap::new(), truth: Default::default() };
        let mut state = u64::from(seed) << 32 | 1;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            ((state >> 40) as f32 + 0.5) / (1 << 24) as f32
        };
        for y in 0..SIZE.1 {
            for x in 0..SIZE.0 {
                let (u, v) = (x as f32 / SIZE.0 as f32, y as f32 / SIZE.1 as f32);
                let (dx, dy) = ((u - 0.6) / 0.2, (v - 0.5) / 0.28);
                let ball = dx * dx + dy * dy < 1.0;
                let check = if (x / 6 + y / 6) % 2 == 0 { 0.2 } else { 0.7 };
                let albedo = if ball { [0.8, 0.2, 0.1] } else { [check, 0.3, 0.9 - check] };
                let z = (1.0 - dx * dx - dy * dy).max(0.0).sqrt();
                let normal = if ball { [dx, dy, z] } else { [0.0, 0.0, 1.0] };
                let light = 0.4 + 0.8 * (0.4 * normal[0] - 0.4 * normal[1] + 0.8 * normal[2]);
                // Four samples of a light that is there every other time.
                let seen: f32 = (0..4).map(|_| -uniform().ln()).sum::<f32>() / 4.0;
                for (k, name) in ["R", "G", "B"].into_iter().enumerate() {
                    made.truth[k].push(albedo[k] * light);
                    made.push(name, albedo[k] * light * seen);
                }
                for (k, name) in ["Albedo.R", "Albedo.G", "Albedo.B"].into_iter().enumerate() {
                    made.push(name, albedo[k]);
                }
                for (k, name) in ["Normal.X", "Normal.Y", "Normal.Z"].into_iter().enumerate() {
                    made.push(name, normal[k]);
                }
                made.push("Depth.Z", if ball { 3.0 - z } else { 5.0 });
            }
        }
        made
    }

    fn push(&mut self, name: &'static str, sample: f32) {
        self.channels.entry(name).or_default().push(sample);
    }

    /// The channels, each as f(name) has it renamed; left out where that gives nothing.
    fn named(&self, f: impl Fn(&str) -> Option<String>) -> Vec<(String, FlatSamples)> {
        let channels = self.channels.iter();
        let named = channels
            .filter_map(|(name, samples)| Some((f(name)?, FlatSamples::F32(samples.clone()))));
        named.collect()
    }

    fn all(&self) -> Vec<(String, FlatSamples)> {
        self.named(|name| Some(name.to_owned()))
    }

    fn error_of(&self, image: [&[f32]; 3]) -> f64 {
        error(image, self.truth.each_ref().map(Vec::as_slice))
    }

    fn noise(&self) -> f64 {
        self.error_of(["R", "G", "B"].map(|name| &self.channels[name][..]))
    }
}

fn layer(channels: Vec<(String, FlatSamples)>) -> Layer<AnyChannels<FlatSamples>> {
    let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(&name[..], samples));
    let channels = AnyChannels::sort(channels.collect());
    Layer::new(SIZE, Default::default(), Encoding::FAST_LOSSLESS, channels)
}

fn write(path: &Path, channels: Vec<(String, FlatSamples)>) {
    Image::from_layer(layer(channels)).write().to_file(path).expect("a writable folder");
}

/// Filters `in.exr`, and gives both files.
#[track_caller]
fn denoised(place: &Place, more: &[&str]) -> (Whole, Whole, String) {
    let output = place.run(&[&["denoise", "in.exr", "-o", "out.exr"], more].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let whole = |name: &str| Whole::read(&place.path(name));
    (whole("in.exr"), whole("out.exr"), stderr(&output))
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
