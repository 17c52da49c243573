//! Laws of whole filters: units, exposure and orientation do not matter.

mod fixture;

use tamis::backend::{ACCURACY, Backend, Interpreter, Rect};
use tamis::expr::{Feature, Quantity, Tree, codebook};
use tamis::filter::Window;
use tamis::plan::{Passes, Plan};
use tamis::scene::{Facts, RawScene, Scene};

use fixture::{bred, parse, prepare, raw};

fn filtered(scene: &Scene, weight: &Tree) -> Vec<[f32; 3]> {
    let weights = std::slice::from_ref(weight);
    let plan = Plan::new(weights, Window::dense(3), &Facts::of(scene), Passes::ALL)
        .expect("the fixture has every feature");
    let code = Interpreter.compile(&plan).expect("always possible");
    code.run(scene, &[Rect::whole(scene)]).expect("the whole is inside").swap_remove(0).pixels
}

fn filters() -> Vec<Tree> {
    let named = codebook::known().iter().map(|known| known.weight.clone());
    named.chain(bred().into_iter().map(parse)).collect()
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
    for weight in filters() {
        let expected = filtered(&prepare(raw.clone()), &weight);
        for stops in [-20, -3, 1, 20] {
            let factor = 2f32.powi(stops);
            let exposed = changed(&raw, |feature, quantity, _, x| match quantity {
                Quantity::Variance if light(feature) => x * factor * factor,
                Quantity::Value | Quantity::Gradient if light(feature) => x * factor,
                Quantity::Value | Quantity::Gradient | Quantity::Variance => x,
            });
            let got = filtered(&prepare(exposed), &weight);
            let scaled: Vec<[f32; 3]> = expected.iter().map(|p| p.map(|c| c * factor)).collect();
            assert!(got == scaled, "{weight}: {stops} stops");
        }
    }
}

#[test]
fn the_unit_of_length_does_not_matter() {
    let raw = raw(24, 9, 2);
    let length = |feature| matches!(feature, Feature::WorldPosition | Feature::Depth);
    for weight in filters() {
        let expected = filtered(&prepare(raw.clone()), &weight);
        for exponent in [-10, 7] {
            let factor = 2f32.powi(exponent);
            let scaled = changed(&raw, |feature, quantity, _, x| match quantity {
                Quantity::Variance if length(feature) => x * factor * factor,
                Quantity::Value | Quantity::Gradient if length(feature) => x * factor,
                Quantity::Value | Quantity::Gradient | Quantity::Variance => x,
            });
            assert!(filtered(&prepare(scaled), &weight) == expected, "{weight}: 2^{exponent}");
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
    for known in codebook::known() {
        let expected = filtered(&prepare(raw.clone()), &known.weight);
        let got = filtered(&prepare(transposed.clone()), &known.weight);
        for (k, got) in got.iter().enumerate() {
            let expected = expected[(k % height) * width + k / height];
            for (got, expected) in got.iter().zip(expected) {
                let error = f64::from((got - expected).abs());
                let allowed = 2.0 * ACCURACY * f64::from(expected);
                assert!(error <= allowed, "{}: pixel {k}: {got} {expected}", known.name);
            }
        }
    }
}
