//! Open Image Denoise as a contestant, through its program `oidnDenoise`.
//!
//! Every run is a process of its own, which reads its images from files. The time
//! that counts is what it reports of its filter's execution; the whole process
//! stands beside it.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::contest::{Contestant, Lap, Round, Runner};
use super::program;
use crate::cli::error::Error;
use crate::expr::{Feature, PlaneId, Quantity};
use crate::image::{Image, pfm};
use crate::scene::{Needs, Samples};

/// Three channels, each row by row from the top.
type Channels = [Vec<f32>; 3];

/// What the program is called.
pub(super) const NAME: &str = "oidnDenoise";

/// Beside the colour: the option, and what it takes.
const GUIDES: [(&str, Feature); 2] = [("--alb", Feature::Texture), ("--nrm", Feature::Normal)];

/// How it takes part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Given {
    /// Whether it is given albedo and normal.
    guided: bool,
    /// Its `--quality`.
    quality: &'static str,
}

impl Given {
    pub(super) const ALL: [Self; 4] = [
        Self { guided: false, quality: "balanced" },
        Self { guided: true, quality: "fast" },
        Self { guided: true, quality: "balanced" },
        Self { guided: true, quality: "high" },
    ];

    /// What the table calls it.
    pub(super) fn title(self) -> String {
        let guides = if self.guided { "+albedo, normal" } else { "colour" };
        format!("oidn {}: {guides}", self.quality)
    }

    fn guides(self) -> &'static [(&'static str, Feature)] {
        if self.guided { &GUIDES } else { &[] }
    }

    /// The planes that it is made of.
    pub(super) fn needs(self) -> Needs {
        Needs::terms(self.guides().iter().map(|&(_, feature)| (feature, Quantity::Value)))
    }
}

/// The program with what it is given.
pub(super) struct Oidn {
    pub(super) program: PathBuf,
    pub(super) given: Given,
    pub(super) threads: usize,
}

struct Ready<'a> {
    round: &'a Round,
    command: Command,
    output: PathBuf,
    initialization: Option<Duration>,
    _folder: TempDir,
}

impl Contestant for Oidn {
    fn enter<'a>(&'a self, round: &'a Round) -> Result<Box<dyn Runner + 'a>, Error> {
        round.scene.require(&self.given.needs())?;
        let folder = program::folder()?;
        let mut command = Command::new(&self.program);
        let mut give = |option: &str, channels: &Channels| -> Result<(), Error> {
            let path = folder.path().join(format!("{}.pfm", option.trim_start_matches('-')));
            let channels = channels.each_ref().map(Vec::as_slice);
            fs::write(&path, pfm::write(round.reference.size(), channels))
                .map_err(program::file(&path, "write"))?;
            command.arg(option).arg(path);
            Ok(())
        };
        give("--hdr", &color(round))?;
        for &(option, feature) in self.given.guides() {
            give(option, &guide(round, feature))?;
        }
        let output = folder.path().join("out.pfm");
        command.arg("-o").arg(&output).args(["--quality", self.given.quality]);
        command.args(["--threads", &self.threads.to_string()]);
        Ok(Box::new(Ready { round, command, output, initialization: None, _folder: folder }))
    }
}

impl Runner for Ready<'_> {
    fn run(&mut self) -> Result<Lap, Error> {
        let start = Instant::now();
        let output = program::run(&mut self.command, "failed to filter")?;
        let process = start.elapsed();
        let said = String::from_utf8_lossy(&output.stdout);
        self.initialization = reported(&said, "filter");
        let time = reported(&said, "denoising").unwrap_or(process);
        Ok(Lap { time, process: Some(process) })
    }

    fn result(&mut self) -> Result<Image, Error> {
        let bytes = fs::read(&self.output).map_err(program::file(&self.output, "read"))?;
        let (width, height) = self.round.reference.size();
        let fault =
            |reason: &str| program::failed(&self.command, "wrote what cannot be read", reason);
        let pfm = pfm::read(&bytes).map_err(|reason| fault(&reason))?;
        let image = match <[Vec<f32>; 3]>::try_from(pfm.channels) {
            Ok(rgb) if pfm.size == (width, height) => {
                Image::new(self.round.scene.name(), width, height, rgb)
            }
            Ok(_) | Err(_) => None,
        };
        image.ok_or_else(|| fault("it is no image of that size in three channels"))
    }

    fn compile(&self) -> Option<Duration> {
        self.initialization
    }
}

fn color(round: &Round) -> Channels {
    let height = round.scene.layout().height();
    let flat = |channel: &Samples| (0..height).flat_map(|y| channel.pixels(y)).copied().collect();
    round.scene.color().each_ref().map(flat)
}

fn guide(round: &Round, feature: Feature) -> Channels {
    let (width, height) = (round.scene.layout().width(), round.scene.layout().height());
    [0, 1, 2].map(|component| {
        let id = PlaneId { feature, quantity: Quantity::Value, component };
        let plane = round.scene.plane(id).expect("enter() requires it");
        (0..height).flat_map(|y| (0..width).map(move |x| plane.at(x, y))).collect()
    })
}

/// The milliseconds that it reports under a heading that names `step`. What is
/// under a heading is indented; headings that tell of progress overwrite each other.
fn reported(said: &str, step: &str) -> Option<Duration> {
    let mut named = false;
    for line in said.split(['\n', '\r']).filter(|line| !line.trim().is_empty()) {
        if !line.starts_with(' ') {
            named = line.to_lowercase().contains(step);
        } else if named && let Some((_, figure)) = line.split_once("msec=") {
            let milliseconds: f64 = figure.split([',', ' ']).next()?.parse().ok()?;
            return Duration::try_from_secs_f64(milliseconds / 1e3).ok();
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_found_under_their_headings() {
        // As version 2.5.1 prints it.
        let said = "Initializing device\n  device=CPU, version=2.5.1, msec=305.066\n\
            Initializing filter\n  filter=RT, msec=6.1089\n\
            \rDenoising 0%\rDenoising 100% \r\n  msec=9.75, hash=a5\nSaving output\n";
        assert_eq!(reported(said, "filter"), Some(Duration::from_nanos(6_108_900)));
        assert_eq!(reported(said, "denoising"), Some(Duration::from_micros(9750)));
        assert_eq!(reported(said, "saving"), None);
        assert_eq!(reported("Denoising\n  msec=soon\n", "denoising"), None);
    }
}
