//! Shading languages: every export goes through whatever compiler or validator
//! there is for its language.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use libtest_mimic::Trial;
use tamis::export::{Language, Shading};
use tamis::filter::Filter;
use tamis::plan::Precision;

use crate::every::hostile_names;
use crate::fixture::{bred, parse};
use crate::harness::{is_required, trial};
use crate::{bytes, known_and_shipped};

pub(crate) const CASES: &[(&str, fn())] = &[
    ("shading::wgsl_is_valid", wgsl_is_valid),
    ("shading::metal_has_its_kernel_and_its_slots", metal_has_its_kernel_and_its_slots),
    ("shading::spirv_begins_as_it_should", spirv_begins_as_it_should),
    ("shading::names_survive", names_survive),
    ("shading::what_is_read_at_i_alone_has_a_buffer", what_is_read_at_i_alone_has_a_buffer),
    ("shading::fast_means_built_in_functions", fast_means_built_in_functions),
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
    ("named_filters_compile", Length::Short, || in_every_precision(known_and_shipped())),
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
    [known_and_shipped(), bred_filters(), shapes()].concat()
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
        let text = shader(&filter, Shading::Wgsl, precision);
        let module = naga::front::wgsl::parse_str(&text)
            .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&text)));
        let mut validator = naga::valid::Validator::new(
            naga::valid::ValidationFlags::all(),
            naga::valid::Capabilities::empty(),
        );
        validator
            .validate(&module)
            .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&text)));
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
