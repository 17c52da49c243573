//! Python: every export runs, and is near to the exact meaning of its filter.

use std::fmt::Write;
use std::fs;
use std::process::Command;

use libtest_mimic::Trial;
use tamis::backend::reference::meaning;
use tamis::export::{Language, Options};
use tamis::expr::{Feature, PlaneId};
use tamis::filter::{Filter, shipped};
use tamis::scene::Scene;

use crate::c::supply;
use crate::every::hostile_names;
use crate::fixture::{prepare, raw_with, scene};
use crate::fixture_programs::{SAMPLE, random};
use crate::harness::{is_required, trial};
use crate::programs::parse;
use crate::{exported, known};

/// The tests, ignored where there is no Python with NumPy.
pub(crate) fn trials() -> Vec<Trial> {
    let ignored = interpreter().is_none() && !is_required();
    let cases: [(&str, fn()); 5] = [
        ("shipped_programs_are_near_to_their_meaning", shipped_programs),
        ("random_programs_are_near_to_their_meaning", random_programs),
        ("single_weights_are_near_to_their_meaning", single_weights),
        ("what_is_absent_is_in_the_code", what_is_absent),
        ("any_name_is_read", any_name),
    ];
    cases.map(|(name, case)| trial(format!("python::{name}"), ignored, case)).into()
}

/// A Python that has NumPy: the first one, or the system's.
fn interpreter() -> Option<&'static str> {
    ["python3", "/usr/bin/python3"].into_iter().find(|python| {
        let output = Command::new(python).args(["-c", "import numpy"]).output();
        output.is_ok_and(|output| output.status.success())
    })
}

/// What calls every module `f0`, `f1`, … with the images of a file, by the names of the
/// arguments.
const DRIVER: &str = r#"
import importlib, inspect, sys
import numpy as np

count, width, height, exposure = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
images = np.fromfile("scene", dtype=np.float32).reshape(-1, height, width)
given = {"exposure": exposure}
for name, first, components, whole in TERMS:
    image = np.moveaxis(images[first : first + components], 0, 2)
    given[name] = image[0, 0] if whole else image[:, :, 0] if components == 1 else image
for k in range(count):
    function = getattr(importlib.import_module(f"f{k}"), f"f{k}")
    names = inspect.signature(function).parameters
    result = function(**{name: given[name] for name in names})
    assert result.shape == (height, width, 3)
    result.astype(np.float32).tofile(sys.stdout.buffer)
"#;

/// Holds the exports of filters to what these mean on scenes.
fn agree(filters: Vec<Filter>, scenes: &[Scene], options: &Options<'_>, bound: f64) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut terms = String::from("TERMS = [\n");
    for (k, (feature, quantity)) in Feature::terms().enumerate() {
        let (name, first) = (feature.identifier(quantity), 3 + 3 * k);
        let components = PlaneId::components(feature, quantity);
        let whole = if feature.row().per_image { "True" } else { "False" };
        let _ = writeln!(terms, "    (\"{name}\", {first}, {components}, {whole}),");
    }
    fs::write(folder.path().join("driver.py"), terms + "]\n" + DRIVER).expect("writable");
    let filters: Vec<Filter> = filters
        .into_iter()
        .enumerate()
        .map(|(k, filter)| Filter { name: format!("f{k}"), ..filter })
        .collect();
    for filter in &filters {
        let path = folder.path().join(format!("{}.py", filter.name));
        fs::write(path, exported(filter, Language::Python, options)).expect("writable");
    }
    for scene in scenes {
        fs::write(folder.path().join("scene"), supply(scene)).expect("writable");
        let (width, height) = (scene.layout().width(), scene.layout().height());
        let mut run = Command::new(interpreter().expect("install python3-numpy"));
        run.current_dir(folder.path()).arg("driver.py");
        run.args([filters.len(), width, height].map(|number| number.to_string()));
        run.arg(scene.normalization().exposure.to_string());
        let output = run.output().expect("it starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
        let pixels: Vec<[f32; 3]> = output
            .stdout
            .as_chunks::<12>()
            .0
            .iter()
            .map(|pixel| {
                let [r, g, b] = [0, 4, 8].map(|k| pixel[k..k + 4].try_into().expect("four bytes"));
                [r, g, b].map(f32::from_ne_bytes)
            })
            .collect();
        assert_eq!(pixels.len(), filters.len() * width * height);
        for (filter, pixels) in filters.iter().zip(pixels.chunks_exact(width * height)) {
            let exact = meaning::of(scene, &filter.check().expect("a sound filter"));
            let differences =
                pixels.iter().zip(&exact.pixels).map(|(&got, exact)| exact.difference(got));
            let worst = differences.fold(0.0, f64::max);
            let toml = || filter.to_toml(toml::Table::new());
            assert!(
                worst < bound,
                "{worst:e} from exact at {width} x {height} pixels:\n{}",
                toml()
            );
        }
    }
}

fn shipped_programs() {
    let filters = shipped::programs().chain([parse(SAMPLE)]).collect();
    agree(filters, &[scene(23, 18, 5), scene(6, 5, 6), scene(1, 1, 7)], &Options::default(), 1e-5);
}

fn random_programs() {
    let filters = (0..24).map(|seed| parse(&random(seed, 1 + seed as usize % 12))).collect();
    agree(filters, &[scene(19, 14, 8), scene(2, 3, 9)], &Options::default(), 1e-4);
}

fn single_weights() {
    let mut filters = known();
    for gather in filters.iter_mut().flat_map(Filter::gathers_mut) {
        gather.window.radius = 2;
    }
    // Every operator, once.
    let weights = tamis::expr::Op::ALL.iter().map(|&op| {
        let (x, y) = ("(3 * distance2(color, color) - 1)", "(distance1(normal, normal) - 0.5)");
        let operands = match op.operands() {
            [tamis::expr::Sort::Vector, _] => vec!["texture", "secTexture"],
            [_, _] => vec![x, y],
            _ => vec![x],
        };
        let operands: Vec<_> = operands.into_iter().map(crate::fixture::parse).collect();
        let operands: Vec<_> = operands.iter().collect();
        let tree = tamis::expr::Tree::apply(op, &operands).expect("operands of the right sorts");
        // Weights of one sign: sums that cancel make much of what rounding left of the features.
        Filter::single("operator", crate::fixture::parse(&format!("2 + tanh({tree})")), 1)
    });
    filters.extend(weights);
    agree(filters, &[scene(13, 9, 21)], &Options::default(), 1e-5);
}

fn what_is_absent() {
    let without = [Feature::Depth, Feature::Normal, Feature::Texture];
    let options = Options { without: &without, ..Options::default() };
    let scene = prepare(raw_with(17, 12, 10, 1.0, &without));
    agree(shipped::programs().collect(), &[scene], &options, 1e-5);
}

fn any_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in
        hostile_names().into_iter().chain(["gather", "np", "light", "color"].map(str::to_owned))
    {
        let filter = Filter { name, ..parse(SAMPLE) };
        let text = exported(&filter, Language::Python, &Options::default());
        fs::write(folder.path().join("named.py"), text).expect("writable");
        let mut check = Command::new(interpreter().expect("install python3-numpy"));
        check.current_dir(folder.path()).args(["-m", "py_compile", "named.py"]);
        let output = check.output().expect("it starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}
