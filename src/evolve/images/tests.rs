//! Laws of the paper's fitness, on two of the project's own scenes.

use std::path::Path;

use super::*;
use crate::backend::{Executable, Interpreter};
use crate::evolve::materials::Materials;
use crate::evolve::mutation::mutate;
use crate::evolve::rng::stream;
use crate::evolve::settings::Preset;
use crate::plan::Plan;
use crate::scene::{LoadOptions, Needs};

const RADIUS: u32 = 3;

/// About two rows of each tile column: enough to tell expressions apart.
const COVERAGE: Coverage = Coverage::Share { share: 0.03, seed: 5 };

fn scenes() -> Vec<TrainingScene> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/train");
    let load = |name| {
        let folder = root.join(name);
        let options = LoadOptions::default();
        let noisy =
            Scene::load(&folder.join("4spp.exr"), &Needs::everything(), RADIUS as usize, &options);
        let reference = Image::load(&folder.join("reference.exr"));
        TrainingScene::new(noisy.unwrap(), reference.unwrap()).unwrap()
    };
    ["study", "meadow"].map(load).into()
}

fn fitness(backend: &dyn Backend) -> ImageFitness<'_> {
    ImageFitness::new(scenes(), Window::dense(RADIUS), COVERAGE, backend)
}

/// Bred expressions, and a brood of each that grows apart from it.
fn bred(count: usize) -> Vec<Tree> {
    let settings = Preset::Quick.settings();
    let materials = Materials::new(&settings).unwrap();
    let fixture = include_str!("../../../tests/fixture/bred.txt");
    let parents: Vec<Tree> = fixture
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.parse().unwrap())
        .collect();
    (0..count)
        .map(|k| {
            let mut rng = stream(11, 0, 0, k);
            let generations = k / parents.len();
            (0..generations).fold(parents[k % parents.len()].clone(), |tree, _| {
                mutate(&tree, &materials, &settings, &mut rng)
            })
        })
        .collect()
}

/// Every CPU back end that this build has.
fn backends() -> Vec<Box<dyn Backend>> {
    vec![
        Box::new(Interpreter),
        #[cfg(feature = "jit")]
        Box::new(crate::backend::Jit::new().unwrap()),
    ]
}

#[test]
fn company_changes_no_bit() {
    let trees = bred(300);
    let alone = fitness(&Interpreter).together(1).evaluate(&trees).unwrap();
    assert!(alone.iter().filter(|e| e.is_finite()).count() > 200);
    for backend in backends() {
        for together in [2, 7, 64] {
            let values = fitness(&*backend).together(together).evaluate(&trees).unwrap();
            for ((tree, alone), value) in trees.iter().zip(&alone).zip(values) {
                assert_eq!(value.to_bits(), alone.to_bits(), "{together} together: {tree}");
            }
        }
    }
}

/// Compiles plans of a few weights only, and none that reads depth.
struct Limited;

impl Backend for Limited {
    fn name(&self) -> &'static str {
        "limited"
    }

    fn agreement(&self) -> crate::backend::Agreement {
        crate::backend::Agreement::Bits
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        let reads_depth = plan.planes().iter().any(|p| p.feature == crate::expr::Feature::Depth);
        if reads_depth || plan.pair().results().len() > 3 {
            return Err(BackendError::Padding { reach: 1, pad: 0 });
        }
        Interpreter.compile(plan)
    }
}

#[test]
fn one_that_fails_takes_nobody_along() {
    let trees: Vec<Tree> = [
        "exp(-distance2(normal, normal))",
        "distance2(depth, depth)",
        "exp(-distance2(normal, normal) / 2)",
        "exp(-distance2(texture, texture))",
        "1",
    ]
    .map(|text| text.parse().unwrap())
    .into();
    let expected = fitness(&Interpreter).together(1).evaluate(&trees).unwrap();
    for together in [1, 2, 3, 5] {
        let mut values = fitness(&Limited).together(together).evaluate(&trees).unwrap();
        assert_eq!(std::mem::replace(&mut values[1], expected[1]), f64::INFINITY);
        assert_eq!(values, expected, "{together} together");
    }
}

#[test]
fn breeding_on_all_pixels_is_judging_in_full() {
    let trees = bred(10);
    let backend = Interpreter;
    let fitness = ImageFitness::new(scenes(), Window::dense(1), Coverage::Full, &backend);
    assert_eq!(fitness.evaluate(&trees).unwrap(), fitness.evaluate_full(&trees).unwrap());
}
