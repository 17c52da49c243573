//! Any bytes as a file of an image: `inspect` and `denoise` come to an end with an image of
//! finite colours, which is written as a file that can be read, or with an error that names the
//! file.
#![no_main]

use std::path::Path;
use std::sync::{Arc, LazyLock};

use libfuzzer_sys::fuzz_target;
use tamis::backend::{Backend, Interpreter, Rect};
use tamis::denoise::{DenoiseError, Denoiser, Options};
use tamis::expr::Tree;
use tamis::filter::{Filter, Window};
use tamis::image::exr::Unfinished;
use tamis::plan::{Passes, Plan};
use tamis::scene::inspect::Inspection;
use tamis::scene::{Facts, LoadOptions, Needs, Scene, SceneError, load_image};
use tempfile::TempDir;

const PAD: usize = 2;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a folder"));

static WEIGHT: LazyLock<Tree> = LazyLock::new(|| {
    "exp(-distance2(color, color) - distance2(pixel, pixel))".parse().expect("an expression")
});

fn filtered(path: &Path) -> Result<Vec<[f32; 3]>, SceneError> {
    let inspection = Inspection::of(path)?;
    inspection.scan()?;
    let load = LoadOptions { unfinished: Unfinished::Zero, ..LoadOptions::default() };
    let scene = Scene::load(path, &Needs::everything(), PAD, &load)?;
    let weights = std::slice::from_ref(&*WEIGHT);
    let window = Window::dense(PAD as u32);
    let plan = Plan::new(weights, window, &Facts::of(&scene), Passes::ALL).expect("a plan");
    let code = Interpreter.compile(&plan).expect("always possible");
    let filtered = code.run(&scene, &[Rect::whole(&scene)]).expect("every scene has colours");
    Ok(filtered.into_iter().flat_map(|filtered| filtered.pixels).collect())
}

/// Filters every picture of the file, and writes the whole of it.
fn rewritten(path: &Path) -> Result<(), DenoiseError> {
    let filter = Some(Filter::single("fuzzed", WEIGHT.clone(), PAD as u32));
    let load = LoadOptions { unfinished: Unfinished::Zero, ..LoadOptions::default() };
    let options = Options { filter, load, ..Options::default() };
    let denoised = Denoiser::new(Arc::new(Interpreter), options).denoise(path)?;
    let copy = FOLDER.path().join("fuzzed copy.exr");
    denoised.save(&copy)?;
    load_image(&copy).expect("what was written is an image");
    Ok(())
}

fuzz_target!(
    init: {
        // The decoder's panics are caught and become errors; libFuzzer's hook would end
        // the process before. A panic that nobody catches ends it all the same.
        std::panic::set_hook(Box::new(|panic| eprintln!("{panic}")));
    },
    |bytes: &[u8]| {
        let path = FOLDER.path().join("fuzzed.exr");
        std::fs::write(&path, bytes).expect("a writable folder");
        match filtered(&path) {
            Ok(pixels) => assert!(pixels.iter().flatten().all(|x| x.is_finite())),
            Err(error) => assert!(error.to_string().contains("fuzzed"), "{error}"),
        }
        if let Err(error) = rewritten(&path) {
            assert!(error.to_string().contains("fuzzed"), "{error}");
        }
    }
);
