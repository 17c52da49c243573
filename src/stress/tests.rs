//! The measurements on filters of which one knows what they do.

use std::path::Path;

use super::accuracy::Accuracy;
use super::adversary::{Stream, grounds, steps_alone};
use super::behaviour::{Fault, Outcome, observe};
use super::guards::Guards;
use super::sensitivity::Noise;
use super::trial::Trial;
use super::*;
use crate::expr::{Feature, Quantity, codebook};
use crate::filter::{Filter, Window};

fn single(weight: &str, radius: u32) -> Filter {
    let weight = weight.parse().unwrap_or_else(|error| panic!("{weight}: {error}"));
    Filter::single("single", weight, radius)
}

fn program(stages: &str) -> Filter {
    let text = format!("version = 2\nname = \"program\"\n{stages}");
    Filter::parse(&text, Path::new("test.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn trial<'a>(ground: &'a Ground, filter: &Filter) -> Trial<'a> {
    let checked = filter.check().expect("it makes sense");
    Trial::new(ground, &checked, &Interpreter).expect("every feature is there")
}

fn guards(weight: &str) -> Guards {
    let ground = steps_alone(1);
    Guards::of(&trial(&ground, &single(weight, 2))).swap_remove(0)
}

#[test]
fn guards_are_told_apart() {
    let pixels = steps_alone(1).raw.width * steps_alone(1).raw.height;
    let none = Guards { stage: Filter::RESULT.to_owned(), pixels, ..Guards::default() };
    assert_eq!(guards("1"), none);
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
    let overflow = Guards::of(&trial(&ground, &single("1e18", 10))).swap_remove(0);
    assert!((1..pixels).contains(&overflow.overflowed), "{overflow:?}");
    assert_eq!(overflow.vanished + overflow.cancelled + overflow.unpromised, 0, "{overflow:?}");
}

#[test]
fn noise_is_of_the_size_that_it_says_and_leaves_zeros() {
    // Weights that know nothing: colours change by what they are changed by.
    let ground = steps_alone(1);
    let trial = trial(&ground, &single("1", 0));
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
        let trial = trial(&ground, &single(weight, 2));
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
    let filter = single("exp(-distance2(normal, normal)) + nVariance", 2);
    let checked = filter.check().expect("it makes sense");
    let observed = observe(&checked, &Interpreter, 1).expect("it runs");
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
    let made = grounds(1, Some(Window::dense(10)));
    for ground in &made {
        let names = Feature::ALL.into_iter().filter(|feature| feature.is_stored());
        for feature in names {
            assert!(ground.raw.features.contains_key(&(feature, Quantity::Value)));
            assert!(ground.raw.features.contains_key(&(feature, Quantity::Variance)));
        }
        let color = &ground.raw.features[&(Feature::Color, Quantity::Value)];
        assert!(color.iter().flatten().all(|&c| c >= 0.0), "{}", ground.raw.name);
    }
    let images = |seed| grounds(seed, None).into_iter().map(|g| g.raw.features);
    assert!(images(1).eq(made[..made.len() - 1].iter().map(|g| g.raw.features.clone())));
    assert!(images(1).zip(images(2)).filter(|(a, b)| a != b).count() >= made.len() - 2);
}

#[test]
fn doubt_about_a_gather_reaches_as_far_as_it_is_read() {
    let ground = steps_alone(1);
    // Nothing is hit in a corner of 8 by 6 pixels, where the depth is 0.
    let filter = program(
        "[[stage]]\nname = \"a\"\ngather = \"color\"\nweight = \"min(depth[i], 1)\"\nradius = 2\n\
         [[stage]]\nname = \"b\"\ngather = \"a\"\nweight = \"1\"\nradius = 1\n\
         [[stage]]\nname = \"unread\"\ngather = \"a\"\nweight = \"0\"\nradius = 1\n\
         [[stage]]\nname = \"c\"\nmap = \"b[3, 0] + color\"\n",
    );
    let trial = trial(&ground, &filter);
    let pixels = ground.raw.width * ground.raw.height;
    let guards = Guards::of(&trial);
    let counted: Vec<_> = guards.iter().map(|g| (g.stage.as_str(), g.vanished)).collect();
    assert_eq!(counted, [("a", 8 * 6), ("b", 0), ("unread", pixels)]);
    assert_eq!(guards[0].unpromised, 8 * 6);
    // One pixel further, and three to the left of that.
    assert_eq!(pixels - trial.promised().count(), (8 + 1 - 3) * (6 + 1));
    let of_half = program(
        "[[stage]]\nname = \"a\"\ngather = \"color\"\nweight = \"min(depth[i], 1)\"\nradius = 0\n\
         [[stage]]\nname = \"b\"\ngrid = \"half\"\nmap = \"a\"\n\
         [[stage]]\nname = \"c\"\nmap = \"b\"\n",
    );
    // The next pixels of the image lie between two of half the resolution.
    assert_eq!(pixels - self::trial(&ground, &of_half).promised().count(), (8 + 1) * (6 + 1));
}

#[test]
fn a_program_does_without_what_something_stands_in_for() {
    let stages = "[[stage]]\nname = \"a\"\ngather = \"color\"\n\
                  weight = \"exp(-distance2(normal, normal) - distance1(depth, depth))\"\nradius = 2\n\
                  [[stage]]\nname = \"b\"\nmap = \"a / 2 + color / 2\"\n";
    let filter = program(&format!("[absent]\nnormal = 0\n{stages}"));
    let checked = filter.check().expect("it makes sense");
    let observed = observe(&checked, &Interpreter, 1).expect("it runs");
    let outcome = |feature: &str, fault| {
        let found = observed.iter().find(|b| b.feature == feature && b.fault == fault);
        found.expect("every fault of what is read").outcome
    };
    assert_eq!(outcome("depth", Fault::Missing), Outcome::Refused);
    let without = outcome("normal", Fault::Missing);
    let Outcome::Filtered { difference: Some(difference), broken: 0, .. } = without else {
        panic!("{without:?}");
    };
    assert!(difference < 1e-6, "{difference}");
    for (feature, fault) in [("color", Fault::Nan), ("normal", Fault::Infinite)] {
        let bad = Outcome::Filtered { difference: None, broken: 0, escaped: 0 };
        assert_eq!(outcome(feature, fault), bad, "{feature}, {fault:?}");
    }
}

#[test]
fn programs_are_certified_like_single_weights() {
    let filter = program(
        "[[stage]]\nname = \"a\"\ngather = \"color\"\n\
         weight = \"exp(-distance2(normal, normal))\"\nradius = 1\n\
         [[stage]]\nname = \"b\"\nmap = \"a / 2 + color / 2\"\n",
    );
    let name = "interp".to_owned();
    let engine = Engine { name, backend: Ok(&Interpreter), precision: Precision::Standard };
    let checked = filter.check().expect("it makes sense");
    let certificate = certify(&checked, &[], &[engine], 1).expect("the interpreter runs it");
    assert_eq!(certificate.verdict, Verdict::Stable, "{:?}", certificate.reasons);
    for scene in &certificate.scenes {
        let [Accuracy::Measured(peak)] = &scene.accuracy[..] else {
            panic!("{:?}", scene.accuracy);
        };
        assert!(peak.value < 1e-6, "{}: {peak:?}", scene.scene);
    }
    assert_eq!((certificate.stages, certificate.reach), (2, 1));
    // Made scenes are all there is: a program has no window to cut down.
    assert_eq!(certificate.scenes.len(), 11);
}
