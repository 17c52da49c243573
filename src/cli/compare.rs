//! `tamis compare`: how far an image is from its reference.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::error::Error;
use crate::image::Comparison;
use crate::report::score::{MetricsJson, json};
use crate::report::{Align, Format, Table, number};
use crate::scene::load_image;

const EXAMPLES: &str = "\
Examples:
  tamis compare clean.exr reference.exr
  tamis compare --json clean.exr reference.exr

RelMSE is the mean over pixels and channels of (image - reference)² /
(reference² + 0.01); trimmed, the worst 0.1% of the pixels are left out, as a
handful of pixels at the edges of visible lights decides the plain mean. PSNR is
that of the images clamped to [0, 1] under the sRGB curve. In JSON, infinite
figures are null.

Pixels of the reference that are not finite are left out, and counted. Pixels of
the image that are not finite make its errors infinite, and are counted too.";

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
        let image = load_image(&self.image)?;
        let reference = load_image(&self.reference)?;
        let Comparison { metrics, left_out, bad } = Comparison::of(&image, &reference)?;
        if self.json {
            let metrics = MetricsJson::of(&metrics);
            return Ok(json(&ComparisonJson { metrics, left_out, not_finite: bad }));
        }
        let mut table = Table::new([("measure", Align::Left), ("value", Align::Right)]);
        table.row(["RelMSE".to_owned(), number::error(metrics.rel_mse)]);
        table.row(["RelMSE, trimmed".to_owned(), number::error(metrics.trimmed_rel_mse)]);
        table.row(["MSE".to_owned(), number::error(metrics.mse)]);
        table.row(["PSNR".to_owned(), number::decibels(metrics.psnr)]);
        for (measure, pixels) in [("pixels left out", left_out), ("pixels not finite", bad)] {
            if pixels > 0 {
                table.row([measure.to_owned(), pixels.to_string()]);
            }
        }
        Ok(table.render(Format::Plain))
    }
}

/// The errors and what they leave out, as JSON spells them.
#[derive(Serialize)]
struct ComparisonJson {
    #[serde(flatten)]
    metrics: MetricsJson,
    left_out: usize,
    not_finite: usize,
}
