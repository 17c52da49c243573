//! Filters measured on scenes.

use super::apply::{needs, reach};
use super::error::Error;
use super::log::Log;
use super::options::Running;
use crate::backend::Backend;
use crate::denoise::{Applied, Run, apply};
use crate::filter::Filter;
use crate::image::{Image, Metrics};
use crate::plan::Passes;
use crate::report::{Measured, Score, ScoreTable, Total};
use crate::scene::{LoadOptions, Needs, Scene, SceneFiles, load_reference};

/// How to measure.
pub(super) struct Measuring<'a> {
    pub(super) backend: &'a dyn Backend,
    pub(super) passes: Passes,
    pub(super) options: LoadOptions,
}

impl<'a> Measuring<'a> {
    /// As the command line says.
    pub(super) fn with(running: &Running, backend: &'a dyn Backend) -> Self {
        Self { backend, passes: running.passes(), options: running.load_options() }
    }

    /// Loads a scene with everything that these filters read and it has.
    pub(super) fn load(&self, files: &SceneFiles, filters: &[Filter]) -> Result<Scene, Error> {
        let all = filters.iter().map(needs).fold(Needs::nothing(), Needs::union);
        let pad = filters.iter().map(reach).max().unwrap_or(0);
        Ok(Scene::load(&files.noisy, &all, pad, &self.options)?)
    }

    /// Applies a filter.
    pub(super) fn apply(&self, filter: &Filter, scene: &Scene) -> Result<(Image, Applied), Error> {
        Ok(apply(filter, scene, self.backend, self.passes, Run::default())?)
    }

    /// Runs every filter on every scene. That a filter cannot run on a scene is
    /// part of the result; that a scene cannot be read is an error.
    pub(super) fn table(
        &self,
        scenes: &[SceneFiles],
        filters: &[Filter],
        total: Total,
        log: Log,
    ) -> Result<ScoreTable, Error> {
        let mut scores = Vec::with_capacity(scenes.len());
        for files in scenes {
            let scene = self.load(files, filters)?;
            let reference = load_reference(&files.reference)?;
            for note in scene.notes() {
                log.say(format_args!("{}: {note}", files.noisy.display()));
            }
            let noisy = Metrics::of(&scene.noisy(), &reference)?;
            let measured = filters.iter().map(|filter| {
                let (image, Applied { kept, filtering, .. }) =
                    self.apply(filter, &scene).map_err(|error| error.to_string())?;
                let metrics = Metrics::of(&image, &reference).map_err(|error| error.to_string())?;
                Ok(Measured { metrics, kept: kept.into_iter().sum(), time: filtering })
            });
            scores.push(Score {
                scene: files.name.clone(),
                pixels: scene.layout().pixels(),
                noisy,
                filters: measured.collect(),
            });
        }
        let names = filters.iter().map(|filter| filter.name.clone());
        Ok(ScoreTable { filters: names.collect(), scenes: scores, total })
    }
}
