//! The measurements on filters of which one knows what they do.

use super::adversary::{Stream, grounds, steps_alone};
use super::behaviour::{Fault, Outcome, observe};
use super::guards::Guards;
use super::sensitivity::Noise;
use super::trial::Trial;
use super::*;
use crate::expr::{Feature, Quantity, codebook};
use crate::filter::Window;

fn stage(weight: &str) -> Gather {
    let weight = weight.parse().unwrap_or_else(|error| panic!("{weight}: {error}"));
    Gather::of_color(weight, Window::dense(2))
}

fn guards(weight: &str) -> Guards {
    let ground = steps_alone(1);
    let trial = Trial::new(&ground, &stage(weight), &Interpreter).expect("every feature is there");
    Guards::of(&trial)
}

#[test]
fn guards_are_told_apart() {
    let pixels = steps_alone(1).raw.width * steps_alone(1).raw.height;
    assert_eq!(guards("1"), Guards::default());
    let nothing = guards("1 / 1e17 / 1e17");
    assert_eq!((nothing.vanished, nothing.unpromised, nothing.doubtful), (pixels, pixels, 0));
    // Small, but not too small to be divided by.
    let little = guards("1 / 1e17");
    assert_eq!((little.vanished, little.cancelled, little.unpromised), (0, 0, pixels));
    // 25 weights, of which as many are +1 as -1, but for one in the middle of the image.
    let both = guards("cos(pi * distance1(pixel, pixel)) - 0.04");
    assert!(both.cancelled > pixels / 2 && both.cancelled == both.doubtful, "{both:?}");

    // 441 weights of 1e18 times colours of nearly as much.
    let mut ground = steps_alone(1);
    let channel: Vec<f32> = (0..pixels).map(|k| if k % 2 == 0 { 1e18 } else { 9e17 }).collect();
    ground.raw.features.insert((Feature::Color, Quantity::Value), vec![channel; 3]);
    ground.radius = 10;
    let stage = Gather { window: Window::dense(10), ..stage("1e18") };
    let trial = Trial::new(&ground, &stage, &Interpreter).expect("it reads nothing");
    let overflow = Guards::of(&trial);
    assert!((1..pixels).contains(&overflow.overflowed), "{overflow:?}");
    assert_eq!(overflow.vanished + overflow.cancelled + overflow.unpromised, 0, "{overflow:?}");
}

#[test]
fn noise_is_of_the_size_that_it_says_and_leaves_zeros() {
    // Weights that know nothing: colours change by what they are changed by.
    let ground = steps_alone(1);
    let stage = Gather { window: Window::dense(0), ..stage("1") };
    let trial = Trial::new(&ground, &stage, &Interpreter).expect("it reads nothing");
    let stream = Stream { seed: 1, scene: 0 };
    let measured = sensitivity::measure(&trial, &Interpreter, stream).expect("it runs");
    let [ulp, relative] = &measured[..] else { panic!("{measured:?}") };
    assert_eq!((ulp.feature, ulp.noise, relative.noise), ("color", Noise::Ulp, Noise::Relative));
    assert!((5e-8..1.2e-7).contains(&ulp.greatest.value), "{ulp:?}");
    assert!((9e-4..=1.001e-3).contains(&relative.greatest.value), "{relative:?}");
    assert!(relative.most <= relative.greatest.value);
}

#[test]
fn laws_hold_for_what_looks_at_differences_and_not_for_what_looks_at_places() {
    let ground = steps_alone(1);
    let greatest = |weight: &str| -> Vec<(&str, f64)> {
        let trial = Trial::new(&ground, &stage(weight), &Interpreter).expect("a sound filter");
        let measured = invariance::measure(&trial, &Interpreter).expect("it runs");
        measured.into_iter().map(|i| (i.change, i.greatest.value)).collect()
    };
    let sound = greatest("exp(-distance2(worldPosition, worldPosition) - distance1(color, color))");
    assert_eq!(sound.len(), 9);
    for (change, value) in sound {
        assert!(value < 1e-5, "{change}: {value}");
        assert!(value == 0.0 || !change.contains('^'), "{change}: {value}");
    }
    let absolute = greatest("1 + distanceMax(color, pixel)");
    // Nothing of the world is read.
    assert_eq!(absolute.len(), 5);
    let moved = |(change, value): &&(&str, f64)| !change.contains('^') && *value > 1e-3;
    assert_eq!(absolute.iter().filter(moved).count(), 3, "{absolute:?}");
}

#[test]
fn missing_features_are_refused_and_missing_variances_estimated() {
    let stage = stage("exp(-distance2(normal, normal)) + nVariance");
    let observed = observe(&stage, &Interpreter, 1).expect("it runs");
    let outcome = |feature: &str, fault| {
        let found = observed.iter().find(|b| b.feature == feature && b.fault == fault);
        found.expect("every fault of what is read").outcome
    };
    assert_eq!(outcome("normal", Fault::Missing), Outcome::Refused);
    for (feature, fault) in [
        ("nVariance", Fault::Missing),
        ("nVariance", Fault::Nan),
        ("normal", Fault::Constant),
        ("normal", Fault::Infinite),
        ("color", Fault::Nan),
    ] {
        let Outcome::Filtered { difference, broken: 0, escaped: 0 } = outcome(feature, fault)
        else {
            panic!("{feature}, {fault:?}: {:?}", outcome(feature, fault));
        };
        assert!(difference.unwrap_or(0.0) < 1e-6, "{feature}, {fault:?}: {difference:?}");
    }
    assert_eq!(observed.len(), 3 * Fault::ALL.len() - 1);
}

/// What a screen refuses must be what certificates find unstable, or nearly so.
#[test]
fn a_screen_refuses_what_hangs_on_last_bits() {
    let screen = Screen::new(&[], Window::dense(3), &Interpreter, 1).expect("sound scenes");
    let refuses = |text: &str| screen.refuses(&text.parse().expect("an expression")).expect("runs");
    for sound in ["1", "exp(-distance2(normal, normal) / 0.1)", "nVariance + 1"] {
        assert!(!refuses(sound), "{sound}");
    }
    for (name, unstable) in [("bilateral", false), ("cross-bilateral", false), ("kan2017", true)] {
        let known = codebook::named(name).expect("a known name");
        assert_eq!(screen.refuses(known).expect("runs"), unstable, "{name}");
    }
    assert!(refuses("1 / distance2(texture, texture)"));
    assert!(refuses(
        "exp(sinc(distance1(texture, texture) / biweight(distanceMax(texture, depth))) \
         - distance2(normal, normal))"
    ));
    // Nothing is promised of what cancels.
    assert!(!refuses("1 / 1e17 / 1e17 / distance2(texture, texture)"));
    // There is no plan for a vector.
    assert!(refuses("normal"));
}

#[test]
fn made_scenes_have_all_features_and_follow_the_seed() {
    let made = grounds(1, Window::dense(10));
    for ground in &made {
        let names = Feature::ALL.into_iter().filter(|&feature| feature != Feature::Pixel);
        for feature in names {
            assert!(ground.raw.features.contains_key(&(feature, Quantity::Value)));
            assert!(ground.raw.features.contains_key(&(feature, Quantity::Variance)));
        }
        let color = &ground.raw.features[&(Feature::Color, Quantity::Value)];
        assert!(color.iter().flatten().all(|&c| c >= 0.0), "{}", ground.raw.name);
    }
    let images = |seed| grounds(seed, Window::dense(2)).into_iter().map(|g| g.raw.features);
    assert!(images(1).eq(made[..made.len() - 1].iter().map(|g| g.raw.features.clone())));
    assert!(images(1).zip(images(2)).filter(|(a, b)| a != b).count() >= made.len() - 2);
}
