//! `tamis denoise`: filters one image, or several: a single one is a sequence
//! of one.

mod files;
mod form;
mod frame;
mod pipeline;
mod progress;
mod sources;
mod timings;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;

use super::backend::Opened;
use super::error::Error;
use super::log::Log;
use super::options::Running;
use super::resolve::resolve;
use crate::denoise::{Denoiser, Options};
use files::Files;
use form::Form;
use frame::Job;
use pipeline::Pipeline;
use progress::Progress;
use sources::Sources;

const EXAMPLES: &str = "\
Examples:
  tamis denoise render.exr -o clean.exr
  tamis denoise render.exr -o clean.png --filter kan2017
  tamis denoise frames/*.exr -o clean/ --backend gpu
  tamis denoise frames/*.exr -o preview/ --format png --timings
  tamis denoise render.exr -o clean.exr --filter out/best.toml --radius 6
  tamis denoise render.exr -o clean.exr \\
      --filter 'exp(-distance2(normal, normal) / 0.1 - distance2(texture, texture) / 0.02)'

Only the channels that the filter reads are decoded. Without --filter, a file that lacks
what the best filter reads (direct light, say) is filtered with what it has, and a line
says so; with --filter, a missing feature is an error.

Several images are filtered one after another; meanwhile the next is loaded and
the one before is written, so there are at most three in memory (four with a GPU,
which filters two at a time). One that fails does not stop the others; the exit
status is then 1.";

/// Filter noisy images with the features in their files.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Denoise {
    /// The noisy images, with the features that the filter reads
    #[arg(required = true, num_args = 1.., value_name = "IN.exr")]
    inputs: Vec<PathBuf>,

    /// Where the result goes: OpenEXR (the input with its colour replaced), PNG
    /// (tone-mapped) or PFM by the name's ending; or a folder, where results have their inputs' names,
    /// and which is made if its name ends in /
    #[arg(long, short, value_name = "OUT.exr|DIR/")]
    output: PathBuf,

    /// What results in a folder are written as [default: exr]
    #[arg(long, value_enum, value_name = "FORMAT")]
    format: Option<Form>,

    /// A filter's name (see `tamis filters`), a filter file, or an expression
    /// [default: for each image the best shipped filter that its file can feed]
    #[arg(long, short, value_name = "NAME|FILE|EXPRESSION", allow_hyphen_values = true)]
    filter: Option<String>,

    /// How much of the result is taken, from 0 to 1; the rest is the noisy image
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = strength)]
    strength: f32,

    /// Make PNG results brighter by so many stops, or darker
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,

    #[command(flatten)]
    sources: Sources,

    #[command(flatten)]
    running: Running,

    /// Say what each step took
    #[arg(long)]
    timings: bool,
}

/// Reads a share.
fn strength(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        Ok(_) | Err(_) => Err("it must be a number from 0 to 1".to_owned()),
    }
}

impl Denoise {
    pub(super) fn run(&self, log: Log, started: Instant) -> Result<String, Error> {
        let files = Files::of(&self.inputs, &self.output, self.format)?;
        let radius = self.running.radius;
        let filter = self.filter.as_ref().map(|text| resolve(text, radius)).transpose()?;
        let Opened { backend, frames } = self.running.backend.open(log)?;
        // One frame is read and one written while others are filtered.
        let flying = files.len().min(frames.get() + 2) as u64;
        let options = Options {
            filter,
            radius,
            passes: self.running.passes(),
            load: self.running.load_options(),
            selection: self.sources.selection(),
            strength: Some(self.strength),
            max_memory: Some(self.running.backend.memory_for_scenes() / flying),
        };
        let job = Job {
            denoiser: Denoiser::new(&*backend, options),
            form: files.form(),
            is_named: self.filter.is_some(),
            aux: self.sources.aux(),
            exposure: self.exposure,
        };

        let start = started.elapsed();
        let several = files.len() > 1;
        let progress = Progress::new(log, files.len());
        let mut timings = Vec::with_capacity(files.len());
        let mut fed = Vec::new();
        let run = Pipeline::new(frames).run(
            files.len(),
            |frame| job.load(files.frame(frame)),
            |_, loaded| job.filter(loaded),
            |frame, filtered| {
                let written = match filtered {
                    Ok(filtered) => {
                        // Without it no result has a place to go.
                        files.make_folder()?;
                        job.write(files.frame(frame), filtered)
                    }
                    Err(error) => Err(error),
                };
                match written {
                    Ok(written) => {
                        progress.aside(|| {
                            // Frames of a sequence are alike: what differs is told.
                            if written.feeds != fed {
                                let input = files.frame(frame).input.display();
                                for feeds in &written.feeds {
                                    log.say(format_args!("{input}: {feeds}"));
                                }
                            }
                            written.warnings.iter().for_each(|warning| log.warn(warning));
                            written.remarks.iter().for_each(|remark| log.say(remark));
                            if self.timings {
                                log.say(written.timings);
                            }
                        });
                        fed = written.feeds;
                        timings.push(written.timings);
                    }
                    Err(error) if several => progress.aside(|| log.error(&error)),
                    Err(error) => return Err(error),
                }
                progress.advance(frame + 1);
                Ok(())
            },
        );
        progress.finish();
        run?;
        if self.timings && !timings.is_empty() {
            log.say(timings::summary(&timings, start, started.elapsed()));
        }
        match files.len() - timings.len() {
            0 => Ok(String::new()),
            failed => Err(Error::Frames { failed, of: files.len() }),
        }
    }
}
