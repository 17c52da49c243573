//! The exact meaning of a program, in f64: what back ends are held to.
//!
//! No schedule, no kernel and no tape is involved: every stage is computed at every pixel
//! of the image, by the meanings of the operator table.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::oracle::neighbours;
use super::{TRUSTED_SHARE, TRUSTED_SUM};
use crate::expr::builder::LIMIT;
use crate::expr::evaluate::Evaluator;
use crate::expr::feature::Feature;
use crate::expr::tape::Side;
use crate::expr::tree::{Place, Source, StagePlane, Tree};
use crate::filter::{Checked, Gather, Resolved, StageKind};
use crate::scene::{Facts, Scene};

/// The images of the stages so far.
struct Images<'a> {
    filter: &'a Checked<'a>,
    scene: &'a Scene,
    facts: Facts,
    planes: BTreeMap<StagePlane, Vec<f64>>,
}

/// The filtered colour of every pixel, row by row, in the units of the file.
///
/// # Panics
/// If the scene was loaded without a plane that the filter needs.
pub fn program(scene: &Scene, filter: &Checked<'_>) -> Vec<[f64; 3]> {
    let facts = Facts::of(scene);
    let mut images = Images { filter, scene, facts, planes: BTreeMap::new() };
    let stages = &filter.filter().stages;
    for (k, stage) in stages.iter().enumerate() {
        let components = match &stage.kind {
            StageKind::Map(value) => images.map(value),
            StageKind::Gather(gather) => images.gather(gather),
        };
        let planes = (0..).map(|component| StagePlane { stage: k as u16, component });
        images.planes.extend(planes.zip(components));
    }
    let last = stages.len() as u16 - 1;
    let result = |component| &images.planes[&StagePlane { stage: last, component }];
    let exposure = f64::from(scene.normalization().exposure);
    let [r, g, b] = [result(0), result(1), result(2)];
    (0..r.len()).map(|k| [r[k], g[k], b[k]].map(|x| x * exposure)).collect()
}

impl Images<'_> {
    fn size(&self) -> (usize, usize) {
        (self.scene.layout().width(), self.scene.layout().height())
    }

    /// A plane's value at a pixel, which may lie beside the image.
    fn read(&self, source: Source, x: i64, y: i64) -> f64 {
        let (width, height) = self.size();
        let x = x.clamp(0, width as i64 - 1) as usize;
        let y = y.clamp(0, height as i64 - 1) as usize;
        match source {
            Source::Stage(plane) => self.planes[&plane][y * width + x],
            Source::Feature(plane) => match (plane.feature, plane.component) {
                (Feature::Pixel, 0) => x as f64,
                (Feature::Pixel, _) => y as f64,
                _ => match self.filter.resolve(plane, &self.facts) {
                    Some(Resolved::Plane(plane)) => {
                        f64::from(self.scene.plane(plane).expect("it is loaded").at(x, y))
                    }
                    Some(Resolved::Constant(value)) => f64::from(value),
                    None => panic!("the scene was loaded without `{plane}`"),
                },
            },
        }
    }

    /// A formula at every pixel, component by component.
    fn map(&self, value: &Tree) -> Vec<Vec<f64>> {
        let (width, height) = self.size();
        let rows = (0..height).into_par_iter().map(|y| {
            let mut row = vec![Vec::with_capacity(width); value.width()];
            let mut evaluator = Evaluator::new(value, true, &self.filter.filter().constants);
            for x in 0..width {
                let at = |source, place| {
                    let [dx, dy] = match place {
                        Place::Side(_) => [0, 0],
                        Place::Shift(dx, dy) => [i64::from(dx), i64::from(dy)],
                    };
                    self.read(source, x as i64 + dx, y as i64 + dy)
                };
                for (component, &x) in row.iter_mut().zip(evaluator.run(at)) {
                    component.push(x);
                }
            }
            row
        });
        stacked(rows.collect(), value.width())
    }

    /// A weighted mean at every pixel, component by component, and its variance.
    fn gather(&self, gather: &Gather) -> Vec<Vec<f64>> {
        let (width, height) = self.size();
        let of = self.map(&gather.of);
        let variance = gather.variance.as_ref().map(|variance| self.map(variance).swap_remove(0));
        let count = of.len() + usize::from(variance.is_some());
        let rows = (0..height).into_par_iter().map(|y| {
            let constants = &self.filter.filter().constants;
            let mut evaluator = Evaluator::new(&gather.weight, false, constants);
            let mut row = vec![Vec::with_capacity(width); count];
            for x in 0..width {
                let mut sums = vec![0.0; count];
                let (mut total, mut magnitude) = (0.0, 0.0);
                for (u, v) in neighbours(self.scene, gather.window, x, y) {
                    let weight = evaluator.run(|source, place| match place {
                        Place::Side(Side::I) => self.read(source, x as i64, y as i64),
                        Place::Side(Side::J) => self.read(source, u as i64, v as i64),
                        Place::Shift(..) => unreachable!("weights look at i and j alone"),
                    })[0];
                    let at = v * width + u;
                    for (sum, of) in sums.iter_mut().zip(&of) {
                        *sum += weight * of[at];
                    }
                    if let Some(variance) = &variance {
                        let limit = f64::from(LIMIT);
                        sums[of.len()] += (weight * weight).min(limit) * variance[at];
                    }
                    total += weight;
                    magnitude += weight.abs();
                }
                let trusted =
                    total.abs() >= f64::from(TRUSTED_SUM).max(f64::from(TRUSTED_SHARE) * magnitude);
                for (k, component) in row.iter_mut().enumerate() {
                    let own = of.get(k).or(variance.as_ref()).expect("one of the two");
                    component.push(match (trusted, k < of.len()) {
                        (false, _) => own[y * width + x],
                        (true, true) => sums[k] / total,
                        (true, false) => sums[k] / (total * total),
                    });
                }
            }
            row
        });
        stacked(rows.collect(), count)
    }
}

/// Rows of components as whole images of components.
fn stacked(rows: Vec<Vec<Vec<f64>>>, components: usize) -> Vec<Vec<f64>> {
    (0..components).map(|k| rows.iter().flat_map(|row| row[k].iter().copied()).collect()).collect()
}
