//! Shares of a sequence, one per machine.

use std::fmt;
use std::str::FromStr;

/// The k-th of n interleaved shares. Interleaved, because neighbouring frames take as long
/// as each other: consecutive blocks would not be done at the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shard {
    /// From 1.
    index: usize,
    of: usize,
}

impl Shard {
    /// Whether the frame at a position of the whole sequence is in this share.
    pub(super) fn has(self, position: usize) -> bool {
        position % self.of == self.index - 1
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

impl FromStr for Shard {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const MEANT: &str = "it must be a share and their number, such as 3/16";
        let (index, of) = text.split_once('/').ok_or(MEANT)?;
        let [index, of] = [index, of].map(str::parse::<usize>);
        let (index, of) = (index.map_err(|_| MEANT)?, of.map_err(|_| MEANT)?);
        match (1..=of).contains(&index) {
            true => Ok(Self { index, of }),
            false => Err("shares are counted from 1 to their number"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_is_in_one_share() {
        let shares = ["1/3", "2/3", "3/3"].map(|text| text.parse::<Shard>().expect(text));
        for frame in 0..10 {
            assert_eq!(shares.iter().filter(|share| share.has(frame)).count(), 1, "{frame}");
        }
        assert_eq!((0..10).filter(|&k| shares[1].has(k)).collect::<Vec<_>>(), [1, 4, 7]);
    }

    #[test]
    fn what_is_no_share_is_refused() {
        for text in ["0/4", "5/4", "x", "1", "1/", "/2", "1/0", "-1/3", "1/2/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
