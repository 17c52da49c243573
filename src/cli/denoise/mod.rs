//! `tamis denoise`: filters one image, or several: a single one is a sequence
//! of one.

mod files;
mod frame;
mod inputs;
mod numbers;
mod pattern;
mod pipeline;
mod progress;
mod sequence;
mod shard;
mod sources;
mod streams;
mod tally;
mod timings;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};

use super::backend::Opened;
use super::error::Error;
use super::log::Log;
use super::options::Running;
use super::resolve::resolve;
use crate::denoise::{Denoiser, Options};
use crate::filter::shipped;
use crate::report::{Form, number};
use files::{Files, Frame};
use frame::{Job, Remark};
use inputs::is_stream;
use pipeline::Pipeline;
use progress::Progress;
use sequence::Sequence;
use sources::Sources;
use streams::Streams;
use tally::Tally;

const EXAMPLES: &str = "\
Examples:
  tamis denoise render.exr -o clean.exr
  tamis denoise render.exr -o clean.exr --layers 'light_*'
  tamis denoise render.exr -o clean.exr --map albedo=DiffuseFilter,normal=BumpNormals
  tamis denoise hdr.pfm -o clean.pfm --albedo alb.pfm --normal nrm.pfm
  tamis denoise render.exr -o clean.png --filter kan2017
  tamis denoise frames/*.exr -o clean/ --backend gpu
  tamis denoise frames/*.exr -o preview/ --format png --timings
  tamis denoise frames/ -o clean/ --skip-existing
  tamis denoise shot.####.exr -o clean/shot.####.exr --frames 1-240x2
  tamis denoise shot.%04d.exr -o clean/ --frames 1-240 --shard 3/16 --json --keep-going
  render | tamis denoise - -o - > clean.exr
  tamis denoise render.exr -o clean.exr --filter out/best.toml --radius 6
  tamis denoise render.exr -o clean.exr \\
      --filter 'exp(-distance2(normal, normal) / 0.1 - distance2(texture, texture) / 0.02)'

Only the channels that the filter reads are decoded. Without --filter, a file that lacks
what the best filter reads (direct light, say) is filtered with what it has, and a line
says so; with --filter, a missing feature is an error.

Several images are filtered one after another; meanwhile the next is loaded and
the one before is written, so there are at most three in memory (four with a GPU,
which filters two at a time). One that fails does not stop the others; failures are
listed at the end, and the exit status is then 1.

In shot.####.exr each # is a digit of the frame's number, as in shot.%04d.exr; without
--frames these are all frames that are there. A glob in quotes ('frames/*.exr') is
expanded by the program, and a folder stands for every .exr file directly in it.

With --json stdout has a line per frame, with the keys frame (its number, if it has
one), input, output, status (done, skipped or failed), seconds, filter and error.";

/// Filter noisy images with the features in their files.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Denoise {
    /// The noisy images, with the features that the filter reads: files, folders, patterns
    /// such as shot.####.exr or shot.%04d.exr, or - for standard input
    #[arg(required = true, num_args = 1.., value_name = "IN.exr")]
    inputs: Vec<PathBuf>,

    /// Where the result goes: OpenEXR (the input with its colour replaced), PNG
    /// (tone-mapped) or PFM by the name's ending; or a folder, where results have their
    /// inputs' names, and which is made if its name ends in /; or a pattern such as
    /// clean/shot.####.exr, which gets the frames' numbers; or - for standard output
    #[arg(long, short, value_name = "OUT.exr|DIR/")]
    output: PathBuf,

    /// What results in a folder, or on standard output, are written as [default: exr]
    #[arg(long, value_enum, value_name = "FORMAT")]
    format: Option<Form>,

    /// A filter's name (see `tamis filters`), a filter file, or an expression
    /// [default: for each image the best shipped filter that its file can feed]
    #[arg(long, short, value_name = "NAME|FILE|EXPRESSION", allow_hyphen_values = true)]
    filter: Option<String>,

    /// How much of the result is taken, from 0 to 1; the rest is the noisy image
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = strength)]
    strength: f32,

    /// What becomes of the alpha of the colour
    #[arg(long, value_enum, value_name = "HOW", default_value_t = Alpha::Keep)]
    alpha: Alpha,

    /// Make PNG results brighter by so many stops, or darker
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = stops, allow_negative_numbers = true)]
    exposure: f32,

    #[command(flatten)]
    running: Running,

    /// Say what each step took
    #[arg(long)]
    timings: bool,

    #[command(flatten)]
    sequence: Sequence,

    // The last, as its heading would stand above what follows.
    #[command(flatten)]
    sources: Sources,
}

impl ValueEnum for Form {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.ending()).help(self.doc()))
    }
}

/// Reads a number of photographic stops.
fn stops(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(stops) if (-64.0..=64.0).contains(&stops) => Ok(stops),
        Ok(_) | Err(_) => Err("it must be a number of stops from -64 to 64".to_owned()),
    }
}

/// What becomes of the alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Alpha {
    /// It stays as it is, and where it and the colour are zero, the result is
    Keep,
    /// It is filtered by the colour's weights
    Filter,
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
        let (files, several) = self.files()?;
        if files.len() == 0 {
            log.say("nothing to do: there are fewer frames than shares");
            return Ok(String::new());
        }
        let radius = self.running.radius;
        let filter = match &self.filter {
            Some(text) => resolve(text, radius)?,
            None => resolve(&shipped::best().name, radius)?,
        };
        let Opened { backend, frames } = self.running.backend.open(log)?;
        // One frame is read and one written while others are filtered.
        let flying = files.len().min(frames.get() + 2) as u64;
        let options = Options {
            filter: Some(filter),
            passes: self.running.passes(),
            load: self.running.load_options(),
            selection: self.sources.selection(),
            layers: self.sources.layers.clone(),
            filters_alpha: self.alpha == Alpha::Filter,
            strength: Some(self.strength),
            max_memory: Some(self.running.backend.memory_for_scenes() / flying),
        };
        let job = Job {
            denoiser: Denoiser::new(backend.into(), options),
            form: files.form(),
            is_named: self.filter.is_some(),
            exposure: self.exposure,
        };
        let streams = Streams::open(files.frame(0))?;

        let start = started.elapsed();
        let progress = Progress::new(log, files.len());
        let mut tally = Tally::new(self.sequence.json);
        let (mut fed, mut left_out) = (Vec::new(), None);
        let run = Pipeline::new(frames).run(
            files.len(),
            |frame| {
                let frame = files.frame(frame);
                if self.skips(frame) {
                    return Ok(None);
                }
                progress.step("loading");
                job.load(streams.source(frame), &self.sources.aux(frame)?).map(Some)
            },
            |_, loaded| {
                let Some(loaded) = loaded else { return Ok(None) };
                progress.step("filtering");
                let told = |done, of| {
                    progress.rows(done, of);
                    ControlFlow::Continue(())
                };
                job.filter(loaded, &told).map(Some)
            },
            |place, filtered| {
                let frame = files.frame(place);
                let written = match filtered {
                    Ok(Some(filtered)) => {
                        progress.step("writing");
                        // Without it no result has a place to go.
                        files.make_folder()?;
                        let written = job.write(frame, streams.target(frame), filtered);
                        written.and_then(|written| streams.deliver().map(|()| Some(written)))
                    }
                    Ok(None) => Ok(None),
                    Err(error) => Err(error),
                };
                match written.map_err(|error| streams.named(error)) {
                    Ok(Some(written)) => {
                        progress.aside(|| {
                            // Frames of a sequence are alike: what differs is told.
                            if written.feeds != fed {
                                let input = frame.input_name();
                                for feeds in &written.feeds {
                                    log.say(format_args!("{input}: {feeds}"));
                                }
                            }
                            if let Some(text) = &written.left_out
                                && written.left_out != left_out
                            {
                                log.say(format_args!("{}: {text}", frame.output_name()));
                            }
                            written.remarks.iter().for_each(|remark| match remark {
                                Remark::Warning(text) => log.warn(text),
                                Remark::Detail(text) => log.say(text),
                            });
                            if self.timings {
                                log.say(written.timings);
                            }
                            tally.done(frame, &written.filter, written.timings)
                        })?;
                        (fed, left_out) = (written.feeds, written.left_out);
                    }
                    Ok(None) => progress.aside(|| tally.skipped(frame))?,
                    Err(error) => {
                        progress.aside(|| {
                            if several {
                                log.error(&error);
                            }
                            tally.failed(frame, &error)
                        })?;
                        if !several {
                            return Err(error);
                        }
                    }
                }
                progress.advance(place + 1, tally.skipped);
                Ok(())
            },
        );
        progress.finish();
        run?;
        if tally.skipped > 0 {
            log.say(format_args!(
                "{} of {} skipped, as their results exist",
                tally.skipped,
                number::plural(files.len(), "frame"),
            ));
        }
        if self.timings && !tally.done.is_empty() {
            log.say(timings::summary(&tally.done, start, started.elapsed()));
        }
        tally.verdict(files.len()).map(|()| String::new())
    }

    /// The files of this run, and whether they are of several frames: a share of these is
    /// several even if it is one.
    fn files(&self) -> Result<(Files, bool), Error> {
        let Sequence { frames, shard, keep_going, json, .. } = &self.sequence;
        if *json && is_stream(&self.output) {
            return Err(Error::Usage(
                "--json: standard output is taken by --output -; write the result into a file"
                    .to_owned(),
            ));
        }
        let is_frame = |path: &Path| !self.sources.is_beside(path);
        let inputs = inputs::find(&self.inputs, frames.as_ref(), *keep_going, &is_frame)?;
        let mut files = Files::of(&inputs, &self.output, self.format)?;
        let several = files.len() > 1;
        if !keep_going {
            let beside = |frame: &Frame| {
                let aux = self.sources.aux(frame)?;
                Ok(aux.into_iter().map(|aux| aux.path).collect())
            };
            files.find_the_inputs(|frame| !self.skips(frame), beside)?;
        }
        if let Some(shard) = *shard {
            files = files.share(shard);
        }
        Ok((files, several))
    }

    /// Whether a frame is left out, as its result exists.
    fn skips(&self, frame: &Frame) -> bool {
        self.sequence.skip_existing && frame.output.is_file()
    }
}
