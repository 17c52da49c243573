//! Stands in for the fitness on scenes until that lands.

use crate::backend::{Backend, BackendError, Rect};
use crate::evolve::{Fitness, Settings};
use crate::expr::Tree;
use crate::plan::{Passes, Plan, Window};
use crate::scene::metric::rel_mse;
use crate::scene::{Facts, Image, Scene};

pub(super) struct SceneFitness<'a> {
    scenes: Vec<(Scene, Image)>,
    backend: &'a dyn Backend,
    window: Window,
}

impl<'a> SceneFitness<'a> {
    pub(super) fn new(
        scenes: Vec<(Scene, Image)>,
        backend: &'a dyn Backend,
        settings: &Settings,
    ) -> Self {
        Self { scenes, backend, window: Window::dense(settings.radius) }
    }
}

impl Fitness for SceneFitness<'_> {
    type Error = BackendError;

    fn evaluate(&self, trees: &[Tree]) -> Result<Vec<f64>, BackendError> {
        let one = |tree: &Tree| -> Result<f64, BackendError> {
            let mut sum = 0.0;
            for (scene, reference) in &self.scenes {
                let facts = Facts::of(scene);
                let weights = std::slice::from_ref(tree);
                let Ok(plan) = Plan::new(weights, self.window, &facts, Passes::ALL) else {
                    return Ok(f64::INFINITY);
                };
                let code = self.backend.compile(&plan)?;
                let filtered = code.run(scene, &[Rect::whole(scene)])?;
                let rgb: [Vec<f32>; 3] =
                    [0, 1, 2].map(|c| filtered[0].pixels.iter().map(|p| p[c]).collect());
                sum += rel_mse(rgb.each_ref().map(Vec::as_slice), reference.rgb());
            }
            Ok(sum)
        };
        trees.iter().map(one).collect()
    }

    fn identity(&self) -> String {
        self.scenes.iter().map(|(scene, _)| scene.name()).collect::<Vec<_>>().join(", ")
    }
}
