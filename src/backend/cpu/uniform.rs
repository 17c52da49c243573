//! Pixels that need no filter: all colours in their window are one.
//!
//! Σ c·w / Σ w of equal colours c is c, whatever the weights; and where the
//! weights cannot be trusted the noisy colour stays, which is c too. So the result
//! is known without computing a weight, and known exactly. A renderer's black
//! background is like that, and so is a sky of one colour.

use std::ops::Range;

use crate::backend::Rect;
use crate::scene::Scene;
use crate::scene::plane::Samples;

/// Columns between two stretches of pixels to be computed that are not worth
/// being left out: each stretch is rounded up to whole vectors, and a mirrored one
/// also computes as many pixels beside it as its window reaches.
const GAP: usize = 64;

/// Where the colours of a scene change, so that any window can be asked.
pub(super) struct Changes {
    width: usize,
    height: usize,
    reach: usize,
    /// Pixels that differ from the next one to the right.
    rightwards: Table,
    /// Pixels that differ from the next one below.
    downwards: Table,
}

impl Changes {
    /// Looks at the scene's colours; windows reach `reach` pixels to every side.
    /// `None` if so few neighbouring pixels are alike that no window can hold one
    /// colour only.
    pub(super) fn of(scene: &Scene, reach: usize) -> Option<Self> {
        let (width, height) = (scene.layout().width(), scene.layout().height());
        let colors = scene.color().each_ref().map(Samples::as_slice);
        let differ = |a: usize, b: usize| colors.iter().any(|plane| plane[a] != plane[b]);
        let index = |x, y| scene.layout().index(x, y);
        let right = |x, y| x + 1 < width && differ(index(x, y), index(x + 1, y));
        let down = |x, y| y + 1 < height && differ(index(x, y), index(x, y + 1));
        // Every window has one row of these, with so many neighbours in it.
        let rows = (0..height).step_by(reach.max(1));
        let alike = |y| (1..width).filter(|&x| !right(x - 1, y)).count();
        if rows.map(alike).sum::<usize>() < width.saturating_sub(1).min(reach) {
            return None;
        }
        let rightwards = Table::new(width, height, right);
        let downwards = Table::new(width, height, down);
        Some(Self { width, height, reach, rightwards, downwards })
    }

    /// Whether the window of a pixel holds one colour only.
    pub(super) fn is_uniform(&self, x: usize, y: usize) -> bool {
        let [left, top] = [x, y].map(|at| at.saturating_sub(self.reach));
        let right = (x + self.reach + 1).min(self.width);
        let bottom = (y + self.reach + 1).min(self.height);
        self.rightwards.is_empty(left..right - 1, top..bottom)
            && self.downwards.is_empty(left..right, top..bottom - 1)
    }

    /// The parts of a strip that have to be computed: all of its rows, and the
    /// columns around pixels that are not uniform, from left to right.
    pub(super) fn stretches(&self, strip: Rect) -> Vec<Rect> {
        let rows = strip.y..strip.y + strip.height;
        let needed = |x: &usize| rows.clone().any(|y| !self.is_uniform(*x, y));
        let mut stretches: Vec<Rect> = Vec::new();
        for x in (strip.x..strip.x + strip.width).filter(needed) {
            match stretches.last_mut() {
                Some(last) if x <= last.x + last.width + GAP + 2 * self.reach => {
                    last.width = x + 1 - last.x;
                }
                _ => stretches.push(Rect { x, width: 1, ..strip }),
            }
        }
        stretches
    }
}

/// How many pixels of any rectangle have some property: a summed-area table, with
/// a row and a column of zeros before it (Crow, "Summed-Area Tables for Texture
/// Mapping", 1984).
struct Table {
    stride: usize,
    count: Vec<u32>,
}

impl Table {
    fn new(width: usize, height: usize, has: impl Fn(usize, usize) -> bool) -> Self {
        let stride = width + 1;
        let mut count = vec![0; stride * (height + 1)];
        for y in 0..height {
            let mut row = 0;
            for x in 0..width {
                row += u32::from(has(x, y));
                count[(y + 1) * stride + x + 1] = count[y * stride + x + 1] + row;
            }
        }
        Self { stride, count }
    }

    /// Whether no pixel in these columns and rows has it.
    fn is_empty(&self, columns: Range<usize>, rows: Range<usize>) -> bool {
        let up_to = |x: usize, y: usize| self.count[y * self.stride + x];
        up_to(columns.end, rows.end) + up_to(columns.start, rows.start)
            == up_to(columns.start, rows.end) + up_to(columns.end, rows.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{LoadOptions, Needs, RawScene};

    /// A scene of one colour, but for some pixels.
    fn scene(width: usize, height: usize, others: &[[usize; 2]]) -> Scene {
        let mut red = vec![0.25; width * height];
        for [x, y] in others {
            red[y * width + x] = 0.5;
        }
        let flat = vec![0.25; width * height];
        let raw = RawScene::new("test", width, height, [flat.clone(), red, flat]);
        raw.prepare(&Needs::nothing(), 4, &LoadOptions::default()).expect("it has a colour")
    }

    #[test]
    fn pixels_are_uniform_whose_windows_hold_one_colour() {
        for others in [vec![], vec![[0, 0]], vec![[20, 5]], vec![[39, 11], [7, 3]]] {
            let scene = scene(40, 12, &others);
            let changes = Changes::of(&scene, 3).expect("most pixels are alike");
            for (x, y) in (0..12usize).flat_map(|y| (0..40usize).map(move |x| (x, y))) {
                let near = |&[u, v]: &[usize; 2]| x.abs_diff(u) <= 3 && y.abs_diff(v) <= 3;
                let expected = !others.iter().any(near);
                assert_eq!(changes.is_uniform(x, y), expected, "({x}, {y}) near {others:?}");
            }
        }
    }

    #[test]
    fn noise_is_not_looked_into() {
        let others: Vec<[usize; 2]> = (0..12)
            .flat_map(|y| (0..40).map(move |x| [x, y]))
            .filter(|[x, y]| (x + y) % 2 == 0)
            .collect();
        assert!(Changes::of(&scene(40, 12, &others), 3).is_none());
    }

    #[test]
    fn stretches_cover_what_is_not_uniform() {
        let scene = scene(400, 12, &[[30, 5], [60, 2], [350, 6]]);
        let changes = Changes::of(&scene, 3).expect("most pixels are alike");
        let strip = Rect { x: 10, y: 4, width: 380, height: 4 };
        let stretches = changes.stretches(strip);
        let columns: Vec<_> = stretches.iter().map(|s| s.x..s.x + s.width).collect();
        assert_eq!(columns, [27..64, 347..354]);
        assert!(stretches.iter().all(|s| (s.y, s.height) == (4, 4)));
        assert!(changes.stretches(Rect { x: 100, y: 0, width: 200, height: 12 }).is_empty());
    }
}
