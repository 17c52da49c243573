//! `tamis compare`: how far images are from their reference.

use std::path::{Path, PathBuf};

use bytesize::ByteSize;
use clap::Args;
use serde::Serialize;

use super::error::Error;
use super::log::Log;
use super::spare::spare;
use crate::image::exr::Window;
use crate::image::{Image, write_atomically};
use crate::report::page::compare::ComparePage;
use crate::report::score::{MetricsJson, json};
use crate::report::{Align, Contrast, FIGURES, Format, Table, common_window};
use crate::scene::load_image;

const EXAMPLES: &str = "\
Examples:
  tamis compare clean.exr reference.exr
  tamis compare --json clean.exr reference.exr
  tamis compare noisy.exr clean.exr other.exr reference.exr --html page.html

RelMSE is the mean over pixels and channels of (image - reference)² /
(reference² + 0.01); trimmed, the worst 0.1% of the pixels are left out, as a
handful of pixels at the edges of visible lights decides the plain mean. PSNR,
SSIM and FLIP see the images clamped to [0, 1] under the sRGB curve: SSIM is
scikit-image's with Gaussian weights, FLIP is LDR-FLIP at 67 pixels per degree.
The greater PSNR and SSIM the better. In JSON, infinite and unknown figures are
null; of several images it is a list.

--html writes one file for a browser, which fetches nothing: images to flip
between, with zoom, exposure and error maps, and crops of where they differ.

Images that begin at different places (data windows) are compared where all overlap.

Pixels of the reference that are not finite are left out, and counted. Pixels of
an image that are not finite make its errors infinite, and are counted too.";

/// Measure how far images are from their reference, and show where.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Compare {
    /// The images to be judged, and last the clean image of the same size (OpenEXR)
    #[arg(required = true, num_args = 2.., value_names = ["IMAGE", "REFERENCE"])]
    images: Vec<PathBuf>,

    /// Print JSON
    #[arg(long)]
    json: bool,

    /// Write a page for a browser, too
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl Compare {
    pub(super) fn run(&self, log: Log) -> Result<String, Error> {
        let (reference, paths) = self.images.split_last().expect("clap asks for two");
        if let Some(page) = &self.html {
            spare(page, self.images.iter().map(PathBuf::as_path))?;
        }
        let reference = load_image(reference)?;
        let images = paths.iter().map(|path| load_image(path)).collect::<Result<Vec<_>, _>>()?;
        let overlap = common_window(&images, &reference);
        let cut = |image: Image| match overlap {
            Some(window) => image.within(window),
            None => image,
        };
        let reference = cut(reference);
        let named = images.into_iter().zip(names(paths));
        let contrasts = named
            .map(|(image, name)| Contrast::of(name, cut(image), &reference))
            .collect::<Result<Vec<Contrast>, _>>()?;
        if let Some(path) = &self.html {
            let page = ComparePage { contrasts: &contrasts, reference: &reference, overlap }.html();
            write_atomically(path, page.as_bytes())?;
            let size = ByteSize::b(page.len() as u64);
            log.say(format_args!("wrote {} ({size})", path.display()));
        }
        Ok(if self.json { as_json(&contrasts, overlap) } else { table(&contrasts, overlap) })
    }
}

/// A column per image.
fn table(contrasts: &[Contrast], overlap: Option<Window>) -> String {
    let names = contrasts.iter().map(|contrast| match contrasts {
        [_] => "value".to_owned(),
        _ => contrast.name.clone(),
    });
    let names = names.map(|name| (name, Align::Right));
    let mut table = Table::new([("measure".to_owned(), Align::Left)].into_iter().chain(names));
    let mut row = |measure: &str, cells: Vec<String>| {
        table.row([measure.to_owned()].into_iter().chain(cells));
    };
    let figures: Vec<_> = contrasts.iter().map(Contrast::figures).collect();
    for figure in &FIGURES {
        row(figure.name, figures.iter().map(figure.text).collect());
    }
    if let Some(window) = overlap {
        let who = if contrasts.len() == 1 { "both" } else { "all" };
        row("compared", vec![format!("where {who} are: {window}"); contrasts.len()]);
    }
    let left_out = contrasts.iter().map(|contrast| contrast.comparison.left_out).collect();
    let bad = contrasts.iter().map(|contrast| contrast.comparison.bad).collect();
    let counts: [(&str, Vec<usize>); 2] =
        [("pixels left out", left_out), ("pixels not finite", bad)];
    for (measure, counts) in counts {
        if counts.iter().any(|count| *count > 0) {
            row(measure, counts.iter().map(usize::to_string).collect());
        }
    }
    table.render(Format::Plain)
}

/// An object of a single image, a list of several.
fn as_json(contrasts: &[Contrast], overlap: Option<Window>) -> String {
    let of = |contrast: &Contrast| {
        let figures = contrast.figures();
        ComparisonJson {
            image: (contrasts.len() > 1).then(|| contrast.name.clone()),
            metrics: MetricsJson::of(&figures.metrics),
            ssim: figures.ssim,
            flip: figures.flip,
            left_out: contrast.comparison.left_out,
            not_finite: contrast.comparison.bad,
            overlap: overlap.map(|window| window.to_string()),
        }
    };
    match contrasts {
        [only] => json(&of(only)),
        several => json(&several.iter().map(of).collect::<Vec<_>>()),
    }
}

/// The errors and what they leave out, as JSON spells them.
#[derive(Serialize)]
struct ComparisonJson {
    /// Which one, of several.
    #[serde(skip_serializing_if = "Option::is_none")]
    image: Option<String>,
    #[serde(flatten)]
    metrics: MetricsJson,
    ssim: Option<f64>,
    flip: Option<f64>,
    left_out: usize,
    not_finite: usize,
    /// The window that was compared, where the images begin at different places.
    #[serde(skip_serializing_if = "Option::is_none")]
    overlap: Option<String>,
}

/// What images are called: by their files' names, or where two have the same, by their paths.
fn names(paths: &[PathBuf]) -> Vec<String> {
    let short = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let is_own = |path: &PathBuf| paths.iter().filter(|p| short(p) == short(path)).count() == 1;
    let long = |path: &PathBuf| path.display().to_string();
    let name = |path: &PathBuf| match short(path) {
        Some(name) if is_own(path) => name,
        Some(_) | None => long(path),
    };
    paths.iter().map(name).collect()
}
