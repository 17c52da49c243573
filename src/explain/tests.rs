//! What is said of filters against what they do.

use std::path::Path;

use super::*;
use crate::backend::Interpreter;
use crate::denoise::{Run, apply};
use crate::scene::{LoadOptions, Needs, load_reference};

fn galley(filter: &Filter) -> (Scene, Image) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test/galley");
    let checked = filter.check().expect("it makes sense");
    let (needs, options) = (checked.needs(), LoadOptions::default());
    let scene = Scene::load(&folder.join("4spp.exr"), &needs, checked.reach(), &options);
    let reference = load_reference(&folder.join("reference.exr"));
    (scene.expect("a scene of ours"), reference.expect("one of ours"))
}

fn rel_mse(filter: &Filter, scene: &Scene, reference: &Image) -> f64 {
    let (image, _) =
        apply(filter, scene, &Interpreter, Passes::ALL, Run::default()).expect("it runs");
    Metrics::of(&image, reference).expect("the same size").rel_mse
}

const TWO_PASSES: &str = r#"
version = 2
name = "two"
[absent]
albedo = 0.5
depth = 0.0
direct = "color"
[params]
near = 0.5
[[stage]]
name = "light"
map = "color / (albedo + 0.01)"
[[stage]]
name = "rough"
map = "clamp(join(mean(tGradient), mean(light)), 0, 4)"
[[stage]]
name = "coarse"
gather = "light"
weight = "exp(-min(near * pow(distance2(normal, normal), 2) + rough[0][i], 60))"
variance = "mean(cVariance)"
radius = 2
dilation = 2
grid = "half"
[[stage]]
name = "fine"
gather = "coarse * (albedo + 0.01)"
weight = "exp(-(pow(distance2(pixel, pixel), 2) / 4)) * (1 + rough[1] * coarse.variance)"
radius = 1
"#;

fn two_passes() -> Filter {
    Filter::parse(TWO_PASSES, "two.toml".as_ref()).expect("it makes sense")
}

#[test]
fn parts_are_those_of_the_filter_and_effects_those_of_leaving_them_out() {
    let filter = two_passes();
    let (scene, reference) = galley(&filter);
    let told = explain(&filter, &scene, &reference, &Interpreter, &|_, _| {}).expect("it runs");
    let texts: Vec<&str> = told.parts.iter().map(|(part, _)| part.text.as_str()).collect();
    assert_eq!(
        texts,
        [
            "normal",
            "albedo",
            "variances",
            "light = color / (albedo + 0.01)",
            "rough[0] = mean(tGradient)",
            "rough[1] = mean(light)",
            "coarse = mean of light",
            "near * pow(distance2(normal, normal), 2)",
            "rough[0][i]",
            "fine = mean of coarse * (albedo + 0.01)",
            "pow(distance2(pixel, pixel), 2) / 4",
            "1 + rough[1] * coarse.variance",
        ]
    );
    let found =
        |text: &str| told.parts.iter().find(|(part, _)| part.text == text).expect("it is there").1;
    let effect = |text: &str| match found(text) {
        Found::Without(effect) => effect,
        other => panic!("{text}: {other:?}"),
    };
    // Nothing stands in for normals.
    assert!(matches!(found("normal"), Found::Needed));
    let changed = |from: &str, to: &str| {
        let text = TWO_PASSES.replace(from, to);
        assert_ne!(text, TWO_PASSES);
        Filter::parse(&text, "two.toml".as_ref()).expect("it makes sense")
    };
    let rows = [
        ("albedo", "albedo", "0.5"),
        (
            "near * pow(distance2(normal, normal), 2)",
            "near * pow(distance2(normal, normal), 2)",
            "0",
        ),
        ("1 + rough[1] * coarse.variance", "(1 + rough[1] * coarse.variance)", "1"),
        ("coarse = mean of light", "radius = 2\ndilation = 2", "radius = 0"),
    ];
    for (text, from, to) in rows {
        // A feature that stands in for itself cannot be named any more.
        let other = match text {
            "albedo" => {
                let text = TWO_PASSES.replace("albedo = 0.5\n", "").replace("mean(tGradient)", "0");
                let text = text.replace("albedo", "0.5");
                Filter::parse(&text, "two.toml".as_ref()).expect("it makes sense")
            }
            _ => changed(from, to),
        };
        assert_eq!(effect(text).metrics.rel_mse, rel_mse(&other, &scene, &reference), "{text}");
    }
    assert_eq!(told.whole.metrics.rel_mse, rel_mse(&filter, &scene, &reference));
    assert!(effect("coarse = mean of light").cost < told.whole.cost);
}

#[test]
fn what_a_scene_lacks_is_said() {
    let filter = two_passes();
    let (_, reference) = galley(&filter);
    let bare = Needs::planes(
        filter
            .check()
            .expect("it makes sense")
            .needs()
            .named()
            .expect("named")
            .iter()
            .copied()
            .filter(|plane| plane.feature != Feature::Texture),
    );
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test/galley");
    let scene = Scene::load(&folder.join("4spp.exr"), &bare, 8, &LoadOptions::default());
    let scene = scene.expect("a scene of ours");
    let told = explain(&filter, &scene, &reference, &Interpreter, &|_, _| {}).expect("it runs");
    let albedo = told.parts.iter().find(|(part, _)| part.text == "albedo").expect("it is read");
    assert!(matches!(albedo.1, Found::Absent));
}

#[test]
fn a_weight_alone_has_its_terms() {
    let weight = "exp(-distance2(normal, normal) * 4 - distance2(pixel, pixel) / 9)";
    let filter = Filter::single("w", weight.parse().expect("a weight"), 3);
    let (scene, reference) = galley(&filter);
    let told = explain(&filter, &scene, &reference, &Interpreter, &|_, _| {}).expect("it runs");
    let pass = told.parts.iter().find(|(part, _)| part.kind == Kind::Pass).expect("one pass");
    let Found::Without(effect) = pass.1 else { panic!("it can be left out") };
    assert_eq!(effect.metrics.rel_mse, told.noisy.rel_mse);
    let terms = told.parts.iter().filter(|(part, _)| part.kind == Kind::Term).count();
    assert_eq!(terms, 2);
}

/// The shares, times what they are shares of, are what the filter gives.
#[test]
fn footprints_are_what_results_are_made_of() {
    let weight = "exp(-distance2(normal, normal) * 4 - distance2(pixel, pixel) / 9)";
    let single = Filter::single("w", weight.parse().expect("a weight"), 3);
    let program = r#"
version = 2
name = "p"
[[stage]]
name = "smooth"
gather = "color"
weight = "1"
radius = 1
dilation = 2
[[stage]]
name = "result"
gather = "color"
weight = "exp(-pow(distance2(smooth, smooth), 2))"
radius = 2
dilation = 3
"#;
    let program = Filter::parse(program, "p.toml".as_ref()).expect("it makes sense");
    for filter in [single, program] {
        let (scene, _) = galley(&filter);
        let (image, _) =
            apply(&filter, &scene, &Interpreter, Passes::ALL, Run::default()).expect("it runs");
        let (width, height) = image.size();
        let window = filter.gathers().last().expect("one").window;
        for at in [[0, 0], [width - 1, height / 2], [61, 43], [20, height - 1]] {
            let print = footprints(&filter, &scene, at).pop().expect("one per pass");
            let diameter = window.diameter();
            let mut sum = 0.0;
            for (k, share) in print.shares.iter().enumerate() {
                let place = |tap: usize, at: usize| {
                    (at + tap * window.dilation as usize).checked_sub(window.reach() as usize)
                };
                let tap = [place(k % diameter, at[0]), place(k / diameter, at[1])];
                let inside = matches!(tap, [Some(x), Some(y)] if x < width && y < height);
                assert_eq!(share.is_some(), inside);
                if let (Some(share), [Some(x), Some(y)]) = (share, tap) {
                    sum += share * f64::from(scene.color()[1].at(x, y));
                }
            }
            let filtered = f64::from(image.rgb()[1][at[1] * width + at[0]]);
            assert!((sum - filtered).abs() <= 1e-4 * filtered.abs(), "{at:?}: {sum} {filtered}");
        }
    }
}

/// Half the resolution, and a filter that looks far.
#[test]
fn shares_of_every_pass_add_up_to_one() {
    let filter = crate::filter::shipped::best();
    let (scene, _) = galley(&filter);
    let prints = footprints(&filter, &scene, [61, 43]);
    assert_eq!(prints.len(), filter.gathers().count());
    for print in prints {
        let sum: f64 = print.shares.iter().flatten().sum();
        assert!((sum - 1.0).abs() < 1e-9, "{}: {sum}", filter.stages[print.stage].name);
    }
}
