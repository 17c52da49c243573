//! Exported C in the loop nest of our own machine code, as a compiler makes it at its
//! best: `-O3 -march=native`, with vectors of either width, over blocks of either size.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use libloading::Library;
use tamis::backend::{Rect, TRUSTED_SHARE, TRUSTED_SUM};
use tamis::export::{self, Language, Options};
use tamis::expr::{PlaneId, Tree};
use tamis::filter::Filter;
use tamis::plan::{Precision, Run};
use tamis::scene::Scene;
use tamis::scene::plane::Plane;
use tempfile::TempDir;

const NEST: &str = include_str!("nest.c");

/// What makes C fast without changing its results: nobody asks for `errno` or for
/// traps.
const OPTIONS: &[&str] = &[
    "-std=c99",
    "-O3",
    "-march=native",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-shared",
    "-fPIC",
];

/// Channels: R, G, B and one.
const CHANNELS: usize = 4;

/// One way to have the nest compiled.
#[derive(Clone, Debug)]
pub(crate) struct Variant {
    pub(crate) compiler: PathBuf,
    /// Pixels side by side.
    block: usize,
    /// Bits of the vectors that the compiler should prefer.
    bits: u32,
}

impl Variant {
    /// All that are tried of a compiler.
    pub(crate) fn of(compiler: &Path) -> impl Iterator<Item = Self> {
        [(16, 512), (32, 512), (16, 256), (32, 256)].into_iter().map(|(block, bits)| Self {
            compiler: compiler.to_owned(),
            block,
            bits,
        })
    }

    /// What tables call it.
    pub(crate) fn name(&self) -> String {
        let file = self.compiler.file_name().unwrap_or_default().display();
        format!("{file} {}x{}", self.bits, self.block)
    }
}

type NestFunction = unsafe extern "C" fn(
    planes: *const *const f32,
    runs: *const CRun,
    count: usize,
    first: usize,
    stride: usize,
    top: i32,
    rows: i32,
    height: i32,
    width: usize,
    out: *mut f32,
);

/// `struct bench_run`.
#[repr(C)]
struct CRun {
    dx: i32,
    dy: i32,
    count: u32,
    step: i32,
}

/// The source of a weight's nest, but for what the variants differ in.
pub(crate) struct Source {
    text: String,
    images: Vec<PlaneId>,
    signed: bool,
}

impl Source {
    pub(crate) fn new(weight: &Tree, radius: u32, precision: Precision) -> Self {
        // The name that the nest knows.
        let named = Filter::single("bench", weight.clone(), radius);
        let options = Options { precision, without: &[] };
        let kernel = export::export(&named, Language::C, &options).expect("one stage");
        let text =
            String::from_utf8(kernel.into_file().expect("C is one file")).expect("C is text");
        // A call, which compilers make of long functions, cannot be vectorised.
        let text = ["float", "struct bench_features"].iter().fold(text, |text, kind| {
            let inline = format!("static inline __attribute__((always_inline)) {kind} bench_");
            text.replace(&format!("static {kind} bench_"), &inline)
        });
        let line = |start: &str| {
            let found = text.lines().map(str::trim).find(|line| line.starts_with(start));
            found.unwrap_or_default()
        };
        let terms = export::images(&named).expect("it was exported");
        let mut assignments = String::new();
        let mut images = Vec::new();
        for (feature, quantity) in terms {
            let field = feature.identifier(quantity);
            let components = PlaneId::components(feature, quantity);
            for component in 0..components {
                let index = if components == 1 { String::new() } else { format!("[{component}]") };
                assignments += &format!("filled.{field}{index} = *plane++;\n    ");
            }
            images.extend(PlaneId::of(feature, quantity));
        }
        let nest = NEST
            .replace("ASSIGN\n", &format!("{}\n", assignments.trim_end()))
            .replace("READ_I\n", &format!("{}\n", line("const struct bench_features i =")))
            .replace("READ_J\n", &format!("{}\n", line("const struct bench_features j =")))
            .replace("WEIGHT\n", &format!("{}\n", line("const float w =")));
        Self { signed: text.contains("float magnitude;"), text: text + &nest, images }
    }

    /// Has it compiled and loaded.
    pub(crate) fn compile(&self, variant: &Variant) -> Nest<'_> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let pragma = match variant.name().starts_with("clang") {
            true => "_Pragma(\"clang loop vectorize(assume_safety) unroll(disable)\")",
            false => "_Pragma(\"GCC ivdep\")",
        };
        let define = |name: &str, value: &str| format!("#define {name} {value}\n");
        let text = define("BLOCK", &variant.block.to_string())
            + &define("SIGNED", if self.signed { "1" } else { "0" })
            + &define("VECTORISE", pragma)
            + &self.text;
        fs::write(folder.path().join("nest.c"), text).expect("a writable folder");
        let made = Command::new(&variant.compiler)
            .current_dir(folder.path())
            .args(OPTIONS)
            .arg(format!("-mprefer-vector-width={}", variant.bits))
            .args(["-o", "nest.so", "nest.c", "-lm"])
            .output()
            .unwrap_or_else(|error| panic!("{}: {error}", variant.compiler.display()));
        let said = String::from_utf8_lossy(&made.stderr);
        assert!(made.status.success(), "{}: {said}", variant.name());
        let path = folder.path().join("nest.so");
        // SAFETY: the library is the nest that was compiled a moment ago; it has no
        // initialisers.
        let library = unsafe { Library::new(path) }.expect("a library that was just linked");
        Nest { source: self, library, _folder: folder }
    }
}

/// A compiled nest.
pub(crate) struct Nest<'a> {
    source: &'a Source,
    library: Library,
    _folder: TempDir,
}

/// What it takes of a scene: the planes that it reads.
pub(crate) struct Supply<'a> {
    scene: &'a Scene,
    /// Those that are constant here, written out.
    constants: Vec<(PlaneId, Vec<f32>)>,
}

impl<'a> Supply<'a> {
    pub(crate) fn new(scene: &'a Scene) -> Self {
        let constants = scene.planes().filter_map(|(id, plane)| match plane {
            Plane::Constant(value) => Some((id, vec![*value; scene.layout().samples()])),
            Plane::Samples(_) => None,
        });
        Self { scene, constants: constants.collect() }
    }

    fn plane(&self, id: PlaneId) -> *const f32 {
        match self.scene.plane(id).expect("every plane was loaded") {
            Plane::Samples(samples) => samples.as_slice().as_ptr(),
            Plane::Constant(_) => {
                let found = self.constants.iter().find(|(constant, _)| *constant == id);
                found.expect("new() wrote out all of them").1.as_ptr()
            }
        }
    }
}

impl Nest<'_> {
    /// The sums of whole rows of a scene, per row and sum.
    pub(crate) fn sums(&self, supply: &Supply<'_>, runs: &[Run], rect: Rect) -> Vec<f32> {
        let layout = supply.scene.layout();
        assert!(rect.x == 0 && rect.width == layout.width(), "whole rows");
        let color = supply.scene.color().each_ref().map(|channel| channel.as_slice().as_ptr());
        let one = supply.scene.ones().as_slice().as_ptr();
        let read = self.source.images.iter().map(|&id| supply.plane(id));
        let planes: Vec<*const f32> = color.into_iter().chain([one]).chain(read).collect();
        let runs: Vec<CRun> =
            runs.iter().map(|&Run { dx, dy, count, step }| CRun { dx, dy, count, step }).collect();
        let width = self.width(rect);
        let mut sums = vec![0.0; self.results() * width * rect.height];
        // SAFETY: the nest has this signature. Planes hold `stride` samples per row, and
        // more than 64 beyond the window's reach on the right, where the last block ends;
        // runs beyond the first and the last row are skipped; the sums have room for
        // `width` numbers each.
        unsafe {
            let nest = self.library.get::<NestFunction>(b"bench_nest").expect("the nest");
            nest(
                planes.as_ptr(),
                runs.as_ptr(),
                runs.len(),
                layout.index(0, 0),
                layout.stride(),
                rect.y as i32,
                rect.height as i32,
                layout.height() as i32,
                width,
                sums.as_mut_ptr(),
            );
        }
        sums
    }

    /// The colours that the sums make; none where the guard acts.
    pub(crate) fn colors(&self, sums: &[f32], rect: Rect) -> Vec<Option<[f32; 3]>> {
        let width = self.width(rect);
        let rows = sums.chunks_exact(self.results() * width);
        rows.flat_map(|row| (0..rect.width).map(move |x| [0, 1, 2, 3].map(|c| row[c * width + x])))
            .zip(self.magnitudes(sums, rect))
            .map(|([r, g, b, total], magnitude)| {
                let least = TRUSTED_SUM.max(TRUSTED_SHARE * magnitude);
                (total.abs() >= least).then(|| [r / total, g / total, b / total])
            })
            .collect()
    }

    fn magnitudes(&self, sums: &[f32], rect: Rect) -> Vec<f32> {
        let width = self.width(rect);
        let rows = sums.chunks_exact(self.results() * width);
        let last = (self.results() - 1) * width;
        rows.flat_map(|row| row[last..last + rect.width].iter().map(|sum| sum.abs())).collect()
    }

    fn results(&self) -> usize {
        CHANNELS + usize::from(self.source.signed)
    }

    /// Pixels computed per row: whole blocks, whatever the variant.
    fn width(&self, rect: Rect) -> usize {
        rect.width.next_multiple_of(32)
    }
}
