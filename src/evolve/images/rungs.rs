//! The pixels that a race looks at first.
//!
//! A scene's pixels are cut into tiles, and the tiles are put in an order every
//! prefix of which is spread over the image. A rung is such a prefix in each
//! scene; a longer one contains a shorter one. What is estimated is the *difference*
//! of two expressions' errors: they fail in the same places, so that differences
//! scatter far less than errors do.

use rand::RngExt;

use super::sample::{Sample, mean};
use super::{TrainingScene, coverage};
use crate::backend::Rect;
use crate::tune::stream;

/// An expression's mean error on each tile, scene by scene, in the order of the
/// rungs.
pub(super) type TileErrors = Vec<Vec<f64>>;

/// What a rung adds to the one before: tiles of each scene.
pub(super) struct Rung {
    pub(super) samples: Vec<Sample>,
}

/// The rungs, and what the whole is.
pub(super) struct Ladder {
    pub(super) rungs: Vec<Rung>,
    /// Tiles of each scene, rungs or no.
    tiles: Vec<usize>,
}

/// Fewer tiles of a scene say nothing about how they scatter.
const LEAST: usize = 2;

impl Ladder {
    /// Rungs of these shares of the samples' pixels. A rung that adds nothing to
    /// the one before is left out.
    pub(super) fn new(
        scenes: &[TrainingScene],
        samples: &[Sample],
        shares: &[f64],
        seed: u64,
    ) -> Self {
        let orders: Vec<Vec<Rect>> =
            samples.iter().enumerate().map(|(k, sample)| order(sample.region(), seed, k)).collect();
        let mut seen = vec![0; scenes.len()];
        let mut rungs = Vec::new();
        for share in shares {
            let upto = |order: &Vec<Rect>| {
                ((order.len() as f64 * share).round() as usize).max(LEAST).min(order.len())
            };
            let ends: Vec<usize> = orders.iter().map(upto).collect();
            if ends.iter().zip(&seen).all(|(end, seen)| end <= seen) {
                continue;
            }
            let new = scenes.iter().zip(&orders).zip(seen.iter().zip(&ends));
            let samples = new
                .map(|((scene, order), (&seen, &end))| {
                    Sample::new(scene, order[seen..end.max(seen)].to_vec())
                })
                .collect();
            rungs.push(Rung { samples });
            seen = ends.iter().zip(&seen).map(|(&end, &seen)| end.max(seen)).collect();
        }
        Self { rungs, tiles: orders.iter().map(Vec::len).collect() }
    }

    /// Pixels of the first so many rungs.
    pub(super) fn pixels(&self, rungs: usize) -> usize {
        self.rungs[..rungs].iter().flat_map(|rung| &rung.samples).map(Sample::pixels).sum()
    }

    /// The tiles' errors in all rungs, from those of all pixels of the samples.
    pub(super) fn read(&self, scene: usize, whole: &Sample, errors: &[f64]) -> Vec<f64> {
        let tiles = self.rungs.iter().flat_map(|rung| rung.samples[scene].region());
        tiles.map(|&tile| mean(&whole.within(tile, errors))).collect()
    }

    /// By how much the first expression's error exceeds the second's, judging by
    /// the tiles that both have: the estimate and its standard error.
    ///
    /// A stratified sample from a finite whole: each scene is a stratum, and
    /// the part of it that has been seen adds no doubt.
    pub(super) fn excess(&self, errors: &TileErrors, bar: &TileErrors) -> (f64, f64) {
        let (mut excess, mut variance) = (0.0, 0.0);
        for ((errors, bar), &tiles) in errors.iter().zip(bar).zip(&self.tiles) {
            let differences: Vec<f64> = errors.iter().zip(bar).map(|(x, y)| x - y).collect();
            let count = differences.len() as f64;
            let middle = mean(&differences);
            let squares: f64 = differences.iter().map(|d| (d - middle).powi(2)).sum();
            excess += middle;
            variance += squares / (count - 1.0).max(1.0) / count * (1.0 - count / tiles as f64);
        }
        (excess, variance.sqrt())
    }
}

/// The tiles of a sample, in an order every prefix of which is spread out.
///
/// Tiles come in rounds, one of each column; over the rounds a column's tiles
/// follow a van der Corput sequence down the image, and the columns are shifted
/// against each other.
fn order(region: &[Rect], seed: u64, scene: usize) -> Vec<Rect> {
    let mut columns: Vec<Vec<Rect>> = Vec::new();
    let mut tiles: Vec<Rect> = region.iter().flat_map(|&rect| coverage::cut(rect)).collect();
    tiles.sort_by_key(|tile| (tile.x, tile.y));
    for tile in tiles {
        match columns.last_mut() {
            Some(column) if column[0].x == tile.x => column.push(tile),
            _ => columns.push(vec![tile]),
        }
    }
    // A stream that no individual and no coverage has.
    let mut stream = stream(seed, usize::MAX - 1, scene as u32, 0);
    let shift: f64 = stream.random_range(0.0..1.0);
    for (k, column) in columns.iter_mut().enumerate() {
        // Golden sections put any number of columns far apart.
        let shift = shift + k as f64 * 0.618_033_988_749_895;
        let mut left: Vec<Option<Rect>> = column.iter().copied().map(Some).collect();
        let places = (0..).map(|round| {
            let place = (van_der_corput(round) + shift).fract();
            (place * left.len() as f64) as usize
        });
        let places: Vec<usize> = places.take(4 * left.len()).collect();
        let mut spread: Vec<Rect> = places.iter().filter_map(|&at| left[at].take()).collect();
        spread.extend(left.into_iter().flatten());
        *column = spread;
    }
    let rounds = columns.iter().map(Vec::len).max().unwrap_or(0);
    (0..rounds)
        .flat_map(|round| columns.iter().filter_map(move |c| c.get(round).copied()))
        .collect()
}

/// Bits mirrored at the point: 0, 1/2, 1/4, 3/4, 1/8, …
fn van_der_corput(n: u32) -> f64 {
    f64::from(n.reverse_bits()) / 2f64.powi(32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_van_der_corput_sequence_halves_the_gaps() {
        let start: Vec<f64> = (0..5).map(van_der_corput).collect();
        assert_eq!(start, [0.0, 0.5, 0.25, 0.75, 0.125]);
    }

    #[test]
    fn an_order_holds_every_tile_once_and_its_prefixes_are_spread() {
        for (width, height) in [(256, 256), (337, 191), (5, 3), (64, 1)] {
            let whole = Rect { x: 0, y: 0, width, height };
            let tiles: Vec<Rect> = coverage::cut(whole).collect();
            let order = order(&[whole], 3, 1);
            let sorted = |mut list: Vec<Rect>| {
                list.sort();
                list
            };
            assert_eq!(sorted(order.clone()), sorted(tiles));
            if order.len() < 64 {
                continue;
            }
            // A sixteenth of the tiles, and every quarter of the image has its share.
            let prefix = &order[..order.len() / 16];
            for quarter in 0..4 {
                let rows = quarter * height / 4..(quarter + 1) * height / 4;
                let count = prefix.iter().filter(|tile| rows.contains(&tile.y)).count();
                let expected = prefix.len() as f64 / 4.0;
                assert!((count as f64 / expected - 1.0).abs() < 0.5, "{count} of {expected}");
            }
        }
    }
}
