//! Pixels that are no numbers.
//!
//! Renderers leave NaN and infinities behind, and one of them in a sum spoils
//! every pixel whose window reaches it. They are found on load, before anything
//! is derived, in every channel that is read, and by default replaced by the
//! median of the finite samples around them: never a new value, so no bad pixel
//! reaches further than its own window. Values beyond ±1e18, the limit of what
//! expressions compute with, count as bad too. What looks wrong but is a number is
//! counted and kept: see [`defect`](super::defect).
//!
//! **What one bad pixel changes.** A repaired image *is* the image with a sample of the
//! pixel's neighbours in its place, bit for bit, whatever the bad value was. So
//!
//! - *outside* of the windows that reach it, and one pixel around them (gradients and
//!   estimated variances are made of neighbours), no bit changes, unless a scale of the
//!   whole scene does: exposure, centre and extent are quantiles, which one sample moves
//!   by no more than one rank, to the next value in the image;
//! - *inside*, where weights are not negative, every result stays between the least and
//!   the greatest of the good colours in its window and next to the bad pixel; and if
//!   the colour is bad and the weight does not look at it, it changes by no more than the
//!   repaired colour differs from the true one.
//!
//! `tests/bad_pixels.rs` holds filters to that. The one exception is +Inf in a depth,
//! which says that nothing was hit.

use super::defect::Tally;
use crate::image::is_good;

/// What to do with bad pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Repair {
    /// Replace each by the lower median of the good samples in the smallest
    /// window (3x3, 5x5, 9x9, …) that has one; by zero if there is none at all.
    #[default]
    Median,
    /// Refuse the image.
    Error,
    /// Leave them. A pixel whose window reaches one in the colour keeps its noisy
    /// colour, as no mean is finite there; the bad pixel stays bad. (A finite one beyond
    /// ±1e18 outshines its window instead.) A bad feature makes weights in its window
    /// arbitrary, but none of the results non-finite. Elsewhere nothing changes but
    /// roundings, as a plan knows no range of such a plane.
    None,
}

/// Counts the bad samples of a channel; `None` if there are none.
pub fn find(samples: &[f32]) -> Option<Tally> {
    Tally::of(samples, |x| !is_good(x))
}

/// Replaces bad samples as [`Repair::Median`] says. Only samples that were good
/// to begin with are looked at, so the order of repairs does not matter.
///
/// `samples` are rows of `width`.
pub fn by_median(samples: &mut [f32], width: usize) {
    let bad: Vec<usize> = (0..samples.len()).filter(|&i| !is_good(samples[i])).collect();
    let repaired: Vec<f32> = bad.iter().map(|&i| median_around(samples, width, i)).collect();
    for (i, value) in bad.into_iter().zip(repaired) {
        samples[i] = value;
    }
}

fn median_around(samples: &[f32], width: usize, position: usize) -> f32 {
    let height = samples.len() / width;
    let (x, y) = (position % width, position / width);
    let mut radius = 1;
    let mut good = Vec::new();
    loop {
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(width);
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
        for row in rows {
            let line = &samples[row * width..(row + 1) * width];
            good.extend(line[columns.clone()].iter().copied().filter(|&x| is_good(x)));
        }
        if !good.is_empty() {
            let middle = (good.len() - 1) / 2;
            return *good.select_nth_unstable_by(middle, f32::total_cmp).1;
        }
        if radius >= width.max(height) {
            return 0.0;
        }
        radius *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_samples_become_the_median_of_their_good_neighbours() {
        let inf = f32::INFINITY;
        #[rustfmt::skip]
        let mut image = [
            1.0, 2.0, 3.0,
            4.0, inf, -5.0,
            f32::NAN, 2e18, 9.0,
        ];
        assert_eq!(find(&image), Some(Tally { count: 3, first: vec![4, 6, 7] }));
        by_median(&mut image, 3);
        // Around the middle: -5 1 2 3 4 9, lower median 2; its bad neighbours
        // take no part, and are not fed by it.
        assert_eq!(image, [1.0, 2.0, 3.0, 4.0, 2.0, -5.0, 4.0, 4.0, 9.0]);
        assert_eq!(find(&image), None);
    }

    #[test]
    fn the_window_grows_until_something_good_is_in_it() {
        let mut row = [f32::NAN; 40];
        row[39] = 7.0;
        by_median(&mut row, 40);
        assert_eq!(row, [7.0; 40]);
        let mut hopeless = [f32::NAN; 4];
        by_median(&mut hopeless, 2);
        assert_eq!(hopeless, [0.0; 4]);
    }

    #[test]
    fn negative_and_subnormal_samples_are_good() {
        assert_eq!(find(&[-3.0, f32::MIN_POSITIVE / 4.0, -0.0, 1e18, -1e18]), None);
    }
}
