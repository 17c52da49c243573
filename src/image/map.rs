//! How far an image is from its reference, pixel by pixel.

use super::exr::Window;

/// A value per pixel, as far as it is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    size: (usize, usize),
    /// Row by row; not a number where nothing is known.
    values: Vec<f64>,
}

impl Map {
    /// A map of a value per pixel, row by row, which is not a number where nothing is known.
    ///
    /// # Panics
    /// If there are not as many as pixels.
    pub fn new(size: (usize, usize), values: Vec<f64>) -> Self {
        assert_eq!(values.len(), size.0 * size.1, "a value per pixel");
        Self { size, values }
    }

    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The values, row by row; not a number where nothing is known.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The mean of what is known; none if nothing is.
    pub fn mean(&self) -> Option<f64> {
        self.mean_in(&Window::of_size(self.size))
    }

    /// The same of a part, whose place is counted from the top left corner.
    pub fn mean_in(&self, part: &Window) -> Option<f64> {
        let part = part.overlap(&Window::of_size(self.size))?;
        let (x, y) = (part.origin.0 as usize, part.origin.1 as usize);
        let rows = self.values.chunks_exact(self.size.0).skip(y).take(part.size.1);
        let values = rows.flat_map(|row| &row[x..x + part.size.0]).filter(|value| !value.is_nan());
        let (sum, count) = values.fold((0.0, 0usize), |(sum, n), value| (sum + value, n + 1));
        (count > 0).then(|| sum / count as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_leave_out_what_is_not_known_and_what_is_not_there() {
        let map = Map::new((3, 2), vec![1.0, f64::NAN, 3.0, 5.0, 7.0, 100.0]);
        assert_eq!(map.mean(), Some(116.0 / 5.0));
        let part = |x, y, w, h| map.mean_in(&Window { origin: (x, y), size: (w, h) });
        assert_eq!(part(0, 0, 2, 2), Some(13.0 / 3.0));
        assert_eq!(part(1, 0, 1, 1), None);
        assert_eq!(part(2, 1, 9, 9), Some(100.0));
        assert_eq!(part(9, 9, 1, 1), None);
    }
}
