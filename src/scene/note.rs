//! What was done to a scene on the way in, for people to know.

use std::fmt;

use crate::expr::feature::{Feature, Quantity};

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
    /// A feature was recognised by a name of another convention than the file's.
    Borrowed {
        /// Which.
        feature: Feature,
        /// The channels.
        channels: Vec<String>,
        /// Whose names they are.
        convention: &'static str,
    },
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
                    feature.row().name
                )
            }
            Self::Fireflies { feature, count } => {
                let fate = if feature.row().bounds.is_some() { "" } else { " kept" };
                write!(f, "{}: {count} firefly pixel(s){fate}", feature.row().name)
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
            Self::Borrowed { feature, channels, convention } => write!(
                f,
                "{}: taken from {} ({convention})",
                feature.row().name,
                channels.join(", ")
            ),
        }
    }
}
