//! Options about many frames: which are done, and what becomes of the others.

use clap::Args;

use super::numbers::Numbers;
use super::shard::Shard;

#[derive(Debug, Args)]
#[command(next_help_heading = "Sequences")]
pub(super) struct Sequence {
    /// Only frames with these numbers: 7, 1-240, 1-240x2, or a list such as 1-10,20,30-40x5.
    /// A file's number is the last one in its name
    #[arg(long, value_name = "LIST")]
    pub(super) frames: Option<Numbers>,

    /// Only the K-th of N interleaved shares of the frames, for N machines; which frames
    /// that are does not depend on what --skip-existing finds
    #[arg(long, value_name = "K/N")]
    pub(super) shard: Option<Shard>,

    /// Leave out frames whose results exist
    #[arg(long)]
    pub(super) skip_existing: bool,

    /// Begin even if inputs are missing, and count each as a failed frame. (A frame that
    /// cannot be read, filtered or written never stops the others.)
    #[arg(long)]
    pub(super) keep_going: bool,

    /// Write one line of JSON per frame to stdout, as soon as the frame is done
    #[arg(long)]
    pub(super) json: bool,
}
