//! How long the rest of a search takes.
//!
//! Expressions grow, and with them the time that a generation takes: what the first ones took
//! says little. So the latest count.

use std::collections::VecDeque;
use std::time::Duration;

/// So many generations are the latest.
const LATEST: usize = 8;

/// What the latest generations took.
#[derive(Debug, Default)]
pub(super) struct Pace {
    latest: VecDeque<Duration>,
}

impl Pace {
    /// A generation is complete that this run formed as a whole.
    pub(super) fn add(&mut self, took: Duration) {
        self.latest.push_back(took);
        if self.latest.len() > LATEST {
            self.latest.pop_front();
        }
    }

    /// How long the rest takes: so many generations after the one that is being formed, of
    /// which this share is done and took so long.
    pub(super) fn left(&self, after: f64, share: f64, took: Duration) -> Duration {
        let share = share.clamp(1e-3, 1.0);
        let each = match self.latest.len() {
            0 => took.div_f64(share),
            count => self.latest.iter().sum::<Duration>() / count as u32,
        };
        each.mul_f64(after.max(0.0) + 1.0 - share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn the_first_generation_stands_for_all_until_it_is_complete() {
        let left = Pace::default().left(3.0, 0.5, SECOND);
        assert_eq!(left, 7 * SECOND);
    }

    #[test]
    fn generations_that_grow_are_judged_by_the_latest() {
        let mut pace = Pace::default();
        for k in 1..=100 {
            pace.add(k * SECOND);
        }
        // Those from 93 to 100 took 96.5 on average; all of them 50.5.
        assert_eq!(pace.left(10.0, 1.0, SECOND), 965 * SECOND);
        assert_eq!(
            pace.left(9.0, 0.5, 50 * SECOND),
            (96.5 * 9.5) as u32 * SECOND + 750 * SECOND / 1000
        );
    }
}
