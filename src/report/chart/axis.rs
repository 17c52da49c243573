//! A logarithmic axis: where values stand, and which are written beside it.

/// The least share of a decade that an axis shows, so that equal values have a
/// place too, and some round value is among what is shown.
const LEAST: f64 = 0.5;
/// Room at both ends, as a share of the axis.
const MARGIN: f64 = 0.06;
/// Decades from which only powers of ten are written.
const MANY: f64 = 3.4;

/// An axis from `start` to `end` on the paper.
pub(super) struct Axis {
    /// Logarithms of the values at both ends.
    low: f64,
    high: f64,
    start: f64,
    end: f64,
}

impl Axis {
    /// The axis that shows positive values, with room at the ends.
    pub(super) fn over(values: impl Iterator<Item = f64>, start: f64, end: f64) -> Self {
        let ends = values.map(f64::log10).fold(None, |ends: Option<(f64, f64)>, x| {
            Some(ends.map_or((x, x), |(low, high)| (low.min(x), high.max(x))))
        });
        let (low, high) = ends.unwrap_or((0.0, 1.0));
        let lacking = (LEAST - (high - low)).max(0.0) / 2.0;
        let margin = MARGIN * (high - low).max(LEAST) + lacking;
        Self { low: low - margin, high: high + margin, start, end }
    }

    /// Where a value stands.
    pub(super) fn at(&self, value: f64) -> f64 {
        let share = (value.log10() - self.low) / (self.high - self.low);
        self.start + share * (self.end - self.start)
    }

    /// The values to write: round ones, powers of ten alone if there are many.
    pub(super) fn ticks(&self) -> impl Iterator<Item = f64> {
        let steps: &[f64] = if self.high - self.low > MANY { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let (low, high) = (self.low, self.high);
        let decades = low.floor() as i32..=high.ceil() as i32;
        let all = decades.flat_map(|decade| steps.iter().map(move |m| m * 10f64.powi(decade)));
        all.filter(move |value| (low..=high).contains(&value.log10()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_inside_and_in_order() {
        for values in [&[3.0][..], &[1e-9, 1e9], &[0.02, 0.03, 0.5]] {
            let axis = Axis::over(values.iter().copied(), 100.0, 20.0);
            let places: Vec<f64> = values.iter().map(|&value| axis.at(value)).collect();
            assert!(places.iter().all(|place| (20.0..100.0).contains(place)), "{places:?}");
            assert!(places.is_sorted_by(|a, b| a > b), "{places:?}");
            assert!(axis.ticks().count() > 0, "{values:?}");
        }
    }
}
