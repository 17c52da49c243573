//! Every output pixel of the test scenes, those included of which nothing is promised.

use std::path::Path;

use tamis::backend::{ACCURACY, Backend, Exact, Jit, Rect};
use tamis::filter::Window;
use tamis::plan::{Passes, Plan};
use tamis::scene::{Facts, LoadOptions, Needs, Scene};

use crate::gpu::named;

/// Cases that take minutes:
/// `cargo test --release --test conformance long -- --ignored`
pub(crate) const LONG: &[(&str, fn())] = &[("long::every_pixel", every_pixel)];

const RADIUS: u32 = 5;

/// Named and shipped filters by machine code beside what `--precision exact` gives: no
/// channel of any pixel is further off than is promised of most. Where weights all but
/// vanish that takes a guard that acts in both or in neither.
fn every_pixel() {
    let jit = Jit::new().expect("the host has a code generator");
    for name in ["courtyard", "galley", "showroom"] {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/test");
        let file = root.join(name).join("4spp.exr");
        let (needs, options) = (Needs::everything(), LoadOptions::default());
        let scene =
            Scene::load(&file, &needs, RADIUS as usize, &options).expect("the project's own scene");
        for (filter, weight) in named() {
            let facts = Facts::of(&scene);
            let plan = Plan::new(&[weight], Window::dense(RADIUS), &facts, Passes::ALL)
                .expect("the scene has every feature");
            let [exact, computed] = [&Exact as &dyn Backend, &jit].map(|backend| {
                let code = backend.compile(&plan).expect("compiles");
                code.run(&scene, &[Rect::whole(&scene)]).expect("runs").swap_remove(0).pixels
            });
            let channels = exact.as_flattened().iter().zip(computed.as_flattened());
            let off = channels
                .filter(|(exact, computed)| exact != computed)
                .map(|(&exact, &computed)| f64::from((exact - computed).abs() / exact.abs()))
                .fold(0.0, f64::max);
            println!("{filter} on {name}: every pixel within {off:.1e}");
            assert!(off <= ACCURACY, "{filter} on {name}: {off:e} from exact");
        }
    }
}
