//! The data of a run: how planes lie in memory, which pixels to compute, over
//! which window. Everything that machine code will rely on is checked here.

use std::ops::Range;

use crate::error::ShapeError;
use crate::window::WindowSpec;

/// How the rows of every plane of one image lie in memory.
///
/// A plane is a slice of at least `stride × height` values. Each row holds
/// `pad` values of padding, `width` pixels, and padding again to its end, so
/// that taps may reach `pad` columns past either side and a whole vector step
/// may be read past the last pixel. There are no padding rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Layout {
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
    /// Columns of padding to the left of the image, and at least as many to
    /// its right.
    pub pad: usize,
    /// Values from one row to the next.
    pub stride: usize,
}

/// What a plane holds outside the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Border {
    /// Zeros: for channels, whose terms must vanish there.
    Zero,
    /// The nearest pixel of the row: for features, whose distances stay tame.
    Replicate,
}

impl Layout {
    /// The widest step of any code generator: rows of [`new`](Self::new) are
    /// long enough for every kernel.
    const WIDEST_STEP: usize = 64;

    /// The layout of an image whose windows reach at most `pad` columns
    /// sideways. Rows start on multiples of 64 bytes.
    pub fn new(width: usize, height: usize, pad: usize) -> Self {
        let stride = (width + 2 * pad + Self::WIDEST_STEP - 1).next_multiple_of(16);
        Self { width, height, pad, stride }
    }

    /// Where pixel (x, y) lies in a plane.
    pub fn index(&self, x: usize, y: usize) -> usize {
        y * self.stride + self.pad + x
    }

    /// A plane that holds `pixel(x, y)` inside the image and `border` around it.
    pub fn plane(&self, border: Border, pixel: impl Fn(usize, usize) -> f32) -> Vec<f32> {
        let mut plane = Vec::with_capacity(self.stride * self.height);
        let last = self.width.saturating_sub(1);
        for y in 0..self.height {
            plane.extend((0..self.stride).map(|column| {
                let inside = (self.pad..self.pad + self.width).contains(&column);
                if inside || (border == Border::Replicate && self.width > 0) {
                    pixel(column.saturating_sub(self.pad).min(last), y)
                } else {
                    0.0
                }
            }));
        }
        plane
    }
}

/// Taps of a window side by side in one row: `count` of them, the first at
/// (dx, dy) from the centre, each `step` columns from the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Run {
    /// Columns from the centre to the first tap, to the right.
    pub dx: isize,
    /// Rows from the centre to all of them, downwards.
    pub dy: isize,
    /// How many taps there are.
    pub count: usize,
    /// Columns from one tap to the next; negative from right to left.
    pub step: isize,
}

impl Run {
    /// The full square of pixels within `radius`, from the top, left to right.
    pub fn square(radius: usize) -> Vec<Self> {
        let reach = radius as isize;
        let row = |dy| Self { dx: -reach, dy, count: 2 * radius + 1, step: 1 };
        (-reach..=reach).map(row).collect()
    }

    /// How far the taps reach to either side, in columns; wide enough for every
    /// field that there can be.
    fn reach(&self) -> i128 {
        let last = self.count.saturating_sub(1) as i128;
        let [first, step] = [self.dx, self.step].map(|x| x as i128);
        first.abs().max((first + last * step).abs())
    }
}

/// A rectangle of output pixels.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Rect {
    /// Its columns.
    pub x: Range<usize>,
    /// Its rows.
    pub y: Range<usize>,
}

impl Rect {
    /// The whole image.
    pub fn all(layout: &Layout) -> Self {
        Self { x: 0..layout.width, y: 0..layout.height }
    }
}

/// How the results of a rectangle lie in the output buffer: row after row of
/// pixels, and in each all first results, then all second results, and so on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct OutputShape {
    /// Rows of the rectangle.
    pub rows: usize,
    /// Its columns.
    pub columns: usize,
    /// Results per pixel, see [`WindowSpec::result`].
    pub results: usize,
    /// Values from one result to the next: the columns rounded up to whole
    /// steps. What lies behind the last column is scratch.
    pub stride: usize,
}

impl OutputShape {
    /// The length of the buffer, saturating.
    #[expect(clippy::len_without_is_empty, reason = "a shape, not a collection")]
    pub fn len(&self) -> usize {
        self.stride.saturating_mul(self.results).saturating_mul(self.rows)
    }

    /// Where the values of one result lie, for row number `row` of the
    /// rectangle: one value per column.
    pub fn row(&self, row: usize, result: usize) -> Range<usize> {
        let start = (row * self.results + result) * self.stride;
        start..start + self.columns
    }
}

/// How mirrored sums lie in their buffer: run after run, and of each all first
/// sums, then all second ones, and so on, each of them a row as long as those of
/// the planes and padded like them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MirrorShape {
    /// Runs of the window.
    pub runs: usize,
    /// Sums per pixel, see [`WindowSpec::result`].
    pub results: usize,
    /// Values from one sum to the next.
    pub stride: usize,
}

impl MirrorShape {
    /// The length of the buffer, saturating.
    #[expect(clippy::len_without_is_empty, reason = "a shape, not a collection")]
    pub fn len(&self) -> usize {
        self.runs.saturating_mul(self.run())
    }

    /// The values of one run, saturating.
    pub fn run(&self) -> usize {
        self.results.saturating_mul(self.stride)
    }

    /// Where one sum of a run lies: a padded row.
    pub fn row(&self, run: usize, result: usize) -> Range<usize> {
        let start = run * self.run() + result * self.stride;
        start..start + self.stride
    }
}

/// The data of one run of a kernel.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// How every plane is laid out.
    pub layout: Layout,
    /// The planes: channels first, padded with zeros, then features.
    pub planes: &'a [&'a [f32]],
    /// The window, in the order of summation.
    pub runs: &'a [Run],
    /// The values of every tap, in the order of the runs.
    pub taps: &'a [f32],
    /// The pixels to compute.
    pub rect: Rect,
}

impl Job<'_> {
    /// Checks all that machine code relies on: every address that a kernel of
    /// `spec` with steps of `step` pixels reaches from here lies inside `planes`,
    /// `taps`, an output of `output` values, or `mirrored` mirrored sums.
    pub(crate) fn check(
        &self,
        spec: &WindowSpec,
        step: usize,
        output: usize,
        mirrored: usize,
    ) -> Result<(OutputShape, MirrorShape), ShapeError> {
        self.check_rows(step)?;
        self.check_planes(spec)?;
        self.check_window(spec)?;
        let shape = self.check_rect(spec, step)?;
        if output != shape.len() {
            return Err(ShapeError::Output { expected: shape.len(), found: output });
        }
        let mirror = self.mirror_shape(spec);
        if mirrored != mirror.len() {
            return Err(ShapeError::Mirror { expected: mirror.len(), found: mirrored });
        }
        if spec.mirrored && shape.rows > 1 {
            return Err(ShapeError::MirroredRows { found: shape.rows });
        }
        Ok((shape, mirror))
    }

    /// The shape of the mirrored sums for a kernel of `spec`; empty if it has none.
    pub(crate) fn mirror_shape(&self, spec: &WindowSpec) -> MirrorShape {
        let runs = if spec.mirrored { self.runs.len() } else { 0 };
        MirrorShape { runs, results: spec.results(), stride: self.layout.stride }
    }

    /// Every row has room for its padding and a step that starts at its last pixel.
    fn check_rows(&self, step: usize) -> Result<(), ShapeError> {
        let Layout { width, pad, stride, .. } = self.layout;
        let expected = pad.saturating_mul(2).saturating_add(width).saturating_add(step - 1);
        // A sum that saturated is no length at all, not even of such a stride.
        if stride < expected || expected == usize::MAX {
            return Err(ShapeError::Stride { expected, found: stride });
        }
        Ok(())
    }

    fn check_planes(&self, spec: &WindowSpec) -> Result<(), ShapeError> {
        let Layout { height, stride, .. } = self.layout;
        let expected = stride.checked_mul(height).ok_or(ShapeError::Size { stride, height })?;
        if self.planes.len() != spec.planes {
            return Err(ShapeError::PlaneCount { expected: spec.planes, found: self.planes.len() });
        }
        match self.planes.iter().position(|plane| plane.len() < expected) {
            None => Ok(()),
            Some(index) => {
                Err(ShapeError::PlaneLength { index, expected, found: self.planes[index].len() })
            }
        }
    }

    fn check_window(&self, spec: &WindowSpec) -> Result<(), ShapeError> {
        let pad = self.layout.pad;
        if let Some(index) = self.runs.iter().position(|run| run.reach() > pad as i128) {
            return Err(ShapeError::Reach { index, pad });
        }
        let taps = self.runs.iter().fold(0, |taps: usize, run| taps.saturating_add(run.count));
        let expected = taps.saturating_mul(spec.taps);
        if self.taps.len() != expected {
            return Err(ShapeError::TapCount { expected, found: self.taps.len() });
        }
        Ok(())
    }

    fn check_rect(&self, spec: &WindowSpec, step: usize) -> Result<OutputShape, ShapeError> {
        let (Rect { x, y }, Layout { width, height, .. }) = (&self.rect, self.layout);
        if x.start > x.end || x.end > width || y.start > y.end || y.end > height {
            return Err(ShapeError::Rect { x: x.clone(), y: y.clone(), width, height });
        }
        Ok(OutputShape::new(&self.rect, spec, step))
    }
}

impl OutputShape {
    /// The shape for a kernel of `spec` with steps of `step` pixels.
    pub(crate) fn new(rect: &Rect, spec: &WindowSpec, step: usize) -> Self {
        let columns = rect.x.len();
        Self {
            rows: rect.y.len(),
            columns,
            results: spec.results(),
            stride: columns.div_ceil(step).saturating_mul(step),
        }
    }
}
