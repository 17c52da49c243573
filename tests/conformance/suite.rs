//! The cases, generic over the back end: each is held to the scalar meaning of the
//! tapes (bit for bit where it promises that) and to the exact meaning of the
//! trees in f64, within what it promises.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tamis::backend::reference::oracle;
use tamis::backend::{
    Agreement, Backend, BackendError, FAST_ACCURACY, Filtered, Interpreter, Rect,
};
use tamis::expr::grammar::{Limits, Vocabulary};
use tamis::expr::tape::{Axis, Input, Side};
use tamis::expr::{Feature, Op, Quantity, Symbol, Tree, codebook};
use tamis::filter::{Gather, Window};
use tamis::plan::{PASSES, Passes, Plan, Precision, WindowPlan};
use tamis::scene::facts::{Fact, Facts};
use tamis::scene::{LoadOptions, Needs, RawScene, Scene};

use crate::fixture::{self, parse, scene};

/// A case that every back end must pass.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) check: fn(&dyn Backend),
}

macro_rules! cases {
    ($($name:ident)*) => {
        /// Every case.
        pub(crate) const CASES: &[Case] =
            &[$(Case { name: stringify!($name), check: $name }),*];
    };
}

cases! {
    every_operator
    every_term
    all_terms_at_once
    named_filters
    bred_trees
    windows_and_shapes
    rectangles_give_what_the_whole_gives
    several_weights_in_one_plan
    untrusted_sums_keep_the_noisy_colour
    sums_far_from_one
    sums_that_overflow
    any_trees_on_extreme_numbers
    a_constant_image_stays_constant
    windows_of_one_colour_keep_it
    passes_change_cost_not_meaning
    threads_do_not_matter
    scenes_that_a_plan_is_not_made_for_are_refused
}

pub(crate) fn plan(weights: &[Tree], window: Window, scene: &Scene, passes: Passes) -> Plan {
    Plan::new(weights, window, &Facts::of(scene), passes).expect("the fixture has every feature")
}

/// All taps of a window, as `plan::Taps` orders them: runs of [u, v].
fn order_of_summation(radius: i64) -> Vec<Vec<[i64; 2]>> {
    let rightwards = |v: i64| (-radius..=radius).map(move |u| [u, v]);
    let mut runs: Vec<Vec<[i64; 2]>> = (-radius..0).map(|v| rightwards(v).collect()).collect();
    runs.push((1..=radius).rev().map(|u| [u, 0]).collect());
    runs.push(vec![[0, 0]]);
    runs.extend((1..=radius).map(|v| rightwards(v).rev().collect()));
    runs.push((-radius..0).map(|u| [u, 0]).collect());
    runs
}

fn color(scene: &Scene, x: i64, y: i64) -> [f32; 3] {
    [0, 1, 2].map(|c| scene.color()[c].at(x as usize, y as usize))
}

/// Whether the square around the taps that count holds one colour only.
fn is_uniform(plan: &WindowPlan, scene: &Scene, x: i64, y: i64) -> bool {
    let reach = i64::from(plan.support().reach());
    let (width, height) = (scene.layout().width() as i64, scene.layout().height() as i64);
    let along = |at: i64, end: i64| (at - reach).max(0)..(at + reach + 1).min(end);
    let mut window = along(y, height).flat_map(|v| along(x, width).map(move |u| (u, v)));
    window.all(|(u, v)| color(scene, u, v) == color(scene, x, y))
}

/// What the tapes mean, computed one pixel and one instruction at a time, in
/// the order of summation that `backend` states.
fn scalar(plan: &Plan, scene: &Scene) -> Vec<Filtered> {
    let plan = plan.window().expect("weights over a window");
    let (width, height) = (scene.layout().width(), scene.layout().height());
    let window = plan.window();
    let (radius, dilation) = (window.radius as i64, i64::from(window.dilation));
    let read = |id, x: i64, y: i64| {
        let x = x.clamp(0, width as i64 - 1) as usize;
        scene.plane(id).expect("loaded").at(x, y as usize)
    };
    let weights = plan.pair().results().len();
    let mut filtered = vec![Filtered { pixels: Vec::new(), kept: vec![0] }; weights];
    for y in 0..height as i64 {
        for x in 0..width as i64 {
            if plan.skips_uniform() && is_uniform(plan, scene, x, y) {
                for filtered in &mut filtered {
                    filtered.pixels.push(color(scene, x, y));
                }
                continue;
            }
            let per_pixel = plan.pixel().eval(|input| match input {
                Input::Plane(id, Side::I) => read(id, x, y),
                other => panic!("{other:?} is not known per pixel"),
            });
            let mut sums = vec![[0.0f32; 5]; weights];
            for run in order_of_summation(radius) {
                let mut partial = vec![[0.0f32; 5]; weights];
                for [u, v] in run {
                    let (beside, below) = (x + u * dilation, y + v * dilation);
                    if !(0..height as i64).contains(&below) {
                        continue;
                    }
                    let inside = (0..width as i64).contains(&beside);
                    let per_tap = plan.tap().eval(|input| match input {
                        Input::Offset(Axis::X) => (u * dilation) as f32,
                        Input::Offset(Axis::Y) => (v * dilation) as f32,
                        other => panic!("{other:?} is not known per tap"),
                    });
                    let pair = plan.pair().eval(|input| match input {
                        Input::Plane(id, Side::I) => read(id, x, y),
                        Input::Plane(id, Side::J) => read(id, beside, below),
                        Input::PerPixel(k, Side::I) => per_pixel[k as usize],
                        Input::PerPixel(_, Side::J) => panic!("only mirrored tapes look there"),
                        Input::PerTap(k) => per_tap[k as usize],
                        Input::Offset(_) => panic!("offsets are read through the tap tape"),
                        Input::Signal(..) | Input::Constant(_) => {
                            panic!("only programs have these")
                        }
                    });
                    let channel = |c: usize| match inside {
                        true => scene.color()[c].at(beside as usize, below as usize),
                        false => 0.0,
                    };
                    let one = f32::from(u8::from(inside));
                    for (partial, w) in partial.iter_mut().zip(pair) {
                        let terms = [0, 1, 2].map(channel).map(|c| (w, c));
                        let terms = terms.into_iter().chain([(w, one), (w.abs(), one)]);
                        for (partial, (w, c)) in partial.iter_mut().zip(terms) {
                            *partial = w.mul_add(c, *partial);
                        }
                    }
                }
                for (sum, partial) in sums.iter_mut().flatten().zip(partial.iter().flatten()) {
                    *sum += partial;
                }
            }
            for (filtered, [r, g, b, total, magnitude]) in filtered.iter_mut().zip(sums) {
                let magnitude = if plan.signed() { magnitude } else { total };
                let least = tamis::backend::TRUSTED_SUM;
                let share = tamis::backend::TRUSTED_SHARE;
                if total.abs() >= least.max(share * magnitude) {
                    filtered.pixels.push([r / total, g / total, b / total]);
                } else {
                    filtered.pixels.push(color(scene, x, y));
                    filtered.kept[0] += 1;
                }
            }
        }
    }
    filtered
}

pub(crate) fn run(backend: &dyn Backend, plan: &Plan, scene: &Scene) -> Vec<Filtered> {
    let code = backend.compile(plan).expect("compiles");
    code.run(scene, &[Rect::whole(scene)]).expect("runs")
}

/// The greatest relative difference from the exact filter that a back end may show.
fn accuracy(backend: &dyn Backend) -> f64 {
    backend.agreement().bound(Precision::Standard)
}

/// The precisions of plans that a back end is run with: a GPU is opened for one.
fn precisions(backend: &dyn Backend) -> &'static [Precision] {
    match backend.agreement() {
        Agreement::Bits => &Precision::ALL,
        Agreement::Budget(budget) if budget < FAST_ACCURACY => &[Precision::Standard],
        Agreement::Budget(_) => &[Precision::Fast],
    }
}

/// Holds a back end to the scalar meaning and to the oracle on one weight.
fn check(backend: &dyn Backend, scene: &Scene, text: &str, window: Window) {
    let weight = parse(text);
    let stage = Gather::of_color(weight.clone(), window);
    let exact = oracle::filter(scene, &stage, Rect::whole(scene));
    for &precision in precisions(backend) {
        let passes = Passes { precision, ..Passes::ALL };
        let plan = plan(std::slice::from_ref(&weight), window, scene, passes);
        let got = run(backend, &plan, scene);
        if backend.agreement() == Agreement::Bits {
            assert!(got == scalar(&plan, scene), "{} differs on {text}", backend.name());
        }
        for (k, (got, exact)) in got[0].pixels.iter().zip(&exact).enumerate() {
            // No factor here is flushed to zero, so smaller sums are right too than those
            // of which anything is promised; the rest is as in `is_promised`.
            let condition = exact.magnitude / exact.total.abs();
            if condition > 500.0 || exact.magnitude < 1e-25 {
                continue;
            }
            let difference = exact.difference(*got);
            assert!(
                difference <= backend.agreement().bound(precision),
                "{text}, {precision:?}: pixel {k} is {got:?} instead of {:?}: off by \
                 {difference:.1e} (condition {condition})",
                exact.color
            );
        }
    }
}

/// Asserts that two results are the same as far as the back end promises: to the
/// bit, or within its budget (twice, where both are its own).
fn agree(backend: &dyn Backend, got: &[Filtered], expected: &[Filtered], what: &str) {
    match backend.agreement() {
        Agreement::Bits => assert!(got == expected, "{} differs on {what}", backend.name()),
        Agreement::Budget(budget) => {
            for (got, expected) in got.iter().zip(expected) {
                for (g, e) in got.pixels.iter().flatten().zip(expected.pixels.iter().flatten()) {
                    let error = f64::from((g - e).abs());
                    assert!(error <= 2.0 * budget * f64::from(e.abs()), "{what}: {g}, not {e}");
                }
            }
        }
    }
}

fn every_operator(backend: &dyn Backend) {
    let scene = scene(23, 9, 1);
    for &op in Op::ALL {
        let operand = parse("0.6 * distance2(normal, normal)");
        let scalar = Tree::constant(0.75);
        let vector = parse("dot(normal, normal)").subtree(0);
        let operands: Vec<&Tree> = match op.operands() {
            [tamis::expr::Sort::Scalar] => vec![&operand],
            [tamis::expr::Sort::Scalar, _] => vec![&operand, &scalar],
            _ => vec![&vector, &vector],
        };
        let tree = Tree::apply(op, &operands).expect("the operands are of the sorts it takes");
        check(backend, &scene, &tree.to_string(), Window::dense(2));
    }
}

fn every_term(backend: &dyn Backend) {
    let scene = scene(17, 6, 2);
    for absolute in ["1 + dot(pixel, pixel)", "1 / (1 + distance1(depth, pixel))"] {
        check(backend, &scene, absolute, Window::dense(1));
    }
    for (feature, quantity) in Feature::terms() {
        let symbol = Symbol::of(feature, quantity).expect("terms() lists what can be spelt");
        let leaf = Tree::leaf(symbol).expect("a leaf");
        let scalar = match quantity {
            Quantity::Variance => leaf,
            Quantity::Value | Quantity::Gradient => {
                Tree::apply(Op::Distance1, &[&leaf, &leaf]).expect("two vectors")
            }
        };
        check(backend, &scene, &format!("1 / (1 + {scalar})"), Window::dense(1));
        let text = format!("exp(-({scalar}) * distanceMax(texture, texture))");
        check(backend, &scene, &text, Window::dense(1));
    }
}

/// Some forty planes: more than a shader may have buffers.
fn all_terms_at_once(backend: &dyn Backend) {
    let scene = scene(21, 10, 12);
    let terms = Feature::terms().filter(|(feature, _)| feature.is_stored());
    let sum: Vec<String> = terms
        .map(|(feature, quantity)| {
            let term = feature.spelling(quantity).expect("terms() lists what can be spelt");
            match quantity {
                Quantity::Variance => format!("{term} / 9"),
                Quantity::Value | Quantity::Gradient => format!("distance1({term}, {term}) / 9"),
            }
        })
        .collect();
    check(backend, &scene, &format!("exp(-({}))", sum.join(" + ")), Window::dense(2));
}

fn named_filters(backend: &dyn Backend) {
    let scene = scene(40, 13, 3);
    for known in codebook::known() {
        check(backend, &scene, &known.weight.to_string(), Window::dense(4));
    }
}

fn windows_and_shapes(backend: &dyn Backend) {
    let text = "exp(-distance1(pixel, pixel) / 3) * (0.1 + distance2(color, color))";
    for (width, height) in [(1, 1), (1, 7), (7, 1), (16, 2), (17, 3), (70, 5), (300, 2)] {
        let scene = scene(width, height, 4);
        for (radius, dilation) in [(0, 1), (1, 1), (3, 1), (2, 4), (16, 1)] {
            check(backend, &scene, text, Window { radius, dilation });
        }
    }
}

fn rectangles_give_what_the_whole_gives(backend: &dyn Backend) {
    let scene = scene(70, 20, 5);
    let weights = [parse("exp(-distance2(normal, normal)) * nVariance")];
    let plan = plan(&weights, Window::dense(3), &scene, Passes::ALL);
    let whole = run(backend, &plan, &scene);
    let rect = Rect { x: 13, y: 5, width: 31, height: 9 };
    let second = Rect { x: 69, y: 19, width: 1, height: 1 };
    let code = backend.compile(&plan).expect("compiles");
    let part = code.run(&scene, &[rect, second]).expect("runs");
    let expected: Vec<[f32; 3]> = [rect, second]
        .iter()
        .flat_map(|r| {
            (r.y..r.y + r.height).flat_map(move |y| (r.x..r.x + r.width).map(move |x| (x, y)))
        })
        .map(|(x, y)| whole[0].pixels[y * 70 + x])
        .collect();
    assert_eq!(part[0].pixels, expected);
    let outside = Rect { x: 60, y: 0, width: 11, height: 1 };
    assert!(code.run(&scene, &[outside]).is_err());
}

fn several_weights_in_one_plan(backend: &dyn Backend) {
    let scene = scene(33, 8, 6);
    let weights = [
        parse("exp(-distance2(normal, normal))"),
        parse("exp(-distance2(normal, normal)) - 0.5"),
        parse("1"),
    ];
    let window = Window::dense(2);
    let together = run(backend, &plan(&weights, window, &scene, Passes::ALL), &scene);
    for (weight, together) in weights.iter().zip(&together) {
        let alone = plan(std::slice::from_ref(weight), window, &scene, Passes::ALL);
        let alone = run(backend, &alone, &scene);
        agree(backend, &alone, std::slice::from_ref(together), &weight.to_string());
    }
}

fn untrusted_sums_keep_the_noisy_colour(backend: &dyn Backend) {
    let scene = scene(12, 5, 7);
    for text in ["0", "0 * distance2(color, color)", "exp(-80)", "distance1(pixel, pixel) - 1.2"] {
        let plan = plan(&[parse(text)], Window::dense(1), &scene, Passes::ALL);
        let got = run(backend, &plan, &scene);
        agree(backend, &got, &scalar(&plan, &scene), text);
    }
    let nothing = plan(&[parse("0")], Window::dense(1), &scene, Passes::ALL);
    let got = &run(backend, &nothing, &scene)[0];
    assert_eq!(got.kept, [60]);
    assert_eq!(got.pixels[13], [0, 1, 2].map(|c| scene.color()[c].at(1, 1)));
}

/// A scene in which w(i, j) is a number within ±1 that pixel j holds, times a power of two
/// (or a number that is the same for all): errors are the sum's alone. With its filter.
fn weighted(scale: f32, weights: Vec<f32>, color: [Vec<f32>; 3]) -> (Scene, Tree) {
    let pixels = weights.len();
    assert_eq!(pixels, WEIGHTED.0 * WEIGHTED.1);
    let same = |x: f32| vec![x; pixels];
    let raw = RawScene::new("weighted", WEIGHTED.0, WEIGHTED.1, color)
        .with(Feature::Texture, Quantity::Value, vec![same(1.0), same(0.0), same(0.0)])
        .with(Feature::Normal, Quantity::Value, vec![weights, same(0.0), same(0.0)]);
    // The texture is that of pixel i and 1, the normal that of pixel j.
    let weight = parse(&format!("{scale:e} * dot(texture, normal)"));
    let needs = Needs::planes(weight.planes());
    (raw.prepare(&needs, 32, &LoadOptions::default()).expect("a sound scene"), weight)
}

/// The size of such scenes: windows of radius 32 hold them whole.
const WEIGHTED: (usize, usize) = (41, 24);

/// The greatest power of two that expressions compute with.
const GREATEST: f32 = (1u64 << 59) as f32;

/// A number between powers of ten.
fn decades(rng: &mut impl Rng, lo: f32, hi: f32) -> f32 {
    10f32.powf(rng.random_range(lo..=hi))
}

/// Weights from 1e-29 to 6e17 and colours from 1e-6 to 1e6, added up over windows of
/// any size, in all signs that leave something: as far as `backend` promises, and on
/// processors as far as the chain of additions allows.
fn sums_far_from_one(backend: &dyn Backend) {
    let pixels = WEIGHTED.0 * WEIGHTED.1;
    let mut rng = ChaCha8Rng::seed_from_u64(14);
    for weights in [[0.0, 0.0], [-29.0, -28.0], [-12.0, 12.0], [-3.0, 3.0], [17.0, 18.0]] {
        let scale = 10f32.powf(weights[1]).log2().ceil().exp2().min(GREATEST);
        // The share of the weights that is negative.
        for negative in [0.0, 0.3, 0.49] {
            let weight = |rng: &mut ChaCha8Rng| {
                let weight = decades(rng, weights[0], weights[1]).min(GREATEST) / scale;
                if rng.random_bool(negative) { -weight } else { weight }
            };
            let weight: Vec<f32> = (0..pixels).map(|_| weight(&mut rng)).collect();
            let color = [0; 3].map(|_| (0..pixels).map(|_| decades(&mut rng, -6.0, 6.0)).collect());
            let (scene, tree) = weighted(scale, weight, color);
            for radius in [1, 10, 32] {
                let window = Window::dense(radius);
                let plan = plan(std::slice::from_ref(&tree), window, &scene, Passes::ALL);
                let got = run(backend, &plan, &scene).swap_remove(0);
                let stage = Gather::of_color(tree.clone(), window);
                let exact = oracle::filter(&scene, &stage, Rect::whole(&scene));
                let chain = f64::from(2 * radius + 4) * f64::from(f32::EPSILON);
                let bound = match backend.agreement() {
                    Agreement::Bits => chain.min(accuracy(backend)),
                    Agreement::Budget(budget) => budget,
                };
                let what = format!("1e{weights:?}, {negative} negative, radius {radius}");
                let (mut least, mut most) = (0, 0);
                for (k, (got, exact)) in got.pixels.iter().zip(&exact).enumerate() {
                    let noisy = [0, 1, 2].map(|c| scene.color()[c].at(k % 41, k / 41));
                    // What is near the guard's bounds may go either way.
                    let cancelled = exact.total.abs() / exact.magnitude * 1024.0;
                    let vanished = exact.total.abs() / 1e-30;
                    let doubt = cancelled.min(vanished);
                    least += usize::from(doubt < 0.9);
                    most += usize::from(doubt < 1.1);
                    if doubt < 0.9 {
                        assert_eq!(*got, noisy, "{what}: pixel {k} was to be kept");
                    } else if doubt > 1.1 {
                        let off = exact.difference(*got);
                        assert!(off <= bound, "{what}: pixel {k} is off by {off:.1e}");
                    }
                }
                assert!((least..=most).contains(&got.kept[0]), "{what}: {} kept", got.kept[0]);
            }
        }
    }
}

/// Where Σ c·w leaves the range of `f32` the noisy colour stays, and only there.
fn sums_that_overflow(backend: &dyn Backend) {
    let pixels = WEIGHTED.0 * WEIGHTED.1;
    // Brighter and brighter to the right, until 441 terms are too much; and never of one
    // colour, which needs no sum.
    let ramp = |k: usize| {
        let bright = ((k % WEIGHTED.0 + 1) as f32 / 20.0).min(1.0);
        1e18 * bright * (1.0 - 0.01 * (k % 5) as f32)
    };
    let color = [0; 3].map(|_| (0..pixels).map(ramp).collect());
    let (scene, tree) = weighted(1e18, vec![1.0; pixels], color);
    let window = Window::dense(10);
    let plan = plan(std::slice::from_ref(&tree), window, &scene, Passes::ALL);
    let got = run(backend, &plan, &scene).swap_remove(0);
    let stage = Gather::of_color(tree, window);
    let exact = oracle::filter(&scene, &stage, Rect::whole(&scene));
    let mut kept = 0;
    for (k, (got, exact)) in got.pixels.iter().zip(&exact).enumerate() {
        let sum = exact.color[0] * exact.total / f64::from(f32::MAX);
        if sum > 1.001 && backend.name() != "exact" {
            assert_eq!(got[0], scene.color()[0].at(k % 41, k / 41), "pixel {k}");
            kept += 1;
        } else if !(0.999..=1.001).contains(&sum) {
            assert!(exact.difference(*got) <= accuracy(backend), "pixel {k}: {got:?}");
        }
    }
    assert!((kept..pixels).contains(&got.kept[0]), "{} of {kept} kept", got.kept[0]);
    assert!(kept > 0 || backend.name() == "exact");
}

/// Whatever the grammar makes, on numbers that arithmetic trips over: finite colours, and
/// where bits are promised those of the scalar meaning.
fn any_trees_on_extreme_numbers(backend: &dyn Backend) {
    const VALUES: [f32; 12] =
        [0.0, -0.0, 1e-45, -1e-40, 1e-20, -1e-18, 1.0, -1.0, 0.5, 1e9, 1e18, -1e18];
    let mut rng = ChaCha8Rng::seed_from_u64(15);
    let (width, height) = (37, 4);
    let mut samples = |least: f32| -> Vec<f32> {
        let value = |_| VALUES[rng.random_range(0..VALUES.len())].max(least);
        (0..width * height).map(value).collect()
    };
    let mut raw = RawScene::new("extreme", width, height, [0; 3].map(|_| samples(0.0)));
    for feature in Feature::ALL.into_iter().filter(|feature| feature.is_stored()) {
        if feature != Feature::Color {
            let values = (0..feature.width()).map(|_| samples(f32::MIN)).collect();
            raw = raw.with(feature, Quantity::Value, values);
        }
        raw = raw.with(feature, Quantity::Variance, vec![samples(0.0)]);
    }
    let scene = fixture::prepare(raw);
    let vocabulary = Vocabulary::all();
    for seed in 0..24 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let trees =
            [4, 8].map(|depth| vocabulary.random_tree(&mut rng, Limits { depth, nodes: 80 }));
        for &precision in precisions(backend) {
            let passes = Passes { precision, ..Passes::ALL };
            let plan = plan(&trees, Window::dense(2), &scene, passes);
            let got = run(backend, &plan, &scene);
            for (tree, got) in trees.iter().zip(&got) {
                assert!(got.pixels.iter().flatten().all(|c| c.is_finite()), "{tree}: {got:?}");
            }
            if backend.agreement() == Agreement::Bits {
                assert!(got == scalar(&plan, &scene), "{} differs on {trees:?}", backend.name());
            }
        }
    }
}

fn a_constant_image_stays_constant(backend: &dyn Backend) {
    let scene = fixture::constant_color(30, 9, [0.25, 3.0, 1e-4]);
    let filtered_all_the_same = Passes { uniform: false, ..Passes::ALL };
    for known in codebook::known() {
        let name = known.name;
        let weights = std::slice::from_ref(&known.weight);
        let plan = plan(weights, Window::dense(3), &scene, filtered_all_the_same);
        for pixel in &run(backend, &plan, &scene)[0].pixels {
            for (got, expected) in pixel.iter().zip([0.25f32, 3.0, 1e-4]) {
                assert!((got - expected).abs() <= 1e-5 * expected, "{name}: {got}");
            }
        }
    }
}

fn windows_of_one_colour_keep_it(backend: &dyn Backend) {
    // Weights that cannot be trusted are none that count.
    let weights = [parse("exp(-distance2(normal, normal))"), parse("0")];
    let flat = fixture::constant_color(30, 9, [0.25, 3.0, 1e-4]);
    let got = run(backend, &plan(&weights, Window::dense(3), &flat, Passes::ALL), &flat);
    if backend.agreement() == Agreement::Bits {
        for filtered in got {
            assert!(filtered.pixels.iter().all(|&pixel| pixel == [0.25, 3.0, 1e-4]));
            assert_eq!(filtered.kept, [0]);
        }
    }
    let striped = fixture::striped(300, 40);
    let plan = plan(&weights[..1], Window::dense(3), &striped, Passes::ALL);
    let got = run(backend, &plan, &striped);
    agree(backend, &got, &scalar(&plan, &striped), "stripes");
}

fn passes_change_cost_not_meaning(backend: &dyn Backend) {
    let scene = scene(25, 7, 8);
    let bred = "pow(nVariance + 0.5, 2) * exp(-distance2(normal, normal) * 2) \
                * exp(-distanceMax(texture, texture) / 0.3) / (1 + sin(dVariance))";
    let mut trees = vec![parse(bred)];
    trees.extend(codebook::known().iter().map(|known| known.weight.clone()));
    for tree in trees {
        let plan = |passes| plan(std::slice::from_ref(&tree), Window::dense(2), &scene, passes);
        let all = run(backend, &plan(Passes::ALL), &scene);
        let mut others = vec![(Passes::NONE, "all", false)];
        others.extend(
            PASSES
                .iter()
                .map(|row| (Passes::ALL.without(row.name).expect("listed"), row.name, row.exact)),
        );
        for (passes, name, exact) in others {
            let off = run(backend, &plan(passes), &scene);
            for (on, off) in all[0].pixels.iter().flatten().zip(off[0].pixels.iter().flatten()) {
                let same = if exact && backend.agreement() == Agreement::Bits {
                    on == off
                } else {
                    f64::from((on - off).abs()) <= 2.0 * accuracy(backend) * f64::from(*on)
                };
                assert!(same, "{tree} without {name}: {off} instead of {on}");
            }
        }
    }
}

fn bred_trees(backend: &dyn Backend) {
    let scene = scene(61, 6, 9);
    for text in fixture::bred() {
        let window = Window::dense(3);
        check(backend, &scene, text, window);
        let plan = plan(&[parse(text)], window, &scene, Passes::ALL);
        let got = run(backend, &plan, &scene);
        if backend.agreement() == Agreement::Bits {
            assert!(run(&Interpreter, &plan, &scene) == got, "{text}");
        }
        assert!(got[0].pixels.iter().flatten().all(|x| x.is_finite()), "{text}");
    }
}

fn threads_do_not_matter(backend: &dyn Backend) {
    let scene = scene(64, 30, 10);
    let weight = codebook::named("kan2017").expect("listed").clone();
    let plan = plan(&[weight], Window::dense(5), &scene, Passes::ALL);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| run(backend, &plan, &scene))
    };
    let one = on(1);
    assert!(one == on(2) && one == on(5));
}

/// What a plan takes for granted is checked before a pixel is filtered, also where it
/// took a plane out of the code.
fn scenes_that_a_plan_is_not_made_for_are_refused(backend: &dyn Backend) {
    let weight = parse("exp(-distance2(secTexture, secTexture) - distance2(normal, normal))");
    let second = (Feature::SecTexture, Quantity::Value);
    let with = |values: Option<f32>| {
        let mut raw = fixture::raw(20, 9, 11);
        match values {
            Some(x) => raw.features.insert(second, vec![vec![x; 180]; 3]),
            None => raw.features.remove(&second),
        };
        fixture::prepare(raw)
    };
    let (black, varied, absent) = (with(Some(0.0)), scene(20, 9, 11), with(None));
    let run_on = |facts: &Facts, passes, scene: &Scene| {
        let plan = Plan::new(std::slice::from_ref(&weight), Window::dense(2), facts, passes);
        let code = backend.compile(&plan.expect("plans")).expect("compiles");
        code.run(scene, &[Rect::whole(scene)])
    };

    let made = Facts::of(&black);
    run_on(&made, Passes::ALL, &black).expect("it was made for this one");
    let refused = |scene: &Scene, feature: Feature, assumed: Option<Fact>| {
        let result = run_on(&made, Passes::ALL, scene);
        if backend.name() == "exact" {
            // It looks at the expressions alone, and takes nothing for granted.
            let own = run_on(&Facts::of(scene), Passes::ALL, scene).expect("made for it");
            assert_eq!(result.expect("right on any scene"), own);
            return;
        }
        let error = result.expect_err("something else holds here");
        let BackendError::Unlike { plane, assumed: stated, actual, .. } = &error else {
            panic!("{error}")
        };
        assert_eq!(plane.feature, feature, "{error}");
        assert_eq!((*stated, *actual), (made.get(*plane), scene.fact(*plane)));
        assert!(assumed.is_none_or(|assumed| assumed == *stated), "{error}");
    };
    refused(&varied, Feature::SecTexture, Some(Fact::Constant(0.0)));
    refused(&with(Some(0.5)), Feature::SecTexture, Some(Fact::Constant(0.0)));
    let mut raw = fixture::raw(20, 9, 11);
    raw.features.insert(second, vec![vec![0.0; 180]; 3]);
    raw.features.get_mut(&(Feature::Normal, Quantity::Value)).expect("it has normals")[1][77] = 9.0;
    refused(&fixture::prepare(raw), Feature::Normal, None);
    let error = run_on(&made, Passes::ALL, &absent).expect_err("a plane is not there");
    assert!(matches!(error, BackendError::NotLoaded(id) if id.feature == Feature::SecTexture));

    // What is made for several scenes, or takes nothing for granted, runs on each.
    let joint = Facts::of_all([&black, &varied]);
    for scene in [&black, &varied] {
        let alone = run_on(&Facts::of(scene), Passes::ALL, scene).expect("made for it");
        let without_facts = Passes { facts: false, ..Passes::ALL };
        for (facts, passes) in [(&joint, Passes::ALL), (&made, without_facts)] {
            let got = run_on(facts, passes, scene).expect("it holds of both");
            let pixels = |all: &[Filtered]| -> Vec<[f32; 3]> { all[0].pixels.clone() };
            for (got, alone) in pixels(&got).iter().flatten().zip(pixels(&alone).iter().flatten()) {
                let difference = f64::from((got - alone).abs());
                assert!(difference <= 2.0 * accuracy(backend) * f64::from(*alone));
            }
        }
    }
}
