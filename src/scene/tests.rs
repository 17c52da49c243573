//! Whole scenes: what loading promises.

use super::defect::Defect;
use super::inspect::{Finding, Inspection, Scan};
use super::*;
use crate::expr::feature::{Feature, Quantity};
use crate::image::Metrics;
use crate::image::sample::{PartOf, file, part};
use crate::scene::load_image;

const SIZE: (usize, usize) = (23, 17);

/// Reproducible noise in [0, 1).
fn noise(seed: usize, i: usize) -> f32 {
    let mut h = (seed as u64) << 32 | i as u64;
    for _ in 0..3 {
        h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    (h >> 40) as f32 / (1u64 << 24) as f32
}

fn image(seed: usize) -> Vec<f32> {
    (0..SIZE.0 * SIZE.1).map(|i| noise(seed, i)).collect()
}

fn images(seeds: std::ops::Range<usize>) -> Vec<Vec<f32>> {
    seeds.map(image).collect()
}

/// A scene with every feature, a hole in its geometry, and some variances.
fn made() -> RawScene {
    let color = [1, 2, 3].map(image);
    let mut raw = RawScene::new("made", SIZE.0, SIZE.1, color)
        .with(Feature::Normal, Quantity::Value, images(10..13))
        .with(Feature::Texture, Quantity::Value, images(20..23))
        .with(Feature::SecTexture, Quantity::Value, vec![vec![0.0; SIZE.0 * SIZE.1]; 3])
        .with(Feature::Depth, Quantity::Value, images(30..31))
        .with(Feature::DirIllumination, Quantity::Value, images(40..43))
        .with(Feature::WorldPosition, Quantity::Value, images(50..53))
        .with(Feature::WorldPosition, Quantity::Variance, images(60..61))
        .with(Feature::Color, Quantity::Variance, images(70..73));
    for ((feature, quantity), components) in &mut raw.features {
        let is_geometry = matches!(feature, Feature::Depth | Feature::WorldPosition);
        if is_geometry && *quantity == Quantity::Value {
            components.iter_mut().for_each(|samples| samples[..30].fill(0.0));
        }
    }
    raw
}

fn prepared(raw: RawScene, options: &LoadOptions) -> Scene {
    raw.prepare(&Needs::everything(), 5, options).expect("a sound scene")
}

fn planes(scene: &Scene) -> Vec<(PlaneId, &Plane)> {
    scene.planes().collect()
}

/// Multiplies the values of some features by a factor, their variances by its
/// square.
fn scaled(mut raw: RawScene, which: &[Feature], factor: f32) -> RawScene {
    for ((feature, quantity), components) in &mut raw.features {
        let factor = match quantity {
            Quantity::Value | Quantity::Gradient => factor,
            Quantity::Variance => factor * factor,
        };
        if which.contains(feature) {
            components.iter_mut().flatten().for_each(|x| *x *= factor);
        }
    }
    raw
}

const LIGHT: [Feature; 2] = [Feature::Color, Feature::DirIllumination];
const SPACE: [Feature; 2] = [Feature::WorldPosition, Feature::Depth];

#[test]
fn exposure_by_powers_of_two_changes_no_bit() {
    for color_scale in [ColorScale::Linear, ColorScale::Compressed] {
        let options = LoadOptions { color_scale, ..LoadOptions::default() };
        let before = prepared(made(), &options);
        for k in [-20, -3, 1, 20] {
            let after = prepared(scaled(made(), &LIGHT, 2f32.powi(k)), &options);
            assert_eq!(planes(&before), planes(&after), "2^{k}");
            assert_eq!(after.color()[0].at(3, 3), before.color()[0].at(3, 3) * 2f32.powi(k));
        }
    }
}

#[test]
fn the_worlds_unit_changes_no_bit_or_only_by_rounding() {
    let options = LoadOptions::default();
    let before = prepared(made(), &options);
    for k in [-20, 7, 20] {
        let after = prepared(scaled(made(), &SPACE, 2f32.powi(k)), &options);
        assert_eq!(planes(&before), planes(&after), "2^{k}");
    }
    let after = prepared(scaled(made(), &SPACE, 0.01), &options);
    assert_close(&before, &after, 1e-5);
}

#[test]
fn moving_the_world_changes_nothing_beyond_rounding() {
    let mut moved = made();
    let position = (Feature::WorldPosition, Quantity::Value);
    let components = moved.features.get_mut(&position).expect("made() has positions");
    for (k, samples) in components.iter_mut().enumerate() {
        // The renderer leaves 0 where nothing is hit, wherever the world is.
        samples[30..].iter_mut().for_each(|x| *x += 16.0 * (k as f32 + 1.0));
    }
    let (before, after) =
        (prepared(made(), &LoadOptions::default()), prepared(moved, &LoadOptions::default()));
    assert_close(&before, &after, 1e-4);
    let id = PlaneId { feature: Feature::WorldPosition, quantity: Quantity::Value, component: 1 };
    assert_eq!(after.plane(id).expect("positions were made").at(0, 0), 0.0);
}

fn assert_close(a: &Scene, b: &Scene, tolerance: f32) {
    for ((id, a), (_, b)) in a.planes().zip(b.planes()) {
        for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
            let (a, b) = (a.at(x, y), b.at(x, y));
            assert!((a - b).abs() <= tolerance * a.abs().max(1.0), "{id} at ({x}, {y}): {a} {b}");
        }
    }
}

#[test]
fn what_holds_of_any_scene_holds_of_each() {
    let any = Facts::of_any_scene();
    for color_scale in [ColorScale::Linear, ColorScale::Compressed] {
        let options = LoadOptions { color_scale, ..LoadOptions::default() };
        let mut negative = made();
        let variance = (Feature::Normal, Quantity::Variance);
        negative.features.insert(variance, vec![vec![-1.0; SIZE.0 * SIZE.1]]);
        for scene in [prepared(made(), &options), prepared(negative, &options)] {
            for (id, fact) in Facts::of(&scene).iter() {
                assert_eq!(any.get(id).join(fact), any.get(id), "{id}");
            }
        }
    }
}

#[test]
fn what_is_constant_is_no_image_and_facts_enclose_the_rest() {
    let mut raw = made();
    raw.features.insert((Feature::Texture, Quantity::Value), vec![vec![0.25; SIZE.0 * SIZE.1]; 3]);
    let scene = prepared(raw, &LoadOptions::default());
    let facts = Facts::of(&scene);
    let id = |feature, quantity| PlaneId { feature, quantity, component: 0 };
    assert_eq!(facts.get(id(Feature::SecTexture, Quantity::Value)), Fact::Constant(0.0));
    assert_eq!(facts.get(id(Feature::SecTexture, Quantity::Gradient)), Fact::Constant(0.0));
    assert_eq!(facts.get(id(Feature::SecTexture, Quantity::Variance)), Fact::Constant(0.0));
    assert_eq!(facts.get(id(Feature::Texture, Quantity::Value)), Fact::Constant(0.25));
    for (id, plane) in scene.planes() {
        if let Plane::Samples(samples) = plane {
            let interval = facts.get(id).interval();
            assert!(samples.as_slice().iter().all(|&x| interval.contains(x)), "{id}");
        }
    }
    let mut light = made();
    light.features.remove(&(Feature::Texture, Quantity::Value));
    let without = prepared(light, &LoadOptions::default());
    let joined = Facts::of_all([&scene, &without]);
    assert_eq!(joined.get(id(Feature::Texture, Quantity::Value)), Fact::Absent);
    assert_eq!(joined.get(id(Feature::SecTexture, Quantity::Value)), Fact::Constant(0.0));
}

/// The scene of [`made`] as a part of a file of ours.
fn written() -> PartOf {
    let mut sample = part(SIZE);
    for ((feature, quantity), components) in made().features {
        let row = feature.row();
        let names = match quantity {
            Quantity::Value | Quantity::Gradient => row.channels,
            Quantity::Variance => row.variance_channels,
        };
        for (name, samples) in names.iter().zip(components) {
            sample = sample.with(name, samples);
        }
    }
    sample
}

#[test]
fn a_file_gives_what_memory_gives_and_what_else_is_needed_does_not_matter() {
    let sample = file(vec![written()]);
    let options = LoadOptions::default();
    let all = Scene::load(&sample.path, &Needs::everything(), 5, &options).expect("a sound file");
    assert_eq!(planes(&all), planes(&prepared(made(), &options)));
    assert_eq!(all.layout(), Layout::new(SIZE.0, SIZE.1, 5));
    let pad = all.layout().pad();
    assert_eq!(all.ones().row(0)[pad - 1..=pad], [0.0, 1.0]);
    for term in Feature::terms() {
        let needs = Needs::terms([term]);
        for color_scale in [ColorScale::Linear, ColorScale::Compressed] {
            let options = LoadOptions { color_scale, ..options };
            let all = Scene::load(&sample.path, &Needs::everything(), 5, &options).expect("sound");
            let one = Scene::load(&sample.path, &needs, 5, &options).expect("a sound file");
            one.require(&needs).expect("the file has everything");
            for (id, plane) in one.planes() {
                assert!(needs.includes(id));
                assert_eq!(Some(plane), all.plane(id), "{id}");
            }
        }
    }
    let none = Scene::load(&sample.path, &Needs::nothing(), 5, &options).expect("a sound file");
    assert_eq!(none.planes().count(), 0);
    assert_eq!(none.normalization().extent, None);
}

#[test]
fn a_missing_feature_names_the_term_the_channels_and_what_there_is() {
    let sample = file(vec![part((3, 2)).filled(&["R", "G", "B", "Depth.Z"], |_, i| i as f32)]);
    let needs = Needs::terms([
        (Feature::Depth, Quantity::Gradient),
        (Feature::Texture, Quantity::Gradient),
    ]);
    let scene =
        Scene::load(&sample.path, &needs, 2, &LoadOptions::default()).expect("colour is there");
    let error = scene.require(&needs).unwrap_err().to_string();
    for part in ["sample.exr", "`tGradient`", "Albedo.R", "Denoising Albedo", "B, Depth.Z, G, R"] {
        assert!(error.contains(part), "{part} in {error}");
    }
    scene.require(&Needs::terms([(Feature::Depth, Quantity::Gradient)])).expect("depth is there");
}

#[test]
fn bad_pixels_are_repaired_refused_or_left_and_always_counted() {
    let mut sample = written();
    for (name, samples) in &mut sample.channels {
        if let exr_image::FlatSamples::F32(samples) = samples
            && matches!(name.as_str(), "G" | "Normal.Y")
        {
            samples[40] = f32::NAN;
            samples[41] = f32::INFINITY;
            samples[42] = -3e30;
        }
    }
    let sample = file(vec![sample]);
    let load = |repair| {
        let options = LoadOptions { repair, ..LoadOptions::default() };
        Scene::load(&sample.path, &Needs::everything(), 5, &options)
    };
    let scene = load(Repair::Median).expect("repaired");
    let is_good = |samples: &Samples| samples.as_slice().iter().all(|x| x.abs() <= 1e18);
    assert!(scene.color().iter().all(is_good));
    for (id, plane) in scene.planes() {
        assert!(
            matches!(plane, Plane::Constant(x) if x.is_finite())
                || matches!(plane, Plane::Samples(s) if is_good(s)),
            "{id}"
        );
    }
    for channel in ["G", "Normal.Y"] {
        assert!(scene.notes().contains(&Note::Repaired { channel: channel.to_owned(), count: 3 }));
    }
    let error = load(Repair::Error).unwrap_err().to_string();
    assert!(error.contains("3 pixel(s)") && error.contains("x = 17, y = 1"), "{error}");
    let left = load(Repair::None).expect("left in");
    assert!(left.color()[1].at(17, 1).is_nan());
    assert!(left.notes().iter().any(|note| matches!(note, Note::LeftBad { count: 3, .. })));
    let id = PlaneId { feature: Feature::Normal, quantity: Quantity::Value, component: 1 };
    assert_eq!(Facts::of(&left).get(id).interval(), crate::expr::interval::Interval::ENTIRE);

    let scans = Inspection::of(&sample.path).and_then(|file| file.scan()).expect("a sound file");
    let scan = scans.channels["Normal.Y"];
    assert_eq!((scan.nan, scan.infinite, scan.huge), (1, 1, 1));
    assert_eq!(scans.channels["SecondaryAlbedo.R"].constant(), Some(0.0));
}

#[test]
fn what_is_found_on_load_is_what_inspection_lists() {
    let mut sample = written();
    let places = [
        ("G", vec![(40, f32::NAN), (60, f32::NEG_INFINITY), (61, f32::INFINITY), (80, 2e18)]),
        ("R", vec![(100, -0.5), (101, -0.25), (200, 100.0)]),
        ("Depth.Z", vec![(50, f32::INFINITY), (51, f32::NAN), (52, -1.0)]),
        ("Normal.X", vec![(33, -1.0)]),
        ("Albedo.B", vec![(77, 100.0)]),
        ("Variance.B", vec![(11, -1e-9)]),
    ];
    for (name, samples) in &mut sample.channels {
        if let exr_image::FlatSamples::F32(samples) = samples {
            let of_channel = places.iter().filter(|(channel, _)| channel == name);
            of_channel.flat_map(|(_, places)| places).for_each(|&(k, x)| samples[k] = x);
        }
    }
    let foreign = vec![f32::NAN; SIZE.0 * SIZE.1];
    let sample = file(vec![sample.with("foreign", foreign)]);
    let scans = Inspection::of(&sample.path).and_then(|file| file.scan()).expect("a sound file");
    let place = |k: usize| (k % SIZE.0, k / SIZE.0);
    let [value, variance] = [Quantity::Value, Quantity::Variance].map(Some);
    let expected = [
        (Defect::Infinite, "G", value, vec![60, 61]),
        (Defect::Nan, "G", value, vec![40]),
        (Defect::Huge, "G", value, vec![80]),
        (Defect::Negative, "R", value, vec![100, 101]),
        (Defect::Firefly, "color", value, vec![200]),
        (Defect::Far, "Depth.Z", value, vec![50]),
        (Defect::Nan, "Depth.Z", value, vec![51]),
        (Defect::Negative, "Depth.Z", value, vec![52]),
        (Defect::Outside, "Albedo.B", value, vec![77]),
        (Defect::Firefly, "texture", value, vec![77]),
        (Defect::Negative, "Variance.B", variance, vec![11]),
    ];
    for (defect, of, quantity, places) in &expected {
        let first = places.iter().map(|&k| place(k)).collect();
        let (of, count) = ((*of).to_owned(), places.len());
        let finding = Finding { defect: *defect, of, quantity: *quantity, count, first };
        assert!(scans.findings.contains(&finding), "{finding:?} in {:?}", scans.findings);
    }
    let foreign = scans.findings.iter().find(|finding| finding.of == "foreign");
    let foreign = foreign.expect("what is read by nobody is listed, too");
    assert_eq!((foreign.quantity, foreign.count), (None, SIZE.0 * SIZE.1));
    assert_eq!(foreign.first, [0, 1, 2, 3].map(place));
    assert_eq!(scans.findings.len(), expected.len() + 1, "{:?}", scans.findings);

    let scene = Scene::load(&sample.path, &Needs::everything(), 5, &LoadOptions::default());
    let scene = scene.expect("repaired");
    for note in [
        Note::Repaired { channel: "G".to_owned(), count: 4 },
        Note::Negative { channel: "R".to_owned(), quantity: Quantity::Value, count: 2 },
        Note::Fireflies { feature: Feature::Color, count: 1 },
        Note::FarDepth { count: 1 },
        Note::Repaired { channel: "Depth.Z".to_owned(), count: 1 },
        Note::Negative { channel: "Depth.Z".to_owned(), quantity: Quantity::Value, count: 1 },
        Note::Bounded { feature: Feature::Texture, bounds: [0.0, 1.0], count: 1 },
        Note::Fireflies { feature: Feature::Texture, count: 1 },
        Note::Negative { channel: "Variance.B".to_owned(), quantity: Quantity::Variance, count: 1 },
    ] {
        assert!(scene.notes().contains(&note), "{note:?} in {:?}", scene.notes());
    }
    // Counted, and kept.
    assert_eq!(scene.color()[0].at(place(100).0, place(100).1), -0.5);
    assert_eq!(scene.color()[0].at(place(200).0, place(200).1), 100.0);
}

#[test]
fn variances_that_a_file_lacks_are_estimated_and_said_to_be() {
    let scene = prepared(made(), &LoadOptions::default());
    let estimated = |feature| scene.notes().contains(&Note::EstimatedVariance(feature));
    assert!(estimated(Feature::Normal) && estimated(Feature::Depth));
    assert!(!estimated(Feature::Color) && !estimated(Feature::WorldPosition));
    assert!(!estimated(Feature::Pixel));
}

#[test]
fn depths_of_nothing_are_zero_in_any_renderer() {
    let pixels = SIZE.0 * SIZE.1;
    for far in [1e10, 2.5e9, f32::INFINITY] {
        let mut depth = vec![3.0; pixels];
        depth[..30].fill(far);
        let raw = made().with(Feature::Depth, Quantity::Value, vec![depth]);
        let scene = prepared(raw, &LoadOptions::default());
        let id = PlaneId { feature: Feature::Depth, quantity: Quantity::Value, component: 0 };
        assert_eq!(scene.plane(id).expect("depth was made").at(0, 0), 0.0);
        assert!(scene.notes().contains(&Note::FarDepth { count: 30 }));
    }
}

#[test]
fn one_pixel_and_one_row_are_images_too() {
    for size in [(1, 1), (500, 1), (1, 500)] {
        let names: Vec<&str> =
            Feature::ALL.iter().flat_map(|f| f.row().channels).copied().collect();
        let sample = file(vec![part(size).filled(&names, noise)]);
        let scene = Scene::load(&sample.path, &Needs::everything(), 3, &LoadOptions::default());
        let scene = scene.expect("a sound file");
        scene.require(&Needs::terms(Feature::terms())).expect("everything can be derived");
        assert_eq!(scene.noisy().size(), size);
    }
}

#[test]
fn images_are_read_by_any_renderers_name_for_them() {
    let named = |name| PartOf { name: Some(name), ..part((4, 4)) }.filled(&["R", "G", "B"], noise);
    let sample = file(vec![named("ViewLayer.Denoising Albedo"), named("ViewLayer.Combined")]);
    let image = load_image(&sample.path).expect("Blender's colour");
    assert_eq!(image.rgb()[1][3], noise(1, 3));
    let copy = sample.folder.path().join("copy.exr");
    image.save(&copy).expect("writable");
    let metrics = Metrics::of(&load_image(&copy).expect("just written"), &image);
    assert_eq!(metrics.expect("of one size").rel_mse, 0.0);
}

#[test]
fn inspection_tells_what_feeds_what() {
    let sample =
        file(vec![part((2, 2)).filled(&["R", "G", "B", "Normal.X", "Depth.Z", "foo"], noise)]);
    let inspection = Inspection::of(&sample.path).expect("a sound file");
    let role = |name: &str| {
        let found = inspection.channels().find(|(_, channel, _)| channel.name == name);
        found.expect("it was written").2.map(|id| id.to_string())
    };
    assert_eq!(role("G").as_deref(), Some("color[1]"));
    assert_eq!(role("Depth.Z").as_deref(), Some("depth[0]"));
    assert_eq!(role("foo"), None);
    // One component of three is no normal.
    assert_eq!(role("Normal.X"), None);
    assert!(inspection.absent().any(|feature| feature == Feature::Normal));
    assert!(inspection.absent().all(|feature| feature != Feature::Pixel));
    assert_eq!(Scan::of(&[-1.0, 2.0]).negative, 1);
    assert_eq!(Scan::of(&[f32::NAN]).constant(), None);
}

use ::exr::image as exr_image;
