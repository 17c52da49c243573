//! Any bytes as an EXR file: `inspect` and `denoise` come to an end with an image of
//! finite colours, or with an error that names the file.
#![no_main]

use std::path::Path;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use tamis::backend::{Backend, Interpreter, Rect};
use tamis::expr::Tree;
use tamis::filter::Window;
use tamis::plan::{Passes, Plan};
use tamis::scene::inspect::Inspection;
use tamis::scene::{Facts, LoadOptions, Needs, Scene, SceneError};
use tempfile::TempDir;

const PAD: usize = 2;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a folder"));

static WEIGHT: LazyLock<Tree> = LazyLock::new(|| {
    "exp(-distance2(color, color) - distance2(pixel, pixel))".parse().expect("an expression")
});

fn filtered(path: &Path) -> Result<Vec<[f32; 3]>, SceneError> {
    let inspection = Inspection::of(path)?;
    inspection.scan()?;
    let scene = Scene::load(path, &Needs::everything(), PAD, &LoadOptions::default())?;
    let weights = std::slice::from_ref(&*WEIGHT);
    let window = Window::dense(PAD as u32);
    let plan = Plan::new(weights, window, &Facts::of(&scene), Passes::ALL).expect("a plan");
    let code = Interpreter.compile(&plan).expect("always possible");
    let filtered = code.run(&scene, &[Rect::whole(&scene)]).expect("every scene has colours");
    Ok(filtered.into_iter().flat_map(|filtered| filtered.pixels).collect())
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
    }
);
