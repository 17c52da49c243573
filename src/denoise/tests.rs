//! Parts against the whole.

use std::path::Path;

use super::*;
use crate::backend::Interpreter;
use crate::filter::{Window, shipped};
use crate::scene::Repair;

fn galley() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test/galley/4spp.exr")
}

fn denoised(filter: &Filter, max_memory: Option<u64>) -> Denoised {
    let options = Options { filter: Some(filter.clone()), max_memory, ..Options::default() };
    let denoiser = Denoiser::new(&Interpreter, options);
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
    let error = Denoiser::new(&Interpreter, options).denoise(&galley()).unwrap_err();
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
        let denoised = Denoiser::new(&Interpreter, options).denoise(&galley());
        assert!(denoised.is_ok(), "nothing in it needs repair");
    }
}
