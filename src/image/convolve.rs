//! Sums over neighbourhoods by kernels that are products of a row and a column, in `f64`.
//!
//! A result depends on its pixel's surroundings alone, and each is summed in one order, so that
//! no result depends on the number of threads.

use rayon::prelude::*;

/// What stands beside the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Edge {
    /// The nearest pixel of the image.
    Nearest,
    /// The image mirrored at its edge: c b a | a b c.
    Mirrored,
}

impl Edge {
    /// The pixel of `count` that stands at a place beside or in the image.
    fn index(self, at: isize, count: usize) -> usize {
        let count = count as isize;
        let index = match self {
            Self::Nearest => at.clamp(0, count - 1),
            Self::Mirrored => {
                let at = at.rem_euclid(2 * count);
                at.min(2 * count - 1 - at)
            }
        };
        index as usize
    }
}

/// Samples at -radius..=radius of a function.
pub(super) fn kernel(radius: usize, f: impl Fn(f64) -> f64) -> Vec<f64> {
    let radius = radius as isize;
    (-radius..=radius).map(|x| f(x as f64)).collect()
}

/// Σ over dx and dy of row(dx) column(dy) plane(x + dx, y + dy), at every pixel.
///
/// # Panics
/// If the plane is not of that size or empty, or a kernel has no centre.
pub(super) fn convolve(
    plane: &[f64],
    (width, height): (usize, usize),
    row: &[f64],
    column: &[f64],
    edge: Edge,
) -> Vec<f64> {
    assert!(plane.len() == width * height && !plane.is_empty(), "a plane of that size");
    assert!(row.len() % 2 == 1 && column.len() % 2 == 1, "kernels with a centre");
    let radius = (row.len() / 2) as isize;
    let columns: Vec<usize> =
        (-radius..width as isize + radius).map(|x| edge.index(x, width)).collect();
    let mut along = vec![0.0; plane.len()];
    along.par_chunks_exact_mut(width).zip(plane.par_chunks_exact(width)).for_each(|(out, line)| {
        let padded: Vec<f64> = columns.iter().map(|&x| line[x]).collect();
        for (x, sum) in out.iter_mut().enumerate() {
            *sum = row.iter().zip(&padded[x..]).map(|(k, v)| k * v).sum();
        }
    });
    let radius = (column.len() / 2) as isize;
    let mut across = vec![0.0; plane.len()];
    across.par_chunks_exact_mut(width).enumerate().for_each(|(y, out)| {
        for (k, dy) in column.iter().zip(-radius..) {
            let line = &along[edge.index(y as isize + dy, height) * width..][..width];
            for (sum, v) in out.iter_mut().zip(line) {
                *sum += k * v;
            }
        }
    });
    across
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_as_they_say() {
        let at = |edge: Edge| [-4, -1, 0, 2, 3, 7].map(|x| edge.index(x, 3));
        assert_eq!(at(Edge::Nearest), [0, 0, 0, 2, 2, 2]);
        assert_eq!(at(Edge::Mirrored), [2, 0, 0, 2, 2, 1]);
    }

    #[test]
    fn rows_and_columns_are_weighted_apart() {
        let plane = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
        // Differences to the right, sums with the row below.
        let out = convolve(&plane, (3, 2), &[0.0, -1.0, 1.0], &[0.0, 1.0, 1.0], Edge::Nearest);
        assert_eq!(out, [9.0, 18.0, 0.0, 16.0, 32.0, 0.0]);
    }
}
