//! Frames in memory get the bits that files get, whatever their buffers look like.

use std::num::NonZeroUsize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use half::f16;
use tamis::backend::{BackendError, Choice};
use tamis::denoise::{Buffers, DenoiseError, Denoiser, SampleType, Strides, View, ViewMut};
use tamis::expr::{Feature, Quantity};
use tamis::filter::{Filter, shipped};
use tamis::scene::{LoadOptions, Needs, Note, RawScene, Repair};

fn scenes() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test");
    let mut scenes: Vec<PathBuf> = std::fs::read_dir(folder)
        .expect("scenes")
        .map(|entry| entry.expect("a folder").path().join("4spp.exr"))
        .filter(|path| path.is_file())
        .collect();
    scenes.sort();
    assert!(scenes.len() >= 3);
    scenes
}

fn raw(path: &Path) -> RawScene {
    RawScene::read(path, &Needs::everything(), &LoadOptions::default()).expect("a file of ours")
}

fn interleaved(planes: &[Vec<f32>]) -> Vec<f32> {
    (0..planes[0].len()).flat_map(|k| planes.iter().map(move |plane| plane[k])).collect()
}

/// A file's features as a renderer would have them, one buffer each.
struct Buffered {
    size: (usize, usize),
    samples: Option<u32>,
    buffers: Vec<(Feature, Quantity, Vec<f32>)>,
}

impl Buffered {
    fn of(raw: &RawScene) -> Self {
        let buffers = raw.features.iter().map(|(&(feature, quantity), planes)| {
            // One variance is as good as three of which it is the mean.
            let wide = feature == Feature::Color || quantity == Quantity::Value;
            let mean =
                |k: usize| planes.iter().map(|plane| plane[k]).sum::<f32>() / planes.len() as f32;
            let samples = match wide {
                true => interleaved(planes),
                false => (0..planes[0].len()).map(mean).collect(),
            };
            (feature, quantity, samples)
        });
        let (size, samples) = ((raw.width, raw.height), raw.samples);
        Self { size, samples, buffers: buffers.collect() }
    }

    fn of_file(path: &Path) -> Self {
        Self::of(&raw(path))
    }

    fn frame<'d, 'v>(&'v self, denoiser: &'d Denoiser) -> Buffers<'d, 'v> {
        let mut frame = denoiser.frame(self.size.0, self.size.1);
        for (feature, quantity, samples) in &self.buffers {
            frame = frame.feature(*feature, *quantity, samples);
        }
        match self.samples {
            Some(samples) => frame.samples(samples),
            None => frame,
        }
    }

    fn color(&self) -> &[f32] {
        let is_color = |(feature, quantity, _): &&(Feature, Quantity, Vec<f32>)| {
            (*feature, *quantity) == (Feature::Color, Quantity::Value)
        };
        &self.buffers.iter().find(is_color).expect("every scene has one").2
    }
}

fn denoiser(filter: Filter) -> Denoiser {
    Denoiser::builder().filter(filter).build().expect("the processor is there")
}

#[test]
fn memory_and_files_give_the_same_bits_on_every_test_scene() {
    for path in scenes() {
        let buffered = Buffered::of_file(&path);
        for filter in shipped::programs().chain(Filter::named("kan2017")) {
            let denoiser = denoiser(filter);
            let file = denoiser.denoise(&path).expect("it has every feature");
            let expected = interleaved(&file.image().rgb().map(<[f32]>::to_vec));
            let mut out = vec![0.0f32; expected.len()];
            let report = buffered.frame(&denoiser).run(&mut out).expect("it has the same");
            let name = &denoiser.filter_used().name;
            assert!(out == expected, "{name} on {}", path.display());
            assert_eq!(report.applied.kept, file.pictures[0].applied.kept, "{name}");
        }
    }
}

#[test]
fn threads_do_not_matter_and_code_is_made_once() {
    let buffered = Buffered::of_file(&scenes()[0]);
    let on = |threads| {
        let threads = NonZeroUsize::new(threads).expect("some");
        Denoiser::builder().threads(threads).build().expect("the processor is there")
    };
    let (one, three) = (on(1), on(3));
    let first = buffered.frame(&one).filter().expect("it runs");
    let second = buffered.frame(&three).filter().expect("it runs");
    assert!(first.colors() == second.colors());
    let again = buffered.frame(&one).filter().expect("it runs");
    assert!(again.colors() == first.colors());
    assert!(again.report.applied.compilation.is_zero() && again.report.applied.planning.is_zero());
    assert!(!first.report.applied.compilation.is_zero());
}

#[test]
fn buffers_of_any_shape_are_read_and_written_in_place() {
    let raw = raw(&scenes()[1]);
    let (width, height) = (raw.width, raw.height);
    let of = |feature| &raw.features[&(feature, Quantity::Value)];
    let denoiser = denoiser(shipped::best());
    let (color, albedo) = (interleaved(of(Feature::Color)), interleaved(of(Feature::Texture)));
    let normal = interleaved(of(Feature::Normal));
    let expected = denoiser
        .frame(width, height)
        .color(&color)
        .albedo(&albedo)
        .normal(&normal)
        .filter()
        .expect("it runs");

    let mut rgba: Vec<f32> = color.chunks(3).flat_map(|c| [c[0], c[1], c[2], 0.25]).collect();
    let planar: Vec<f32> = of(Feature::Texture).concat();
    // The last row first, as some renderers have it.
    let rows: Vec<u8> = normal
        .chunks(3 * width)
        .rev()
        .flat_map(|row| row.iter().flat_map(|x| x.to_ne_bytes()))
        .collect();
    let row = 12 * width as isize;
    let strides = Strides { offset: rows.len() - 12 * width, pixel: 12, row: -row, component: 4 };
    let filtered = denoiser
        .frame(width, height)
        .color(View::interleaved(&rgba, 4))
        .albedo(View::planar(&planar))
        .normal(View::strided(&rows, SampleType::F32, strides))
        .filter()
        .expect("it runs");
    filtered.write(&mut ViewMut::interleaved(&mut rgba, 4)).expect("it fits");
    for (pixel, expected) in rgba.chunks(4).zip(expected.colors()) {
        assert_eq!((&pixel[..3], pixel[3]), (&expected[..], 0.25));
    }

    // Halves are what their values are in 32 bits.
    let halves: Vec<f16> = color.iter().map(|&x| f16::from_f32(x)).collect();
    let wide: Vec<f32> = halves.iter().map(|x| x.to_f32()).collect();
    let [of_halves, of_wide] = [View::from(&halves), View::from(&wide)]
        .map(|color| denoiser.frame(width, height).color(color).filter().expect("it runs"));
    assert!(of_halves.colors() == of_wide.colors());
    let mut out = vec![f16::ZERO; halves.len()];
    of_wide.write(&mut (&mut out).into()).expect("it fits");
    assert!(out.iter().zip(of_wide.colors().as_flattened()).all(|(h, &x)| *h == f16::from_f32(x)));
}

#[test]
fn encoded_colors_are_decoded_first_and_encoded_last() {
    let buffered = Buffered::of_file(&scenes()[0]);
    let denoiser = denoiser(shipped::best());
    let expected = buffered.frame(&denoiser).filter().expect("it runs").map(|c| c.map(|x| x / 4.0));
    let quarter: Vec<f32> = buffered.color().iter().map(|x| x / 4.0).collect();
    let frame = buffered.frame(&denoiser).color(&quarter).decoded(|x| 4.0 * x);
    let mut out = vec![0.0f32; quarter.len()];
    let filtered = frame.filter().expect("it runs").map(|c| c.map(|x| x / 4.0));
    filtered.write(&mut (&mut out).into()).expect("it fits");
    assert!(out == expected.colors().as_flattened());
}

#[test]
fn somebody_may_watch_and_stop() {
    let buffered = Buffered::of_file(&scenes()[0]);
    for name in ["tamis", "cross-bilateral"] {
        let denoiser = denoiser(Filter::named(name).expect("it ships"));
        let told = std::sync::Mutex::new(Vec::new());
        let progress = |done, of| {
            told.lock().expect("nobody panics").push((done, of));
            ControlFlow::Continue(())
        };
        buffered.frame(&denoiser).progress(&progress).filter().expect("it runs");
        let height = buffered.size.1;
        let mut told = told.into_inner().expect("nobody panics");
        told.sort_unstable();
        assert_eq!(told.last(), Some(&(height, height)), "{name}");

        let mut out = vec![7.0f32; buffered.color().len()];
        let stop = |_, _| ControlFlow::Break(());
        let stopped = buffered.frame(&denoiser).progress(&stop).run(&mut out).unwrap_err();
        assert!(stopped.is_stop(), "{stopped}");
        assert!(out.iter().all(|&x| x == 7.0), "nothing was written");
        buffered.frame(&denoiser).run(&mut out).expect("it can go on");
    }
}

#[test]
fn mistakes_are_errors_that_name_the_buffer() {
    let denoiser = denoiser(shipped::best());
    let color = vec![0.5f32; 3 * 8 * 4];
    let frame = || denoiser.frame(8, 4).color(&color);
    let mut out = vec![0.0f32; color.len()];
    let text = |error: Result<_, DenoiseError>| -> String { error.expect_err("wrong").to_string() };

    let short = vec![0.5f32; 95];
    assert!(text(frame().albedo(&short).filter()).contains("albedo: it has 95 samples, but 96"));
    // A feature that the filter does not read is looked at, too.
    let unread = frame().feature(Feature::DirIllumination, Quantity::Value, &short).filter();
    assert!(text(unread).contains("direct: it has 95"));
    assert!(text(denoiser.frame(8, 4).albedo(&color).filter()).contains("no colour"));
    assert!(text(denoiser.frame(0, 4).filter()).contains("0 x 4"));
    assert!(text(denoiser.frame(usize::MAX, 2).filter()).contains("at most"));
    let grain = frame().feature(Feature::Grain, Quantity::Value, &short).filter();
    assert!(text(grain).contains("grain is no buffer"));
    let error = frame().run(&mut out[1..]).expect_err("too short").to_string();
    assert!(error.contains("the result: it has 95"), "{error}");

    // A filter that cannot do without direct light says so.
    let needs_light = Filter::named("kan2017").expect("it ships");
    let demanding = Denoiser::builder().filter(needs_light).build().expect("the processor");
    let error = demanding.frame(8, 4).color(&color).filter().expect_err("it is not there");
    assert!(matches!(error, DenoiseError::Scene(_)), "{error}");
}

#[test]
fn bad_pixels_are_repaired_and_told_or_refused() {
    let mut color = vec![0.5f32; 3 * 8 * 8];
    color[3 * 20] = f32::NAN;
    let mut out = vec![0.0f32; color.len()];
    let builder = Denoiser::builder();
    let repairing = builder.clone().build().expect("the processor is there");
    let report = repairing.frame(8, 8).color(&color).run(&mut out).expect("repaired");
    assert!(report.notes.iter().any(|note| matches!(note, Note::Repaired { count: 1, .. })));
    assert!(out.iter().all(|&x| (x - 0.5).abs() < 1e-3));
    let refusing = builder.repair(Repair::Error).build().expect("the processor is there");
    let error = refusing.frame(8, 8).color(&color).run(&mut out).expect_err("refused");
    assert!(error.to_string().contains("x = 4, y = 2"), "{error}");
}

#[test]
fn strength_and_samples_are_those_of_files() {
    let path = &scenes()[2];
    let buffered = Buffered::of_file(path);
    let half = Denoiser::builder().strength(0.5).build().expect("the processor is there");
    let whole = Denoiser::builder().build().expect("the processor is there");
    let [half, whole] = [&half, &whole].map(|d| buffered.frame(d).filter().expect("it runs"));
    let colors = half.colors().as_flattened().iter().zip(whole.colors().as_flattened());
    for ((half, whole), noisy) in colors.zip(buffered.color()) {
        assert_eq!(*half, noisy + 0.5 * (whole - noisy));
    }
}

#[test]
fn every_back_end_takes_frames_in_memory() {
    let buffered = Buffered::of_file(&scenes()[0]);
    let on = |choice| {
        let denoiser = Denoiser::builder().backend(choice).build()?;
        buffered.frame(&denoiser).filter().map(|pixels| pixels.colors().to_vec())
    };
    let expected = on(Choice::Interp).expect("always there");
    for choice in [Choice::default(), Choice::Auto, Choice::Gpu] {
        match on(choice) {
            Ok(colors) if choice == Choice::default() => assert!(colors == expected),
            Ok(colors) => {
                let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-3 * (1.0 + b.abs());
                let (a, b) = (colors.as_flattened(), expected.as_flattened());
                assert!(a.iter().zip(b).all(close), "{choice:?}");
            }
            // There may be no GPU here.
            Err(error) => {
                assert!(choice == Choice::Gpu, "{choice:?}: {error}");
                let DenoiseError::Backend(error) = error else { panic!("{error}") };
                assert!(!BackendError::is_stop(&error));
            }
        }
    }
}
