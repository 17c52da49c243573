//! Exact results as a back end: what the weights mean, and their sums, in f64.

use rayon::prelude::*;

use super::meaning::Images;
use super::oracle;
use crate::backend::{ACCURACY, color_at, tell};
use crate::backend::{Agreement, Backend, BackendError, Executable, Filtered, Rect, Watch, inside};
use crate::expr::Tree;
use crate::filter::{Filter, Gather};
use crate::plan::Plan;
use crate::scene::Scene;

/// The [`oracle`] as a back end. Only the last step rounds to `f32`, so that colours are
/// within half a unit in the last place of what f64 gives. It looks at the plan's
/// weights as they were given, evaluates them node by node, and takes hundreds of
/// times as long as machine code.
#[derive(Clone, Copy, Debug)]
pub struct Exact;

impl Backend for Exact {
    fn name(&self) -> &'static str {
        "exact"
    }

    fn agreement(&self) -> Agreement {
        Agreement::Budget(ACCURACY)
    }

    fn compile(&self, plan: &Plan) -> Result<Box<dyn Executable>, BackendError> {
        Ok(match plan {
            Plan::Window(plan) => {
                let stage = |weight: &Tree| Gather::of_color(weight.clone(), plan.window());
                Box::new(Meaning { stages: plan.expressions().iter().map(stage).collect() })
            }
            Plan::Program(program) => {
                let (filter, results) = (program.filter.clone(), program.results.clone());
                Box::new(Whole { filter, results })
            }
        })
    }
}

/// A program's exact meaning.
struct Whole {
    filter: Filter,
    /// The stages that give results.
    results: Vec<u16>,
}

impl Executable for Whole {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        inside(scene, region)?;
        let checked = self.filter.check().expect("only filters that make sense are scheduled");
        let required = checked.required();
        let lacking = required.named().into_iter().flatten().find(|p| scene.plane(**p).is_none());
        if let Some(&plane) = lacking {
            return Err(BackendError::NotLoaded(plane));
        }
        // A pixel hangs on all those around it, so that a part takes as long as the whole.
        let (images, gathers) = Images::of(scene, &checked, self.filter.stages.len());
        let width = scene.layout().width();
        let inside = |rect: &Rect, [x, y]: [usize; 2]| {
            (rect.x..rect.x + rect.width).contains(&x)
                && (rect.y..rect.y + rect.height).contains(&y)
        };
        let mut kept = vec![0; self.filter.stages.len()];
        for gather in &gathers {
            let grid = self.filter.stages[gather.stage].grid;
            let (columns, step) = (grid.along(width), grid.step());
            for (k, _) in gather.sums.iter().enumerate().filter(|(_, sums)| !sums.is_trusted()) {
                let at = [k % columns, k / columns].map(|n| n * step);
                kept[gather.stage] += region.iter().filter(|rect| inside(rect, at)).count();
            }
        }
        let pictures = self.results.iter().map(|&stage| {
            let exact = images.pixels(stage);
            let rows = region.iter().flat_map(|&rect| {
                (rect.y..rect.y + rect.height).map(move |y| (y * width + rect.x, rect.width))
            });
            let pixels = rows.flat_map(|(start, width)| &exact[start..start + width]);
            let pixels = pixels.map(|pixel| pixel.color.map(|c| c as f32)).collect();
            Filtered { pixels, kept: kept.clone() }
        });
        let pictures = pictures.collect();
        tell(watch, rows_of(region))?;
        Ok(pictures)
    }
}

struct Meaning {
    stages: Vec<Gather>,
}

impl Executable for Meaning {
    fn run_watched(
        &self,
        scene: &Scene,
        region: &[Rect],
        watch: &Watch<'_>,
    ) -> Result<Vec<Filtered>, BackendError> {
        inside(scene, region)?;
        for stage in &self.stages {
            if let Some(&plane) = stage.weight.planes().iter().find(|&&p| scene.plane(p).is_none())
            {
                return Err(BackendError::NotLoaded(plane));
            }
        }
        let filtered = self.stages.iter().map(|stage| filter(scene, stage, region)).collect();
        tell(watch, rows_of(region))?;
        Ok(filtered)
    }
}

fn rows_of(region: &[Rect]) -> usize {
    region.iter().map(|rect| rect.height).sum()
}

fn filter(scene: &Scene, stage: &Gather, region: &[Rect]) -> Filtered {
    let rows: Vec<Rect> = region
        .iter()
        .flat_map(|&rect| (0..rect.height).map(move |k| Rect { y: rect.y + k, height: 1, ..rect }))
        .collect();
    let filtered: Vec<(Vec<[f32; 3]>, usize)> = rows
        .par_iter()
        .map(|&row| {
            let mut kept = 0;
            let exact = oracle::filter(scene, stage, row);
            let colors = exact.iter().zip(row.x..).map(|(exact, x)| {
                trusted(exact).unwrap_or_else(|| {
                    kept += 1;
                    color_at(scene, x, row.y)
                })
            });
            (colors.collect(), kept)
        })
        .collect();
    let kept = filtered.iter().map(|(_, kept)| kept).sum();
    let pixels = filtered.into_iter().flat_map(|(colors, _)| colors).collect();
    Filtered { pixels, kept: vec![kept] }
}

/// The pixel's colour, unless the guard keeps the noisy one.
fn trusted(exact: &oracle::ExactGather) -> Option<[f32; 3]> {
    let trusted = exact.sums().is_trusted() && exact.color.iter().all(|c| c.is_finite());
    trusted.then(|| exact.color.map(|c| c as f32))
}
