//! The exact meaning of a filter on a scene, in f64: what back ends are held to.
//!
//! No schedule, no kernel and no tape is involved. What is planned as one weight is left to
//! the [`oracle`]; of a program every stage is computed at every pixel of the image, by the
//! meanings of the operator table.
//!
//! **Doubt.** Where the weights of a gather all but vanish or cancel, rounding decides
//! whether its guard acts, and where sums may overflow, so does the order of summation.
//! Nothing is promised of such a pixel, nor of any that reads it, however little of it.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::oracle::{self, DARKEST, Pixel, Sums, neighbours};
use crate::backend::{ACCURACY, Rect};
use crate::expr::builder::LIMIT;
use crate::expr::evaluate::Evaluator;
use crate::expr::feature::{Feature, PlaneId};
use crate::expr::symbol::{Place, Source, StagePlane, Symbol};
use crate::expr::tape::Side;
use crate::expr::tree::Tree;
use crate::filter::{Checked, Gather, Grid, Resolved, StageKind};
use crate::scene::{Facts, Scene};

/// What a filter means on a scene.
#[derive(Clone, Debug)]
pub struct Meaning {
    /// The filtered pixels, row by row.
    pub pixels: Vec<Pixel>,
    /// The gathers, in the order of the stages.
    pub gathers: Vec<Weighed>,
    /// Differences of colours are measured by no less than this.
    pub darkest: f64,
}

/// What the guard of a gather decides by.
#[derive(Clone, Debug)]
pub struct Weighed {
    /// The stage, counted from 0.
    pub stage: usize,
    /// By pixel of the stage's grid, row by row.
    pub sums: Vec<Sums>,
}

/// A filter's meaning on a whole scene.
///
/// # Panics
/// If the scene was loaded without a plane that the filter needs.
pub fn of(scene: &Scene, filter: &Checked<'_>) -> Meaning {
    match filter.filter().paper() {
        Some(gather) => weight(scene, gather),
        None => program(scene, filter),
    }
}

fn weight(scene: &Scene, gather: &Gather) -> Meaning {
    let (width, height) = (scene.layout().width(), scene.layout().height());
    let row = |y| oracle::filter(scene, gather, Rect { x: 0, y, width, height: 1 });
    let exact: Vec<oracle::ExactGather> = (0..height).into_par_iter().flat_map_iter(row).collect();
    let sums = exact.iter().map(oracle::ExactGather::sums).collect();
    Meaning {
        pixels: exact.iter().map(oracle::ExactGather::pixel).collect(),
        gathers: vec![Weighed { stage: 0, sums }],
        darkest: DARKEST,
    }
}

fn program(scene: &Scene, filter: &Checked<'_>) -> Meaning {
    let stages = &filter.filter().stages;
    let (images, gathers) = Images::of(scene, filter, stages.len());
    let pixels = images.pixels(stages.len() as u16 - 1);
    Meaning { pixels, gathers, darkest: f64::from(scene.normalization().exposure) }
}

/// The share of the brightest colour in its receptive field that errors of a pixel are
/// measured by at least, so that what is promised is not less than that one's last bit.
/// Weights of a far brighter pixel are small powers of e, whose roundings grow with the
/// exponent: a dark pixel that owes its colour to that one is off by more of its own.
const LEAKED: f64 = f32::EPSILON as f64 / ACCURACY;

/// Per pixel, the greatest value at most so many rows and columns away.
fn greatest_around(values: Vec<f64>, [width, height]: [usize; 2], reach: usize) -> Vec<f64> {
    let along = |values: &[f64], length: usize, step: usize, start: usize, out: &mut [f64]| {
        for k in 0..length {
            let window = k.saturating_sub(reach)..(k + reach + 1).min(length);
            out[start + k * step] =
                window.map(|j| values[start + j * step]).fold(f64::NEG_INFINITY, f64::max);
        }
    };
    let (mut rows, mut both) = (values.clone(), values.clone());
    (0..height).for_each(|y| along(&values, width, 1, y * width, &mut rows));
    (0..width).for_each(|x| along(&rows, height, width, x, &mut both));
    both
}

/// What the stages of a filter give on a scene, exactly.
pub struct Images<'a> {
    filter: &'a Checked<'a>,
    scene: &'a Scene,
    facts: Facts,
    planes: BTreeMap<StagePlane, Vec<f64>>,
    /// By stage and pixel, where nothing is promised; `None` if that is nowhere.
    doubts: Vec<Option<Vec<bool>>>,
}

impl<'a> Images<'a> {
    /// The images of a filter's first `count` stages, and what their gathers' guards decide by.
    ///
    /// # Panics
    /// If the scene was loaded without a plane that one of them needs.
    pub fn of(scene: &'a Scene, filter: &'a Checked<'a>, count: usize) -> (Self, Vec<Weighed>) {
        let facts = Facts::of(scene);
        let (planes, doubts) = (BTreeMap::new(), Vec::new());
        let mut images = Self { filter, scene, facts, planes, doubts };
        let mut gathers = Vec::new();
        for (k, stage) in filter.filter().stages.iter().enumerate().take(count) {
            let grid = stage.grid;
            let components = match &stage.kind {
                StageKind::Map(value) => {
                    images.doubts.push(images.doubt_of_map(value, grid));
                    images.map(value, grid)
                }
                StageKind::Gather(gather) => {
                    let (components, sums) = images.gather(gather, grid);
                    images.doubts.push(images.doubt_of_gather(gather, grid, &sums));
                    gathers.push(Weighed { stage: k, sums });
                    components
                }
            };
            let planes = (0..).map(|component| StagePlane { stage: k as u16, component });
            images.planes.extend(planes.zip(components));
        }
        (images, gathers)
    }

    /// What a stage gives as a colour, pixel by pixel.
    pub fn pixels(&self, stage: u16) -> Vec<Pixel> {
        let scene = self.scene;
        let result = |component| &self.planes[&StagePlane { stage, component }];
        let exposure = f64::from(scene.normalization().exposure);
        let [r, g, b] = [result(0), result(1), result(2)];
        let doubt = &self.doubts[usize::from(stage)];
        let field = self.filter.receptive_field();
        let size = [scene.layout().width(), scene.layout().height()];
        let brightest = scene.color().each_ref().map(|channel| {
            let magnitude =
                (0..size[1]).flat_map(|y| channel.pixels(y)).map(|c| f64::from(c.abs()));
            greatest_around(magnitude.collect(), size, field)
        });
        let pixel = |k: usize| Pixel {
            color: [r[k], g[k], b[k]].map(|x| x * exposure),
            condition: 1.0,
            least: brightest.each_ref().map(|channel| exposure.max(channel[k] * LEAKED)),
            promised: doubt.as_ref().is_none_or(|doubt| !doubt[k]),
        };
        (0..r.len()).map(pixel).collect()
    }

    /// Columns and rows of a grid.
    pub fn size(&self, grid: Grid) -> [usize; 2] {
        [self.scene.layout().width(), self.scene.layout().height()].map(|n| grid.along(n))
    }

    /// The pixels of a grid, each with its share, that stand for a pixel of another one,
    /// which may lie beside the image.
    fn around(&self, own: Grid, grid: Grid, at: [i64; 2], mut visit: impl FnMut([usize; 2], f64)) {
        let (size, end) = (self.size(grid), self.size(own));
        let inside = |at: i64, end: usize| at.clamp(0, end as i64 - 1);
        let [x, y] = [0, 1].map(|axis| inside(at[axis], size[axis]));
        let mut visit = |x, y, share| {
            visit([inside(x, end[0]) as usize, inside(y, end[1]) as usize], share);
        };
        match (own, grid) {
            (Grid::Full, Grid::Full) | (Grid::Half, Grid::Half) => visit(x, y, 1.0),
            (Grid::Full, Grid::Half) => {
                for [dx, dy] in [[0, 0], [1, 0], [0, 1], [1, 1]] {
                    visit(2 * x + dx, 2 * y + dy, 0.25);
                }
            }
            (Grid::Half, Grid::Full) => {
                // The nearest pixel, and the next one to that side.
                let along = |x: i64| {
                    let other = if x % 2 == 0 { x / 2 - 1 } else { x / 2 + 1 };
                    [(x / 2, 0.75), (other, 0.25)]
                };
                for (y, v) in along(y) {
                    for (x, u) in along(x) {
                        visit(x, y, u * v);
                    }
                }
            }
        }
    }

    /// A plane's value at a pixel of a grid, which may lie beside the image.
    fn read(&self, source: Source, grid: Grid, at: [i64; 2]) -> f64 {
        let own = match source {
            Source::Stage(plane) => self.filter.filter().stages[usize::from(plane.stage)].grid,
            // The middle of two pixels, also where there is one.
            Source::Feature(PlaneId { feature: Feature::Pixel, component, .. })
                if grid == Grid::Half =>
            {
                let axis = usize::from(component);
                let last = self.size(grid)[axis] as i64 - 1;
                let top = [0, self.scene.top() as i64 / 2][axis];
                return 2.0 * (top + at[axis].clamp(0, last)) as f64 + 0.5;
            }
            Source::Feature(_) => Grid::Full,
        };
        let mut value = 0.0;
        self.around(own, grid, at, |pixel, share| value += share * self.pixel(source, pixel));
        value
    }

    /// A plane's value at a pixel of its own grid.
    fn pixel(&self, source: Source, [x, y]: [usize; 2]) -> f64 {
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

    /// A formula of one pixel at every pixel, component by component.
    pub fn map(&self, value: &Tree, grid: Grid) -> Vec<Vec<f64>> {
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

    /// The weights that a gather gives the pixels around one of its grid, each with its place;
    /// pixels beside the image have none.
    pub fn weights(
        &self,
        gather: &Gather,
        grid: Grid,
        [x, y]: [usize; 2],
    ) -> Vec<([usize; 2], f64)> {
        let constants = &self.filter.filter().constants;
        let mut evaluator = Evaluator::new(&gather.weight, false, constants);
        let around = neighbours(self.size(grid), gather.window, [x, y]);
        around.map(|at| (at, self.weight(&mut evaluator, grid, [x, y], at))).collect()
    }

    /// The weight of one pixel of a grid for another.
    fn weight(
        &self,
        evaluator: &mut Evaluator<'_>,
        grid: Grid,
        i: [usize; 2],
        j: [usize; 2],
    ) -> f64 {
        let place = |at: [usize; 2]| at.map(|n| n as i64);
        evaluator.run(|source, from| match from {
            Place::Side(Side::I) => self.read(source, grid, place(i)),
            Place::Side(Side::J) => self.read(source, grid, place(j)),
            Place::Shift(..) => unreachable!("weights look at i and j alone"),
        })[0]
    }

    /// A weighted mean at every pixel, component by component, and its variance; and what
    /// its guard decides by.
    fn gather(&self, gather: &Gather, grid: Grid) -> (Vec<Vec<f64>>, Vec<Sums>) {
        let [width, height] = self.size(grid);
        let limit = f64::from(LIMIT);
        let of = self.map(&gather.of, grid);
        let variance = gather.variance.as_ref();
        let variance = variance.map(|variance| self.map(variance, grid).swap_remove(0));
        let count = of.len() + usize::from(variance.is_some());
        let rows = (0..height).into_par_iter().map(|y| {
            let constants = &self.filter.filter().constants;
            let mut evaluator = Evaluator::new(&gather.weight, false, constants);
            let mut row = vec![Vec::with_capacity(width); count];
            let mut guard = Vec::with_capacity(width);
            for x in 0..width {
                let mut sums = vec![0.0; count];
                let (mut total, mut magnitude, mut bound) = (0.0, 0.0, 0.0f64);
                for [u, v] in neighbours([width, height], gather.window, [x, y]) {
                    let weight = self.weight(&mut evaluator, grid, [x, y], [u, v]);
                    let at = v * width + u;
                    let mut greatest = weight.abs();
                    for (sum, of) in sums.iter_mut().zip(&of) {
                        *sum += weight * of[at];
                        greatest = greatest.max((weight * of[at]).abs());
                    }
                    if let Some(variance) = &variance {
                        let part = (weight * weight).min(limit) * variance[at];
                        sums[of.len()] += part;
                        greatest = greatest.max(part.abs());
                    }
                    total += weight;
                    magnitude += weight.abs();
                    bound += greatest;
                }
                let greatest = sums.iter().map(|sum| sum.abs()).fold(total.abs(), f64::max);
                let guarded = Sums { total, magnitude, greatest, bound };
                for (k, component) in row.iter_mut().enumerate() {
                    let own = of.get(k).or(variance.as_ref()).expect("one of the two");
                    component.push(match (guarded.is_trusted(), k < of.len()) {
                        (false, _) => own[y * width + x],
                        (true, true) => (sums[k] / total).clamp(-limit, limit),
                        (true, false) => (sums[k] / (total * total)).clamp(-limit, limit),
                    });
                }
                guard.push(guarded);
            }
            (row, guard)
        });
        let (rows, guards): (Vec<_>, Vec<_>) = rows.unzip();
        (stacked(rows, count), guards.concat())
    }

    /// The doubtful stages that a formula reads, each with where it is looked at.
    fn doubted(&self, tree: &Tree, map: bool) -> Vec<(usize, Place)> {
        let looks = tree.symbols().iter().zip(tree.places(map)).filter_map(|(symbol, place)| {
            let Symbol::Stage(signal) = symbol else { return None };
            let stage = usize::from(signal.stage);
            self.doubts[stage].is_some().then_some((stage, place))
        });
        let mut looks: Vec<(usize, Place)> = looks.collect();
        looks.sort_unstable();
        looks.dedup();
        looks
    }

    /// Whether nothing is promised of what a stage gives at a pixel of a grid, which may lie
    /// beside the image.
    fn is_doubtful(&self, stage: usize, grid: Grid, at: [i64; 2]) -> bool {
        let Some(doubt) = &self.doubts[stage] else { return false };
        let own = self.filter.filter().stages[stage].grid;
        let width = self.size(own)[0];
        let mut found = false;
        self.around(own, grid, at, |[x, y], _| found |= doubt[y * width + x]);
        found
    }

    /// Where a formula reads what is in doubt.
    fn doubt_of_map(&self, value: &Tree, grid: Grid) -> Option<Vec<bool>> {
        let looks = self.doubted(value, true);
        if looks.is_empty() {
            return None;
        }
        let width = self.size(grid)[0];
        let doubtful = |k: usize| {
            looks.iter().any(|&(stage, place)| {
                let [dx, dy] = match place {
                    Place::Side(_) => [0, 0],
                    Place::Shift(dx, dy) => [i64::from(dx), i64::from(dy)],
                };
                let [x, y] = [k % width, k / width].map(|n| n as i64);
                self.is_doubtful(stage, grid, [x + dx, y + dy])
            })
        };
        some_if_any((0..width * self.size(grid)[1]).map(doubtful).collect())
    }

    /// Where rounding decides about a gather, or what is in doubt is read.
    fn doubt_of_gather(&self, gather: &Gather, grid: Grid, sums: &[Sums]) -> Option<Vec<bool>> {
        let size = self.size(grid);
        let averaged = [Some(&gather.of), gather.variance.as_ref()].into_iter().flatten();
        let averaged: Vec<Vec<bool>> =
            averaged.filter_map(|tree| self.doubt_of_map(tree, grid)).collect();
        let (own, others): (Vec<_>, Vec<_>) = self
            .doubted(&gather.weight, false)
            .into_iter()
            .partition(|(_, place)| *place == Place::Side(Side::I));
        let pixel = |(k, sums): (usize, &Sums)| {
            let at = [k % size[0], k / size[0]];
            let place = at.map(|n| n as i64);
            let own = || own.iter().any(|&(stage, _)| self.is_doubtful(stage, grid, place));
            let read = |at: [usize; 2]| {
                let place = at.map(|n| n as i64);
                averaged.iter().any(|doubt| doubt[at[1] * size[0] + at[0]])
                    || others.iter().any(|&(stage, _)| self.is_doubtful(stage, grid, place))
            };
            let certain = averaged.is_empty() && others.is_empty();
            !sums.is_promised()
                || sums.may_overflow()
                || own()
                || !certain && neighbours(size, gather.window, at).any(read)
        };
        some_if_any(sums.iter().enumerate().map(pixel).collect())
    }
}

fn some_if_any(doubt: Vec<bool>) -> Option<Vec<bool>> {
    doubt.contains(&true).then_some(doubt)
}

/// Rows of components as whole images of components.
fn stacked(rows: Vec<Vec<Vec<f64>>>, components: usize) -> Vec<Vec<f64>> {
    (0..components).map(|k| rows.iter().flat_map(|row| row[k].iter().copied()).collect()).collect()
}
