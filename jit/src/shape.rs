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

/// The taps of a window: the pixels at `dilation × d` from the centre, for every
/// d in `-radius..=radius`, along both axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Window {
    /// Taps to each side: x, then y.
    pub radius: [usize; 2],
    /// Pixels from one tap to the next: x, then y.
    pub dilation: [usize; 2],
}

impl Window {
    /// The full square of pixels within `radius`.
    pub fn square(radius: usize) -> Self {
        Self { radius: [radius; 2], dilation: [1; 2] }
    }

    /// The number of taps, saturating.
    ///
    /// The table of tap values holds them row by row from the top, left to
    /// right within a row: value k of the tap in row v and column u is number
    /// `(v × (2 × radius[0] + 1) + u) × taps + k`.
    pub fn taps(&self) -> usize {
        let [columns, rows] = self.radius.map(Self::across);
        columns.saturating_mul(rows)
    }

    /// How far the window reaches to the sides, in pixels, saturating.
    pub fn reach(&self) -> usize {
        self.radius[0].saturating_mul(self.dilation[0])
    }

    fn across(radius: usize) -> usize {
        radius.saturating_mul(2).saturating_add(1)
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

/// The data of one run of a kernel.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// How every plane is laid out.
    pub layout: Layout,
    /// The planes: channels first, padded with zeros, then features.
    pub planes: &'a [&'a [f32]],
    /// The window.
    pub window: Window,
    /// The table of tap values, see [`Window::taps`].
    pub taps: &'a [f32],
    /// The pixels to compute.
    pub rect: Rect,
}

impl Job<'_> {
    /// Checks all that machine code relies on: every address that a kernel of
    /// `spec` with steps of `step` pixels reaches from here lies inside `planes`,
    /// `taps`, or an output of `output` values.
    pub(crate) fn check(
        &self,
        spec: &WindowSpec,
        step: usize,
        output: usize,
    ) -> Result<OutputShape, ShapeError> {
        self.check_rows(step)?;
        self.check_planes(spec)?;
        self.check_window(spec)?;
        let shape = self.check_rect(spec, step)?;
        if output != shape.len() {
            return Err(ShapeError::Output { expected: shape.len(), found: output });
        }
        Ok(shape)
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
        if self.window.dilation.contains(&0) {
            return Err(ShapeError::Dilation);
        }
        let (reach, pad) = (self.window.reach(), self.layout.pad);
        if reach > pad {
            return Err(ShapeError::Reach { reach, pad });
        }
        let expected = self.window.taps().saturating_mul(spec.taps);
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

    /// The rows of taps that lie inside the image for output row `y`: how many
    /// lie above the centre, and how many below.
    pub(crate) fn rows_inside(&self, y: usize) -> (usize, usize) {
        let (radius, dilation) = (self.window.radius[1], self.window.dilation[1]);
        let below = self.layout.height - 1 - y;
        (radius.min(y / dilation), radius.min(below / dilation))
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
