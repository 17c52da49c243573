//! What a kernel computes: a windowed weighted sum, and its loop nest.
//!
//! For output pixel i, every weight k and every channel c:
//!
//! ```text
//! S[k][c] = +0.0
//! for dy in rows of the window that lie inside the image, ascending
//!     p[k][c] = +0.0
//!     for dx in columns of the window, ascending        j = i + (dx, dy)
//!         p[k][c] = fma(w_k(i, j), channel_c[j], p[k][c])
//!     S[k][c] = S[k][c] + p[k][c]
//! ```
//!
//! The order is part of the promise: a pixel's sums have the same bits whatever
//! rectangle, chunk or number of chains it is computed in. Summing row by row
//! also keeps the rounding error near that of one row.
//!
//! Rows outside the image are left out; columns outside it are cut off by data:
//! channels are padded with zeros there, so that the terms vanish without masks.
//! One channel is usually the constant 1, whose sum is the sum of the weights.

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
}

impl WindowSpec {
    /// The most planes, tap values or results that a kernel takes.
    pub const LIMIT: usize = 1 << 12;

    /// Sums per output pixel: weights × channels, with the absolute sums.
    pub fn results(&self) -> usize {
        self.weights.saturating_mul(self.channels.saturating_add(usize::from(self.absolute)))
    }

    /// The number of the sum S\[weight\]\[channel\] among a pixel's results.
    ///
    /// The sum of |w| counts as the channel after the last.
    pub fn result(&self, weight: usize, channel: usize) -> usize {
        weight * (self.channels + usize::from(self.absolute)) + channel
    }

    /// Refuses a kernel without results or beyond [`LIMIT`](Self::LIMIT).
    pub(crate) fn check(&self) -> Result<(), CompileError> {
        let ranges = [
            ("planes", self.planes, 1),
            ("tap values", self.taps, 0),
            ("weights × channels", self.results(), 1),
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

    /// Loops over the rows of taps.
    fn for_rows(&mut self, body: impl FnOnce(&mut Self));

    /// Loops over the taps of a row, with the row's partials starting at +0.0.
    fn for_columns(&mut self, body: impl FnOnce(&mut Self));

    /// Adds `channel` × `weight` to partial number `index`, rounding once.
    fn accumulate(&mut self, index: usize, channel: Self::F, weight: Self::F);

    /// The partial number `index`, after the loop over the taps of a row.
    fn partial(&mut self, index: usize) -> Self::F;

    /// Sets result number `index` of the chunk at hand.
    fn store_result(&mut self, index: usize, value: Self::F);

    /// Adds to it.
    fn add_to_result(&mut self, index: usize, value: Self::F);
}

/// Emits the whole nest around `body`.
///
/// Sums live in the output: they are touched once per row of taps. Where the
/// partials live is the code generator's choice.
pub(crate) fn emit<N: Nest, B: Body>(
    nest: &mut N,
    spec: &WindowSpec,
    body: &B,
) -> Result<(), CompileError> {
    let mut found = spec.weights;
    nest.for_chunks(|nest| {
        let zero = nest.constant(0.0);
        for index in 0..spec.results() {
            nest.store_result(index, zero);
        }
        nest.for_rows(|nest| {
            nest.for_columns(|nest| {
                let weights = body.emit(nest);
                found = weights.len();
                add_tap(nest, spec, &weights);
            });
            for index in 0..spec.results() {
                let partial = nest.partial(index);
                nest.add_to_result(index, partial);
            }
        });
    });
    if found == spec.weights {
        Ok(())
    } else {
        Err(CompileError::Weights { expected: spec.weights, found })
    }
}

/// Adds one tap to all channels of all weights.
///
/// Each channel is loaded once, right before its use: loaded all together, the
/// channels would push partials out of the registers.
fn add_tap<N: Nest>(nest: &mut N, spec: &WindowSpec, weights: &[N::F]) {
    // One weight too many is the caller's to report.
    let weights = &weights[..weights.len().min(spec.weights)];
    for c in 0..spec.channels {
        let channel = nest.plane(c, Side::J);
        for (k, &weight) in weights.iter().enumerate() {
            nest.accumulate(spec.result(k, c), channel, weight);
            if spec.absolute && c + 1 == spec.channels {
                let size = nest.abs(weight);
                nest.accumulate(spec.result(k, spec.channels), channel, size);
            }
        }
    }
}
