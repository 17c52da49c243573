//! What can go wrong: while compiling ([`CompileError`]) and when a kernel is
//! handed data that do not fit it ([`ShapeError`]).

use crate::width::Width;

/// Why no kernel was made. It costs the one kernel, never the process.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompileError {
    /// No machine code can be made for this kind of processor.
    #[error("no machine code for this processor: {0}")]
    Host(String),

    /// The processor has no vectors of this width.
    #[error("this processor has no vectors of {0}: they take {needs}", needs = .0.needs())]
    Width(Width),

    /// The specification asks for nothing, or for more than a kernel can hold.
    #[error("{what} is {value}; a kernel takes 1 to {limit}", limit = crate::WindowSpec::LIMIT)]
    Spec {
        /// The field, or the product of fields, that is out of range.
        what: &'static str,
        /// Its value, saturating.
        value: usize,
    },

    /// The specification sums more channels than it has planes.
    #[error("{channels} channels, but only {planes} planes")]
    Channels {
        /// Channels to sum.
        channels: usize,
        /// Planes in all.
        planes: usize,
    },

    /// The body read a plane that is not there.
    #[error("the body reads plane {index} of {planes}")]
    Plane {
        /// The plane that it asked for.
        index: usize,
        /// How many there are.
        planes: usize,
    },

    /// The body read a tap value that is not there.
    #[error("the body reads tap value {index} of {taps}")]
    Tap {
        /// The value that it asked for.
        index: usize,
        /// How many each tap has.
        taps: usize,
    },

    /// The body returned more or fewer weights than the specification says.
    #[error("the body returned {found} weights instead of {expected}")]
    Weights {
        /// Weights in the specification.
        expected: usize,
        /// Weights that came back.
        found: usize,
    },

    /// The code generator refused the function, or no memory could be mapped.
    #[error("the code generator failed: {0}")]
    Generator(String),

    /// The code generator, or the body, panicked.
    #[error("compilation panicked: {0}")]
    Panic(String),
}

/// Why a kernel would not run: the data handed to it do not fit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// Not as many planes as the kernel was compiled for.
    #[error("{found} planes instead of {expected}")]
    PlaneCount {
        /// Planes in the specification.
        expected: usize,
        /// Planes given.
        found: usize,
    },

    /// A plane is shorter than the layout says.
    #[error("plane {index} holds {found} values; the layout needs {expected}")]
    PlaneLength {
        /// Which plane.
        index: usize,
        /// `stride × height`.
        expected: usize,
        /// Its length.
        found: usize,
    },

    /// The rows are too short for their padding and one step to spare.
    #[error("stride {found} is below width + 2 × pad + step - 1 = {expected}")]
    Stride {
        /// The least stride that would do, saturating.
        expected: usize,
        /// The layout's stride.
        found: usize,
    },

    /// `stride × height` is no length that a slice can have.
    #[error("stride {stride} × height {height} is too large")]
    Size {
        /// The layout's stride.
        stride: usize,
        /// The layout's height.
        height: usize,
    },

    /// A run of taps reaches further to the sides than the planes are padded.
    #[error("run {index} of the window reaches beyond the planes' padding of {pad} columns")]
    Reach {
        /// Which run.
        index: usize,
        /// The layout's padding.
        pad: usize,
    },

    /// The table of tap values does not match the window.
    #[error("{found} tap values; the window needs {expected}")]
    TapCount {
        /// Taps of all runs times values per tap, saturating.
        expected: usize,
        /// Values given.
        found: usize,
    },

    /// The rectangle is reversed or leaves the image.
    #[error("columns {x:?}, rows {y:?} do not lie in an image of {width} × {height}")]
    Rect {
        /// The rectangle's columns.
        x: std::ops::Range<usize>,
        /// The rectangle's rows.
        y: std::ops::Range<usize>,
        /// The image's width.
        width: usize,
        /// The image's height.
        height: usize,
    },

    /// The buffer of mirrored sums has another length than the kernel needs.
    #[error("{found} mirrored sums instead of {expected}")]
    Mirror {
        /// See [`MirrorShape::len`](crate::MirrorShape::len); 0 for a kernel that
        /// is not mirrored.
        expected: usize,
        /// Values given.
        found: usize,
    },

    /// A mirrored kernel computes one row at a time: the mirrored sums of
    /// different rows belong to different rows.
    #[error("a mirrored kernel computes one row at a time, not {found}")]
    MirroredRows {
        /// Rows of the rectangle.
        found: usize,
    },

    /// The output buffer has another length than the rectangle's results.
    #[error("the output holds {found} values instead of {expected}")]
    Output {
        /// See [`OutputShape::len`](crate::OutputShape::len), saturating.
        expected: usize,
        /// Values given.
        found: usize,
    },
}
