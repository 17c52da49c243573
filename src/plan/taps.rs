//! The taps of a window, in the order in which they are summed.
//!
//! ```text
//!   1 → → → → → →      Rows above pixel i from the top, each from left to right;
//!   2 → → → → → →      then what lies to the right of i, from the far end; i
//!   6 → → → 4 ← ← 3    itself; the rows below, each from right to left; and last
//!   5 ← ← ← ← ← ←      what lies to the left of i, from left to right.
//! ```
//!
//! The order is part of a filter's meaning in `f32`. It is this one because the
//! half of the window that comes from right to left (3, 4, 5) can be computed once
//! for both ends of every pair: what row y owes to the rows below it, pixel by
//! pixel from the left, then reaches each of them in exactly the order of 1, 2 and
//! 6. So using a weight for both of its ends changes no bit.

use crate::filter::Window;

/// Taps side by side: `count` of them, the first at (dx, dy) from pixel i, each
/// `step` columns from the one before. All in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Columns to the right of pixel i.
    pub dx: i32,
    /// Rows below pixel i.
    pub dy: i32,
    /// How many taps there are.
    pub count: u32,
    /// From one tap to the next.
    pub step: i32,
}

impl Run {
    /// The taps' offsets from pixel i, in order.
    pub fn offsets(self) -> impl Iterator<Item = [i32; 2]> {
        (0..self.count as i32).map(move |k| [self.dx + k * self.step, self.dy])
    }

    /// Whether this is pixel i itself.
    pub fn is_center(self) -> bool {
        self.dx == 0 && self.dy == 0 && self.count == 1
    }
}

/// The taps of a window that count, as runs in the order of summation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Taps {
    runs: Vec<Run>,
    /// Where the half begins and ends that is to the right of i or below.
    half: [usize; 2],
}

impl Taps {
    /// The taps within `extents`: number v is how many taps to either side of the
    /// middle count in the rows v above and v below pixel i, if any does.
    pub(super) fn new(window: Window, extents: &[Option<u32>]) -> Self {
        let dilation = window.dilation as i32;
        let run = |u: i32, v: i32, count: u32, towards: i32| Run {
            dx: u * dilation,
            dy: v * dilation,
            count,
            step: towards * dilation,
        };
        let rows = || (1i32..).zip(extents.iter().skip(1)).filter_map(|(v, &e)| Some((v, e?)));
        let mut runs: Vec<Run> = rows().map(|(v, e)| run(-(e as i32), -v, 2 * e + 1, 1)).collect();
        runs.reverse();
        let first = runs.len();
        let own = extents.first().copied().flatten();
        if let Some(e) = own {
            runs.extend((e > 0).then(|| run(e as i32, 0, e, -1)));
            runs.push(run(0, 0, 1, 1));
        }
        runs.extend(rows().map(|(v, e)| run(e as i32, v, 2 * e + 1, -1)));
        let last = runs.len();
        if let Some(e) = own.filter(|&e| e > 0) {
            runs.push(run(-(e as i32), 0, e, 1));
        }
        Self { runs, half: [first, last] }
    }

    /// All of them.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.runs.iter().map(|run| run.count as usize).sum()
    }

    /// How many taps away from the middle the farthest are, along an axis.
    pub(super) fn radius(&self, dilation: u32) -> u32 {
        let along = |run: &Run| run.dx.unsigned_abs().max(run.dy.unsigned_abs());
        self.runs.iter().map(along).max().unwrap_or(0) / dilation.max(1)
    }

    /// Pixel i itself and one of every two that lie opposite each other: to the
    /// right of i or below. From right to left, the nearest row first.
    pub fn half(&self) -> &[Run] {
        let [first, last] = self.half;
        &self.runs[first..last]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offsets(runs: &[Run]) -> Vec<[i32; 2]> {
        runs.iter().flat_map(|run| run.offsets()).collect()
    }

    #[test]
    fn the_order_is_the_one_drawn_above() {
        let taps = Taps::new(Window::dense(1), &[Some(1), Some(1)]);
        let above = [[-1, -1], [0, -1], [1, -1]];
        let half = [[1, 0], [0, 0], [1, 1], [0, 1], [-1, 1]];
        assert_eq!(offsets(taps.runs()), [&above[..], &half, &[[-1, 0]]].concat());
        assert_eq!(offsets(taps.half()), half);
    }

    #[test]
    fn a_half_and_its_mirror_image_are_the_whole_with_every_tap_once() {
        let dilated = Window { radius: 3, dilation: 4 };
        for extents in [
            vec![Some(3), Some(3), Some(3), Some(3)],
            vec![Some(3), Some(2), Some(0), None],
            vec![None, Some(1), None, Some(2)],
            vec![Some(0), None, None, None],
            vec![None; 4],
        ] {
            let taps = Taps::new(dilated, &extents);
            let mut all = offsets(taps.runs());
            let half = offsets(taps.half());
            let mirrored = half.iter().map(|[dx, dy]| [-dx, -dy]).filter(|tap| *tap != [0, 0]);
            let mut both: Vec<[i32; 2]> = half.iter().copied().chain(mirrored).collect();
            all.sort_unstable();
            both.sort_unstable();
            assert_eq!(all, both);
            let counted = extents.iter().enumerate().map(|(v, extent)| {
                extent.map_or(0, |e| (2 * e as usize + 1) * if v == 0 { 1 } else { 2 })
            });
            assert_eq!(all.len(), counted.sum::<usize>());
            assert_eq!(taps.count(), all.len());
            all.dedup();
            assert_eq!(all.len(), both.len());
        }
    }
}
