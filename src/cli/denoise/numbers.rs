//! Numbers of frames, as `--frames` names them: `1-240`, `1-240x2`, `1-10,20,30-40x5`.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// The most frames that can be named: more are a slip of the keyboard.
const MOST: u64 = 1_000_000;

/// A set of numbers, each once and in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Numbers(BTreeSet<u64>);

impl Numbers {
    pub(super) fn contains(&self, number: u64) -> bool {
        self.0.contains(&number)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = u64> {
        self.0.iter().copied()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The same as text, neighbours as ranges: `3, 7-9`.
    pub(super) fn listing(&self) -> String {
        let mut runs: Vec<RangeInclusive<u64>> = Vec::new();
        for number in self.iter() {
            match runs.last_mut() {
                Some(run) if run.end() + 1 == number => *run = *run.start()..=number,
                Some(_) | None => runs.push(number..=number),
            }
        }
        let text = |run: &RangeInclusive<u64>| match run.start() == run.end() {
            true => run.start().to_string(),
            false => format!("{}-{}", run.start(), run.end()),
        };
        runs.iter().map(text).collect::<Vec<String>>().join(", ")
    }
}

impl FromIterator<u64> for Numbers {
    fn from_iter<I: IntoIterator<Item = u64>>(numbers: I) -> Self {
        Self(numbers.into_iter().collect())
    }
}

impl FromStr for Numbers {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut numbers = BTreeSet::new();
        for part in text.split(',') {
            let (first, last, step) = range(part.trim()).ok_or_else(|| {
                format!("`{part}` is no frame and no range of frames such as 7, 1-240 or 1-240x2")
            })?;
            if last < first {
                return Err(format!("`{part}` ends before it begins"));
            }
            if (last - first) / step >= MOST {
                return Err(format!("`{part}` names more than {MOST} frames"));
            }
            numbers.extend((0..=(last - first) / step).map(|k| first + k * step));
        }
        Ok(Self(numbers))
    }
}

/// The first and the last number of a range, and its step, which is not 0.
fn range(text: &str) -> Option<(u64, u64, u64)> {
    let (ends, step) = match text.split_once('x') {
        Some((ends, step)) => (ends, number(step).filter(|&step| step > 0)?),
        None => (text, 1),
    };
    match ends.split_once('-') {
        Some((first, last)) => Some((number(first)?, number(last)?, step)),
        None if step == 1 => number(ends).map(|only| (only, only, 1)),
        None => None,
    }
}

fn number(text: &str) -> Option<u64> {
    // Parsing alone takes a sign.
    text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_and_ranges_are_read() {
        for (text, expected) in [
            ("7", &[7][..]),
            ("0001-4", &[1, 2, 3, 4]),
            ("1-8x3", &[1, 4, 7]),
            ("9,1-2, 20-30x10", &[1, 2, 9, 20, 30]),
            ("5,5,4-6", &[4, 5, 6]),
            ("18446744073709551615", &[u64::MAX]),
        ] {
            let numbers: Numbers = text.parse().expect(text);
            assert_eq!(numbers.iter().collect::<Vec<_>>(), expected, "{text}");
        }
    }

    #[test]
    fn what_is_no_range_is_named() {
        for text in ["", "a", "1-", "-3", "1-5x0", "1-5x", "4x2", "1,,2", "+3", "1-2-3", "9-1"] {
            let error = text.parse::<Numbers>().expect_err(text);
            assert!(error.contains('`'), "{text}: {error}");
        }
        assert!("1-100000000000".parse::<Numbers>().is_err_and(|error| error.contains("more")));
        assert!("1-1000000".parse::<Numbers>().is_ok());
    }

    #[test]
    fn neighbours_are_listed_as_ranges() {
        let listing = |numbers: &[u64]| numbers.iter().copied().collect::<Numbers>().listing();
        assert_eq!(listing(&[9, 3, 7, 8, 20]), "3, 7-9, 20");
        assert_eq!(listing(&[]), "");
    }
}
