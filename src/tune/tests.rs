use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::loss::Reference;
use super::*;
use crate::backend::Interpreter;
use crate::expr::{Feature, Quantity};
use crate::filter::Filter;
use crate::image::Image;
use crate::scene::{LoadOptions, Needs, RawScene};

/// A blur whose width, and what edges it keeps, are constants, with a layer in it.
const FILTER: &str = r#"
version = 2
name = "blur"

[absent]
normal = 0

[params]
width = { value = 0.3, min = 0.001, max = 10 }
edges = 0.1
fixed = { value = 1.5, tune = false }

[layers.knob]
weights = [[0.1, -0.1], [0.05, 0.02]]
bias = [0.0, 0.1]

[[stage]]
name = "knobs"
map = "knob(join(mean(color), mean(normal)))"

[[stage]]
name = "result"
gather = "color"
weight = "exp(-(1 / width + knobs[0]) * distance2(pixel, pixel) - exp(edges + knobs[1]) * distance2(normal, normal) * fixed)"
radius = 2
"#;

fn filter(text: &str) -> Filter {
    Filter::parse(text, Path::new("blur.toml")).expect("it parses")
}

/// Two walls with noise on them, at two sample counts.
fn scene(seed: u64) -> TuningScene {
    use rand::RngExt;
    let (width, height) = (36, 24);
    let mut random = stream(seed, 0, 0, 0);
    let wall = |k: usize| if k % width < 15 { 0.2f32 } else { 0.9 };
    let image = |f: &mut dyn FnMut(usize) -> f32| (0..width * height).map(f).collect::<Vec<f32>>();
    let clean = image(&mut |k| wall(k));
    let mut level = |samples: u32| {
        let noise = 0.5 / (samples as f32).sqrt();
        let color = [(); 3].map(|()| {
            image(&mut |k| (wall(k) * (1.0 + noise * random.random_range(-1.5f32..1.5))).max(0.0))
        });
        let normal = [image(&mut |k| wall(k).round()), image(&mut |_| 0.3), image(&mut |_| 0.0)];
        let variance = image(&mut |k| 0.75 * (wall(k) * noise).powi(2));
        let scene = RawScene::new("walls", width, height, color)
            .with(Feature::Color, Quantity::Variance, vec![variance])
            .with(Feature::Normal, Quantity::Value, normal.into())
            .prepare(&Needs::everything(), 2, &LoadOptions::default())
            .expect("a sound scene");
        Level { samples: Some(samples), scene }
    };
    let levels = vec![level(1), level(4)];
    let image = Image::new("clean", width, height, [(); 3].map(|()| clean.clone()));
    let image = image.expect("it has its size");
    let reference = Reference::new(image.rgb());
    TuningScene { name: format!("walls {seed}"), levels, image, reference }
}

fn settings() -> Settings {
    Settings { steps: 60, batch: 3, crop: 16, interval: 20, rate: 0.1, ..Settings::default() }
}

fn tuned(settings: Settings, threads: usize) -> Outcome {
    let (training, validation) = ([scene(1), scene(2)], [scene(3)]);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let filter = filter(FILTER);
        let mut tuner =
            Tuner::new(filter, settings, &training, &validation, &Interpreter).expect("it begins");
        tuner.run(&Control::default(), &mut |_| {}).expect("it runs")
    })
}

#[test]
fn tuning_makes_errors_small_and_leaves_alone_what_is_not_to_be_tuned() {
    let outcome = tuned(settings(), 2);
    let (first, last) = (&outcome.history[0], outcome.history.last().expect("rows"));
    assert!(last.rel_mse < 0.5 * first.rel_mse, "{first:?} {last:?}");
    let params = &outcome.filter.constants.params;
    let value = |name: &str| params.iter().find(|p| p.name == name).expect("it is there").value;
    assert!(value("width") > 0.6, "{params:?}");
    assert_eq!(value("fixed"), 1.5);
    assert_ne!(outcome.filter.constants.layers, filter(FILTER).constants.layers);
    assert_eq!(outcome.ending, Ending::Finished);
    let best = outcome.history.iter().map(|row| row.validation).fold(f64::INFINITY, f64::min);
    let found = outcome.history.iter().find(|row| row.step == outcome.step).expect("its row");
    assert_eq!(found.validation, best);
}

#[test]
fn threads_change_no_bit_and_seeds_do() {
    let [one, three] = [1, 3].map(|threads| tuned(settings(), threads));
    assert_eq!(one.filter, three.filter);
    assert_eq!(csv(&one.history)[..40], csv(&three.history)[..40]);
    let other = tuned(Settings { seed: 2, ..settings() }, 1);
    assert_ne!(one.filter, other.filter);
}

#[test]
fn what_was_interrupted_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("checkpoint.json");
    let (training, validation) = ([scene(1), scene(2)], [scene(3)]);
    let begin = || Tuner::new(filter(FILTER), settings(), &training, &validation, &Interpreter);
    let whole = begin().expect("it begins").run(&Control::default(), &mut |_| {}).expect("runs");

    let stop = Arc::new(AtomicBool::new(false));
    let control = Control {
        stop: Arc::clone(&stop),
        time_limit: None,
        checkpoints: Some(Checkpoints { path: path.clone(), interval: 0 }),
    };
    let mut tuner = begin().expect("it begins");
    let part = tuner.run(&control, &mut |event| {
        if let Event::Step { step: 33, .. } = event {
            stop.store(true, Ordering::Relaxed);
        }
    });
    assert_eq!(part.expect("it runs").ending, Ending::Stopped);
    let checkpoint = Checkpoint::read(&path).expect("it was written");
    let resume = |filter: Filter, training: &[TuningScene]| {
        Tuner::resume(checkpoint.clone(), filter, training, &validation, &Interpreter)
            .map(|mut tuner| tuner.run(&Control::default(), &mut |_| {}).expect("it runs"))
    };
    let resumed = resume(filter(FILTER), &training).expect("the same run");
    assert_eq!(resumed.filter, whole.filter);
    assert_eq!(csv(&resumed.history), csv(&whole.history));

    let other = filter(&FILTER.replace("edges = 0.1", "edges = 0.2"));
    assert!(matches!(resume(other, &training), Err(Error::Other { what: "filter" })));
    let fewer = resume(filter(FILTER), &training[..1]);
    assert!(matches!(fewer, Err(Error::Other { what: "set of scenes" })));
}

#[test]
fn what_cannot_be_tuned_is_refused() {
    let training = [scene(1)];
    let refused = |filter: Filter, settings: Settings, training: &[TuningScene]| {
        Tuner::new(filter, settings, training, &[], &Interpreter).err().expect("it is refused")
    };
    let nothing = "version = 2\nname = \"x\"\n[[stage]]\nname = \"y\"\nmap = \"2 * color\"\n";
    let error = refused(filter(nothing), settings(), &training);
    assert!(matches!(error, Error::NoConstants(_)), "{error}");
    let error = refused(filter(FILTER), Settings { crop: 9, ..settings() }, &training);
    assert!(error.to_string().contains("crop"), "{error}");
    assert!(matches!(refused(filter(FILTER), settings(), &[]), Error::NoScenes));
    let needs = FILTER.replace("mean(normal)", "mean(albedo)");
    let error = refused(filter(&needs), settings(), &training).to_string();
    assert!(error.contains("walls 1") && error.contains("texture"), "{error}");
}

#[test]
fn files_without_variances_are_met_where_a_filter_asks_for_them() {
    let sets = |text: &str| {
        let training = [scene(1)];
        let tuner = Tuner::new(filter(text), settings(), &training, &[], &Interpreter);
        tuner.expect("it begins").feature_sets()
    };
    assert_eq!(sets(FILTER), ["all features", "colour alone"]);
    let asks = FILTER.replace("mean(color)", "mean(color) + cVariance + 0.01 * samples * measured");
    let names = ["all features", "colour alone"];
    let without = ["colour, albedo, normal and depth without variances"];
    let last = ["colour alone without variances"];
    assert_eq!(sets(&asks), [&names[..], &without, &last].concat());
}
