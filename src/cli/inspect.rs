//! `tamis inspect`: what is in a file, and what becomes of it. What this computer
//! can do is next door, in [`host`].

use std::path::PathBuf;

use clap::Args;

use super::error::Error;
use super::host;
use crate::report::Findings;
use crate::report::score::json;
use crate::scene::inspect::Inspection;

const EXAMPLES: &str = "\
Examples:
  tamis inspect render.exr
  tamis inspect --json render.exr
  tamis inspect --host

FEEDS names the term of expressions that reads a channel, which is also what
`denoise --map` takes. A variance that the file lacks is estimated from the image
where a filter reads it; gradients are always derived.

Bad pixels are those that filters cannot use or should not trust. By default what
is no number, or beyond ±1e18, is replaced by the median of the good samples
around it (`denoise --repair`). Negative samples are listed where they mean
nothing (in light, albedo, depth and variances), fireflies where a pixel is more
than 16 times as bright as the median of the 24 around it and of the image: both
are left to the filter.";

/// List a file's channels, what they feed, and what is wrong with them; or what
/// this processor can do.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Inspect {
    /// An OpenEXR file
    #[arg(value_name = "IN.exr", required_unless_present = "host")]
    input: Option<PathBuf>,

    /// Instead of a file: how wide machine code can be on this processor, and what
    /// `--lanes auto` takes
    #[arg(long, conflicts_with = "input")]
    host: bool,

    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Inspect {
    pub(super) fn run(&self) -> Result<String, Error> {
        let Some(input) = &self.input else {
            return host::report(self.json);
        };
        let inspection = Inspection::of(input)?;
        let findings = Findings::of(&inspection, &inspection.scan()?);
        Ok(if self.json { json(&findings) } else { findings.text() })
    }
}
