//! `tamis compare`: how far an image is from its reference.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::error::Error;
use crate::image::exr::Window;
use crate::image::{Comparison, Image};
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

Images that begin at different places (data windows) are compared where they overlap.

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
        let mut image = load_image(&self.image)?;
        let mut reference = load_image(&self.reference)?;
        let overlap = overlap(&image, &reference);
        if let Some(overlap) = overlap {
            (image, reference) = (image.within(overlap), reference.within(overlap));
        }
        let Comparison { metrics, left_out, bad } = Comparison::of(&image, &reference)?;
        if self.json {
            let metrics = MetricsJson::of(&metrics);
            return Ok(json(&ComparisonJson {
                metrics,
                left_out,
                not_finite: bad,
                overlap: overlap.map(|window| window.to_string()),
            }));
        }
        let mut table = Table::new([("measure", Align::Left), ("value", Align::Right)]);
        table.row(["RelMSE".to_owned(), number::error(metrics.rel_mse)]);
        table.row(["RelMSE, trimmed".to_owned(), number::error(metrics.trimmed_rel_mse)]);
        table.row(["MSE".to_owned(), number::error(metrics.mse)]);
        table.row(["PSNR".to_owned(), number::decibels(metrics.psnr)]);
        if let Some(window) = overlap {
            table.row(["compared".to_owned(), format!("where both are: {window}")]);
        }
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
    /// The window that was compared, where the images begin at different places.
    #[serde(skip_serializing_if = "Option::is_none")]
    overlap: Option<String>,
}

/// The window that both images have, if they begin at different places.
fn overlap(image: &Image, reference: &Image) -> Option<Window> {
    let (a, b) = (image.window()?, reference.window()?);
    if a.origin == b.origin { None } else { a.overlap(&b) }
}
