//! C, as people use it: compiled by this machine's compiler without a warning, it
//! filters whole images to the interpreter's bits.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::Command;

use tamis::backend::{Backend, Filtered, Interpreter, Rect};
use tamis::export::Language;
use tamis::expr::{Feature, PlaneId};
use tamis::filter::{Filter, Window};
use tamis::plan::{Passes, Precision, WindowPlan};
use tamis::scene::{Facts, Scene};

use crate::every::hostile_names;
use crate::fixture::{bred, parse, scene};
use crate::{bytes as export_as, known, text};

pub(crate) const CASES: &[(&str, fn())] = &[
    ("c::named_filters_give_the_interpreters_bits", named_filters),
    ("c::bred_filters_give_the_interpreters_bits", bred_filters),
    ("c::weights_of_every_shape_give_the_interpreters_bits", weights_of_every_shape),
    ("c::any_name_compiles", any_name_compiles),
];

/// A filter of the fixture's kind, called by a letter and a number.
fn numbered(k: usize, weight: &str, window: Window) -> Filter {
    let mut filter = Filter::single(format!("f{k}"), parse(weight), 0);
    filter.gathers_mut().next().expect("one gather").window = window;
    filter
}

/// The plan that an export is made of.
fn plan(filter: &Filter, precision: Precision) -> WindowPlan {
    let stage = filter.paper().expect("one gather");
    // Exports filter every pixel.
    let passes = Passes { hoist: false, uniform: false, precision, ..Passes::ALL };
    let weights = std::slice::from_ref(&stage.weight);
    WindowPlan::new(weights, stage.window, &Facts::of_any_scene(), passes).expect("a sound filter")
}

/// The machine's C compiler, without which nothing here could have been linked.
/// Whatever it warns of is an error.
pub(crate) fn compiler(folder: &Path) -> Command {
    let mut command = Command::new("cc");
    command.current_dir(folder);
    command.args(["-std=c99", "-O2", "-ffp-contract=off"]);
    command.args(["-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("fma") {
        command.arg("-mfma");
    }
    command
}

pub(crate) fn succeed(mut command: Command) -> Vec<u8> {
    let output = command
        .output()
        .unwrap_or_else(|error| panic!("{command:?} cannot be run: {error}; install a C compiler"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}\n{said}", output.status);
    output.stdout
}

/// The numbers that a program reads and writes.
pub(crate) fn bytes(numbers: impl IntoIterator<Item = f32>) -> Vec<u8> {
    numbers.into_iter().flat_map(f32::to_ne_bytes).collect()
}

/// An image of a scene, row by row.
fn image(scene: &Scene, at: impl Fn(usize, usize) -> f32) -> Vec<u8> {
    let (width, height) = (scene.layout().width(), scene.layout().height());
    bytes((0..width * height).map(|k| at(k % width, k / width)))
}

/// A C program of several exports. It reads the images of [`supply`] from a file
/// and writes every filter's R, G, B and count of kept pixels.
fn program(filters: &[Filter], precision: Precision) -> String {
    let mut source = String::new();
    let mut calls = String::new();
    for filter in filters {
        source.push_str(&written(filter, precision));
        let name = &filter.name;
        let _ = writeln!(calls, "    {{\n        struct {name}_images images;");
        let _ = writeln!(calls, "        images.width = width;\n        images.height = height;");
        for c in 0..3 {
            let _ = writeln!(calls, "        images.noisy[{c}] = image({c});");
        }
        let read = plan(filter, precision).planes();
        for (k, (feature, quantity)) in Feature::terms().enumerate() {
            let is_read = PlaneId::of(feature, quantity).any(|plane| read.contains(&plane));
            if !feature.is_stored() || !is_read {
                continue;
            }
            let field = feature.identifier(quantity);
            let components = PlaneId::components(feature, quantity);
            for c in 0..components {
                let index = if components == 1 { String::new() } else { format!("[{c}]") };
                let from = 3 + 3 * k + c;
                let _ = writeln!(calls, "        images.{field}{index} = image({from});");
            }
        }
        let _ = writeln!(calls, "        finish({name}_filter(&images, out));\n    }}");
    }
    source + &DRIVER.replace("CALLS", &calls)
}

const DRIVER: &str = r#"
#include <stdio.h>
#include <stdlib.h>

static float *images;
static int width, height;
static float *out[3];

static const float *image(int index)
{
    return images + (size_t)index * (size_t)width * (size_t)height;
}

static void finish(size_t kept)
{
    const float count = (float)kept;
    for (int c = 0; c < 3; ++c)
        fwrite(out[c], sizeof(float), (size_t)width * (size_t)height, stdout);
    fwrite(&count, sizeof count, 1, stdout);
}

int main(int argc, char **argv)
{
    if (argc != 5)
        return 2;
    width = atoi(argv[2]);
    height = atoi(argv[3]);
    const size_t pixels = (size_t)width * (size_t)height;
    const size_t samples = (size_t)atoi(argv[4]) * pixels;
    FILE *file = fopen(argv[1], "rb");
    images = (float *)malloc(samples * sizeof(float));
    for (int c = 0; c < 3; ++c)
        out[c] = (float *)malloc(pixels * sizeof(float));
    if (!file || !images || !out[0] || !out[1] || !out[2])
        return 3;
    if (fread(images, sizeof(float), samples, file) != samples)
        return 4;
CALLS    return 0;
}
"#;

/// The noisy colour, then three images for every term, those that a term lacks
/// left blank.
pub(crate) fn supply(scene: &Scene) -> Vec<u8> {
    let blank = || image(scene, |_, _| f32::NAN);
    let mut file = Vec::new();
    for channel in scene.color() {
        file.extend(image(scene, |x, y| channel.at(x, y)));
    }
    for (feature, quantity) in Feature::terms() {
        for component in 0..3 {
            let plane = scene.plane(PlaneId { feature, quantity, component });
            file.extend(plane.map_or_else(blank, |plane| image(scene, |x, y| plane.at(x, y))));
        }
    }
    file
}

/// A filter's export.
fn written(filter: &Filter, precision: Precision) -> String {
    String::from_utf8(export_as(filter, Language::C, precision)).expect("C is text")
}

/// Holds filters' exports at both precisions to the interpreter. Returns how many pixels
/// kept their colour.
fn agree(filters: &[Filter], scenes: &[Scene]) -> usize {
    Precision::ALL.map(|precision| agree_at(precision, filters, scenes)).into_iter().sum()
}

/// Compiles the filters' exports and holds them to the interpreter, bit for bit.
/// Returns how many pixels kept their colour.
fn agree_at(precision: Precision, filters: &[Filter], scenes: &[Scene]) -> usize {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("filters.c"), program(filters, precision)).expect("writable");
    let mut compile = compiler(folder.path());
    compile.args(["-o", "filters", "filters.c", "-lm"]);
    succeed(compile);

    let images = 3 + 3 * Feature::terms().count();
    let mut all_kept = 0;
    for scene in scenes {
        let (width, height) = (scene.layout().width(), scene.layout().height());
        fs::write(folder.path().join("scene"), supply(scene)).expect("writable");
        let mut run = Command::new(folder.path().join("filters"));
        run.current_dir(folder.path()).arg("scene");
        run.args([width, height, images].map(|number| number.to_string()));
        let written = succeed(run);
        let per_filter = (3 * width * height + 1) * size_of::<f32>();
        assert_eq!(written.len(), filters.len() * per_filter);
        for (filter, written) in filters.iter().zip(written.chunks_exact(per_filter)) {
            let code = Interpreter.compile(&plan(filter, precision).into()).expect("compiles");
            let filtered = code.run(scene, &[Rect::whole(scene)]).expect("runs").swap_remove(0);
            let Filtered { pixels, kept } = filtered;
            let channel = |c: usize| pixels.iter().map(move |pixel| pixel[c]);
            let planar = channel(0).chain(channel(1)).chain(channel(2));
            let expected = bytes(planar.chain([kept[0] as f32]));
            let weight = &filter.paper().expect("one gather").weight;
            assert!(written == expected, "{weight} on {width} x {height} pixels");
            all_kept += kept[0];
        }
    }
    all_kept
}

/// Small enough that a large window reaches beyond, and wide enough for blocks
/// and a rest in the interpreter.
fn scenes() -> [Scene; 3] {
    [scene(37, 11, 21), scene(6, 4, 22), scene(1, 1, 23)]
}

fn named_filters() {
    let windows = [Window::dense(2), Window::dense(16), Window { radius: 3, dilation: 2 }];
    let filters: Vec<Filter> = known()
        .iter()
        .flat_map(|filter| {
            windows.map(|window| (filter.paper().expect("one gather").weight.to_string(), window))
        })
        .enumerate()
        .map(|(k, (weight, window))| numbered(k, &weight, window))
        .collect();
    assert_eq!(filters.len(), 12);
    agree(&filters, &scenes());
}

fn bred_filters() {
    let bred = bred().into_iter().enumerate();
    let filters: Vec<Filter> =
        bred.map(|(k, weight)| numbered(k, weight, Window::dense(3))).collect();
    assert_eq!(filters.len(), 30);
    agree(&filters, &scenes());
}

fn weights_of_every_shape() {
    let signed = "distance1(pixel, pixel) - 1.2";
    let mut weights = vec![
        // Sums that cancel, sums of nothing, and nothing to look at.
        signed.to_owned(),
        "(distance1(pixel, pixel) - 1.2) * nVariance".to_owned(),
        "0".to_owned(),
        "1".to_owned(),
        "exp(-80)".to_owned(),
        // One side, one axis, coordinates themselves.
        "1 + nVariance".to_owned(),
        "nVariance - 0.02".to_owned(),
        "1 / (1 + dot(pixel, pixel))".to_owned(),
        "1 / (1 + distance1(depth, pixel))".to_owned(),
        "dot(depth, normal)".to_owned(),
        "exp(-distance2(wpGradient, dGradient)) + distanceMax(diGradient, secTGradient)".to_owned(),
    ];
    // Every operator.
    for &op in tamis::expr::Op::ALL {
        let (x, y) = ("(3 * distance2(color, color) - 1)", "(distance1(normal, normal) - 0.5)");
        let operands = match op.operands() {
            [tamis::expr::Sort::Vector, _] => vec!["texture", "secTexture"],
            [_, _] => vec![x, y],
            _ => vec![x],
        };
        let operands: Vec<_> = operands.into_iter().map(parse).collect();
        let operands: Vec<_> = operands.iter().collect();
        let tree = tamis::expr::Tree::apply(op, &operands).expect("operands of the right sorts");
        weights.push(tree.to_string());
    }
    let windows = [Window::dense(0), Window::dense(1), Window { radius: 2, dilation: 3 }];
    let filters: Vec<Filter> = weights
        .iter()
        .flat_map(|weight| windows.map(|window| (weight, window)))
        .enumerate()
        .map(|(k, (weight, window))| numbered(k, weight, window))
        .collect();
    let kept = agree(&filters, &scenes());
    assert!(kept > 0, "the guard was not tried");
}

fn any_name_compiles() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in hostile_names() {
        let filter = Filter::single(name, parse("exp(-distance2(normal, normal))"), 2);
        fs::write(folder.path().join("named.c"), text(&filter, Language::C)).expect("writable");
        let mut check = compiler(folder.path());
        check.args(["-fsyntax-only", "named.c"]);
        succeed(check);
    }
}
