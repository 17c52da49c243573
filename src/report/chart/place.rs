//! Labels beside marks, where they cover neither marks nor each other.

/// A rectangle that something takes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Box {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Box {
    /// The square around a mark.
    pub(super) fn around(x: f64, y: f64, half: f64) -> Self {
        Self { left: x - half, top: y - half, right: x + half, bottom: y + half }
    }

    fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }
}

/// What is taken so far.
pub(super) struct Labels(Vec<Box>);

impl Labels {
    /// Only the marks.
    pub(super) fn around(marks: impl Iterator<Item = Box>) -> Self {
        Self(marks.collect())
    }

    /// A label's left end and base line beside the mark at (x, y): above, below,
    /// right or left of it. `None` if there is no room.
    pub(super) fn place(
        &mut self,
        x: f64,
        y: f64,
        mark: f64,
        width: f64,
        height: f64,
    ) -> Option<(f64, f64)> {
        let gap = mark + 3.0;
        let middle = y + 0.36 * height;
        let candidates = [
            (x - width / 2.0, y - gap),
            (x - width / 2.0, y + gap + 0.75 * height),
            (x + gap, middle),
            (x - gap - width, middle),
        ];
        candidates.into_iter().find(|&(left, base)| {
            let label = Box { left, top: base - 0.75 * height, right: left + width, bottom: base };
            let free = !self.0.iter().any(|taken| taken.overlaps(&label));
            if free {
                self.0.push(label);
            }
            free
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_give_way_and_at_last_give_up() {
        let mut labels = Labels::around([Box::around(50.0, 50.0, 5.0)].into_iter());
        let places: Vec<_> = (0..5).map(|_| labels.place(50.0, 50.0, 5.0, 12.0, 11.0)).collect();
        assert!(places[..4].iter().all(Option::is_some) && places[4].is_none(), "{places:?}");
    }
}
