//! `tamis denoise`: filters one image.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;

use super::apply::{apply, needs, reach};
use super::error::Error;
use super::log::Log;
use super::options::Running;
use super::resolve::resolve;
use super::shipped;
use crate::report::{Picture, number};
use crate::scene::{Scene, SceneError};

const EXAMPLES: &str = "\
Examples:
  tamis denoise render.exr -o clean.exr
  tamis denoise render.exr -o clean.png --filter kan2017
  tamis denoise render.exr -o clean.exr --filter out/best.toml --radius 6 --timings
  tamis denoise render.exr -o clean.exr \\
      --filter 'exp(-distance2(normal, normal) / 0.1 - distance2(texture, texture) / 0.02)'

Only the channels that the filter reads are decoded.";

/// Filter a noisy image with the features in its file.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Denoise {
    /// The noisy image, with the features that the filter reads
    #[arg(value_name = "IN.exr")]
    input: PathBuf,

    /// Where the result goes: OpenEXR (linear R, G, B), or PNG (tone-mapped) by
    /// the name's ending
    #[arg(long, short, value_name = "OUT.exr")]
    output: PathBuf,

    /// A filter's name (see `tamis filters`), a filter file, or an expression
    #[arg(long, short, value_name = "NAME|FILE|EXPRESSION", default_value_t = shipped::default_name(), allow_hyphen_values = true)]
    filter: String,

    #[command(flatten)]
    running: Running,

    /// Say what each step took
    #[arg(long)]
    timings: bool,
}

/// What a result can be written as.
#[derive(Clone, Copy)]
enum Form {
    Exr,
    Png,
}

impl Denoise {
    pub(super) fn run(&self, log: Log) -> Result<String, Error> {
        let form = form(&self.output)?;
        self.check_output()?;
        let filter = resolve(&self.filter, self.running.radius)?;
        let backend = self.running.backend.open()?;

        let start = Instant::now();
        let options = self.running.load_options();
        let scene = Scene::load(&self.input, &needs(&filter), reach(&filter), &options)?;
        let loading = start.elapsed();
        let applied = apply(&filter, &scene, &*backend, self.running.passes())?;
        let start = Instant::now();
        match form {
            Form::Exr => applied.image.save(&self.output)?,
            Form::Png => Picture::of(&applied.image, 0.0).save(&self.output)?,
        }
        let writing = start.elapsed();

        for note in scene.notes() {
            log.say(format_args!("{}: {note}", self.input.display()));
        }
        let pixels = scene.layout().pixels();
        if applied.kept > 0 {
            log.say(format_args!(
                "{}: {} ({}) kept the noisy colour: their weights sum to nothing that can be trusted",
                self.output.display(),
                number::plural(applied.kept, "pixel"),
                number::percent(applied.kept, pixels),
            ));
        }
        log.say(format_args!(
            "{}: {}x{} pixels, filter `{}`, radius {}, {}, {}",
            self.output.display(),
            scene.layout().width(),
            scene.layout().height(),
            filter.name,
            reach(&filter),
            backend.name(),
            number::duration(applied.filtering),
        ));
        if self.timings {
            let taps: usize = filter.stages.iter().map(|stage| stage.window.taps()).sum();
            let pairs = (pixels * taps) as f64;
            let nanoseconds = applied.filtering.as_secs_f64() * 1e9 / pairs;
            log.say(format_args!(
                "load {}, plan {}, compile {}, filter {} ({nanoseconds:.2} ns per pixel pair), write {}",
                number::duration(loading),
                number::duration(applied.planning),
                number::duration(applied.compilation),
                number::duration(applied.filtering),
                number::duration(writing),
            ));
        }
        Ok(String::new())
    }

    /// Finds out before the work, rather than after it, that its result has no
    /// place to go.
    fn check_output(&self) -> Result<(), Error> {
        let (output, input) = (&self.output, &self.input);
        let same = match (output.canonicalize(), input.canonicalize()) {
            (Ok(output), Ok(input)) => output == input,
            (Err(_), _) | (_, Err(_)) => false,
        };
        if same {
            return Err(Error::Usage(format!(
                "{}: this is the input; give the result another name",
                output.display()
            )));
        }
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder
            && let Err(source) = std::fs::metadata(folder)
        {
            return Err(SceneError::Io {
                path: output.clone(),
                action: "write (its folder cannot be used)",
                source,
            }
            .into());
        }
        Ok(())
    }
}

fn form(output: &Path) -> Result<Form, Error> {
    let ending = output.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("exr") => Ok(Form::Exr),
        Some("png") => Ok(Form::Png),
        Some(_) | None => Err(Error::Usage(format!(
            "{}: results are written as .exr (linear) or .png (tone-mapped); \
             give the output one of these endings",
            output.display()
        ))),
    }
}
