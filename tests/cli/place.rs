//! A folder with a small scene in it, and the program running there.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, WritableImage};
use serde_json::Value;

pub(crate) const WIDTH: usize = 24;
pub(crate) const HEIGHT: usize = 20;

/// A channel's name, and its sample in column x and row y.
pub(crate) type Channel = (&'static str, fn(usize, usize) -> f32);

/// Two walls of different brightness that meet at an edge in the normals.
pub(crate) const CLEAN: [Channel; 3] = [
    ("R", |x, _| if x < 12 { 0.8 } else { 0.2 }),
    ("G", |x, _| if x < 12 { 0.6 } else { 0.3 }),
    ("B", |x, _| if x < 12 { 0.4 } else { 0.5 }),
];

pub(crate) const NOISY: [Channel; 9] = [
    ("R", |x, y| CLEAN[0].1(x, y) * noise(x, y, 1)),
    ("G", |x, y| CLEAN[1].1(x, y) * noise(x, y, 2)),
    ("B", |x, y| CLEAN[2].1(x, y) * noise(x, y, 3)),
    ("Normal.X", |x, _| if x < 12 { 1.0 } else { 0.0 }),
    ("Normal.Y", |x, _| if x < 12 { 0.0 } else { 1.0 }),
    ("Normal.Z", |_, _| 0.0),
    ("Albedo.R", |x, _| if x < 12 { 0.8 } else { 0.4 }),
    ("Albedo.G", |_, _| 0.5),
    ("Albedo.B", |_, _| 0.5),
];

/// A factor around 1 that nobody could guess from the pixel's neighbours.
fn noise(x: usize, y: usize, salt: u32) -> f32 {
    let mut bits = (x as u32 * 73_856_093) ^ (y as u32 * 19_349_663) ^ (salt * 83_492_791);
    bits ^= bits >> 13;
    bits = bits.wrapping_mul(0x5bd1_e995);
    bits ^= bits >> 15;
    0.2 + 1.6 * (bits & 0xffff) as f32 / 65_535.0
}

pub(crate) fn write_exr(path: &Path, channels: &[Channel]) {
    let samples = |f: fn(usize, usize) -> f32| {
        FlatSamples::F32((0..WIDTH * HEIGHT).map(|i| f(i % WIDTH, i / WIDTH)).collect())
    };
    let channels =
        AnyChannels::sort(channels.iter().map(|&(n, f)| AnyChannel::new(n, samples(f))).collect());
    let layer = Layer::new((WIDTH, HEIGHT), Default::default(), Encoding::FAST_LOSSLESS, channels);
    Image::from_layer(layer).write().to_file(path).expect("a writable folder");
}

/// A grey image in half floats, compressed as B44, in one chunk.
#[cfg(debug_assertions)]
pub(crate) fn write_b44(path: &Path) {
    let samples = || FlatSamples::F16(vec![exr::prelude::f16::from_f32(0.5); WIDTH * HEIGHT]);
    let channels = ["R", "G", "B"].map(|name| AnyChannel::new(name, samples()));
    let encoding =
        Encoding { compression: exr::prelude::Compression::B44, ..Encoding::FAST_LOSSLESS };
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let layer = Layer::new((WIDTH, HEIGHT), Default::default(), encoding, channels);
    Image::from_layer(layer).write().to_file(path).expect("a writable folder");
}

/// A folder with a scene in it: `room/4spp.exr` and `room/reference.exr`.
pub(crate) struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    pub(crate) fn new() -> Self {
        let place = Self { folder: tempfile::tempdir().expect("a temporary folder") };
        fs::create_dir(place.path("room")).expect("a writable folder");
        write_exr(&place.path("room/4spp.exr"), &NOISY);
        write_exr(&place.path("room/reference.exr"), &CLEAN);
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program, about to run in the folder.
    pub(crate) fn program(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tamis"));
        command.current_dir(self.folder.path()).args(arguments).stdin(Stdio::null());
        command
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        self.program(arguments).output().expect("the program starts")
    }

    /// Runs what must work; returns stdout.
    pub(crate) fn done(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    /// Runs what must fail with a status, naming what is given; returns stderr.
    #[track_caller]
    pub(crate) fn fails(&self, status: i32, arguments: &[&str], named: &[&str]) -> String {
        let before = self.files();
        let output = self.run(arguments);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {message}");
        assert!(output.stdout.is_empty(), "results on stdout of a failed run");
        for name in named {
            assert!(message.contains(name), "{arguments:?}: no `{name}` in: {message}");
        }
        assert!(!message.contains("panicked"), "{message}");
        assert_eq!(self.files(), before, "{arguments:?} left files behind");
        message
    }

    /// Every file in and below the folder.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        fn list(folder: &Path, found: &mut Vec<PathBuf>) {
            for entry in fs::read_dir(folder).expect("readable") {
                let path = entry.expect("readable").path();
                if path.is_dir() { list(&path, found) } else { found.push(path) }
            }
        }
        let mut found = Vec::new();
        list(self.folder.path(), &mut found);
        found.sort();
        found
    }

    /// The values of `--lanes` that this host can do.
    pub(crate) fn lanes(&self) -> Vec<String> {
        let host = json(&self.done(&["inspect", "--host", "--json"]));
        let vectors = host["vectors"].as_array().expect("a list").clone();
        let possible = vectors.iter().filter(|entry| entry["lacking"].is_null());
        possible.map(|entry| entry["bits"].to_string()).collect()
    }

    /// The bits of an image's colours: files also say what made them.
    pub(crate) fn pixels(&self, name: &str) -> Vec<u32> {
        let image = tamis::scene::load_image(&self.path(name)).expect("an image");
        image.rgb().concat().into_iter().map(f32::to_bits).collect()
    }

    pub(crate) fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub(crate) fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error} in: {text}"))
}

/// A filter that reads the normals.
pub(crate) const EDGE_AWARE: &str = "exp(-distance2(normal, normal) / 0.1)";
