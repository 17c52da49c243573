//! Guides that are no guides: what weights look at is brought into bounds first.

use tamis::backend::{Backend, Interpreter, Rect};
use tamis::expr::{Feature, PlaneId, Quantity};
use tamis::filter::{Filter, shipped};
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

/// With variances, which say that nothing is noise, all that ships leaves the image as it is.
#[test]
fn a_lamp_in_view_stays_a_lamp_and_its_surroundings_stay_dark() {
    let still = lamp_in_view(3.0).with(Feature::Color, Quantity::Variance, grey(0.0, 0.0));
    for filter in shipped::programs() {
        let (error, brightest) = lamp_through(&filter, still.clone());
        assert!(error < 1e-9, "{}: RelMSE {error}", filter.name);
        assert!(brightest < 0.1001, "{}: the wall is up to {brightest}, not 0.1", filter.name);
    }
}

/// Without, nine bright pixels could be a firefly's. The default takes a few hundredths of the
/// lamp away, and gives nothing of it to the wall.
#[test]
fn a_lamp_without_variances_is_mostly_left() {
    let (error, brightest) = lamp_through(&shipped::best(), lamp_in_view(3.0));
    println!("RelMSE {error:.2e}");
    assert!(error < 0.002, "RelMSE {error}");
    assert!(brightest < 0.11, "the wall around the lamp is up to {brightest}, not 0.1");
}

/// How far the image of a lamp is from itself once it is filtered, and the brightest pixel
/// beside the lamp.
fn lamp_through(filter: &Filter, raw: RawScene) -> (f64, f32) {
    let checked = filter.check().expect("it makes sense");
    let scene = raw.prepare(&checked.needs(), checked.reach(), &LoadOptions::default());
    let scene = scene.expect("a sound scene");
    let plan = Plan::of(&checked, &Facts::of(&scene), Passes::ALL).expect("a plan");
    let code = Interpreter.compile(&plan).expect("it compiles everything");
    let filtered = code.run(&scene, &[Rect::whole(&scene)]).expect("it runs").swap_remove(0);
    let channel = |c: usize| filtered.pixels.iter().map(|p| p[c]).collect();
    let image = Image::new("filtered", SIZE, SIZE, [0, 1, 2].map(channel)).expect("its size");
    let error = Metrics::of(&image, &scene.noisy()).expect("one size").rel_mse;
    let beside = (0..SIZE * SIZE).filter(|&k| !is_lamp(k));
    (error, beside.map(|k| filtered.pixels[k][0]).fold(0.0, f32::max))
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
