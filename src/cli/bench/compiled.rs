//! Exported C as a contestant: what a filter costs in somebody else's renderer.
//!
//! The export is compiled with a small program around it (`driver.c`) that keeps
//! its images and filters them on request, so that rounds can be interleaved and
//! no start of a process is in the time.

use std::fmt::Write as _;
use std::fs;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::contest::{Contestant, Lap, Round, Runner};
use super::program;
use crate::cli::apply::needs;
use crate::cli::error::Error;
use crate::export::{self, Language, Options};
use crate::expr::{Feature, PlaneId, Quantity};
use crate::filter::Filter;
use crate::image::Image;
use crate::scene::Samples;

const DRIVER: &str = include_str!("driver.c");

/// What makes code fast without changing a bit of its results.
const OPTIONS: &[&str] =
    &["-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O3", "-march=native", "-pthread"];

/// A filter's export, compiled.
pub(super) struct Compiled {
    filter: Filter,
    images: Vec<(Feature, Quantity)>,
    threads: usize,
    compile: Duration,
    folder: TempDir,
}

impl Compiled {
    /// Exports a filter and compiles it.
    pub(super) fn new(filter: &Filter, compiler: &Path, threads: usize) -> Result<Self, Error> {
        // The name that the driver knows.
        let named = Filter { name: "bench".to_owned(), ..filter.clone() };
        let images = export::images(&named)?;
        let kernel = export::export(&named, Language::C, &Options::default())?;
        let kernel = kernel.into_file().expect("C is one file");
        let mut assignments = String::new();
        let mut assign = |place: &str| {
            let _ = writeln!(assignments, "images.{place} = image;\n        image += pixels;");
        };
        for c in 0..3 {
            assign(&format!("noisy[{c}]"));
        }
        for &(feature, quantity) in &images {
            let field = feature.identifier(quantity);
            match PlaneId::components(feature, quantity) {
                1 => assign(&field),
                components => (0..components).for_each(|c| assign(&format!("{field}[{c}]"))),
            }
        }
        let source = String::from_utf8(kernel).expect("C is text")
            + &DRIVER.replace("ASSIGN", assignments.trim_end());
        let folder = program::folder()?;
        let path = folder.path().join("filter.c");
        fs::write(&path, source).map_err(program::file(&path, "write"))?;
        let mut command = Command::new(compiler);
        command.current_dir(folder.path()).args(OPTIONS).args(["-o", "filter", "filter.c", "-lm"]);
        let start = Instant::now();
        program::run(&mut command, "failed to compile the exported filter")?;
        let compile = start.elapsed();
        Ok(Self { filter: filter.clone(), images, threads, compile, folder })
    }
}

impl Contestant for Compiled {
    fn enter<'a>(&'a self, round: &'a Round) -> Result<Box<dyn Runner + 'a>, Error> {
        round.scene.require(&needs(&self.filter))?;
        let folder = self.folder.path();
        let [given, output] = ["given", "result"].map(|name| folder.join(name));
        let (count, bytes) = supply(round, &self.images);
        fs::write(&given, bytes).map_err(program::file(&given, "write"))?;
        let (width, height) = round.reference.size();
        let mut command = Command::new(folder.join("filter"));
        command.arg(given).args([width, height, count, self.threads].map(|n| n.to_string()));
        command.arg(&output);
        let process = Process::start(command)?;
        Ok(Box::new(Running { round, process, output, compile: self.compile }))
    }
}

/// The images in the order in which the driver takes them, and their number.
fn supply(round: &Round, images: &[(Feature, Quantity)]) -> (usize, Vec<u8>) {
    let (width, height) = (round.scene.layout().width(), round.scene.layout().height());
    let mut bytes = Vec::new();
    let mut count = 0;
    let mut add = |at: &dyn Fn(usize, usize) -> f32| {
        for k in 0..width * height {
            bytes.extend(at(k % width, k / width).to_ne_bytes());
        }
        count += 1;
    };
    for channel in round.scene.color() {
        add(&|x, y| Samples::at(channel, x, y));
    }
    for plane in images.iter().flat_map(|&(feature, quantity)| PlaneId::of(feature, quantity)) {
        let plane = round.scene.plane(plane).expect("enter() requires what the filter reads");
        add(&|x, y| plane.at(x, y));
    }
    (count, bytes)
}

struct Running<'a> {
    round: &'a Round,
    process: Process,
    output: PathBuf,
    compile: Duration,
}

impl Runner for Running<'_> {
    fn run(&mut self) -> Result<Lap, Error> {
        let time = self.process.request(b'r')?;
        Ok(Lap { time, process: None })
    }

    fn result(&mut self) -> Result<Image, Error> {
        self.process.request(b'w')?;
        let bytes = fs::read(&self.output).map_err(program::file(&self.output, "read"))?;
        let (width, height) = self.round.reference.size();
        let samples: Vec<f32> =
            bytes.as_chunks::<4>().0.iter().map(|&sample| f32::from_ne_bytes(sample)).collect();
        let mut channels = samples.chunks(width * height);
        let rgb = [0, 1, 2].map(|_| channels.next().unwrap_or_default().to_vec());
        Image::new(self.round.scene.name(), width, height, rgb).ok_or_else(|| {
            self.process.failed(io::Error::new(io::ErrorKind::UnexpectedEof, "its result is short"))
        })
    }

    fn compile(&self) -> Option<Duration> {
        Some(self.compile)
    }
}

/// The compiled program, waiting for requests. It ends when it is dropped.
struct Process {
    command: Command,
    child: Child,
    requests: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
}

const FILTERING: &str = "failed (the compiled export)";

impl Process {
    fn start(mut command: Command) -> Result<Self, Error> {
        let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = match piped.spawn() {
            Ok(child) => child,
            Err(error) => return Err(program::failed(&command, FILTERING, &error.to_string())),
        };
        let requests = child.stdin.take();
        let answers = BufReader::new(child.stdout.take().expect("it is piped"));
        Ok(Self { command, child, requests, answers })
    }

    /// Asks for something to be done; returns the time that the answer states.
    fn request(&mut self, what: u8) -> Result<Duration, Error> {
        let mut answer = String::new();
        let requests = self.requests.as_mut().expect("only dropping takes it");
        let asked = requests.write_all(&[what]).and_then(|()| requests.flush());
        let answered = asked.and_then(|()| self.answers.read_line(&mut answer));
        match (answered, answer.trim().parse()) {
            (Ok(_), Ok(nanoseconds)) => Ok(Duration::from_nanos(nanoseconds)),
            (Ok(_), Err(_)) => Err(self.failed(io::ErrorKind::UnexpectedEof.into())),
            (Err(error), _) => Err(self.failed(error)),
        }
    }

    /// The error, with what the program said and how it ended.
    fn failed(&mut self, error: io::Error) -> Error {
        self.requests = None;
        let mut said = String::new();
        if let Some(stderr) = &mut self.child.stderr {
            // What cannot be read is not told.
            let _ = stderr.read_to_string(&mut said);
        }
        let end = self.child.wait().map_or(String::new(), |status| format!(", {status}"));
        program::failed(&self.command, FILTERING, &format!("{error}{end} {}", said.trim()))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // The end of its requests ends it; if it does not want to, force does.
        self.requests = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
