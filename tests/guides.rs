//! Guides that are no guides: what weights look at is brought into bounds first.

use std::path::Path;

use tamis::backend::{Backend, Interpreter, Rect};
use tamis::expr::{Feature, PlaneId, Quantity};
use tamis::filter::Filter;
use tamis::image::{Image, Metrics};
use tamis::plan::{Passes, Plan};
use tamis::scene::{Facts, LoadOptions, Needs, Note, RawScene};

/// A wall of 32 by 32 pixels with a lamp of 3 by 3 in its middle.
const SIZE: usize = 32;

fn is_lamp(k: usize) -> bool {
    (k % SIZE).abs_diff(16) < 2 && (k / SIZE).abs_diff(16) < 2
}

/// The same number in all components.
fn grey(lamp: f32, wall: f32) -> Vec<Vec<f32>> {
    vec![(0..SIZE * SIZE).map(|k| if is_lamp(k) { lamp } else { wall }).collect(); 3]
}

/// Cycles writes the radiance of a lamp that is in view as its albedo, here 3. There is no
/// noise, so the image is its own reference.
fn lamp_in_view(albedo: f32) -> RawScene {
    let color = grey(3.0, 0.1).try_into().expect("three components");
    let along = |step: &dyn Fn(usize) -> usize| -> Vec<f32> {
        (0..SIZE * SIZE).map(|k| step(k) as f32 / SIZE as f32).collect()
    };
    let flat = || vec![0.0; SIZE * SIZE];
    RawScene::new("lamp", SIZE, SIZE, color)
        .with(Feature::Texture, Quantity::Value, grey(albedo, 0.5))
        .with(Feature::DirIllumination, Quantity::Value, grey(3.0, 0.08))
        .with(Feature::Normal, Quantity::Value, vec![flat(), flat(), vec![1.0; SIZE * SIZE]])
        .with(
            Feature::WorldPosition,
            Quantity::Value,
            vec![along(&|k| k % SIZE), along(&|k| k / SIZE), flat()],
        )
}

/// The filter that `denoise` uses unless it is told otherwise.
fn shipped() -> Filter {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/filters/tamis-2.toml");
    Filter::read(&path).expect("it ships with the program")
}

#[test]
fn a_lamp_in_view_stays_a_lamp_and_its_surroundings_stay_dark() {
    let filter = shipped();
    let stage = filter.paper().expect("one gather");
    let pad = stage.window.reach() as usize;
    let scene = lamp_in_view(3.0)
        .prepare(&Needs::everything(), pad, &LoadOptions::default())
        .expect("a sound scene");
    let weights = std::slice::from_ref(&stage.weight);
    let plan = Plan::new(weights, stage.window, &Facts::of(&scene), Passes::ALL).expect("a plan");
    let code = Interpreter.compile(&plan).expect("it compiles everything");
    let filtered = code.run(&scene, &[Rect::whole(&scene)]).expect("it runs").swap_remove(0);
    let channel = |c: usize| filtered.pixels.iter().map(|p| p[c]).collect();
    let image = Image::new("filtered", SIZE, SIZE, [0, 1, 2].map(channel)).expect("its size");
    let error = Metrics::of(&image, &scene.noisy()).expect("one size").rel_mse;
    println!("RelMSE {error:.2e}");
    assert!(error < 0.001, "RelMSE {error}");
    let brightest = (0..SIZE * SIZE)
        .filter(|&k| !is_lamp(k))
        .map(|k| filtered.pixels[k][0])
        .fold(0.0, f32::max);
    assert!(brightest < 0.11, "the wall around the lamp is up to {brightest}, not 0.1");
}

#[test]
fn gradients_and_estimated_variances_are_those_of_the_bounded_guide() {
    let prepared = |albedo| {
        let options = LoadOptions::default();
        lamp_in_view(albedo).prepare(&Needs::everything(), 4, &options).expect("a sound scene")
    };
    let (radiant, white) = (prepared(3.0), prepared(1.0));
    for quantity in Quantity::ALL {
        for id in PlaneId::of(Feature::Texture, quantity) {
            assert!(radiant.plane(id).is_some() && radiant.plane(id) == white.plane(id), "{id}");
        }
    }
    let said = Note::Bounded { feature: Feature::Texture, bounds: [0.0, 1.0], count: 9 };
    assert!(radiant.notes().contains(&said), "{:?}", radiant.notes());
    assert!(!white.notes().iter().any(|note| matches!(note, Note::Bounded { .. })));
    // A normal that is too long is shortened; what has no bounds stays as it is.
    let long = lamp_in_view(0.5).with(
        Feature::Normal,
        Quantity::Value,
        vec![vec![0.0; SIZE * SIZE], vec![0.0; SIZE * SIZE], grey(-40.0, 1.0).swap_remove(0)],
    );
    let scene =
        long.prepare(&Needs::everything(), 4, &LoadOptions::default()).expect("a sound scene");
    let at = |feature, component| {
        let id = PlaneId { feature, quantity: Quantity::Value, component };
        scene.plane(id).expect("it is there").at(16, 16)
    };
    assert_eq!(at(Feature::Normal, 2), -1.0);
    assert!(at(Feature::DirIllumination, 0) > 29.0 && at(Feature::Color, 0) > 29.0);
    let said = Note::LongNormals { count: 9 };
    assert!(scene.notes().contains(&said), "{:?}", scene.notes());
}
