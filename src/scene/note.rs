//! What was done to a scene on the way in, for people to know.

use std::fmt;

use crate::expr::feature::{Feature, Quantity};
use crate::image::exr::Window;

/// Something about a scene that its file does not say or does not say well.
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// Bad pixels of a channel were replaced.
    Repaired {
        /// The channel's full name.
        channel: String,
        /// How many pixels.
        count: usize,
    },
    /// Bad pixels of a channel were left in, as the user asked.
    LeftBad {
        /// The channel's full name.
        channel: String,
        /// How many pixels.
        count: usize,
    },
    /// Samples of a channel are below zero where that means nothing.
    Negative {
        /// The channel's full name.
        channel: String,
        /// What the channel holds: negative variances count as 0, values are kept.
        quantity: Quantity,
        /// How many samples.
        count: usize,
    },
    /// Pixels of a feature were brought into its bounds.
    Bounded {
        /// Which feature.
        feature: Feature,
        /// Its bounds.
        bounds: [f32; 2],
        /// How many pixels, those left out that were out by rounding alone.
        count: usize,
    },
    /// Pixels far outshine all around them. They are kept, but for what
    /// [`Bounded`](Self::Bounded) says.
    Fireflies {
        /// In which feature.
        feature: Feature,
        /// How many pixels.
        count: usize,
    },
    /// The file holds no variance of a feature: it was estimated from the image.
    EstimatedVariance(Feature),
    /// The file holds a variance that cannot be used.
    UnusableVariance {
        /// Whose.
        feature: Feature,
        /// The channels.
        channels: Vec<String>,
        /// Why not.
        reason: &'static str,
    },
    /// Depths that stand for "nothing hit" were set to 0.
    FarDepth {
        /// How many pixels.
        count: usize,
    },
    /// A feature has another data window than the colour: outside of it, it counts as 0.
    Uncovered {
        /// Which.
        feature: Feature,
        /// Its window.
        window: Window,
        /// Pixels of the colour that are not in it.
        count: usize,
    },
    /// The render was not finished: pixels that are missing count as those near by.
    Unfinished {
        /// Rows in which a pixel of something that is read is missing.
        rows: usize,
        /// Of how many rows.
        of: usize,
        /// Rows in which the colour of a pixel is missing: the result is black there.
        black: usize,
    },
    /// A feature that is one number per pixel was taken from one channel of several: a grey
    /// image that was stored as a coloured one.
    OneOfSeveral {
        /// Which feature.
        feature: Feature,
        /// The channel's full name.
        channel: String,
        /// The layer's other channels.
        others: Vec<String>,
    },
    /// Normals were stored as colours, between 0 and 1.
    EncodedNormals,
    /// Normals were longer than 1.
    LongNormals {
        /// How many.
        count: usize,
    },
}

impl Note {
    /// Whether it tells of a loss that even those should hear of who want to hear nothing.
    pub fn is_warning(&self) -> bool {
        match self {
            Self::Repaired { .. }
            | Self::LeftBad { .. }
            | Self::Unfinished { .. }
            | Self::Uncovered { .. } => true,
            Self::Negative { .. }
            | Self::Bounded { .. }
            | Self::Fireflies { .. }
            | Self::EstimatedVariance(_)
            | Self::UnusableVariance { .. }
            | Self::FarDepth { .. }
            | Self::OneOfSeveral { .. }
            | Self::EncodedNormals
            | Self::LongNormals { .. } => false,
        }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Repaired { channel, count } => {
                write!(f, "{channel}: {count} bad pixel(s) replaced by the median around them")
            }
            Self::LeftBad { channel, count } => {
                write!(f, "{channel}: {count} bad pixel(s) left in")
            }
            Self::Negative { channel, quantity, count } => {
                let fate = match quantity {
                    Quantity::Variance => "counted as 0",
                    Quantity::Value | Quantity::Gradient => "kept",
                };
                write!(f, "{channel}: {count} negative sample(s) {fate}")
            }
            Self::Bounded { feature, bounds: [lo, hi], count } => {
                write!(
                    f,
                    "{}: {count} pixel(s) outside of [{lo}, {hi}] brought into it",
                    feature.row().title
                )
            }
            Self::Fireflies { feature, count } => {
                let fate = if feature.row().bounds.is_some() { "" } else { " kept" };
                write!(f, "{}: {count} firefly pixel(s){fate}", feature.row().title)
            }
            Self::EstimatedVariance(feature) => write!(
                f,
                "{}: not in the file, estimated from the image",
                feature.spelling(Quantity::Variance).unwrap_or(feature.row().name)
            ),
            Self::UnusableVariance { feature, channels, reason } => {
                write!(
                    f,
                    "{}: variance of {} not used: {reason}",
                    channels.join(", "),
                    feature.row().name
                )
            }
            Self::FarDepth { count } => {
                write!(
                    f,
                    "depth: {count} pixel(s) so far away that nothing was hit there, set to 0"
                )
            }
            Self::Uncovered { feature, window, count } => write!(
                f,
                "{}: its data window is {window}; {count} pixel(s) outside of it count as 0",
                feature.row().title
            ),
            Self::Unfinished { rows, of, black } => {
                write!(f, "the render was not finished: {rows} of {of} row(s) are missing")?;
                match black {
                    0 => f.write_str(" in features; they are taken from rows near by"),
                    _ if black == rows => f.write_str("; they stay black"),
                    _ => write!(f, "; {black} of them lack the colour and stay black"),
                }
            }
            Self::OneOfSeveral { feature, channel, others } => write!(
                f,
                "{}: one number per pixel, taken from {channel}; {} not used",
                feature.row().title,
                others.join(", ")
            ),
            Self::EncodedNormals => {
                f.write_str("normals: between 0 and 1 in the file, brought to -1 to 1")
            }
            Self::LongNormals { count } => {
                write!(f, "normals: {count} pixel(s) longer than 1, brought to 1")
            }
        }
    }
}
