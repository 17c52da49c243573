//! Laws of whole filters: units, exposure and orientation do not matter.

mod fixture;
#[path = "fixture/programs.rs"]
mod programs;

use std::path::Path;

use tamis::backend::reference::meaning;
use tamis::backend::reference::oracle::Pixel;
use tamis::backend::{ACCURACY, Backend, Interpreter, Rect};
use tamis::expr::{Feature, Quantity, codebook};
use tamis::filter::{Filter, shipped};
use tamis::plan::{Passes, Plan};
use tamis::scene::{Facts, RawScene, Scene};

use fixture::{bred, parse, prepare, raw};

fn filtered(scene: &Scene, filter: &Filter) -> Vec<[f32; 3]> {
    let checked = filter.check().expect("it makes sense");
    let schedule =
        Plan::of(&checked, &Facts::of(scene), Passes::ALL).expect("the fixture has every feature");
    let code = Interpreter.compile(&schedule).expect("always possible");
    code.run(scene, &[Rect::whole(scene)]).expect("the whole is inside").swap_remove(0).pixels
}

fn known() -> impl Iterator<Item = Filter> {
    codebook::known().iter().map(|known| Filter::single(known.name, known.weight.clone(), 3))
}

fn program(name: String, text: &str) -> Filter {
    let filter = Filter::parse(text, Path::new("test.toml"));
    Filter { name, ..filter.unwrap_or_else(|error| panic!("{error}\n{text}")) }
}

/// Random programs of one to twelve stages, in which nothing but the number of a stage
/// tells columns from rows if they are not to be `shifted`.
fn random(shifted: bool) -> impl Iterator<Item = Filter> {
    (0..36).map(move |seed| {
        let text = programs::random_with(seed, 1 + seed as usize % 12, shifted);
        program(format!("random {seed}"), &text)
    })
}

fn filters() -> Vec<Filter> {
    let bred = bred().into_iter().map(|text| Filter::single(text, parse(text), 3));
    let sample = program("sample".to_owned(), programs::SAMPLE);
    known().chain(bred).chain(shipped::programs()).chain([sample]).chain(random(true)).collect()
}

/// The scene with every image of some quantities changed.
fn changed(raw: &RawScene, change: impl Fn(Feature, Quantity, usize, f32) -> f32) -> RawScene {
    let mut raw = raw.clone();
    for ((feature, quantity), components) in &mut raw.features {
        for (c, component) in components.iter_mut().enumerate() {
            component.iter_mut().for_each(|x| *x = change(*feature, *quantity, c, *x));
        }
    }
    raw
}

fn light(feature: Feature) -> bool {
    matches!(feature, Feature::Color | Feature::DirIllumination)
}

#[test]
fn exposure_by_powers_of_two_scales_the_result_exactly() {
    let raw = raw(24, 9, 1);
    for filter in filters() {
        let expected = filtered(&prepare(raw.clone()), &filter);
        for stops in [-20, -3, 1, 20] {
            let factor = 2f32.powi(stops);
            let exposed = changed(&raw, |feature, quantity, _, x| match quantity {
                Quantity::Variance if light(feature) => x * factor * factor,
                Quantity::Value | Quantity::Gradient if light(feature) => x * factor,
                Quantity::Value | Quantity::Gradient | Quantity::Variance => x,
            });
            let got = filtered(&prepare(exposed), &filter);
            let scaled: Vec<[f32; 3]> = expected.iter().map(|p| p.map(|c| c * factor)).collect();
            assert!(got == scaled, "{}: {stops} stops", filter.name);
        }
    }
}

#[test]
fn the_unit_of_length_does_not_matter() {
    let raw = raw(24, 9, 2);
    let length = |feature| matches!(feature, Feature::WorldPosition | Feature::Depth);
    for filter in filters() {
        let expected = filtered(&prepare(raw.clone()), &filter);
        for exponent in [-10, 7] {
            let factor = 2f32.powi(exponent);
            let scaled = changed(&raw, |feature, quantity, _, x| match quantity {
                Quantity::Variance if length(feature) => x * factor * factor,
                Quantity::Value | Quantity::Gradient if length(feature) => x * factor,
                Quantity::Value | Quantity::Gradient | Quantity::Variance => x,
            });
            let got = filtered(&prepare(scaled), &filter);
            assert!(got == expected, "{}: 2^{exponent}", filter.name);
        }
    }
}

/// The sums run over the window's rows in another order then, so this holds to
/// within rounding.
#[test]
fn transposing_a_scene_transposes_the_result() {
    let (width, height) = (19, 11);
    let raw = raw(width, height, 3);
    let mut transposed = raw.clone();
    (transposed.width, transposed.height) = (height, width);
    for component in transposed.features.values_mut().flatten() {
        let original = component.clone();
        for (k, x) in component.iter_mut().enumerate() {
            *x = original[(k % height) * width + k / height];
        }
    }
    // Where an earlier stage's shift or a coordinate tells columns from rows, the law is not
    // meant to hold: such programs are made without.
    let sample = program("sample".to_owned(), &programs::without_orientation());
    let filters = known().chain(shipped::programs()).chain([sample]).chain(random(false));
    for filter in filters {
        let (before, after) = (prepare(raw.clone()), prepare(transposed.clone()));
        let expected = filtered(&before, &filter);
        let got = filtered(&after, &filter);
        // The meaning says by what dark colours are to be measured.
        let exact = meaning::of(&before, &filter.check().expect("it makes sense"));
        let least = [exact.darkest; 3];
        for (k, &got) in got.iter().enumerate() {
            let at = (k % height) * width + k / height;
            let color = expected[at].map(f64::from);
            let error = Pixel { color, least, condition: 1.0, promised: true }.difference(got);
            assert!(error <= 2.0 * ACCURACY, "{}: pixel {k}: {error:e}", filter.name);
        }
    }
}
