//! The exact meaning of a program, in f64: what back ends are held to.
//!
//! No schedule, no kernel and no tape is involved: every stage is computed at every pixel
//! of the image, by the meanings of the operator table.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::oracle::neighbours;
use crate::backend::{TRUSTED_SHARE, TRUSTED_SUM};
use crate::expr::builder::LIMIT;
use crate::expr::evaluate::Evaluator;
use crate::expr::feature::{Feature, PlaneId};
use crate::expr::symbol::{Place, Source, StagePlane};
use crate::expr::tape::Side;
use crate::expr::tree::Tree;
use crate::filter::{Checked, Gather, Grid, Resolved, StageKind};
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
        let grid = stage.grid;
        let components = match &stage.kind {
            StageKind::Map(value) => images.map(value, grid),
            StageKind::Gather(gather) => images.gather(gather, grid),
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
    fn size(&self, grid: Grid) -> [usize; 2] {
        [self.scene.layout().width(), self.scene.layout().height()].map(|n| grid.along(n))
    }

    /// A plane's value at a pixel of a grid, which may lie beside the image.
    fn read(&self, source: Source, grid: Grid, at: [i64; 2]) -> f64 {
        let size = self.size(grid);
        let [x, y] = [0, 1].map(|axis| at[axis].clamp(0, size[axis] as i64 - 1) as usize);
        let own = match source {
            Source::Stage(plane) => self.filter.filter().stages[usize::from(plane.stage)].grid,
            Source::Feature(_) => Grid::Full,
        };
        let end = self.size(own).map(|n| n as i64 - 1);
        let at = |x: i64, y: i64| self.pixel(source, x.clamp(0, end[0]), y.clamp(0, end[1]));
        let [x, y] = [x as i64, y as i64];
        match (own, grid) {
            (Grid::Full, Grid::Full) | (Grid::Half, Grid::Half) => at(x, y),
            (Grid::Full, Grid::Half) => match source {
                // The middle of two pixels, also where there is one.
                Source::Feature(PlaneId { feature: Feature::Pixel, component, .. }) => {
                    2.0 * [x, y + self.scene.top() as i64 / 2][usize::from(component)] as f64 + 0.5
                }
                Source::Feature(_) | Source::Stage(_) => {
                    let corners = [[0, 0], [1, 0], [0, 1], [1, 1]];
                    corners.map(|[dx, dy]| at(2 * x + dx, 2 * y + dy)).iter().sum::<f64>() / 4.0
                }
            },
            (Grid::Half, Grid::Full) => {
                // The nearest pixel, and the next one to that side.
                let along = |x: i64| {
                    let other = if x % 2 == 0 { x / 2 - 1 } else { x / 2 + 1 };
                    [(x / 2, 0.75), (other, 0.25)]
                };
                let mut value = 0.0;
                for (y, v) in along(y) {
                    for (x, u) in along(x) {
                        value += u * v * at(x, y);
                    }
                }
                value
            }
        }
    }

    /// A plane's value at a pixel of its own grid.
    fn pixel(&self, source: Source, x: i64, y: i64) -> f64 {
        let (x, y) = (x as usize, y as usize);
        match source {
            Source::Stage(plane) => {
                let grid = self.filter.filter().stages[usize::from(plane.stage)].grid;
                self.planes[&plane][y * self.size(grid)[0] + x]
            }
            Source::Feature(plane) => match (plane.feature, plane.component) {
                (Feature::Pixel, 0) => x as f64,
                (Feature::Pixel, _) => (self.scene.top() + y) as f64,
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
    fn map(&self, value: &Tree, grid: Grid) -> Vec<Vec<f64>> {
        let [width, height] = self.size(grid);
        let rows = (0..height).into_par_iter().map(|y| {
            let mut row = vec![Vec::with_capacity(width); value.width()];
            let mut evaluator = Evaluator::new(value, true, &self.filter.filter().constants);
            for x in 0..width {
                let at = |source, place| {
                    let [dx, dy] = match place {
                        Place::Side(_) => [0, 0],
                        Place::Shift(dx, dy) => [i64::from(dx), i64::from(dy)],
                    };
                    self.read(source, grid, [x as i64 + dx, y as i64 + dy])
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
    fn gather(&self, gather: &Gather, grid: Grid) -> Vec<Vec<f64>> {
        let [width, height] = self.size(grid);
        let of = self.map(&gather.of, grid);
        let variance = gather.variance.as_ref();
        let variance = variance.map(|variance| self.map(variance, grid).swap_remove(0));
        let count = of.len() + usize::from(variance.is_some());
        let rows = (0..height).into_par_iter().map(|y| {
            let constants = &self.filter.filter().constants;
            let mut evaluator = Evaluator::new(&gather.weight, false, constants);
            let mut row = vec![Vec::with_capacity(width); count];
            for x in 0..width {
                let mut sums = vec![0.0; count];
                let (mut total, mut magnitude) = (0.0, 0.0);
                for [u, v] in neighbours([width, height], gather.window, [x, y]) {
                    let weight = evaluator.run(|source, place| match place {
                        Place::Side(Side::I) => self.read(source, grid, [x as i64, y as i64]),
                        Place::Side(Side::J) => self.read(source, grid, [u as i64, v as i64]),
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
