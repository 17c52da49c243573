//! Some rows of a plane that a program computes: memory is reused row by row.

use std::ops::Range;

use crate::plan::Edges;
use crate::scene::plane::{Layout, Lines};

/// Some rows of a plane: those that are still read, and those of the wave.
pub(super) struct Band {
    pub(super) layout: Layout,
    /// The row of the image that stands first.
    origin: usize,
    /// How many rows have room.
    pub(super) room: usize,
    /// With the image's edge repeated beside it, if `edges` ask for that.
    repeated: Option<Lines>,
    /// With zeros beside it.
    zero: Option<Lines>,
    edges: Edges,
}

impl Band {
    pub(super) fn new(layout: Layout, edges: Edges) -> Self {
        let lines = |wanted: bool| wanted.then(|| Lines::zeros(0));
        let Edges { repeated, zero } = edges;
        Self {
            edges,
            layout,
            origin: 0,
            room: 0,
            repeated: lines(repeated || !zero),
            zero: lines(zero),
        }
    }

    fn sides(&mut self) -> impl Iterator<Item = &mut Lines> {
        self.repeated.iter_mut().chain(&mut self.zero)
    }

    /// Makes room for rows of the image, and keeps those of them that are there.
    pub(super) fn hold(&mut self, rows: Range<usize>) {
        if rows.end <= self.origin + self.room && rows.start >= self.origin {
            return;
        }
        let (stride, old, room) = (self.layout.stride(), self.origin, self.room);
        let kept = rows.start.max(old)..rows.end.min(old + room).max(rows.start.max(old));
        let (from, to) = ((kept.start - old + 1) * stride, (kept.start - rows.start + 1) * stride);
        let length = kept.len() * stride;
        if rows.len() > room {
            // Twice as many as needed, so that rows seldom have to move.
            self.room = 2 * rows.len();
            // A row of slack at both ends, for who looks beside the first and last pixel.
            let samples = (self.room + 2) * stride;
            for side in self.sides() {
                let mut grown = Lines::zeros(samples);
                if room > 0 {
                    grown[to..to + length].copy_from_slice(&side[from..from + length]);
                }
                *side = grown;
            }
        } else {
            self.sides().for_each(|side| side.copy_within(from..from + length, to));
        }
        self.origin = rows.start;
    }

    /// Makes room for all rows of the image, and no more.
    pub(super) fn hold_all(&mut self) {
        (self.origin, self.room) = (0, self.layout.height());
        let samples = (self.room + 2) * self.layout.stride();
        self.sides().for_each(|side| *side = Lines::zeros(samples));
    }

    /// Where a row of the image begins.
    pub(super) fn start(&self, row: usize) -> usize {
        (row + 1 - self.origin) * self.layout.stride()
    }

    /// Writes a row of pixels.
    pub(super) fn write(&mut self, row: usize, pixels: &[f32]) {
        let (start, pad) = (self.start(row), self.layout.pad());
        if let Some(plane) = &mut self.repeated {
            let row = &mut plane[start..start + self.layout.stride()];
            row[pad..pad + pixels.len()].copy_from_slice(pixels);
            if self.edges.repeated {
                row[..pad].fill(pixels[0]);
                row[pad + pixels.len()..].fill(pixels[pixels.len() - 1]);
            }
        }
        if let Some(plane) = &mut self.zero {
            plane[start + pad..][..pixels.len()].copy_from_slice(pixels);
        }
    }

    /// The pixels of a row, by whichever edges there are: they are the same.
    pub(super) fn pixels(&self, row: usize) -> &[f32] {
        let start = self.start(row) + self.layout.pad();
        &self.looked_at()[start..][..self.layout.width()]
    }

    /// The samples for whoever looks at them.
    pub(super) fn looked_at(&self) -> &[f32] {
        // Who reads no other column takes any edges.
        let plane = self.repeated.as_ref().or(self.zero.as_ref());
        plane.expect("a band has samples")
    }

    /// The samples for whoever averages them.
    pub(super) fn averaged(&self) -> &[f32] {
        self.zero.as_ref().expect("the schedule says who averages what")
    }
}
