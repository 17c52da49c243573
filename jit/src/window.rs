//! What a kernel computes: a windowed weighted sum, and its loop nest.
//!
//! The window is a list of [`Run`](crate::Run)s, taps side by side in one row. For
//! output pixel i, every weight k and every channel c, a kernel adds to the sums
//! that it is given:
//!
//! ```text
//! for run in runs that lie inside the image, in their order
//!     p[k][c] = +0.0
//!     for tap in the run, in its order                  j = i + (dx, dy)
//!         p[k][c] = fma(w_k(i, j), channel_c[j], p[k][c])
//!     S[k][c] = S[k][c] + p[k][c]
//! ```
//!
//! The order is part of the promise: a pixel's sums have the same bits whatever
//! rectangle, chunk or number of chains it is computed in. Summing run by run
//! also keeps the rounding error near that of one run.
//!
//! Runs outside the image are left out; columns outside it are cut off by data:
//! channels are padded with zeros there, so that the terms vanish without masks.
//! One channel is usually the constant 1, whose sum is the sum of the weights.
//!
//! Who needs w(i, j) for all i and j needs w(j, i) too, and the two share most of
//! their work, if they are not the same number. A *mirrored* kernel's body returns
//! both, and it is given one half of the window only
//! ([`WindowSpec::mirrored`]).

use crate::error::CompileError;
use crate::lanes::{Body, Lanes, Side};

/// The fixed numbers of a kernel, known when it is compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct WindowSpec {
    /// Planes in all. The first `channels` of them are summed; every one can be
    /// read by the body.
    pub planes: usize,
    /// Uniform values per tap.
    pub taps: usize,
    /// Channels to sum, at least one.
    pub channels: usize,
    /// Weights that the body returns, at least one: a batch of filters over the
    /// same window.
    pub weights: usize,
    /// Whether to sum |w_k| × the last channel as well. With the constant 1 as
    /// last channel this is the sum of |w_k|, which tells how much cancelled.
    pub absolute: bool,
    /// Whether the last weight and the last channel are summed with each other alone,
    /// every other weight with every other channel. With a weight's square as last weight
    /// and a variance as last channel this is the variance of a weighted mean.
    pub lone: bool,
    /// Whether every tap counts for both of its ends. The body then returns
    /// w_k(i, j) for every k and after them w_k(j, i) for every k, and every tap
    /// also adds
    ///
    /// ```text
    /// M[run][k][c][j] = fma(w_k(j, i), channel_c[i], M[run][k][c][j])
    /// ```
    ///
    /// to the mirrored sums of its run, which are a row of them for the row that
    /// the run's taps lie in ([`MirrorShape`](crate::MirrorShape)). If its taps go
    /// from right to left, pixel j gets its terms in the order of i's column,
    /// whatever the chunks are: of two sources in different chunks the left one
    /// comes first because its chunk does, of two in one chunk because its tap
    /// does. With pixels beyond the image zero in all channels, a whole row of
    /// pixels i leaves in M just what their weights owe to row j.
    pub mirrored: bool,
}

impl WindowSpec {
    /// The most planes, tap values or results that a kernel takes.
    pub const LIMIT: usize = 1 << 12;

    /// Sums per output pixel: weights × channels, with the absolute sums.
    pub fn results(&self) -> usize {
        let [weights, channels] = self.common();
        let sums = weights.saturating_mul(channels.saturating_add(usize::from(self.absolute)));
        sums.saturating_add(usize::from(self.lone))
    }

    /// How many weights and channels are summed each with each.
    fn common(&self) -> [usize; 2] {
        [self.weights, self.channels].map(|n| n.saturating_sub(usize::from(self.lone)))
    }

    /// Whether this weight is the last one, for the last channel alone.
    fn is_lone(&self, weight: usize) -> bool {
        self.lone && weight + 1 == self.weights
    }

    /// The number of the sum S\[weight\]\[channel\] among a pixel's results.
    ///
    /// The sum of |w| counts as the channel after the last that is summed with every weight;
    /// a [`lone`](Self::lone) weight has one sum, whatever the channel.
    pub fn result(&self, weight: usize, channel: usize) -> usize {
        let [_, channels] = self.common();
        let channel = if self.is_lone(weight) { 0 } else { channel };
        weight * (channels + usize::from(self.absolute)) + channel
    }

    /// How many values the body returns.
    pub(crate) fn returned(&self) -> usize {
        self.weights * (1 + usize::from(self.mirrored))
    }

    /// Refuses a kernel without results or beyond [`LIMIT`](Self::LIMIT).
    pub(crate) fn check(&self) -> Result<(), CompileError> {
        let ranges = [
            ("planes", self.planes, 1),
            ("tap values", self.taps, 0),
            ("weights × channels", self.results(), 1),
            ("weights", self.weights, 2 * usize::from(self.lone)),
            ("channels", self.channels, 2 * usize::from(self.lone)),
        ];
        for (what, value, least) in ranges {
            if !(least..=Self::LIMIT).contains(&value) {
                return Err(CompileError::Spec { what, value });
            }
        }
        if !(1..=self.planes).contains(&self.channels) {
            return Err(CompileError::Channels { channels: self.channels, planes: self.planes });
        }
        Ok(())
    }
}

/// What the loop nest needs from a code generator besides straight-line code.
///
/// Loops are emitted, not run: each closure is called once. Inside a loop the
/// generator keeps its cursors ([`Call`](crate::call::Call)) on the pixel, the
/// neighbour and the tap at hand, so that [`Lanes`] reads from there.
pub(crate) trait Nest: Lanes {
    /// Loops over the chunks of the row of output pixels.
    fn for_chunks(&mut self, body: impl FnOnce(&mut Self));

    /// Loops over the runs of taps.
    fn for_runs(&mut self, body: impl FnOnce(&mut Self));

    /// Loops over the taps of a run, with the run's partials starting at +0.0.
    fn for_taps(&mut self, body: impl FnOnce(&mut Self));

    /// Adds `channel` × `weight` to partial number `index`, rounding once.
    fn accumulate(&mut self, index: usize, channel: Self::F, weight: Self::F);

    /// Adds `channel` × `weight` to the neighbour's mirrored sum number `index`,
    /// rounding once.
    fn accumulate_mirrored(&mut self, index: usize, channel: Self::F, weight: Self::F);

    /// The partial number `index`, after the loop over the taps of a run.
    fn partial(&mut self, index: usize) -> Self::F;

    /// Adds to result number `index` of the chunk at hand.
    fn add_to_result(&mut self, index: usize, value: Self::F);
}

/// Emits the whole nest around `body`.
///
/// Sums live in the output: they are touched once per run of taps. Where the
/// partials live is the code generator's choice.
pub(crate) fn emit<N: Nest, B: Body>(
    nest: &mut N,
    spec: &WindowSpec,
    body: &B,
) -> Result<(), CompileError> {
    let expected = spec.returned();
    let mut found = expected;
    nest.for_chunks(|nest| {
        nest.for_runs(|nest| {
            nest.for_taps(|nest| {
                let weights = body.emit(nest);
                found = weights.len();
                // A wrong number of weights is reported below.
                if found == expected {
                    let (there, back) = weights.split_at(spec.weights);
                    add_tap(nest, spec, Side::J, there, N::accumulate);
                    if spec.mirrored {
                        add_tap(nest, spec, Side::I, back, N::accumulate_mirrored);
                    }
                }
            });
            for index in 0..spec.results() {
                let partial = nest.partial(index);
                nest.add_to_result(index, partial);
            }
        });
    });
    if found == expected { Ok(()) } else { Err(CompileError::Weights { expected, found }) }
}

/// Adds one tap to all channels of all weights.
///
/// Each channel is loaded once, right before its use: loaded all together, the
/// channels would push partials out of the registers.
fn add_tap<N: Nest>(
    nest: &mut N,
    spec: &WindowSpec,
    side: Side,
    weights: &[N::F],
    mut accumulate: impl FnMut(&mut N, usize, N::F, N::F),
) {
    let [_, common] = spec.common();
    for c in 0..spec.channels {
        let channel = nest.plane(c, side);
        for (k, &weight) in weights.iter().enumerate() {
            if spec.is_lone(k) != (c >= common) {
                continue;
            }
            accumulate(nest, spec.result(k, c), channel, weight);
            if spec.absolute && c + 1 == common {
                let size = nest.abs(weight);
                accumulate(nest, spec.result(k, common), channel, size);
            }
        }
    }
}
