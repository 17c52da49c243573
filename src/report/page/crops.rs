//! Which parts of images are worth a look.

use rayon::prelude::*;

use crate::image::Map;
use crate::image::exr::Window;

/// The least and the greatest side of a part, if the image is so large.
const SIDES: [usize; 2] = [16, 128];

/// How many parts fit along the image's shorter side.
const ALONG: usize = 5;

/// The parts where images differ most, the greatest difference first, none over another: where the
/// means of their maps are farthest apart, or of a single one, greatest. Fewer than `most` where
/// there is no difference.
///
/// # Panics
/// If the maps differ in size.
pub(super) fn most_different(maps: &[&Map], most: usize) -> Vec<Window> {
    let Some(first) = maps.first() else { return Vec::new() };
    let (width, height) = first.size();
    assert!(maps.iter().all(|map| map.size() == (width, height)), "maps of one size");
    let shorter = width.min(height);
    if shorter == 0 {
        return Vec::new();
    }
    let side = (shorter / ALONG).clamp(SIDES[0], SIDES[1]).min(shorter);
    let places = |length: usize| (0..=length - side).step_by((side / 4).max(1));
    let windows = places(height).flat_map(|y| places(width).map(move |x| (x, y)));
    let windows: Vec<(usize, usize)> = windows.collect();
    let worth = |&(x, y): &(usize, usize)| {
        let window = Window { origin: (x as i32, y as i32), size: (side, side) };
        let means = maps.iter().filter_map(|map| map.mean_in(&window));
        let (low, high) = means
            .fold((f64::INFINITY, 0.0f64), |(low, high), mean| (low.min(mean), high.max(mean)));
        let worth = if maps.len() == 1 { high } else { high - low };
        (worth > 0.0).then_some((worth, window))
    };
    let mut ranked: Vec<(f64, Window)> = windows.par_iter().filter_map(worth).collect();
    // The sort is stable: of equals the first from above and from the left.
    ranked.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let mut chosen: Vec<Window> = Vec::new();
    for (_, window) in ranked {
        if chosen.len() == most {
            break;
        }
        if chosen.iter().all(|other| other.overlap(&window).is_none()) {
            chosen.push(window);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (60, 40);

    fn map(f: impl Fn(usize, usize) -> f64) -> Map {
        Map::new(SIZE, (0..SIZE.0 * SIZE.1).map(|k| f(k % SIZE.0, k / SIZE.0)).collect())
    }

    #[test]
    fn parts_are_where_images_differ_and_not_where_all_are_bad() {
        let bad = |x: usize, y: usize| f64::from(u8::from(x < 16 && y < 16));
        let both = map(bad);
        let one = map(|x, y| bad(x, y) + 0.5 * f64::from(u8::from(x >= 44 && y >= 24)));
        let corner = |windows: &[Window]| windows.first().map(|window| window.origin);
        assert_eq!(corner(&most_different(&[&one], 1)), Some((0, 0)));
        assert_eq!(corner(&most_different(&[&one, &both], 1)), Some((44, 24)));
        let windows = most_different(&[&one], 9);
        for (k, window) in windows.iter().enumerate() {
            assert!(windows[..k].iter().all(|other| other.overlap(window).is_none()));
        }
        assert!(most_different(&[&both, &both], 4).is_empty());
    }

    #[test]
    fn small_images_are_parts_of_themselves() {
        let dot = Map::new((3, 2), vec![1.0; 6]);
        assert_eq!(most_different(&[&dot], 1)[0].size, (2, 2));
        assert!(most_different(&[], 4).is_empty());
    }
}
