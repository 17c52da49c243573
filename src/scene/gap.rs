//! Pixels that a file lacks, as a render that was not finished does.
//!
//! They are no black pixels: weights and sums around would take them for dark ones. They
//! are filled before anything is derived, each with the sample of one pixel near by, and
//! every channel that lacks the same pixels with those of the same one, so that colour and
//! features go together. A column is mirrored at the edge of its gap, so that the
//! noise of the last row does not count several times; where a column has no pixel, the
//! nearest column that has one stands in.

use crate::image::exr::Window;

/// Fills the gaps of the channels of an image.
pub(super) struct Gaps {
    size: (usize, usize),
    /// The gaps that were filled last: channels of one part have the same ones.
    known: Vec<Window>,
    /// Their pixels, each with the one that it is filled with.
    pairs: Vec<(u32, u32)>,
}

/// A row that is none.
const NONE: u32 = u32::MAX;

impl Gaps {
    /// For channels of this width and height.
    pub(super) fn new(size: (usize, usize)) -> Self {
        Self { size, known: Vec::new(), pairs: Vec::new() }
    }

    /// Fills gaps of a channel, which are counted from the image's corner. A channel that has no
    /// pixel stays as it is.
    pub(super) fn fill(&mut self, samples: &mut [f32], missing: &[Window]) {
        if missing != self.known {
            self.known = missing.to_vec();
            self.pairs = pairs(self.size, missing);
        }
        for &(target, source) in &self.pairs {
            samples[target as usize] = samples[source as usize];
        }
    }
}

/// Every pixel that is missing, with the one to fill it with: images have fewer than 2^32.
fn pairs((width, height): (usize, usize), missing: &[Window]) -> Vec<(u32, u32)> {
    let mut is_there = vec![true; width * height];
    for gap in missing {
        let (x, y) = (gap.origin.0 as usize, gap.origin.1 as usize);
        for row in y..y + gap.size.1 {
            is_there[row * width + x..][..gap.size.0].fill(false);
        }
    }
    // Per pixel the next row below that has its column.
    let mut below = vec![NONE; width * height];
    for y in (0..height).rev() {
        for x in 0..width {
            let k = y * width + x;
            below[k] = match is_there[k] {
                true => y as u32,
                false if y + 1 < height => below[k + width],
                false => NONE,
            };
        }
    }
    let mut above = vec![NONE; width];
    let mut columns = Vec::new();
    let mut pairs = Vec::new();
    for y in 0..height {
        for (x, above) in above.iter_mut().enumerate() {
            let k = y * width + x;
            if is_there[k] {
                *above = y as u32;
                continue;
            }
            let near = [*above, below[k]].into_iter().filter(|&row| row != NONE);
            let Some(row) = near.min_by_key(|row| row.abs_diff(y as u32)) else { continue };
            // As far behind the edge as the pixel is before it.
            let (row, y) = (row as usize, y as i64);
            let edge = row as i64;
            let mirrored = if edge < y { 2 * edge + 1 - y } else { 2 * edge - 1 - y };
            let mirrored = usize::try_from(mirrored).ok().filter(|&row| row < height);
            let mirrored = mirrored.map(|row| row * width + x).filter(|&k| is_there[k]);
            pairs.push((k as u32, mirrored.unwrap_or(row * width + x) as u32));
        }
    }
    if height > 0 {
        columns.extend((0..width).filter(|&x| below[x] != NONE));
    }
    if columns.is_empty() || columns.len() == width {
        return pairs;
    }
    for x in (0..width).filter(|&x| below[x] == NONE) {
        let after = columns.partition_point(|&column| column < x);
        let near = columns[after.saturating_sub(1)..].iter().take(2);
        let near = near.min_by_key(|column| column.abs_diff(x)).expect("there is a column");
        // They follow their sources, which are filled by then.
        pairs.extend((0..height).map(|y| ((y * width + x) as u32, (y * width + near) as u32)));
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(size: (usize, usize), samples: &[f32], gaps: &[[usize; 4]]) -> Vec<f32> {
        let window =
            |&[x, y, w, h]: &[usize; 4]| Window { origin: (x as i32, y as i32), size: (w, h) };
        let gaps: Vec<Window> = gaps.iter().map(window).collect();
        let mut samples = samples.to_vec();
        Gaps::new(size).fill(&mut samples, &gaps);
        samples
    }

    #[test]
    fn a_column_is_mirrored_at_its_last_pixel() {
        let column = [1.0, 2.0, 3.0, 0.0, 0.0];
        assert_eq!(filled((1, 5), &column, &[[0, 3, 1, 2]]), [1.0, 2.0, 3.0, 3.0, 2.0]);
        // More is missing than there is: the edge goes on.
        let column = [4.0, 5.0, 0.0, 0.0, 0.0];
        assert_eq!(filled((1, 5), &column, &[[0, 2, 1, 3]]), [4.0, 5.0, 5.0, 4.0, 5.0]);
        // From both sides, in rectangles one by one.
        let column = [0.0, 2.0, 0.0, 0.0, 0.0, 6.0, 7.0];
        let gaps = [[0, 0, 1, 1], [0, 2, 1, 1], [0, 3, 1, 2]];
        assert_eq!(filled((1, 7), &column, &gaps), [2.0, 2.0, 2.0, 2.0, 6.0, 6.0, 7.0]);
    }

    #[test]
    fn columns_without_a_pixel_are_their_neighbours() {
        #[rustfmt::skip]
        let image = [
            0.0, 1.0, 0.0, 0.0, 4.0,
            0.0, 0.0, 0.0, 0.0, 5.0,
        ];
        let gaps = [[0, 0, 1, 2], [2, 0, 2, 2], [1, 1, 1, 1]];
        #[rustfmt::skip]
        let expected = [
            1.0, 1.0, 1.0, 4.0, 4.0,
            1.0, 1.0, 1.0, 5.0, 5.0,
        ];
        assert_eq!(filled((5, 2), &image, &gaps), expected);
        assert_eq!(filled((2, 1), &[0.0; 2], &[[0, 0, 2, 1]]), [0.0; 2]);
    }

    #[test]
    fn gaps_of_one_channel_are_not_those_of_the_next() {
        let gap = |y| Window { origin: (0, y), size: (1, 1) };
        let mut gaps = Gaps::new((1, 2));
        for (missing, expected) in [(vec![gap(0)], [2.0; 2]), (vec![], [1.0, 2.0])] {
            let mut samples = [1.0, 2.0];
            gaps.fill(&mut samples, &missing);
            assert_eq!(samples, expected);
        }
    }
}
