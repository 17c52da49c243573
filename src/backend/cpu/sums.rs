//! Sums over windows, as CPU back ends make them: what is summed, over which taps, and how
//! pairs that are computed once reach both of their ends.

use std::borrow::Cow;

use crate::backend::{BackendError, Rect};
use crate::expr::PlaneId;
use crate::plan::{PairLoop, Run, WindowPlan};
use crate::scene::plane::{Layout, Lines};

/// How the sums over a window are made.
pub(super) struct Sums {
    pub(super) reach: usize,
    pub(super) runs: Vec<Run>,
    per_tap: usize,
    /// Sums per pixel.
    pub(super) results: usize,
    pub(super) mirrored: bool,
}

/// What the rows of a mirrored sum owe to those below that have not been computed yet.
#[derive(Default)]
pub(super) struct Owed {
    /// As many rows of sums as the window reaches, or none before the first strip.
    rows: Vec<f32>,
}

/// How a strip's sums lie in their buffer: `results` runs of `stride` values
/// per row, of which those from `first` on belong to the strip's pixels.
#[derive(Clone, Copy)]
pub(super) struct SumShape {
    pub(super) results: usize,
    pub(super) stride: usize,
    pub(super) first: usize,
}

/// All that the pair tape reads of a scene.
pub(super) struct Frame<'a> {
    pub(super) layout: Layout,
    /// What is averaged, and one: zero outside of the image.
    pub(super) channels: Vec<&'a [f32]>,
    /// Sources of the planes that the pair tape reads, by plane.
    pub(super) planes: Vec<(PlaneId, Cow<'a, [f32]>)>,
    /// Of a program: the planes that the pair tape reads as signals.
    pub(super) signals: Vec<&'a [f32]>,
    /// The pixel tape's results, each a padded plane.
    pub(super) per_pixel: Vec<Lines>,
    /// The tap tape's results: those of the first tap, then of the second, …
    pub(super) per_tap: Vec<f32>,
}

impl Frame<'_> {
    /// The padded samples of a plane.
    pub(super) fn plane(&self, plane: PlaneId) -> &[f32] {
        let found = self.planes.iter().find(|(id, _)| *id == plane);
        &found.expect("gather() took every plane of the plan").1
    }
}

/// Taps to sum over, with what the tap tape gave for them.
#[derive(Clone, Copy)]
pub(super) struct Taps<'a> {
    pub(super) runs: &'a [Run],
    /// Values of the first tap, then of the second, …
    pub(super) values: &'a [f32],
    /// Values of each.
    pub(super) per_tap: usize,
}

/// What a thread keeps from one strip to the next.
#[derive(Default)]
pub(super) struct Scratch<S> {
    summer: S,
    sums: Vec<f32>,
    /// What the row at hand owes to those below, run by run.
    owed: Vec<f32>,
    /// Sums that nobody asked for.
    waste: Vec<f32>,
}

impl<S> Scratch<S> {
    /// The sums that were made last.
    pub(super) fn sums(&self) -> &[f32] {
        &self.sums
    }
}

/// Makes the sums of some pixels.
pub(super) trait Summer: Sync {
    /// Memory that a thread keeps from one strip to the next.
    type Scratch: Default + Send;

    /// Pixels that it handles at a time: rows of sums are whole multiples of it.
    fn step(&self) -> usize;

    /// For every row of the rectangle, every weight and every channel, adds
    /// Σ w·channel over the taps to `sums`; then, if the plan is signed, Σ |w|.
    ///
    /// If the plan is mirrored the rectangle is a single row, and for every run,
    /// weight and channel the terms of w(j, i) with the channel at i are added to
    /// `owed`, in rows padded like those of the planes.
    fn add(
        &self,
        frame: &Frame<'_>,
        taps: Taps<'_>,
        rect: Rect,
        scratch: &mut Self::Scratch,
        sums: &mut [f32],
        owed: &mut [f32],
    ) -> Result<(), BackendError>;
}

impl Sums {
    /// How the sums of a plan are made, by the taps of its tapes.
    pub(super) fn of_plan(plan: &WindowPlan) -> Self {
        let mirrored = plan.mirrored().is_some();
        let tapes = plan.mirrored().unwrap_or(plan.tapes());
        Self {
            reach: plan.support().reach() as usize,
            runs: if mirrored { plan.taps().half() } else { plan.taps().runs() }.to_vec(),
            per_tap: tapes.tap.results().len(),
            results: plan.weights() * (plan.channels() + usize::from(plan.signed())),
            mirrored,
        }
    }

    /// How so many sums of a program's loop over pairs are made.
    pub(super) fn of_pairs(pairs: &PairLoop, results: usize) -> Self {
        Self {
            reach: pairs.reach,
            runs: pairs.runs.clone(),
            per_tap: pairs.tap.results().len(),
            results,
            mirrored: pairs.mirrored,
        }
    }

    /// Sums per pixel.
    pub(super) fn results(&self) -> usize {
        self.results
    }

    /// The sums of a strip, to be found in the scratch memory. `per_tap` is what the tap
    /// tape gives; `owed` is what the strip above it owes to it, if that was computed
    /// before, and then what it owes to the strip below.
    pub(super) fn add<S: Summer>(
        &self,
        summer: &S,
        frame: &Frame<'_>,
        per_tap: &[f32],
        strip: Rect,
        owed: Option<&mut Owed>,
        scratch: &mut Scratch<S::Scratch>,
    ) -> Result<SumShape, BackendError> {
        match self.mirrored {
            true => self.sum_mirrored(summer, frame, per_tap, strip, owed, scratch),
            false => self.sum(summer, frame, per_tap, strip, scratch),
        }
    }

    /// The sums of a strip over all taps.
    fn sum<S: Summer>(
        &self,
        summer: &S,
        frame: &Frame<'_>,
        per_tap: &[f32],
        strip: Rect,
        scratch: &mut Scratch<S::Scratch>,
    ) -> Result<SumShape, BackendError> {
        let results = self.results;
        let stride = strip.width.next_multiple_of(summer.step());
        let Scratch { summer: memory, sums, .. } = scratch;
        clear(sums, strip.height * results * stride);
        let taps = Taps { runs: &self.runs, values: per_tap, per_tap: self.per_tap };
        summer.add(frame, taps, strip, memory, sums, &mut [])?;
        Ok(SumShape { results, stride, first: 0 })
    }

    /// The same, with every pair of pixels computed once.
    ///
    /// Row by row from the top, each row is summed over its half of the window,
    /// and what it owes to the rows below is added there: so a row has got all
    /// that the rows above it owe when its own turn comes, in the order of
    /// [`crate::plan::Taps`]. Rows above the strip, and columns beside it, are
    /// computed for what they owe to it alone, unless the strip above was computed before.
    fn sum_mirrored<S: Summer>(
        &self,
        summer: &S,
        frame: &Frame<'_>,
        values: &[f32],
        strip: Rect,
        mut carried: Option<&mut Owed>,
        scratch: &mut Scratch<S::Scratch>,
    ) -> Result<SumShape, BackendError> {
        let (layout, results) = (frame.layout, self.results);
        let left = strip.x.saturating_sub(self.reach);
        let right = (strip.x + strip.width + self.reach).min(layout.width());
        let stride = (right - left).next_multiple_of(summer.step());
        let row_of_sums = results * stride;
        let Scratch { summer: memory, sums, owed, waste } = scratch;
        // Rows below the strip, for what they are owed.
        let below = if carried.is_some() { self.reach } else { 0 };
        clear(sums, (strip.height + below) * row_of_sums);
        clear(owed, self.runs.len() * results * layout.stride());
        clear(waste, row_of_sums);
        let per_tap = self.per_tap;
        let mut top = strip.y.saturating_sub(self.reach);
        if let Some(Owed { rows }) = carried.as_deref_mut().filter(|owed| !owed.rows.is_empty()) {
            sums[..rows.len()].copy_from_slice(rows);
            top = strip.y;
        }
        let bottom = strip.y + strip.height;
        for y in top..bottom {
            // Of a row above the strip, the nearest runs end before it.
            let short = |run: &&Run| y + (run.dy as usize) < strip.y;
            let (skipped, skipped_taps) = self
                .runs
                .iter()
                .take_while(short)
                .fold((0, 0), |(runs, taps), run| (runs + 1, taps + run.count as usize));
            let taps = Taps {
                runs: &self.runs[skipped..],
                values: &values[skipped_taps * per_tap..],
                per_tap,
            };
            let own = match y.checked_sub(strip.y) {
                Some(row) => &mut sums[row * row_of_sums..][..row_of_sums],
                None => waste.as_mut_slice(),
            };
            let owed = &mut owed[..taps.runs.len() * results * layout.stride()];
            let rect = Rect { x: left, y, width: right - left, height: 1 };
            summer.add(frame, taps, rect, memory, own, owed)?;
            for (run, owed) in
                taps.runs.iter().zip(owed.chunks_exact_mut(results * layout.stride()))
            {
                let target = y + run.dy as usize;
                // What a pixel owes to itself it has got.
                if target < bottom + below && !run.is_center() {
                    let sums = &mut sums[(target - strip.y) * row_of_sums..][..row_of_sums];
                    let rows = owed.chunks_exact(layout.stride());
                    for (sums, owed) in sums.chunks_exact_mut(stride).zip(rows) {
                        let owed = &owed[layout.pad() + left..layout.pad() + right];
                        for (sum, owed) in sums.iter_mut().zip(owed) {
                            *sum += owed;
                        }
                    }
                }
                owed.fill(0.0);
            }
        }
        if let Some(owed) = carried {
            owed.rows.clear();
            owed.rows.extend_from_slice(&sums[strip.height * row_of_sums..]);
        }
        Ok(SumShape { results, stride, first: strip.x - left })
    }
}

/// Makes a buffer as long as given, and zero.
fn clear(buffer: &mut Vec<f32>, length: usize) {
    buffer.clear();
    buffer.resize(length, 0.0);
}
