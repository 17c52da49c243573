//! `tamis compare`: how far an image is from its reference.

use std::path::PathBuf;

use clap::Args;

use super::error::Error;
use crate::report::score::{MetricsJson, json};
use crate::report::{Align, Format, Table, number};
use crate::scene::{Image, Metrics};

const EXAMPLES: &str = "\
Examples:
  tamis compare clean.exr reference.exr
  tamis compare --json clean.exr reference.exr

RelMSE is the mean over pixels and channels of (image - reference)² /
(reference² + 0.01); trimmed, the worst 0.1% of the pixels are left out, as a
handful of pixels at the edges of visible lights decides the plain mean. PSNR is
that of the images clamped to [0, 1] under the sRGB curve. In JSON, infinite
figures are null.";

/// Measure how far an image is from its reference.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Compare {
    /// The image to be judged (OpenEXR)
    #[arg(value_name = "IMAGE")]
    image: PathBuf,

    /// The clean image of the same size (OpenEXR)
    #[arg(value_name = "REFERENCE")]
    reference: PathBuf,

    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Compare {
    pub(super) fn run(&self) -> Result<String, Error> {
        let image = Image::load(&self.image)?;
        let reference = Image::load(&self.reference)?;
        let metrics = Metrics::of(&image, &reference)?;
        if self.json {
            return Ok(json(&MetricsJson::of(&metrics)));
        }
        let mut table = Table::new([("measure", Align::Left), ("value", Align::Right)]);
        table.row(["RelMSE".to_owned(), number::error(metrics.rel_mse)]);
        table.row(["RelMSE, trimmed".to_owned(), number::error(metrics.trimmed_rel_mse)]);
        table.row(["MSE".to_owned(), number::error(metrics.mse)]);
        table.row(["PSNR".to_owned(), number::decibels(metrics.psnr)]);
        Ok(table.render(Format::Plain))
    }
}
