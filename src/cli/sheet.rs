//! `tamis sheet`: a contact sheet of one scene.

use std::path::PathBuf;

use clap::Args;

use super::error::Error;
use super::log::Log;
use super::measure::Measuring;
use super::options::Running;
use super::{scenes, score};
use crate::image::{Image, Metrics};
use crate::report::sheet::{Panel, sheet};
use crate::report::{Picture, number};
use crate::scene::load_reference;

const EXAMPLES: &str = "\
Examples:
  tamis sheet data/test/kitchen -o kitchen.png --filters bilateral out/best.toml
  tamis sheet noisy.exr,clean.exr -o detail.png --crop 100,80,64,64 --zoom 4 --exposure 1";

/// Draw a scene noisy, filtered and clean, side by side.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Sheet {
    /// A folder with 4spp.exr and reference.exr, or a pair of files
    #[arg(value_name = scenes::VALUE)]
    scene: PathBuf,

    /// The picture to be drawn
    #[arg(long, short, value_name = "SHEET.png")]
    output: PathBuf,

    /// Filters: names, files or expressions [default: all that have names]
    #[arg(long, num_args = 1.., value_name = "FILTER")]
    filters: Vec<String>,

    /// Brighten the pictures by photographic stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,

    /// Show a part only
    #[arg(long, value_name = "X,Y,WIDTH,HEIGHT", value_parser = crop)]
    crop: Option<Crop>,

    /// Draw every pixel as a block of so many by so many
    #[arg(long, value_name = "TIMES", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    zoom: u8,

    /// Panels per row [default: all in one row]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    columns: Option<u16>,

    #[command(flatten)]
    running: Running,
}

/// A part of a picture.
#[derive(Clone, Copy, Debug)]
struct Crop {
    corner: (usize, usize),
    size: (usize, usize),
}

fn crop(text: &str) -> Result<Crop, String> {
    let numbers: Option<Vec<usize>> =
        text.split(',').map(|part| part.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, width, height]) if width > 0 && height > 0 => {
            Ok(Crop { corner: (x, y), size: (width, height) })
        }
        Some(_) | None => Err("four numbers are needed: left, top, width, height".to_owned()),
    }
}

impl Sheet {
    pub(super) fn run(&self, log: Log) -> Result<String, Error> {
        if self.output.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("png")) {
            return Err(Error::Usage(format!(
                "{}: contact sheets are PNG files; give the output the ending .png",
                self.output.display()
            )));
        }
        let backend = self.running.backend.open(log)?.backend;
        let filters = score::filters(&self.filters, self.running.radius)?;
        let files = scenes::one(&self.scene)?;
        let measuring = Measuring::with(&self.running, &*backend);
        let scene = measuring.load(&files, &filters)?;
        let reference = load_reference(&files.reference)?;
        let noisy = scene.noisy();
        self.check_crop(noisy.size())?;
        let panel = |title: &str, image: &Image| -> Result<Panel, Error> {
            let metrics = Metrics::of(image, &reference)?;
            Ok(Panel {
                subtitle: format!("RelMSE {}", number::rel_mse(&metrics)),
                ..self.panel(title, image)
            })
        };
        let mut panels = vec![panel("noisy", &noisy)?];
        for filter in &filters {
            match measuring.apply(filter, &scene) {
                Ok((image, _)) => panels.push(panel(&filter.name, &image)?),
                // Whoever names a filter wants it; of all filters, those that can run.
                Err(error) if self.filters.is_empty() => log.say(error),
                Err(error) => return Err(error),
            }
        }
        panels.push(self.panel("reference", &reference));
        let columns = self.columns.map_or(panels.len(), usize::from);
        sheet(&panels, columns).save(&self.output)?;
        log.say(format_args!("{}: {} panels", self.output.display(), panels.len()));
        Ok(String::new())
    }

    fn panel(&self, title: &str, image: &Image) -> Panel {
        let whole = Picture::of(image, self.exposure);
        let part = self.crop.map_or(whole.clone(), |crop| whole.cropped(crop.corner, crop.size));
        let picture = part.enlarged(usize::from(self.zoom));
        Panel { picture, title: title.to_owned(), subtitle: String::new() }
    }

    fn check_crop(&self, (width, height): (usize, usize)) -> Result<(), Error> {
        match self.crop {
            Some(Crop { corner: (x, y), .. }) if x >= width || y >= height => Err(Error::Usage(
                format!("--crop: ({x}, {y}) lies outside of an image of {width}x{height} pixels"),
            )),
            Some(_) | None => Ok(()),
        }
    }
}
