//! Shading languages: every export goes through whatever compiler or validator
//! there is for its language.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use libtest_mimic::Trial;
use tamis::export::{Export, Language, Options, Shading, export};
use tamis::filter::{Filter, shipped};
use tamis::plan::Precision;

use crate::every::hostile_names;
use crate::fixture::{bred, parse};
use crate::fixture_programs::{SAMPLE, random};
use crate::harness::{is_required, trial};
use crate::programs::parse as parse_program;
use crate::{bytes, known};

pub(crate) const CASES: &[(&str, fn())] = &[
    ("shading::wgsl_is_valid", wgsl_is_valid),
    ("shading::metal_has_its_kernel_and_its_slots", metal_has_its_kernel_and_its_slots),
    ("shading::spirv_begins_as_it_should", spirv_begins_as_it_should),
    ("shading::names_survive", names_survive),
    ("shading::what_is_read_at_i_alone_has_a_buffer", what_is_read_at_i_alone_has_a_buffer),
    ("shading::fast_means_built_in_functions", fast_means_built_in_functions),
    ("shading::manifests_say_what_kernels_take", manifests_say_what_kernels_take),
    ("shading::programs_in_wgsl_are_valid", programs_in_wgsl_are_valid),
];

/// The tests that take a program, ignored where it is absent.
pub(crate) fn compiled() -> Vec<Trial> {
    let mut trials = Vec::new();
    for checker in &CHECKERS {
        let ignored = !checker.is_there() && !is_required();
        for &(case, length, files) in CASES_OF_A_CHECKER {
            let name = format!("shading::{}::{case}", checker.language().name());
            trials.push(trial(name, ignored, move || checker.accept(length, &files())));
        }
        let name = format!("shading::{}::programs_compile", checker.language().name());
        trials.push(trial(name, ignored, || checker.accept_programs()));
    }
    trials
}

/// Exports by names for people.
type Files = Vec<(String, Filter, Precision)>;

/// How many files a test has.
#[derive(Clone, Copy, PartialEq)]
enum Length {
    Short,
    Long,
}

/// A test of a checker.
type Case = (&'static str, Length, fn() -> Files);

const CASES_OF_A_CHECKER: &[Case] = &[
    ("named_filters_compile", Length::Short, || in_every_precision(known())),
    ("weights_of_every_shape_compile", Length::Short, || in_every_precision(shapes())),
    ("bred_filters_compile", Length::Long, || in_every_precision(bred_filters())),
    ("any_name_compiles", Length::Long, || {
        let named = |name: String| Filter::single(name, parse("nVariance"), 2);
        let files = hostile_names().into_iter().map(named);
        files.map(|filter| (format!("{:?}", filter.name), filter, Precision::Standard)).collect()
    }),
];

/// A program that says whether shaders are valid.
struct Checker {
    shading: Shading,
    program: &'static str,
    /// Debian's package of it.
    package: &'static str,
    /// With these it takes one file.
    arguments: &'static [&'static str],
    /// With these it takes any number, if it does: it starts slowly, and links what
    /// it is to translate.
    at_once: Option<&'static [&'static str]>,
}

const CHECKERS: [Checker; 3] = [
    Checker {
        shading: Shading::Glsl,
        program: "glslangValidator",
        package: "glslang-tools",
        arguments: &["-V", "-S", "comp", "-o", "/dev/null"],
        at_once: Some(&["-S", "comp"]),
    },
    Checker {
        shading: Shading::Hlsl,
        program: "glslangValidator",
        package: "glslang-tools",
        arguments: &["-V", "-D", "-e", "main", "-S", "comp", "-o", "/dev/null"],
        at_once: None,
    },
    Checker {
        shading: Shading::Spirv,
        program: "spirv-val",
        package: "spirv-tools",
        arguments: &["--target-env", "vulkan1.1"],
        at_once: None,
    },
];

impl Checker {
    fn language(&self) -> Language {
        Language::Shading(self.shading)
    }

    fn is_there(&self) -> bool {
        Command::new(self.program).arg("--version").output().is_ok()
    }

    /// Holds exports to the program.
    fn accept(&self, length: Length, files: &Files) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut paths = Vec::new();
        for (k, (_, filter, precision)) in files.iter().enumerate() {
            let path = folder.path().join(format!("{k}.{}", self.language().ending()));
            fs::write(&path, bytes(filter, self.language(), *precision)).expect("writable");
            paths.push(path);
        }
        match self.at_once.filter(|_| length == Length::Long) {
            Some(arguments) => {
                // The complaints name files by their numbers.
                let complaint = self.check(arguments, &paths).err();
                assert_eq!(complaint, None);
            }
            None => {
                for ((name, _, precision), path) in files.iter().zip(&paths) {
                    let complaint = self.check(self.arguments, std::slice::from_ref(path)).err();
                    assert_eq!(complaint, None, "{name}, {}", precision.name());
                }
            }
        }
    }

    /// Holds the kernels of programs to the program.
    fn accept_programs(&self) {
        for (name, filter, precision) in programs() {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let (kernels, manifest) = kernels(&filter, self.shading, precision);
            let described = manifest["kernels"].as_array().expect("a list");
            for ((file, bytes), kernel) in kernels.iter().zip(described) {
                let path = folder.path().join(file);
                fs::write(&path, bytes).expect("writable");
                let entry = kernel["entry"].as_str().expect("a name");
                // The program is told the entry point's name.
                let named = |&argument: &&'static str| match argument {
                    "main" => entry,
                    argument => argument,
                };
                let arguments: Vec<&str> = self.arguments.iter().map(named).collect();
                let complaint = self.check(&arguments, &[path]).err();
                assert_eq!(complaint, None, "{name}: {file}");
            }
        }
    }

    fn check(&self, arguments: &[&str], paths: &[PathBuf]) -> Result<(), String> {
        let Self { program, package, .. } = self;
        let checked = Command::new(program).args(arguments).args(paths).output();
        let output = checked.unwrap_or_else(|error| {
            panic!("{program} cannot be run: {error}; install Debian's {package}")
        });
        let said = [output.stdout, output.stderr].concat();
        match output.status.success() {
            true => Ok(()),
            false => Err(String::from_utf8_lossy(&said).into_owned()),
        }
    }
}

/// The programs that are shipped, one of everything, and random ones.
fn programs() -> Files {
    let random = (0..6).map(|seed| parse_program(&random(seed, 2 + seed as usize)));
    let random = random.filter(|filter| filter.paper().is_none());
    let programs = shipped::programs().chain([parse_program(SAMPLE)]).chain(random);
    let named = |filter: Filter| (filter.name.clone(), filter, Precision::Standard);
    let fast = (SAMPLE.to_owned(), parse_program(SAMPLE), Precision::Fast);
    programs.map(named).chain([fast]).collect()
}

/// A program's kernels by their files' names, and its manifest.
fn kernels(
    filter: &Filter,
    shading: Shading,
    precision: Precision,
) -> (Vec<(String, Vec<u8>)>, serde_json::Value) {
    let options = Options { precision, without: &[] };
    let exported = export(filter, Language::Shading(shading), &options);
    let Export::Folder(mut files) = exported.unwrap_or_else(|error| panic!("{error}")) else {
        panic!("a program is a folder");
    };
    let (name, manifest) = files.pop().expect("the manifest is the last");
    assert_eq!(name, "manifest.json");
    (files, serde_json::from_slice(&manifest).expect("JSON"))
}

/// How a buffer's length follows from the sizes, which stand in for their names.
fn length(formula: &str, sizes: &[(&str, usize)]) -> usize {
    let factor = |word: &str| {
        let size = sizes.iter().find(|(name, _)| *name == word).map(|(_, size)| *size);
        size.unwrap_or_else(|| word.parse().expect("a number or a size"))
    };
    let product = |term: &str| term.split(" * ").map(factor).product::<usize>();
    formula.split(" + ").map(product).sum()
}

fn manifests_say_what_kernels_take() {
    for (name, filter, precision) in programs() {
        let [wgsl, spirv] = [Shading::Wgsl, Shading::Spirv].map(|s| kernels(&filter, s, precision));
        for (files, manifest) in [&wgsl, &spirv] {
            let described = manifest["kernels"].as_array().expect("a list");
            let names: Vec<&str> =
                described.iter().map(|k| k["file"].as_str().expect("a name")).collect();
            assert_eq!(names, files.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>());
            let buffers = manifest["buffers"].as_array().expect("a list");
            let called: Vec<&str> =
                buffers.iter().map(|b| b["name"].as_str().expect("a name")).collect();
            assert_eq!(
                called,
                ["params", "features", "taps", "planes", "kept", "result"],
                "{name}"
            );
            for (k, buffer) in buffers.iter().enumerate() {
                assert_eq!((&buffer["group"], &buffer["binding"]), (&0.into(), &k.into()));
            }
            let sizes = [
                ("width", 7),
                ("height", 5),
                ("half_width", 4),
                ("half_height", 3),
                ("wanted_width", 6),
                ("wanted_height", 2),
            ];
            let lengths: Vec<usize> = buffers
                .iter()
                .map(|b| length(b["length"].as_str().expect("a formula"), &sizes))
                .collect();
            let features = buffers[1]["holds"].as_array().expect("planes").len();
            let taps = manifest["taps"].as_array().expect("numbers").len();
            assert_eq!(lengths[1..3], [features * 35, taps], "{name}");
            assert_eq!(lengths[4..], [filter.stages.len(), 12], "{name}");
            let fields = buffers[0]["fields"].as_array().expect("a list");
            let offsets: Vec<u64> =
                fields.iter().map(|f| f["offset"].as_u64().expect("bytes")).collect();
            assert_eq!(offsets, [0, 8, 16, 24, 32, 40, 44]);
            assert!(manifest["halo"].as_u64().expect("pixels").is_multiple_of(2));
        }
        let wgsl = wgsl.0.iter().zip(wgsl.1["kernels"].as_array().expect("a list"));
        for ((file, text), kernel) in wgsl {
            let text = String::from_utf8_lossy(text);
            let entry = format!("fn {}(", kernel["entry"].as_str().expect("a name"));
            assert!(text.contains(&entry) && text.contains("@workgroup_size(8, 8)"), "{file}");
        }
    }
}

fn programs_in_wgsl_are_valid() {
    let hostile = hostile_names().into_iter().map(|name| Filter { name, ..parse_program(SAMPLE) });
    let hostile = hostile.map(|filter| (filter.name.clone(), filter, Precision::Standard));
    for (name, filter, precision) in programs().into_iter().chain(hostile) {
        for (file, text) in kernels(&filter, Shading::Wgsl, precision).0 {
            is_valid(&format!("{name}: {file}"), &String::from_utf8(text).expect("WGSL is text"));
        }
    }
}

/// Fails unless naga takes it, with nothing beyond what WebGPU has.
fn is_valid(name: &str, text: &str) {
    let module = naga::front::wgsl::parse_str(text)
        .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(text)));
    let mut validator = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::empty(),
    );
    validator
        .validate(&module)
        .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(text)));
}

fn in_every_precision(filters: Vec<Filter>) -> Files {
    let name = |filter: &Filter| {
        format!("{}: {}", filter.name, filter.paper().expect("one gather").weight)
    };
    let both = |filter: Filter| Precision::ALL.map(|p| (name(&filter), filter.clone(), p));
    filters.into_iter().flat_map(both).collect()
}

fn bred_filters() -> Vec<Filter> {
    let bred = bred().into_iter().enumerate();
    let bred: Vec<Filter> =
        bred.map(|(k, weight)| Filter::single(format!("f{k}"), parse(weight), 3)).collect();
    assert_eq!(bred.len(), 30);
    bred
}

/// Weights of both signs, of nothing, of one side, of one axis, of coordinates.
fn shapes() -> Vec<Filter> {
    let weights = [
        "0",
        "1",
        "distance1(pixel, pixel) - 1.2",
        "1 + nVariance",
        "(distance1(pixel, pixel) - 1.2) * nVariance",
        "1 / (1 + dot(pixel, pixel))",
        "1 / (1 + distance1(depth, pixel))",
        "dot(depth, normal)",
        "exp(-distance2(wpGradient, dGradient)) + distanceMax(diGradient, secTGradient)",
    ];
    weights.map(|weight| Filter::single("shape", parse(weight), 2)).into()
}

fn every_filter() -> Vec<Filter> {
    [known(), bred_filters(), shapes()].concat()
}

fn shader(filter: &Filter, shading: Shading, precision: Precision) -> String {
    let bytes = bytes(filter, Language::Shading(shading), precision);
    String::from_utf8(bytes).expect("the language is text")
}

fn wgsl_is_valid() {
    let mut filters = every_filter();
    let named = |name| Filter::single(name, parse("exp(-distance2(normal, normal))"), 2);
    filters.extend(hostile_names().into_iter().map(named));
    for (name, filter, precision) in in_every_precision(filters) {
        is_valid(&name, &shader(&filter, Shading::Wgsl, precision));
    }
}

fn metal_has_its_kernel_and_its_slots() {
    for (name, filter, precision) in in_every_precision(every_filter()) {
        let text = shader(&filter, Shading::Msl, precision);
        let head = "[[max_total_threads_per_threadgroup(64)]] kernel void main_(";
        let (_, kernel) = text.split_once(head).unwrap_or_else(|| panic!("{name}: {text}"));
        let (arguments, body) = kernel.split_once(") {").expect("a body follows");
        let slots = ["params [[buffer(0)]]", "near [[buffer(1)]]", "result [[buffer(4)]]"];
        for slot in slots.into_iter().chain(["_buffer_sizes [[buffer(5)]]"]) {
            assert!(arguments.contains(slot), "{name}: {arguments}");
        }
        let own = arguments.contains("own [[buffer(2)]]");
        assert_eq!(arguments.matches("[[buffer(").count(), if own { 5 } else { 4 });
        // As the comment says.
        assert!(!body.contains("_buffer_sizes"));
        assert!(text.contains("The kernel `main_`"));
    }
}

fn spirv_begins_as_it_should() {
    for (name, filter, precision) in in_every_precision(every_filter()) {
        let bytes = bytes(&filter, Language::Shading(Shading::Spirv), precision);
        let (words, rest) = bytes.as_chunks::<4>();
        assert!(rest.is_empty(), "{name}");
        let words: Vec<u32> = words.iter().map(|&word| u32::from_le_bytes(word)).collect();
        // The magic number, the version, a generator, a bound on ids, a zero; then
        // OpCapability Shader.
        assert_eq!((words[0], words[1]), (0x0723_0203, 0x0001_0300), "{name}");
        assert_eq!((words[4], words[5], words[6]), (0, (2 << 16) | 17, 1), "{name}");
        let holds = |text: &str| bytes.windows(text.len()).any(|at| at == text.as_bytes());
        assert!(holds("main\0") && holds("weight\0") && holds("exported by Tamis"), "{name}");
    }
}

fn names_survive() {
    for (name, filter, precision) in in_every_precision(every_filter()) {
        for (shading, expected) in [
            (Shading::Wgsl, ["fn weight(", "fn main(", "@binding(1)", "@binding(4)"]),
            (Shading::Glsl, ["float weight(", "void main(", "binding = 1)", "binding = 4)"]),
            (Shading::Hlsl, ["float weight(", "void main(", "register(t1)", "register(u4)"]),
            (Shading::Msl, ["float weight(", "void main_(", "[[buffer(1)]]", "[[buffer(4)]]"]),
        ] {
            let text = shader(&filter, shading, precision);
            for expected in expected {
                assert!(text.contains(expected), "{name}: no {expected} in {text}");
            }
            for plane in text.lines().filter(|line| line.starts_with("//     ")) {
                assert!(!plane.contains("_group_"), "{name}: {plane}");
            }
        }
        let glsl = shader(&filter, Shading::Glsl, precision);
        assert!(glsl.starts_with("#version 450 core\n// Filter \""), "{name}: {glsl}");
    }
}

fn what_is_read_at_i_alone_has_a_buffer() {
    for (weight, has_own) in
        [("1 + nVariance", true), ("distance2(normal, normal)", false), ("1", false)]
    {
        let filter = Filter::single("own", parse(weight), 2);
        for (shading, slot, told) in [
            (Shading::Wgsl, "@binding(2)", "binding 2"),
            (Shading::Glsl, "binding = 2)", "binding 2"),
            (Shading::Hlsl, "register(t2)", "register t2"),
            (Shading::Msl, "[[buffer(2)]]", "buffer 2"),
        ] {
            let text = shader(&filter, shading, Precision::Standard);
            assert_eq!((text.contains(slot), text.contains(told)), (has_own, has_own), "{text}");
        }
    }
}

fn fast_means_built_in_functions() {
    let filter = Filter::single("pow", parse("pow(nVariance, distance1(normal, normal))"), 2);
    for shading in [Shading::Wgsl, Shading::Glsl, Shading::Hlsl, Shading::Msl] {
        let [exact, fast] = Precision::ALL.map(|precision| shader(&filter, shading, precision));
        for function in ["exp2(", "log2("] {
            assert!(fast.contains(function) && !exact.contains(function), "{fast}\n{exact}");
        }
        assert!(exact.contains("pinned(") && !fast.contains("pinned("));
        assert!(exact.contains("precision standard") && fast.contains("precision fast"));
    }
}
