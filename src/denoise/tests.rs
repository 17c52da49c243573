//! Parts against the whole.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use super::*;
use crate::backend::Interpreter;
use crate::filter::{Window, shipped};
use crate::scene::Repair;

fn galley() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test/galley/4spp.exr")
}

fn denoised(filter: &Filter, max_memory: Option<u64>) -> Denoised {
    let options = Options { filter: Some(filter.clone()), max_memory, ..Options::default() };
    let denoiser = Denoiser::new(Arc::new(Interpreter), options);
    denoiser.denoise(&galley()).expect("a file of ours has every feature")
}

#[test]
fn an_image_that_does_not_fit_in_memory_gets_the_bits_of_one_that_does() {
    let single = "exp(-distance2(pixel, pixel)) * exp(-distanceMax(worldPosition, worldPosition))";
    let single = Filter::single("single", single.parse().expect("a weight"), 2);
    // Weights that vanish: pixels keep their colour, and each is counted once.
    let none = Filter::single("none", "1 / 1e17 / 1e17".parse().expect("a weight"), 2);
    let filters = shipped::programs().chain([single, none]);
    for filter in filters {
        let whole = denoised(&filter, None);
        let pixels = whole.image().size().0 * whole.image().size().1;
        let parts = denoised(&filter, Some(SpilledScene::least(pixels)));
        assert!(parts.image().rgb() == whole.image().rgb(), "{}", filter.name);
        assert_eq!(parts.pictures[0].notes, whole.pictures[0].notes);
        assert_eq!(parts.pictures[0].applied.kept, whole.pictures[0].applied.kept);
        if filter.name == "none" {
            assert!(parts.pictures[0].applied.kept[0] > pixels / 2);
        }
    }
}

#[test]
fn too_little_memory_is_an_error_that_says_how_much_is_needed() {
    let filter = shipped::programs().next().expect("one ships");
    let options = Options { filter: Some(filter), max_memory: Some(1), ..Options::default() };
    let error = Denoiser::new(Arc::new(Interpreter), options).denoise(&galley()).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("galley") && text.contains("MiB of memory at least"), "{text}");
}

#[test]
fn spilled_scenes_are_mended_like_others() {
    let load = LoadOptions { repair: Repair::Error, ..LoadOptions::default() };
    let window = Window::dense(1);
    let filter = Filter::single("mean", "1".parse().expect("a weight"), window.radius);
    for max_memory in [None, Some(1 << 24)] {
        let filter = Some(filter.clone());
        let options = Options { filter, load, max_memory, ..Options::default() };
        let denoised = Denoiser::new(Arc::new(Interpreter), options).denoise(&galley());
        assert!(denoised.is_ok(), "nothing in it needs repair");
    }
}

fn galley_pixels() -> usize {
    let target = Target::of(&galley()).expect("a file of ours");
    target.window().expect("it has a colour").pixels()
}

/// Whoever watches is told of every row once, whole frames and parts alike, and before all is done.
#[test]
fn a_watch_is_told_how_far_the_filtering_is() {
    let single = Filter::single("mean", "1".parse().expect("a weight"), 2);
    let program = shipped::programs().next().expect("one ships");
    for filter in [single, program] {
        let is_program = filter.paper().is_none();
        for max_memory in [None, Some(SpilledScene::least(galley_pixels()))] {
            let filter = Some(filter.clone());
            let options = Options { filter, max_memory, ..Options::default() };
            let denoiser = Denoiser::new(Arc::new(Interpreter), options);
            let frame = denoiser.load(&galley(), &[]).expect("a file of ours");
            let told = Mutex::new(Vec::new());
            let watch = |done, of| {
                told.lock().expect("nobody panics").push((done, of));
                ControlFlow::Continue(())
            };
            let denoised = denoiser.filter_watched(frame, &watch).expect("it has every feature");
            let height = denoised.image().size().1;
            let mut told = told.into_inner().expect("nobody panics");
            told.sort_unstable();
            assert!(told.windows(2).all(|pair| pair[0].0 < pair[1].0), "each row once: {told:?}");
            assert_eq!(told.last(), Some(&(height, height)));
            assert!(told.iter().all(|&(_, of)| of == height));
            // Windows that are mirrored are done in strips of many rows.
            assert!(!is_program || told[0].0 <= height / 4, "{told:?}");
        }
    }
}
