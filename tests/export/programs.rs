//! Programs as C: compiled by this machine's compiler without a warning, they filter whole
//! images to the interpreter's bits.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::Command;

use tamis::backend::{Backend, Interpreter, Rect};
use tamis::export::{Export, ExportError, Language, Options, export};
use tamis::expr::{Feature, PlaneId, Quantity};
use tamis::filter::{Filter, shipped};
use tamis::plan::{Passes, Plan, Precision};
use tamis::scene::{Facts, LoadOptions, RawScene, Scene};

use crate::c::{bytes, compiler, succeed, supply};
use crate::every::hostile_names;
use crate::fixture::scene;
use crate::fixture_programs::{SAMPLE, random};

pub(crate) const CASES: &[(&str, fn())] = &[
    ("programs::tamis_gives_the_interpreters_bits_on_rendered_scenes", rendered_scenes),
    ("programs::shipped_programs_give_the_interpreters_bits", shipped_programs),
    ("programs::random_programs_give_the_interpreters_bits", random_programs),
    ("programs::what_is_absent_is_in_the_code", what_is_absent),
    ("programs::any_name_compiles", any_name_compiles),
    ("programs::bad_calls_write_nothing", bad_calls),
    ("programs::layers_are_loops_over_tables", layers_are_loops),
    ("programs::the_example_filters_what_a_renderer_has", the_example),
];

pub(crate) fn parse(text: &str) -> Filter {
    Filter::parse(text, Path::new("test.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// What holds of any scene without some features.
fn facts(without: &[Feature]) -> Facts {
    let all = Facts::of_any_scene();
    Facts::from_planes(all.iter().filter(|(plane, _)| !without.contains(&plane.feature)))
}

/// The plan that an export is made of.
fn plan(filter: &Filter, options: &Options<'_>) -> Plan {
    let passes = Passes { precision: options.precision, ..Passes::ALL };
    let checked = filter.check().expect("a sound filter");
    Plan::of(&checked, &facts(options.without), passes).expect("a sound filter")
}

/// The code and the header.
fn written(filter: &Filter, options: &Options<'_>) -> [String; 2] {
    match export(filter, Language::C, options).unwrap_or_else(|error| panic!("{error}")) {
        Export::WithHeader { code, header } => {
            [code, header].map(|text| String::from_utf8(text).expect("C is text"))
        }
        other => panic!("a program has a header: {other:?}"),
    }
}

/// The calls of filters, which the driver makes one after another.
fn calls(filters: &[Filter], options: &Options<'_>) -> String {
    let mut calls = String::new();
    for filter in filters {
        let name = &filter.name;
        let _ = writeln!(calls, "    {{\n        struct {name}_inputs in;");
        let _ = writeln!(calls, "        in.exposure = exposure;");
        let read = plan(filter, options).inputs();
        for (k, (feature, quantity)) in Feature::terms().enumerate() {
            let is_read = PlaneId::of(feature, quantity).any(|plane| read.contains(&plane));
            if feature == Feature::Pixel || !is_read {
                continue;
            }
            let field = feature.identifier(quantity);
            let components = PlaneId::components(feature, quantity);
            for c in 0..components {
                let index = if components == 1 { String::new() } else { format!("[{c}]") };
                let whole = if feature.row().per_image { "[0]" } else { "" };
                let from = 3 + 3 * k + c;
                let _ = writeln!(calls, "        in.{field}{index} = image({from}){whole};");
            }
        }
        let _ = writeln!(
            calls,
            "        scratch = (float *)malloc({name}_scratch(width, height) * sizeof(float));\n        \
             if (!scratch || {name}_filter(width, height, &in, rgb, scratch) != 0)\n            \
             return 5;\n        free(scratch);\n        \
             fwrite(rgb, sizeof(float), 3 * pixels, stdout);\n    }}"
        );
    }
    calls
}

const DRIVER: &str = r#"
#include <stdio.h>
#include <stdlib.h>
HEADERS
static float *images;
static size_t pixels;

static const float *image(size_t index)
{
    return images + index * pixels;
}

int main(int argc, char **argv)
{
    float *rgb, *scratch, exposure;
    size_t width, height, samples;
    FILE *file;
    if (argc != 6)
        return 2;
    width = (size_t)atoi(argv[2]);
    height = (size_t)atoi(argv[3]);
    pixels = width * height;
    samples = (size_t)atoi(argv[4]) * pixels;
    exposure = strtof(argv[5], NULL);
    file = fopen(argv[1], "rb");
    images = (float *)malloc(samples * sizeof(float));
    rgb = (float *)malloc(3 * pixels * sizeof(float));
    if (!file || !images || !rgb)
        return 3;
    if (fread(images, sizeof(float), samples, file) != samples)
        return 4;
    (void)image;
CALLS    return 0;
}
"#;

/// Compiles the filters' exports, each for itself, and a driver that knows their headers.
/// Then holds them to the interpreter, bit for bit.
fn agree(filters: &[Filter], scenes: &[Scene], options: &Options<'_>) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut headers = String::new();
    let mut compile = compiler(folder.path());
    for filter in filters {
        let [code, header] = written(filter, options);
        let name = &filter.name;
        fs::write(folder.path().join(format!("{name}.c")), code).expect("writable");
        fs::write(folder.path().join(format!("{name}.h")), header).expect("writable");
        let _ = writeln!(headers, "#include \"{name}.h\"");
        compile.arg(format!("{name}.c"));
    }
    let driver = DRIVER.replace("HEADERS\n", &headers).replace("CALLS", &calls(filters, options));
    fs::write(folder.path().join("driver.c"), driver).expect("writable");
    compile.args(["-o", "filters", "driver.c", "-lm"]);
    succeed(compile);

    let images = 3 + 3 * Feature::terms().count();
    for scene in scenes {
        let (width, height) = (scene.layout().width(), scene.layout().height());
        fs::write(folder.path().join("scene"), supply(scene)).expect("writable");
        let mut run = Command::new(folder.path().join("filters"));
        run.current_dir(folder.path()).arg("scene");
        run.args([width, height, images].map(|number| number.to_string()));
        run.arg(format!("{:e}", scene.normalization().exposure));
        let written = succeed(run);
        let per_filter = 3 * width * height * size_of::<f32>();
        assert_eq!(written.len(), filters.len() * per_filter);
        for (filter, written) in filters.iter().zip(written.chunks_exact(per_filter)) {
            let code = Interpreter.compile(&plan(filter, options)).expect("compiles");
            let filtered = code.run(scene, &[Rect::whole(scene)]).expect("runs").swap_remove(0);
            let expected = bytes(filtered.pixels.into_iter().flatten());
            let toml = || filter.to_toml(toml::Table::new());
            assert!(written == expected, "{width} x {height} pixels of:\n{}", toml());
        }
    }
}

fn rendered_scenes() {
    let filter = shipped::programs().next().expect("there are programs");
    assert_eq!(filter.name, "tamis");
    let options = Options::default();
    let Plan::Program(program) = plan(&filter, &options) else { panic!("it is a program") };
    let folders = fs::read_dir("data/test").expect("the repository is there");
    let scenes: Vec<Scene> = folders
        .map(|folder| folder.expect("it is readable").path().join("4spp.exr"))
        .map(|path| {
            let needs = filter.check().expect("a sound filter").needs();
            Scene::load(&path, &needs, program.reach, &LoadOptions::default())
                .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        })
        .collect();
    assert_eq!(scenes.len(), 3);
    agree(&[filter], &scenes, &options);
}

/// A filter with a name that C can tell from others.
fn numbered(k: usize, filter: Filter) -> Filter {
    Filter { name: format!("f{k}"), ..filter }
}

fn shipped_programs() {
    let programs = shipped::programs().chain([parse(SAMPLE)]).enumerate();
    let filters: Vec<Filter> = programs.map(|(k, filter)| numbered(k, filter)).collect();
    assert!(filters.len() >= 4);
    let scenes = [scene(37, 22, 5), scene(6, 5, 6), scene(1, 1, 7)];
    for precision in Precision::ALL {
        agree(&filters, &scenes, &Options { precision, without: &[] });
    }
}

fn random_programs() {
    let programs = (0..48).map(|seed| parse(&random(seed, 1 + seed as usize % 12))).enumerate();
    // One gather of the colour is exported as the paper's filters are.
    let programs = programs.filter(|(_, filter)| filter.paper().is_none());
    let filters: Vec<Filter> = programs.map(|(k, filter)| numbered(k, filter)).collect();
    assert!(filters.len() > 40);
    agree(&filters, &[scene(19, 14, 8), scene(2, 3, 9)], &Options::default());
}

fn what_is_absent() {
    let without = [Feature::Depth, Feature::Normal];
    let options = Options { without: &without, ..Options::default() };
    let filter = shipped::programs().next().expect("there are programs");
    let [code, header] = written(&filter, &options);
    for text in [&code, &header] {
        assert!(text.contains("Absent: `depth`. Instead of it, the code has 0."), "{header}");
        assert!(!text.contains(" *normal[3];") && text.contains(" *texture[3];"), "{header}");
    }
    let raw = crate::fixture::raw_with(23, 17, 10, 1.0, &without);
    agree(&[numbered(0, filter)], &[crate::fixture::prepare(raw)], &options);

    let required = parse(SAMPLE);
    let options = Options { without: &[Feature::Normal], ..Options::default() };
    let error = export(&required, Language::C, &options).expect_err("nothing stands in for it");
    let (filter, term) = ("sample".to_owned(), "normal".to_owned());
    assert_eq!(error, ExportError::Required { filter, term });
}

fn any_name_compiles() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in hostile_names() {
        let filter = Filter { name, ..parse(SAMPLE) };
        let [code, header] = written(&filter, &Options::default());
        fs::write(folder.path().join("named.c"), header + &code).expect("writable");
        let mut check = compiler(folder.path());
        check.args(["-fsyntax-only", "named.c"]);
        succeed(check);
    }
}

/// Sizes that are not accepted and null pointers.
fn bad_calls() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [code, _] = written(&numbered(0, parse(SAMPLE)), &Options::default());
    let main = r#"
#include <stdio.h>
int main(void)
{
    struct f0_inputs in = {0};
    float pixel[3] = {7.0f, 7.0f, 7.0f}, scratch[4096];
    const size_t huge = (size_t)-1;
    if (f0_scratch(0, 1) || f0_scratch(1, 0) || f0_scratch(huge, huge) || f0_scratch(huge, 1))
        return 1;
    if (f0_scratch((size_t)1 << 24, (size_t)1 << 24) && sizeof(size_t) < 8)
        return 2;
    if (f0_scratch(1, 1) < 1 || f0_scratch(1, 1) > 4096)
        return 3;
    if (f0_filter(0, 1, &in, pixel, scratch) != 1 || f0_filter(huge, 1, &in, pixel, scratch) != 1)
        return 4;
    if (f0_filter(1, 1, NULL, pixel, scratch) != 2 || f0_filter(1, 1, &in, NULL, scratch) != 2)
        return 5;
    if (f0_filter(1, 1, &in, pixel, NULL) != 2 || f0_filter(1, 1, &in, pixel, scratch) != 2)
        return 6;
    return pixel[0] == 7.0f ? 0 : 7;
}
"#;
    fs::write(folder.path().join("bad.c"), code + main).expect("writable");
    let mut compile = compiler(folder.path());
    compile.args(["-o", "bad", "bad.c", "-lm"]);
    succeed(compile);
    succeed(Command::new(folder.path().join("bad")));
}

fn layers_are_loops() {
    for filter in shipped::programs().filter(|filter| !filter.constants.layers.is_empty()) {
        let [code, _] = written(&filter, &Options::default());
        for layer in &filter.constants.layers {
            // A layer of one row is a sum.
            let is_loop = code.contains(&format!("_{}[row][column]", layer.name));
            assert!(is_loop || layer.rows() == 1, "{}: {}", filter.name, layer.name);
        }
    }
}

/// The channels of an image, as a PFM file.
fn pfm(width: usize, channels: &[Vec<f32>]) -> Vec<u8> {
    let height = channels[0].len() / width;
    let mut file = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    for y in (0..height).rev() {
        let row = (y * width..(y + 1) * width).flat_map(|k| channels.iter().map(move |c| c[k]));
        file.extend(row.flat_map(f32::to_le_bytes));
    }
    file
}

/// `examples/filter_pfm.c`, as its first lines say, prepares images as Tamis does.
fn the_example() {
    let (width, height) = (29, 18);
    let prepared = scene(width, height, 12);
    let channels = |feature| {
        let planes = PlaneId::of(feature, Quantity::Value);
        let scale = if feature == Feature::Color { prepared.normalization().exposure } else { 1.0 };
        planes
            .map(|id| {
                let plane = prepared.plane(id).expect("the scene has every feature");
                (0..width * height).map(|k| plane.at(k % width, k / width) * scale).collect()
            })
            .collect::<Vec<Vec<f32>>>()
    };
    let [color, albedo, normal] = [Feature::Color, Feature::Texture, Feature::Normal].map(channels);

    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, channels) in [("color", &color), ("albedo", &albedo), ("normal", &normal)] {
        let path = folder.path().join(format!("{name}.pfm"));
        fs::write(path, pfm(width, channels)).expect("writable");
    }
    let filter = shipped::programs().find(|filter| filter.name == "tamis-formula");
    let filter = filter.expect("it is shipped");
    let options = Options { without: &[Feature::Depth], ..Options::default() };
    let [code, header] = written(&filter, &options);
    fs::write(folder.path().join("tamis_formula.c"), code).expect("writable");
    fs::write(folder.path().join("tamis_formula.h"), header).expect("writable");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/filter_pfm.c");
    let mut compile = compiler(folder.path());
    compile.args(["-I.", "-o", "filter_pfm", "tamis_formula.c"]).arg(example).arg("-lm");
    succeed(compile);
    let mut run = Command::new(folder.path().join("filter_pfm"));
    run.current_dir(folder.path()).args(["color.pfm", "albedo.pfm", "normal.pfm", "clean.pfm"]);
    succeed(run);

    let colors: [Vec<f32>; 3] = color.try_into().expect("three channels");
    let raw = RawScene::new("example", width, height, colors)
        .with(Feature::Texture, Quantity::Value, albedo)
        .with(Feature::Normal, Quantity::Value, normal);
    let scene = crate::fixture::prepare(raw);
    let code = Interpreter.compile(&plan(&filter, &options)).expect("compiles");
    let filtered = code.run(&scene, &[Rect::whole(&scene)]).expect("runs").swap_remove(0);
    let expected: Vec<Vec<f32>> =
        (0..3).map(|c| filtered.pixels.iter().map(|pixel| pixel[c]).collect()).collect();
    let result = fs::read(folder.path().join("clean.pfm")).expect("it was written");
    assert!(result == pfm(width, &expected), "the example's pixels are others");

    // What cannot be read is told.
    fs::write(folder.path().join("short.pfm"), &result[..result.len() - 1]).expect("writable");
    for (file, complaint) in [("short.pfm", "ends too early"), ("none.pfm", "cannot be opened")] {
        let mut run = Command::new(folder.path().join("filter_pfm"));
        run.current_dir(folder.path()).args([file, "albedo.pfm", "normal.pfm", "again.pfm"]);
        let output = run.output().expect("it starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(
            !output.status.success() && said.contains(file) && said.contains(complaint),
            "{said}"
        );
    }
}
