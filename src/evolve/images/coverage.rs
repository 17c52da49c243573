//! Which pixels of the training scenes breeding looks at.

use rand::RngExt;

use crate::backend::Rect;
use crate::evolve::settings::Settings;
use crate::tune::stream;

/// Which pixels of the training scenes breeding looks at.
///
/// The image is divided into equal cells, and each cell gives one tile at a
/// place within it that is drawn once for the whole run: stratified sampling,
/// the same for every expression, so that expressions are compared on the same
/// pixels and a fitness can be remembered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coverage {
    /// All of them.
    Full,
    /// About this share of them, in tiles whose places `seed` names.
    Share {
        /// Between 0 and 1.
        share: f64,
        /// Names the places.
        seed: u64,
    },
}

/// Tiles are wide and low: vector code works along rows.
const TILE: (usize, usize) = (64, 2);

impl Coverage {
    /// The coverage that settings ask for.
    pub fn of(settings: &Settings) -> Self {
        if settings.share < 1.0 {
            Self::Share { share: settings.share, seed: settings.seed }
        } else {
            Self::Full
        }
    }

    /// The rectangles of one scene, which is the `scene`-th.
    pub(super) fn region(self, whole: Rect, scene: usize) -> Vec<Rect> {
        match self {
            Self::Full => vec![whole],
            Self::Share { share, seed } => tiles(whole, share, seed, scene),
        }
    }
}

/// A rectangle in tiles.
pub(super) fn cut(rect: Rect) -> impl Iterator<Item = Rect> {
    let (tile_width, tile_height) = TILE;
    let columns = rect.width.div_ceil(tile_width).max(1);
    (0..rect.height).step_by(tile_height).flat_map(move |y| {
        let height = tile_height.min(rect.height - y);
        (0..columns).map(move |column| {
            let x = column * rect.width / columns..(column + 1) * rect.width / columns;
            Rect { x: rect.x + x.start, y: rect.y + y, width: x.len(), height }
        })
    })
}

/// One tile in each cell of a regular grid over the image.
fn tiles(whole: Rect, share: f64, seed: u64, scene: usize) -> Vec<Rect> {
    let (tile_width, tile_height) = TILE;
    // Tiles span their cell's columns; which of its rows, is drawn.
    let columns = whole.width.div_ceil(tile_width).max(1);
    let bands = (whole.height as f64 * share / tile_height as f64).round() as usize;
    let bands = bands.clamp(1, whole.height.div_ceil(tile_height).max(1));
    let mut tiles = Vec::with_capacity(columns * bands);
    for band in 0..bands {
        let rows = band * whole.height / bands..(band + 1) * whole.height / bands;
        for column in 0..columns {
            let x = column * whole.width / columns..(column + 1) * whole.width / columns;
            let height = tile_height.min(rows.len());
            // A stream that no individual has: islands are numbered from zero.
            let mut stream = stream(seed, usize::MAX, scene as u32, tiles.len());
            let y = rows.start + stream.random_range(0..=rows.len() - height);
            tiles.push(Rect { x: x.start, y, width: x.len(), height });
        }
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_share_asked_for_and_stay_in_their_cells() {
        for (width, height, share) in [(256, 256, 0.1), (337, 191, 0.05), (5, 3, 0.5), (64, 1, 1.0)]
        {
            let whole = Rect { x: 0, y: 0, width, height };
            let tiles = tiles(whole, share, 7, 0);
            let mut seen = vec![false; whole.pixels()];
            for tile in &tiles {
                for y in tile.y..tile.y + tile.height {
                    for x in tile.x..tile.x + tile.width {
                        assert!(!std::mem::replace(&mut seen[y * width + x], true), "overlap");
                    }
                }
            }
            let covered = seen.iter().filter(|&&s| s).count() as f64 / whole.pixels() as f64;
            let one_band = 2.0 / height as f64;
            assert!((covered - share).abs() <= one_band, "{covered} of {share}");
        }
    }

    #[test]
    fn every_row_can_be_drawn_and_the_draw_is_named_by_the_seed() {
        let whole = Rect { x: 0, y: 0, width: 640, height: 100 };
        assert_eq!(tiles(whole, 0.1, 7, 0), tiles(whole, 0.1, 7, 0));
        assert_ne!(tiles(whole, 0.1, 7, 0), tiles(whole, 0.1, 8, 0));
        assert_ne!(tiles(whole, 0.1, 7, 0), tiles(whole, 0.1, 7, 1));
    }
}
