//! `tamis stress`: a filter's stability certificate.

mod engines;
mod page;

use std::path::{Path, PathBuf};

use clap::Args;

use super::backend::LanesArgs;
use super::error::Error;
use super::log::Log;
use super::resolve::resolve;
use super::{Report, apply, scenes};
use crate::denoise::DenoiseError;
use crate::filter::{Filter, Window};
use crate::image::write_atomically;
use crate::report::score::json;
use crate::scene::{LoadOptions, RawScene};
use crate::stress::{Engine, Ground, SEED, StressError, Verdict, certify};
use engines::Opened;

const EXAMPLES: &str = "\
Examples:
  tamis stress tamis
  tamis stress tamis
  tamis stress out/best.toml --scenes data/train data/test
  tamis stress 'exp(-distance2(normal, normal) / 0.1)' --scenes render.exr --json

The filter is tried on small scenes that are made to be difficult, and on the
scenes given, there with windows of radius 2 at most (programs run whole, which
takes minutes). It is held to its exact meaning in f64 on every back end that
runs such filters; its result must not change much with the last
bit of a feature, nor with exposure, the world's unit and place, or the image's
orientation; and what is missing, constant or no number must do no harm.

Exit status: 0 stable or sensitive, 1 unstable or the work failed, 2 the command
line is wrong.";

/// How `--scenes` spells an argument here: nothing is compared with a reference.
const VALUE: &str = "DIR|NOISY.exr";

/// Certify that a filter is stable, or say why it is not.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Stress {
    /// A filter's name (see `tamis filters`), a filter file, or an expression
    #[arg(value_name = "FILTER")]
    filter: String,

    /// Folders with 4spp.exr and reference.exr in or below them, or noisy images
    /// [default: made scenes alone]
    #[arg(long, alias = "scene", num_args = 1.., value_name = VALUE)]
    scenes: Vec<PathBuf>,

    /// Window radius in pixels [default: the filter's own; 10 for expressions]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(..=i64::from(Window::MAX_RADIUS)))]
    radius: Option<u32>,

    /// Names the random numbers that scenes and noise are made of
    #[arg(long, value_name = "N", default_value_t = SEED)]
    seed: u64,

    #[command(flatten)]
    lanes: LanesArgs,

    /// Which GPU: an index or a part of its name (see `tamis gpus`) [default: the
    /// best, if there is one]
    #[arg(long, value_name = "NAME|INDEX")]
    gpu: Option<String>,

    /// A file for the certificate as JSON
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Stress {
    pub(super) fn run(&self, log: Log) -> Result<Report, Error> {
        let filter = resolve(&self.filter, self.radius)?;
        let grounds = grounds(&self.scenes, &filter)?;
        let opened = engines::open(self.lanes.lanes, self.gpu.as_deref())?;
        for Opened { name, backend, .. } in &opened {
            if let Err(absent) = backend {
                log.say(format_args!("{name}: {absent}"));
            }
        }
        let engines: Vec<Engine<'_>> = opened
            .iter()
            .map(|Opened { name, backend, precision }| Engine {
                name: name.clone(),
                backend: backend.as_ref().map(|b| &**b).map_err(Clone::clone),
                precision: *precision,
            })
            .collect();
        let certificate = certify(&apply::checked(&filter), &grounds, &engines, self.seed)
            .map_err(|error| failure(&filter, error))?;
        let text = json(&certificate);
        if let Some(output) = &self.output {
            write_atomically(output, text.as_bytes())?;
        }
        let text = if self.json { text } else { page::text(&certificate) };
        Ok(Report { bytes: text.into_bytes(), good: certificate.verdict < Verdict::Unstable })
    }
}

/// The scenes that arguments stand for, with what a filter reads of them.
fn grounds(arguments: &[PathBuf], filter: &Filter) -> Result<Vec<Ground>, Error> {
    let mut noisy: Vec<PathBuf> = Vec::new();
    for argument in arguments {
        let found = match argument.is_file() {
            true => vec![argument.clone()],
            false => scenes::find(std::slice::from_ref(argument))?
                .into_iter()
                .map(|files| files.noisy)
                .collect(),
        };
        for path in found {
            if !noisy.contains(&path) {
                noisy.push(path);
            }
        }
    }
    noisy.iter().map(|path| ground(path, filter)).collect()
}

fn ground(noisy: &Path, filter: &Filter) -> Result<Ground, Error> {
    let needs = apply::needs(filter);
    Ok(Ground::real(RawScene::read(noisy, &needs, &LoadOptions::default())?))
}

/// Why there is no certificate, as other commands say it.
fn failure(filter: &Filter, error: StressError) -> Error {
    let filter = filter.name.clone();
    match error {
        StressError::Scene(error) => error.into(),
        StressError::Plan { scene, source } => DenoiseError::Plan { scene, filter, source }.into(),
        StressError::Run { scene, source } => DenoiseError::Run { scene, filter, source }.into(),
    }
}
