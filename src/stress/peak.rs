//! The greatest of some pixels' figures, and where it was met.

use serde::Serialize;

/// A greatest figure; 0 if there is no pixel that counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Peak {
    /// The figure, never negative nor NaN. Infinite ones are null in JSON.
    pub value: f64,
    /// Column of the first pixel that has it.
    pub x: usize,
    /// Its row.
    pub y: usize,
}

impl Peak {
    /// The greatest of pixels' figures, given with their places row by row.
    pub(super) fn of(figures: impl IntoIterator<Item = (usize, f64)>, width: usize) -> Self {
        let greater = |peak: Self, (k, value): (usize, f64)| match value > peak.value {
            true => Self { value, x: k % width, y: k / width },
            false => peak,
        };
        figures.into_iter().fold(Self::default(), greater)
    }
}

/// How much a colour changed: the greatest difference of a channel, relative to the
/// greatest channel, or to `darkest` if that is more. A colour that is no number has
/// changed infinitely.
pub(super) fn change(before: [f32; 3], after: [f32; 3], darkest: f64) -> f64 {
    let scale = before.iter().map(|&c| f64::from(c.abs())).fold(darkest, f64::max);
    let channels = before.iter().zip(&after);
    let differences = channels.map(|(&a, &b)| (f64::from(a) - f64::from(b)).abs() / scale);
    differences.fold(0.0, |most, d| if d.is_nan() { f64::INFINITY } else { most.max(d) })
}
