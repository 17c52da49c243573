//! What `--timings` says.

use std::fmt;
use std::iter::Sum;
use std::time::Duration;

use crate::report::number;

/// What the steps of a frame took, or of several frames together.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Timings {
    pub(super) load: Duration,
    pub(super) plan: Duration,
    pub(super) compile: Duration,
    pub(super) filter: Duration,
    pub(super) write: Duration,
    /// Pairs of pixels in all windows, those included that passes saved.
    pub(super) pairs: usize,
}

impl Timings {
    pub(super) fn sum(&self) -> Duration {
        self.load + self.plan + self.compile + self.filter + self.write
    }
}

impl Sum for Timings {
    fn sum<I: Iterator<Item = Self>>(frames: I) -> Self {
        frames.fold(Self::default(), |all, frame| Self {
            load: all.load + frame.load,
            plan: all.plan + frame.plan,
            compile: all.compile + frame.compile,
            filter: all.filter + frame.filter,
            write: all.write + frame.write,
            pairs: all.pairs + frame.pairs,
        })
    }
}

impl fmt::Display for Timings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nanoseconds = self.filter.as_secs_f64() * 1e9 / self.pairs as f64;
        write!(
            f,
            "load {}, plan {}, compile {}, filter {} ({nanoseconds:.2} ns per pixel pair), write {}",
            number::duration(self.load),
            number::duration(self.plan),
            number::duration(self.compile),
            number::duration(self.filter),
            number::duration(self.write),
        )
    }
}

/// The last line about frames that took `wall` together, of which `start` passed
/// before the first was opened: the command line was read, and the back end opened.
/// Steps of different frames overlap: the steps' sum says how much. It is no
/// measure of work, as a step that waits for another's threads counts the time.
pub(super) fn summary(frames: &[Timings], start: Duration, wall: Duration) -> String {
    let all: Timings = frames.iter().copied().sum();
    let ratio = wall.as_secs_f64() / all.filter.as_secs_f64();
    let together = format!(
        "{} in {}, start {} of it: {ratio:.2} times the filtering",
        number::plural(frames.len(), "frame"),
        number::duration(wall),
        number::duration(start),
    );
    match frames {
        [_] => together,
        _ => format!(
            "{together}; {:.1} ms per frame; the steps add up to {}: {all}",
            wall.as_secs_f64() * 1e3 / frames.len() as f64,
            number::duration(all.sum()),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_adds_up() {
        let second = Duration::from_secs(1);
        let frame = Timings { load: second, filter: 2 * second, pairs: 1000, ..Timings::default() };
        let text = summary(&[frame, frame], second / 2, 4 * second);
        assert!(text.starts_with("2 frames in 4.00 s, start 500.0 ms of it: 1.00 times"), "{text}");
        assert!(text.contains("2000.0 ms per frame"), "{text}");
        assert!(text.contains("add up to 6.00 s: load 2.00 s, plan"), "{text}");
        assert!(text.contains("filter 4.00 s (2000000.00 ns per pixel pair)"), "{text}");
        let text = summary(&[frame], second, 4 * second);
        assert_eq!(text, "1 frame in 4.00 s, start 1.00 s of it: 2.00 times the filtering");
    }
}
