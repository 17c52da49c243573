//! Cutting an image into tiles that fit.
//!
//! A tile is a rectangle of pixels to filter, and the region that their windows
//! reach: the rectangle and a halo, cut off at the image's border. Since a window
//! is cut off there as well, and nowhere else, a tile gives the same bits as the
//! whole.

use crate::backend::Rect;
use crate::scene::plane::Layout;

/// Some pixels to filter, and those that their windows reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    /// The pixels to filter.
    pub(super) rect: Rect,
    /// The pixels that are read.
    pub(super) region: Rect,
}

impl Tile {
    /// The tile of a rectangle whose windows reach so far; its region begins at, and ends
    /// before, a multiple of `step`, or ends with the image.
    pub(super) fn of(rect: Rect, layout: Layout, reach: usize, step: usize) -> Self {
        let start = |at: usize| at.saturating_sub(reach) / step * step;
        let end = |at: usize, last: usize| (at + reach).next_multiple_of(step).min(last);
        let (left, top) = (start(rect.x), start(rect.y));
        let right = end(rect.x + rect.width, layout.width());
        let bottom = end(rect.y + rect.height, layout.height());
        let region = Rect { x: left, y: top, width: right - left, height: bottom - top };
        Self { rect, region }
    }
}

/// Cuts a rectangle into tiles that `fits` accepts, in halves, as often as it
/// takes. Returns the tile of a single pixel that does not fit, if it comes to
/// that.
pub(super) fn tiles(
    rect: Rect,
    tile: impl Fn(Rect) -> Tile,
    fits: &impl Fn(&Tile) -> bool,
) -> Result<Vec<Tile>, Tile> {
    let mut tiles = Vec::new();
    let mut rest = vec![rect];
    while let Some(rect) = rest.pop() {
        if rect.pixels() == 0 {
            continue;
        }
        let tile = tile(rect);
        if fits(&tile) {
            tiles.push(tile);
        } else if rect.pixels() == 1 {
            return Err(tile);
        } else {
            let (first, second) = halves(rect);
            rest.extend([second, first]);
        }
    }
    Ok(tiles)
}

/// Across the longer side: of all shapes, squares have the least halo.
fn halves(rect: Rect) -> (Rect, Rect) {
    let Rect { x, y, width, height } = rect;
    if width > height {
        let half = width / 2;
        (Rect { width: half, ..rect }, Rect { x: x + half, width: width - half, ..rect })
    } else {
        let half = height / 2;
        (Rect { height: half, ..rect }, Rect { y: y + half, height: height - half, ..rect })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_every_pixel_once_and_their_regions_every_window() {
        let (width, height, reach) = (101, 67, 5);
        let layout = Layout::new(width, height, reach);
        let whole = Rect { x: 0, y: 0, width, height };
        let tile = |rect| Tile::of(rect, layout, reach, 1);
        for limit in [200, 1000, 5000, 100_000] {
            let fits = |tile: &Tile| tile.region.pixels() <= limit;
            let tiles = tiles(whole, tile, &fits).expect("a window has 121 pixels");
            let mut covered = vec![0; width * height];
            for Tile { rect, region } in tiles {
                assert!(region.pixels() <= limit);
                for y in rect.y..rect.y + rect.height {
                    for x in rect.x..rect.x + rect.width {
                        covered[y * width + x] += 1;
                    }
                }
                assert!(region.x == rect.x.saturating_sub(reach));
                assert!(region.y == rect.y.saturating_sub(reach));
                assert!(region.x + region.width == (rect.x + rect.width + reach).min(width));
                assert!(region.y + region.height == (rect.y + rect.height + reach).min(height));
            }
            assert!(covered.iter().all(|&times| times == 1), "at most {limit} pixels");
        }
        let tile = tiles(whole, tile, &|_| false).expect_err("nothing fits");
        assert_eq!((tile.rect.pixels(), tile.region.pixels()), (1, 36));
    }
}
