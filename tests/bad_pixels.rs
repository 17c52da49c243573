//! What one pixel that is no number may change: what `scene::repair` states.

mod fixture;

use tamis::backend::{ACCURACY, Backend, Filtered, Interpreter, Rect};
use tamis::expr::{Feature, Quantity, Tree, codebook};
use tamis::filter::Window;
use tamis::plan::{Passes, Plan};
use tamis::scene::{Facts, LoadOptions, Needs, RawScene, Repair, Scene};

use fixture::{PAD, parse, prepare, raw};

const WIDTH: usize = 29;
const HEIGHT: usize = 23;
const RADIUS: usize = 3;
/// Gradients and estimated variances are made of neighbours.
const DERIVED: usize = 1;

const BAD: [f32; 4] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -3e30];

type Key = (Feature, Quantity);
const COLOR: Key = (Feature::Color, Quantity::Value);
const DEPTH: Key = (Feature::Depth, Quantity::Value);

/// A filter, and whether its weights are known not to be negative.
type Named = (String, Tree, bool);

fn filters() -> Vec<Named> {
    let named = codebook::known().iter();
    let named = named.map(|known| {
        let positive = known.name != "kan2017";
        (known.name.to_owned(), known.weight.clone(), positive)
    });
    named.collect()
}

/// The scene with variances of its own, and one whose variances are estimated.
fn scenes() -> [RawScene; 2] {
    let full = raw(WIDTH, HEIGHT, 5);
    let mut bare = full.clone();
    bare.features.retain(|(_, quantity), _| *quantity == Quantity::Value);
    [full, bare]
}

fn run(backend: &dyn Backend, scene: &Scene, weight: &Tree) -> Filtered {
    let weights = std::slice::from_ref(weight);
    let window = Window::dense(RADIUS as u32);
    let plan = Plan::new(weights, window, &Facts::of(scene), Passes::ALL)
        .expect("the fixture has every feature");
    let code = backend.compile(&plan).expect("it compiles everything");
    code.run(scene, &[Rect::whole(scene)]).expect("the whole is inside").swap_remove(0)
}

fn filtered(scene: &Scene, weight: &Tree) -> Vec<[f32; 3]> {
    run(&Interpreter, scene, weight).pixels
}

/// The scene with all components of a quantity changed at one pixel.
fn with(raw: &RawScene, key: Key, place: usize, value: impl Fn(&[f32]) -> f32) -> RawScene {
    let mut raw = raw.clone();
    for component in raw.features.get_mut(&key).expect("the scene has it") {
        component[place] = value(component);
    }
    raw
}

/// The lower median of the samples next to one, by the book.
fn median_around(samples: &[f32], place: usize) -> f32 {
    let next = |k: usize| is_near(k, place, 1) && k != place;
    let mut around: Vec<f32> =
        (0..samples.len()).filter(|&k| next(k)).map(|k| samples[k]).collect();
    around.sort_by(f32::total_cmp);
    around[(around.len() - 1) / 2]
}

fn is_near(a: usize, b: usize, reach: usize) -> bool {
    (a % WIDTH).abs_diff(b % WIDTH) <= reach && (a / WIDTH).abs_diff(b / WIDTH) <= reach
}

fn is_number(color: &[f32; 3]) -> bool {
    color.iter().all(|c| c.is_finite())
}

/// A pixel from `start` on whose loss moves no scale of the scene.
fn harmless(raw: &RawScene, key: Key, bad: f32, start: usize) -> usize {
    let before = *prepare(raw.clone()).normalization();
    (start..WIDTH * HEIGHT)
        .find(|&place| *prepare(with(raw, key, place, |_| bad)).normalization() == before)
        .expect("few pixels are the median of something")
}

#[test]
fn a_bad_sample_is_replaced_by_its_neighbours_median_and_by_nothing_else() {
    for raw in scenes() {
        for &key in raw.features.keys() {
            for place in [0, WIDTH - 1, 11 * WIDTH + 14, WIDTH * HEIGHT - 7] {
                for bad in BAD {
                    // An infinite depth is no bad one: nothing was hit there.
                    let far = key == DEPTH && bad == f32::INFINITY;
                    let good = |samples: &[f32]| {
                        if far { 0.0 } else { median_around(samples, place) }
                    };
                    let expected = prepare(with(&raw, key, place, good));
                    let got = prepare(with(&raw, key, place, |_| bad));
                    assert_eq!(got.normalization(), expected.normalization(), "{key:?} {bad}");
                    assert!(got.planes().eq(expected.planes()), "{key:?} {bad} at {place}");
                    assert_eq!(got.color(), expected.color(), "{key:?} {bad} at {place}");
                }
            }
        }
    }
}

#[test]
fn outside_of_its_window_a_bad_pixel_changes_no_bit() {
    let mut changed_inside = 0;
    for (name, weight, _) in filters() {
        for raw in scenes() {
            let before = filtered(&prepare(raw.clone()), &weight);
            for &key in raw.features.keys() {
                for bad in [f32::NAN, f32::INFINITY] {
                    for start in [0, 10 * WIDTH + 15] {
                        let place = harmless(&raw, key, bad, start);
                        let after = filtered(&prepare(with(&raw, key, place, |_| bad)), &weight);
                        for (k, (after, before)) in after.iter().zip(&before).enumerate() {
                            let inside = is_near(k, place, RADIUS + DERIVED);
                            let place = format!("{key:?} is {bad} at {place}, pixel {k}");
                            assert!(inside || after == before, "{name}: {place}");
                            assert!(is_number(after), "{name}: {place}");
                            changed_inside += usize::from(after != before);
                        }
                    }
                }
            }
        }
    }
    assert!(changed_inside > 1000, "else nothing was tried");
}

#[test]
fn inside_of_its_window_a_bad_pixel_brings_no_colour_that_was_not_there() {
    for (name, weight, _) in filters().into_iter().filter(|(_, _, positive)| *positive) {
        for raw in scenes() {
            for &key in raw.features.keys() {
                for (bad, place) in BAD.into_iter().zip([3, 10 * WIDTH + 15, 200, 333]) {
                    let got = filtered(&prepare(with(&raw, key, place, |_| bad)), &weight);
                    for (k, got) in got.iter().enumerate() {
                        for (&got, channel) in got.iter().zip(&raw.features[&COLOR]) {
                            let good = (0..channel.len()).filter(|&j| {
                                is_near(j, k, RADIUS) && !(key == COLOR && j == place)
                            });
                            let (least, greatest) = good
                                .map(|j| channel[j])
                                .fold((f32::MAX, 0.0f32), |(lo, hi), c| (lo.min(c), hi.max(c)));
                            // At the window's edge, the median may come from beyond it.
                            let repaired = median_around(channel, place);
                            let beyond = key == COLOR && is_near(k, place, RADIUS);
                            let (least, greatest) = match beyond {
                                true => (least.min(repaired), greatest.max(repaired)),
                                false => (least, greatest),
                            };
                            let rounding = 2.0 * ACCURACY as f32 * greatest;
                            assert!(
                                got >= least - rounding && got <= greatest + rounding,
                                "{name}: {key:?} is {bad} at {place}: pixel {k} is {got}, \
                                 colours around it {least} to {greatest}"
                            );
                        }
                    }
                }
            }
        }
    }
}

/// Then the weights are the same, and the pixel's share is at most one.
#[test]
fn a_weight_that_does_not_look_at_colours_changes_the_result_by_less_than_the_pixel() {
    let [raw, _] = scenes();
    let channels = &raw.features[&COLOR];
    for weight in ["exp(-distance2(pixel, pixel) / 4)", "exp(-distance1(texture, texture) / 0.2)"] {
        let weight = parse(weight);
        let before = filtered(&prepare(raw.clone()), &weight);
        // One of them is the firefly of the fixture, which a median is far from.
        for place in [3, 10 * WIDTH + 15, WIDTH * HEIGHT / 2] {
            let after = filtered(&prepare(with(&raw, COLOR, place, |_| f32::INFINITY)), &weight);
            for (k, (after, before)) in after.iter().zip(&before).enumerate() {
                for ((after, before), channel) in after.iter().zip(before).zip(channels) {
                    let bound = (median_around(channel, place) - channel[place]).abs();
                    let rounding = 2.0 * ACCURACY as f32 * before.max(*after);
                    let change = (after - before).abs();
                    assert!(change <= bound + rounding, "{weight}: pixel {k}: {before} {after}");
                }
            }
        }
    }
}

#[test]
fn one_bad_pixel_moves_a_scale_by_one_rank_at_most() {
    let [raw, _] = scenes();
    let before = *prepare(raw.clone()).normalization();
    let position = &raw.features[&(Feature::WorldPosition, Quantity::Value)];
    let sorted = |samples: Vec<f32>| {
        let mut samples = samples;
        samples.sort_by(f32::total_cmp);
        samples
    };
    let [r, g, b] = [0, 1, 2].map(|c| &raw.features[&COLOR][c]);
    let luminances: Vec<f32> =
        (0..r.len()).map(|k| 0.2126 * r[k] + 0.7152 * g[k] + 0.0722 * b[k]).collect();
    let luminances = sorted(luminances.into_iter().filter(|&y| y > 0.0).collect());
    // The fixture's first pixel hits nothing.
    let axes: Vec<Vec<f32>> = position.iter().map(|axis| sorted(axis[1..].to_vec())).collect();
    let rank = |sorted: &[f32], value: f32| {
        sorted.iter().position(|&x| x == value).expect("a quantile is an element")
    };
    // What stands one rank below and above a value.
    let beside = |sorted: &[f32], value: f32| {
        let rank = rank(sorted, value);
        sorted[rank - 1]..=sorted[rank + 1]
    };
    let mut moved = 0;
    for place in 1..WIDTH * HEIGHT {
        for key in [COLOR, (Feature::WorldPosition, Quantity::Value), DEPTH] {
            for bad in [f32::NAN, f32::INFINITY] {
                let after = *prepare(with(&raw, key, place, |_| bad)).normalization();
                moved += usize::from(after != before);
                assert!(beside(&luminances, before.exposure).contains(&after.exposure));
                let centers = before.center.zip(after.center).expect("the scene has positions");
                for (k, axis) in axes.iter().enumerate() {
                    assert!(beside(axis, centers.0[k]).contains(&centers.1[k]), "{key:?} {place}");
                }
                let extents = axes.iter().map(|axis| {
                    let at = |q: f64| ((axis.len() - 1) as f64 * q).floor() as usize;
                    let (low, high) = (at(0.05), at(0.95));
                    (axis[high - 1] - axis[low + 1], axis[high + 1] - axis[low - 1])
                });
                let (least, greatest) =
                    extents.fold((0.0f32, 0.0f32), |(a, b), (c, d)| (a.max(c), b.max(d)));
                let extent = after.extent.expect("the scene has positions");
                assert!((least..=greatest).contains(&extent), "{key:?} {place}");
            }
        }
    }
    assert!(moved > 0, "else nothing was tried");
}

/// What `--repair none` is documented to do: bad colours keep their window noisy and
/// stay, bad features leave numbers; nothing panics, and what is far off is as ever.
#[test]
fn what_is_left_in_stays_in_its_window() {
    let options = LoadOptions { repair: Repair::None, ..LoadOptions::default() };
    let leave = |raw| {
        RawScene::prepare(raw, &Needs::everything(), PAD, &options).expect("nothing is refused")
    };
    let [raw, bare] = scenes();
    let backends: [&dyn Backend; _] = [
        &Interpreter,
        #[cfg(feature = "jit")]
        &tamis::backend::Jit::new().expect("the host has a code generator"),
    ];
    for backend in backends {
        for (name, weight, _) in filters() {
            for raw in [&raw, &bare] {
                let sane = leave(raw.clone());
                let before = run(backend, &sane, &weight);
                let noisy = sane.noisy();
                for &key in raw.features.keys() {
                    for bad in BAD {
                        let place = (10 * WIDTH + 15..WIDTH * HEIGHT)
                            .find(|&place| {
                                let left = leave(with(raw, key, place, |_| bad));
                                left.normalization() == sane.normalization()
                            })
                            .expect("few pixels are the median of something");
                        let left = leave(with(raw, key, place, |_| bad));
                        let after = run(backend, &left, &weight);
                        let what = format!("{}, {name}, {key:?} is {bad}", backend.name());
                        for (k, (now, then)) in after.pixels.iter().zip(&before.pixels).enumerate()
                        {
                            // A plan knows nothing of a plane with a bad sample, so that
                            // roundings differ everywhere.
                            let far = !is_near(k, place, RADIUS + DERIVED);
                            let differ = |(a, b): (&f32, &f32)| {
                                f64::from((a - b).abs()) > 2.0 * ACCURACY * f64::from(b.abs())
                            };
                            let changed = now.iter().zip(then).any(differ);
                            assert!(!(far && changed), "{what}: pixel {k}: {then:?} {now:?}");
                            let stays = k == place && key == COLOR && !bad.is_finite();
                            assert_eq!(!is_number(now), stays, "{what}: pixel {k} is {now:?}");
                            // Every tap of a Gaussian of the distance counts.
                            let reached = is_near(k, place, RADIUS) && k != place;
                            if name == "gaussian" && key == COLOR && !bad.is_finite() && reached {
                                let kept = noisy.rgb().map(|channel| channel[k]);
                                assert_eq!(*now, kept, "{what}: pixel {k}");
                            }
                        }
                    }
                }
            }
        }
    }
}
